"""The Gymnasium environment that all tasks share: an action moves the probe, the observation is its frame."""

from __future__ import annotations

import reprlib
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, NamedTuple, TypeVar

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from usbench.checks import check_type, probability, unknown
from usbench.coordinates import POSE
from usbench.envs.bmode import Imaging
from usbench.envs.frames import FrameStore, check_recorded, frame_store
from usbench.envs.image_reward import check_depth, likeness, standard_view
from usbench.envs.observation import senses as sensing
from usbench.envs.observation.senses import Observation
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Move, Pose, coordinates, sin_deg
from usbench.envs.probe import LinearArray
from usbench.envs.scene.picture import draw_scene
from usbench.envs.task import IMAGE, REWARDS, Task, check_reward
from usbench.envs.tissue import Tissue

T = TypeVar("T")


class Moved(NamedTuple):
    """What an action and noise did to the probe.

    Attributes:
        pose: After the action and before the noise, for which the reward is.
        displaced: By how much noise changed each coordinate that it meant to.
        stops: Whether the action ends the episode.
        times: How many times the pose's reward is earned.
    """

    pose: Pose
    displaced: dict[str, int]
    stops: bool
    times: int


class GuidanceEnv(gym.Env[Observation, int]):
    """A probe over a phantom; subclasses set `task` and describe themselves.

    Args:
        noise: Probability p_n that the probe is displaced after an action.
        reward: "normalized", "paper" or "image", which is computed from the frame alone.
        phantom: The tissue that is examined: a `Phantom` or a custom `Anatomy`.
        probe: The transducer.
        imaging: How RF becomes an image; the observation space has its size.
        senses: What the agent is told beside the frame, any of "position", "focus", "heading" and "actions"
            that the task has; None for the task's own, which most tasks have none of. With senses the
            observation is a dictionary of `image` and `senses`, see `observation/senses.py`.
        render_mode: None or "rgb_array".

    Attributes:
        pose: Where the probe is now.
        target: The pose that shows the object best; the truth, for evaluation and never for the agent.
        is_watched: Whether somebody looks at the observations; where nobody does they are black, and no frame
            is simulated for them.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}
    task: ClassVar[Task]
    default_phantom: ClassVar[Phantom] = Phantom()
    default_imaging: ClassVar[Imaging] = Imaging()
    default_senses: ClassVar[tuple[str, ...]] = ()
    # The arguments that frames follow from.
    scene: ClassVar[tuple[str, ...]] = ("phantom", "probe", "imaging")

    def __init__(
        self,
        *,
        noise: float = 0.0,
        reward: str = "normalized",
        phantom: Tissue | None = None,
        probe: LinearArray | None = None,
        imaging: Imaging | None = None,
        senses: Iterable[str] | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Check the configuration; nothing is simulated before the first reset.

        Raises:
            TypeError: If an argument has the wrong type.
            ValueError: If a value is not allowed, or the phantom does not fit the task.
        """
        self.noise = probability("noise", noise)
        self.reward = check_reward(reward, self.task)
        self.phantom = self._fitting(self.default_phantom if phantom is None else phantom)
        self.probe = _instance("probe", probe, LinearArray())
        self.imaging = _instance("imaging", imaging, self.default_imaging)
        if not self.phantom.has_focus:
            check_recorded(self.probe, self.imaging, self.default_imaging)
        if self.reward == IMAGE:
            check_depth(self.imaging)
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise unknown("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.senses = sensing.checked(self.default_senses if senses is None else senses, self.task)
        self.target = self.phantom.target
        self.action_space = gym.spaces.Discrete(len(self.task.actions))  # type: ignore[assignment]
        self.observation_space = self.senses.space(
            gym.spaces.Box(0, 255, (self.imaging.height_px, self.imaging.width_px, 1), np.uint8)
        )
        self.is_watched = True
        self._pose: Pose | None = None
        self._last_action: int | None = None
        self._frames: FrameStore | None = None
        self._steps_left = 0

    @property
    def pose(self) -> Pose:
        """Where the probe is now; `gymnasium.error.ResetNeeded` is raised before the first reset."""
        if self._pose is None:
            raise gym.error.ResetNeeded("call reset() first: the probe has no pose before.")
        return self._pose

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Put the probe on a start pose drawn uniformly from the task's.

        Args:
            seed: Starts a new stream of random numbers; None continues the old one.
            options: Any subset of the pose's coordinates ("x_mm", "focal_depth_mm", "angle_deg"; with
                settings "frequency_khz" and "dynamic_range_db" too), in place of the drawn values.

        Raises:
            TypeError: If an option is not a number.
            ValueError: If an option is unknown, not a whole number or outside the probe's limits. A
                refused reset changes nothing.
        """
        self.start(seed, options)
        return self.first_observation()

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Act, reward, displace with probability `noise`, observe; terminates where the agent stops.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
            ValueError: If the task has no such action.
        """
        return self.outcome(self.move(action))

    # Both come in halves: first what moves the probe, then what looks at frames. In between, a vector of
    # environments makes the frames of all of them at once.

    def start(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Do the first half of `reset`, with the same arguments and errors: no frame is looked at."""
        chosen = self._checked(options)
        super().reset(seed=seed)
        # Drawn even where options replace it, so that they do not shift the stream.
        start = self.task.starts[self.np_random.integers(len(self.task.starts))]
        self._pose = self._with_options(start, chosen)
        self._last_action = None
        self._steps_left = self.task.n_steps

    def first_observation(self) -> tuple[Observation, dict[str, Any]]:
        """Do the second half of `reset`: return observation and info."""
        return self._observation(), self._info({})

    def move(self, action: int) -> Moved:
        """Do the first half of `step`: act and displace with probability `noise`; no frame is looked at.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
            ValueError: If the task has no such action.
        """
        if isinstance(action, bool) or not self.action_space.contains(action):
            raise ValueError(
                f"action must be a whole number from 0 to {len(self.task.actions) - 1}, not {action!r}."
            )
        pose = self.pose.moved(self.task.actions[int(action)].move, self.task.limits)
        stops = self.task.stops and int(action) == len(self.task.actions) - 1
        times = max(self._steps_left, 1) if stops else 1
        self._steps_left -= 1
        self._last_action = int(action)

        # Both numbers are drawn at every step: the stream depends neither on the actions nor on `noise`.
        occurs = self.np_random.random() < self.noise and not stops
        displacement = self.task.displacements[self.np_random.integers(len(self.task.displacements))]
        self._pose = pose.moved(displacement, self.task.limits) if occurs else pose
        displaced = _difference(pose, self._pose, displacement) if occurs else {}
        return Moved(pose, displaced, stops, times)

    def outcome(self, moved: Moved) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Do the second half of `step`: return observation, reward, terminated, truncated and info."""
        info = self._info(moved.displaced)
        if self.reward == IMAGE:
            info["true_reward"] = self.task.reward(moved.pose, self.target, REWARDS[0]) * moved.times
        return self._observation(), self._reward(moved.pose) * moved.times, moved.stops, False, info

    def looks_at(self, moved: Moved | None = None) -> list[Pose]:
        """Return the poses whose frames the second half of `step`, or of `reset`, looks at."""
        rewarded = [moved.pose] if moved is not None and self._rewards_frames else []
        return rewarded + ([self.pose] if self.is_watched or self.task.reward_from_frames else [])

    def state_rewards(self) -> npt.NDArray[np.float64]:
        """Return the reward of being in every state of the task, (n_states,), as this environment gives it.

        Where frames tell it, they are those of this phantom, probe and imaging, made at once and kept.
        """
        if self._rewards_frames:
            self.frames.prepare(self.task.states)
        return np.array([self._reward(pose) for pose in self.task.states], dtype=np.float64)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the scene beside the frame, (height, width, 3) uint8 RGB, if render_mode is "rgb_array"."""
        if self.render_mode is None:
            gym.logger.warn("render() does nothing: make the environment with render_mode='rgb_array'.")
            return None
        return draw_scene(self.phantom, self.pose, self._frame(self.pose), self.probe, self.imaging)

    def _fitting(self, tissue: Tissue) -> Tissue:
        """Return the tissue if this task can be done in it."""
        if not isinstance(tissue, Tissue) or isinstance(tissue, type):
            raise TypeError(f"phantom must be of type Phantom or Anatomy, not {reprlib.repr(tissue)}.")
        if tissue.object_of_interest is None and self.task.reward_from_frames:
            raise ValueError(
                f"the task {self.task.name!r} takes no custom anatomy: its reward needs an object whose "
                "outline is known."
            )
        if self.task.moves_focus and not tissue.has_focus:
            raise ValueError(
                f"a recorded image keeps the focus of its recording, which the task {self.task.name!r} "
                "moves: allowed are tasks that do not, as 'pp'."
            )
        if tissue.object_of_interest is None and self.reward == IMAGE:
            raise ValueError(
                f"in a custom anatomy the reward cannot be {IMAGE!r}, whose standard view is that of the "
                f"paper's object: take {REWARDS[0]!r}, the default."
            )
        return tissue

    def _observation(self) -> Observation:
        if self.is_watched:
            image = self._frame(self.pose)[:, :, np.newaxis].copy()
        else:
            image = np.zeros((self.imaging.height_px, self.imaging.width_px, 1), np.uint8)
        if not self.senses.names:
            return image
        told = self.senses.values(self.pose, self._last_action)
        return {sensing.IMAGE: image, sensing.SENSES: told}

    @property
    def _rewards_frames(self) -> bool:
        return self.task.reward_from_frames or self.reward == IMAGE

    @property
    def frames(self) -> FrameStore:
        """The frames of the tissue that is examined now."""
        if self._frames is None:
            self._frames = frame_store(self.phantom, self.probe, self.imaging)
        return self._frames

    def _frame(self, pose: Pose) -> npt.NDArray[np.uint8]:
        return self.frames.frame(pose)

    def _reward(self, pose: Pose) -> float:
        if self.reward == IMAGE:
            # At most 0, as the others are.
            return likeness(self._frame(pose), standard_view(self.probe, self.imaging), self.imaging) - 1
        return self.task.reward(pose, self.target, self.reward)

    def _info(self, displaced: dict[str, int]) -> dict[str, Any]:
        pose = self.pose
        # Where the object is known, so is the pose that shows it.
        target = self._target_info() if self.phantom.object_of_interest is None else {}
        return {
            **{name: getattr(pose, name) for name in coordinates(pose)},
            "distance_mm": self.task.distance_mm(pose, self.target),
            "sin_angle": sin_deg(pose.angle_deg - self.target.angle_deg),
            "noise": displaced,
            "is_success": self._is_success(pose),
            **target,
        }

    def _is_success(self, pose: Pose) -> bool:
        return self.task.is_success(pose, self.target)

    def _target_info(self) -> dict[str, int]:
        return {f"target_{name}": getattr(self.target, name) for name in POSE}

    @property
    def _options(self) -> tuple[str, ...]:
        """What the options of a reset can name."""
        return self.task.coordinates

    def _checked(self, options: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return the options of a reset, or refuse them, which is to happen before anything is drawn."""
        if options is None:
            return {}
        if not isinstance(options, Mapping):
            names = ", ".join(self._options)
            raise TypeError(f"options must be a dict with any of {names}, not {options!r}.")
        for name in options:
            if name not in self.task.coordinates:
                raise unknown("option", name, self._options)
        # Each coordinate is checked by itself, so that any start will do.
        self.task.limits.check(self._with_options(self.task.starts[0], options))
        return dict(options)

    def _with_options(self, start: Pose, options: Mapping[str, Any]) -> Pose:
        return self.task.pose({name: getattr(start, name) for name in self.task.coordinates} | dict(options))

    def __getstate__(self) -> dict[str, Any]:
        """Leave the frames out of a pickle: every process has its own store of them."""
        return {**self.__dict__, "_frames": None}


def _instance(name: str, value: T | None, default: T) -> T:
    """Return `value`, or `default` in place of None."""
    return default if value is None else check_type(name, value, type(default))


def _difference(before: Pose, after: Pose, displacement: Move) -> dict[str, int]:
    """Return by how much noise changed the coordinates that it meant to; 0 where the border blocked it."""
    return {
        name: getattr(displacement, name) if getattr(after, name) != getattr(before, name) else 0
        for name in coordinates(before)
        if getattr(displacement, name) != 0
    }
