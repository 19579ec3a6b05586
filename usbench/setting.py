"""What an agent meets: a task with its noise, what is examined with which probe, and what the agent sees."""

from __future__ import annotations

import contextlib
import reprlib
import warnings
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import load_env_creator
from gymnasium.vector import AutoresetMode

from usbench import suite
from usbench.anchors import Anchors
from usbench.checks import as_configuration_error, probability, unknown, whole_number
from usbench.envs import oracle
from usbench.envs.anatomy import Anatomy
from usbench.envs.bmode import Imaging
from usbench.envs.observation.wrappers import ImageStack, NormalizeImage
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY, LinearArray
from usbench.envs.task import IMAGE, Task, check_reward
from usbench.envs.tasks.phantom_distribution import FIRST_HELD_OUT
from usbench.envs.tissue import Tissue
from usbench.envs.vector.wrappers import VectorImageStack, VectorNormalizeImage
from usbench.records import MAX_FRAMES, ConfigurationError, Frames, TrialConfig
from usbench.records import scene as scene_record
from usbench.setting_parts import anatomy_record
from usbench.setting_parts.evaluation_frames import EvaluationFrames, Report

TRUE_REWARD = "normalized"
TRAINED_ON = (TRUE_REWARD, IMAGE)
# What decides how images look: in other images than those of its training, an agent's actions mean nothing.
LOOKS = ("anatomy", "probe", "imaging")


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What an agent meets in training and evaluation; every value is checked.

    Attributes:
        task: Name of the task.
        noise: Probability of a slip after each action.
        n_frames: Frames in one observation.
        reward: What the agent is trained on; scores are always those of the true reward.
        anatomy: A custom anatomy in place of the task's phantom; None for the task's own.
        probe: The transducer; None becomes the default one.
        imaging: How RF becomes a frame; None takes the task's own, and the attribute then holds that.
        senses: What the agent is told beside the frames, any of those that the task has; None, the default,
            becomes the task's own.
        n_phantoms: How many phantoms there are in training, where the task draws them; None for no limit.

    Raises:
        ConfigurationError: If a value is not allowed; one sentence says which.
    """

    task: str
    noise: float = 0.0
    n_frames: int = 4
    reward: str = TRUE_REWARD
    anatomy: Anatomy | None = None
    probe: LinearArray = DEFAULT_ARRAY
    imaging: Imaging = None  # type: ignore[assignment]
    senses: tuple[str, ...] | None = None
    n_phantoms: int | None = None

    def __post_init__(self) -> None:
        """Hold the values in their own types, or refuse them."""
        if isinstance(self.senses, Iterator):  # the first environment would use it up
            object.__setattr__(self, "senses", tuple(self.senses))
        with as_configuration_error():
            if not isinstance(self.task, str) or self.task not in suite.TASKS:
                raise suite.unknown_task(self.task)
            object.__setattr__(self, "noise", probability("noise", self.noise))
            object.__setattr__(self, "n_frames", whole_number("n_frames", self.n_frames, 1, MAX_FRAMES))
            check_reward(self.reward, self.guidance, TRAINED_ON)
            if self.anatomy is not None:
                self._check_anatomy(self.anatomy)
            if self.n_phantoms is not None:
                self.check_drawn("n_phantoms")
            plain = self.plain_env()
            object.__setattr__(self, "probe", plain.probe)
            object.__setattr__(self, "imaging", plain.imaging)
            object.__setattr__(self, "senses", plain.senses.names)
            if self.n_phantoms is not None:
                object.__setattr__(self, "n_phantoms", plain.phantoms.count)

    @classmethod
    def recorded(cls, config: TrialConfig) -> Setting:
        """Return the setting that a trial has recorded.

        The file of a custom anatomy is read when a frame is made that is not kept.

        Raises:
            ConfigurationError: If the record cannot be one, or its task is not installed.
        """
        suite.check_installed(config.task)
        environment = config.environment
        try:
            found = cls(
                task=suite.name_of(environment.get("id"), config.task),
                noise=config.noise,
                n_frames=config.n_frames,
                reward=environment.get("reward", TRUE_REWARD),
                anatomy=anatomy_record.recorded(environment),
                probe=scene_record.recorded(LinearArray, environment, "probe"),
                imaging=scene_record.recorded(Imaging, environment, "imaging"),
                senses=tuple(environment.get("senses", ())),
                n_phantoms=environment.get("phantoms", {}).get("count"),
            )
            found._check_set(environment.get("phantoms", {}).get("digest"))
            return found
        except ConfigurationError:
            raise
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise ConfigurationError(f"the trial's environment cannot be one ({error}).") from error

    def record(self) -> dict[str, Any]:
        """Return the environment as plain values, as a trial records it."""
        plain = self.plain_env()
        scene = {name: scene_record.plain(getattr(plain, name)) for name in plain.scene}
        if self.n_phantoms is not None:
            scene["phantoms"]["digest"] = plain.phantoms.digest
        own = {} if self.anatomy is None else anatomy_record.plain(self.anatomy)
        reward = {} if self.reward == TRUE_REWARD else {"reward": self.reward}
        senses = {"senses": list(self.senses)} if self.senses else {}
        return {"id": self.row.env_id, **scene, **own, **reward, **senses}

    def differences(self, other: Setting) -> list[str]:
        """Return which of `LOOKS` are otherwise in another setting."""
        return [name for name in LOOKS if getattr(self, name) != getattr(other, name)]

    @property
    def row(self) -> suite.Task:
        """The task's row of the table."""
        return suite.TASKS[self.task]

    @property
    def guidance(self) -> Task:
        """The task as its environment sets it: actions, starts, noise and reward."""
        return self.row.guidance

    def evaluation_episodes(self) -> tuple[suite.EvaluationEpisode, ...]:
        """Return the fixed list of episodes with which every agent is evaluated."""
        return suite.evaluation_episodes(self.task)

    def evaluation_phantoms(self) -> tuple[Tissue, ...]:
        """Return the phantoms of the evaluation, the custom anatomy if there is one."""
        plain = self.plain_env()
        numbers = range(FIRST_HELD_OUT, FIRST_HELD_OUT + self.row.phantoms)
        return tuple(plain.phantoms.phantom(number) for number in numbers) or (plain.phantom,)

    def make_env(self, *, render_mode: str | None = None) -> gym.Env[Any, Any]:
        """Make the environment that every algorithm sees, with stacked frames and normalised pixels."""
        with of_any_version():
            env = gym.make(self.row.env_id, render_mode=render_mode, **self._arguments())
        return NormalizeImage(ImageStack(env, self.n_frames))

    def make_vec_env(
        self,
        num_envs: int,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> gym.vector.VectorEnv[Any, Any, Any]:
        """Make many of these environments in step: frames that are missing are simulated on all cores.

        Args:
            num_envs: How many.
            autoreset_mode: When an environment whose episode has ended is reset, as Gymnasium names it.
            render_mode: None or "rgb_array".

        Raises:
            TypeError: If an argument has a wrong type.
            ValueError: If a value is not allowed.
        """
        with of_any_version():
            env = gym.make_vec(
                self.row.env_id,
                num_envs=num_envs,
                vectorization_mode="vector_entry_point",
                autoreset_mode=autoreset_mode,
                render_mode=render_mode,
                **self._arguments(),
            )
        return VectorNormalizeImage(VectorImageStack(env, self.n_frames))

    def plain_env(self) -> Any:
        """Make the environment itself, without a limit of its steps and without wrappers."""
        return load_env_creator(self.row.entry_point)(**self._arguments())

    def _arguments(self) -> dict[str, Any]:
        """Return what the environment's class is called with."""
        own: dict[str, Any] = {} if self.anatomy is None else {"phantom": self.anatomy}
        alike = {name: getattr(self, name) for name in ("noise", "reward", "probe", "imaging", "senses")}
        if self.n_phantoms is not None:
            environment: Any = load_env_creator(self.row.entry_point)
            own["phantoms"] = replace(environment.distribution, count=self.n_phantoms)
        return alike | own

    def anchors(
        self, report: Report | None = None, episodes: Sequence[suite.EvaluationEpisode] | None = None
    ) -> Anchors:
        """Return the exact expected returns of an evaluation episode, or of one of `episodes`.

        They are the mean over the list of what each episode's phantom and start promise. Where
        every start is in the list and there is one phantom, that is the mean over the starts. `report` is
        told of frames that have to be simulated where rewards are computed from them.

        Raises:
            ValueError: If `episodes` is empty.
        """
        if episodes is not None and not episodes:
            raise ValueError("episodes must be one at least, not none.")
        if self.guidance.reward_from_frames:
            self.prepare_frames(report)
        phantoms, starts = self.evaluation_phantoms(), defaultdict(list)
        if episodes is None and not self.row.phantoms and not self.row.drawn_starts:
            return self.process(phantoms[0].target).returns()
        plain = self.plain_env()
        for episode in self.evaluation_episodes() if episodes is None else episodes:
            number = episode.phantom
            phantom = phantoms[0] if number is None else plain.phantoms.phantom(number)
            starts[phantom.target].append(episode.start)
        found = [self.process(target).returns(tuple(own)) for target, own in starts.items()]
        return Anchors.mean(found, weights=[len(own) for own in starts.values()])

    def process(self, target: Pose = oracle.PAPER_TARGET) -> oracle.DecisionProcess:
        """Return the task as a Markov decision process; rewards from frames are those of this setting."""
        rewards = None
        if self.guidance.reward_from_frames:
            rewards = tuple(self.scored.plain_env().state_rewards().tolist())
        return oracle.DecisionProcess(self.guidance, self.noise, target=target, rewards=rewards)

    def plan(self, target: Pose) -> oracle.Policy:
        """Return the best policy that knows the pose of the probe and the pose that shows the object best."""
        return self.process(target).policy()

    def planner(self) -> oracle.Planner:
        """Return the best policies for all targets that there may be; where there is one phantom, for its."""
        own = oracle.PAPER_TARGET if self.row.phantoms else self.plain_env().phantom.target
        return oracle.Planner(self.process(own))

    def evaluation_frames(self) -> EvaluationFrames:
        """Return the frames that are simulated before the evaluation.

        They are those of every pose that the task can reach, in every phantom of the evaluation, or those
        with which its episodes begin (`Row.every_frame`). Training has other phantoms where there are many.
        """
        starts = defaultdict(list)
        for episode in self.evaluation_episodes():
            starts[episode.phantom_index].append(episode.start)
        views = (
            (phantom, self.guidance.states if self.row.every_frame else tuple(starts[place]))
            for place, phantom in enumerate(self.evaluation_phantoms())
        )
        return EvaluationFrames(tuple(views), self.probe, self.imaging)

    def prepare_frames(self, report: Report | None = None) -> Frames:
        """Simulate the frames of the evaluation, unless they are kept; return their digest.

        Args:
            report: Is told how many there are by now, and how many there will be.
        """
        return self.evaluation_frames().prepare(report)

    @property
    def scored(self) -> Setting:
        """The same setting with the true reward, by which every agent is judged."""
        return replace(self, reward=TRUE_REWARD)

    def check_drawn(self, what: str) -> None:
        """Refuse `what` where it is for tasks that draw phantoms alone, and this one does not.

        Raises:
            ValueError: If the task draws no phantoms.
        """
        if not self.row.phantoms:
            drawing = ", ".join(repr(name) for name, row in suite.TASKS.items() if row.phantoms)
            raise ValueError(f"{what} is for tasks that draw phantoms ({drawing}), not for {self.task!r}.")

    def _check_set(self, digest: object) -> None:
        """Raise ConfigurationError unless the set of training phantoms is the recorded one, if one is."""
        if digest is not None and digest != self.plain_env().phantoms.digest:
            raise ConfigurationError(
                f"the trial's {self.n_phantoms} training phantoms are the set {digest!r}, but this version "
                f"draws the set {self.plain_env().phantoms.digest!r}."
            )

    def _check_anatomy(self, anatomy: object) -> None:
        """Raise an error if it is no anatomy, the task draws its phantoms, or no pose of it is the goal.

        Raises:
            TypeError: If it is no anatomy.
            ValueError: If the task takes none, or not this one.
        """
        if not isinstance(anatomy, Anatomy):
            raise TypeError(f"anatomy must be of type Anatomy, not {reprlib.repr(anatomy)}.")
        if self.row.phantoms:
            allowed = [
                name
                for name, row in suite.TASKS.items()
                if not (row.phantoms or row.guidance.reward_from_frames)
                and (anatomy.has_focus or not row.guidance.moves_focus)
            ]
            raise ValueError(
                f"the task {self.task!r} draws its phantoms and takes no custom anatomy: allowed are "
                f"{', '.join(map(repr, allowed))}."
            )
        task, target = self.plain_env().task, anatomy.target
        if not any(task.is_success(pose, target) for pose in task.states):
            nearest = max(task.states, key=lambda pose: task.reward(pose, target, TRUE_REWARD))
            raise ValueError(
                f"the target must be a pose that the task {self.task!r} reaches, as the nearest, {nearest}, "
                f"not {target}."
            )


@contextlib.contextmanager
def of_any_version() -> Iterator[None]:
    """Keep Gymnasium from warning of an earlier version of a task, which is meant where it is named."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*is out of date", DeprecationWarning)
        yield


def check_arguments(given: Collection[str], others: Sequence[str] = ()) -> None:
    """Raise ConfigurationError unless a `Setting` takes the names `given`, or they are among `others`."""
    allowed = (*others, *(field.name for field in fields(Setting) if field.name != "task"))
    with as_configuration_error():
        for name in given:
            if name not in allowed:
                raise unknown("argument", name, allowed)


def make_env(task: str, *, render_mode: str | None = None, **setting: Any) -> gym.Env[Any, Any]:
    """Make the environment that every algorithm sees; `setting` holds other attributes of a `Setting`.

    Observations are float32 images (height_px, width_px, n_frames), the oldest frame first, in units of
    (grey level - 46.5) / 52.9; with senses they are dictionaries of `image` and `senses`.

    Raises:
        ConfigurationError: If an argument is unknown or a value not allowed; one sentence says which.
    """
    check_arguments(setting, ("render_mode",))
    return Setting(task=task, **setting).make_env(render_mode=render_mode)


def make_vec_env(
    task: str,
    num_envs: int,
    *,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    render_mode: str | None = None,
    **setting: Any,
) -> gym.vector.VectorEnv[Any, Any, Any]:
    """Make `num_envs` environments of `make_env` in step; arguments are those of `Setting.make_vec_env`.

    Raises:
        ConfigurationError: If an argument is unknown, or a value of the setting not allowed; one sentence
            says which.
        TypeError: If another argument has a wrong type.
        ValueError: If another value is not allowed.
    """
    check_arguments(setting, ("autoreset_mode", "render_mode"))
    return Setting(task=task, **setting).make_vec_env(
        num_envs, autoreset_mode=autoreset_mode, render_mode=render_mode
    )
