"""A study: a fixed list of evaluation episodes, which a person plays with and without an agent's advice.

Every episode is played in both ways. The first half of the study takes the episodes in turn with and without
advice, the second half the other way round, so that neither way profits from practice alone; which way begins
depends on the name.
"""

import hashlib
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from filelock import Timeout

from usbench.atomic import atomic_file
from usbench.checks import as_configuration_error, check_plain_name
from usbench.guide.examination import Examination, Opened
from usbench.guide.study_record import has_begun
from usbench.records import EVALUATIONS, ConfigurationError, Evaluation, unwritable
from usbench.records.journal import UNREADABLE, append_all, cut_torn_line, read_rows
from usbench.records.lock import lock_of
from usbench.results.studies import ADVISED, AGENT, HUMAN, OPTIMUM, STUDY, damaged, folder_of
from usbench.setting import Setting
from usbench.suite import EvaluationEpisode

EPISODES = 8


@dataclass(frozen=True)
class Play:
    """One episode of a study, and whether the agent's advice is shown in it."""

    episode: EvaluationEpisode
    advised: bool


def plan(name: str, setting: Setting) -> tuple[Play, ...]:
    """Return what is played, in its order: up to 8 episodes of the evaluation list, each twice."""
    known = setting.evaluation_episodes()
    few = min(EPISODES, len(known))
    chosen = [known[k * len(known) // few] for k in range(few)]
    first = hashlib.sha256(name.encode()).digest()[0] % 2
    return tuple(
        Play(episode, (k + half + first) % 2 == 0) for half in range(2) for k, episode in enumerate(chosen)
    )


class Study:
    """One person's study; what has been played is on disk, and a study that was ended goes on from there.

    Attributes:
        plays: All that is played.
        n_done: How many of `plays` are done.
    """

    def __init__(self, runs: Path, name: str, setting: Setting, agent: str) -> None:
        """Begin the study `name` in a folder of `runs`, or go on with it.

        Raises:
            ConfigurationError: If `name` cannot be that of a folder, the study has begun otherwise, or
                another guide plays it, or its record is damaged.
        """
        with as_configuration_error():
            self.name, self.setting = check_plain_name("the name of a study", name), setting
        self.folder, self.plays = folder_of(runs, name), plan(name, setting)
        record = {"study": name, "task": setting.task, "noise": setting.noise, "agent": agent}
        record["plays"] = len(self.plays)
        record |= {"anchors": asdict(setting.anchors()), "environment": setting.record()}
        has_begun(runs, name, record)  # First: other options are wrong whoever plays it.
        try:
            self._lock = lock_of(self.folder)
            self._lock.acquire()
        except Timeout:
            raise ConfigurationError(
                f"the study {name!r} is played in another guide: end that one first."
            ) from None
        except OSError as error:
            raise unwritable(self.folder, error) from error
        try:
            self._begin(runs, record)
            cut_torn_line(self.folder / EVALUATIONS)
            self.n_done = sum(player in (HUMAN, ADVISED) for _, player in self._recorded())
        except BaseException:
            self.close()
            raise
        self._steps: list[tuple[int | None, bool, float | None]] = []
        # When the person could see what is to be done; nobody knows when the page was opened.
        self._since: float | None = None

    @property
    def now(self) -> Play | None:
        """What is played now; None if all is done."""
        return self.plays[self.n_done] if self.n_done < len(self.plays) else None

    @property
    def words(self) -> str:
        """Where the study is, in a sentence."""
        if self.now is None:
            return f"The study {self.name} is finished. Thank you."
        way = "with" if self.now.advised else "without"
        return f"Study {self.name}: episode {self.n_done + 1} of {len(self.plays)}, {way} advice."

    def close(self) -> None:
        """Let another guide go on with the study."""
        self._lock.release()

    def begin(self) -> None:
        """An episode begins: nothing is done in it yet."""
        self._steps = []
        if self._since is not None:
            self._since = time.monotonic()

    def saw(self, advised: int | None, action: int) -> None:
        """Note a step: what the agent advised, shown or not, and what the person did."""
        now = time.monotonic()
        seconds = None if self._since is None else round(now - self._since, 3)
        self._steps.append((advised, action == advised, seconds))
        self._since = now

    def finish(self, examination: Examination, agent: Opened) -> None:
        """Record an episode that is over, then what agent and optimum do in it."""
        play = self.plays[self.n_done]
        advised, obeyed, seconds = (list(column) for column in zip(*self._steps, strict=True))
        noted = {"advice": advised, "obeyed": obeyed, "seconds": seconds}
        # First, and by itself: a person cannot play an episode for the first time again.
        self._append(self.n_done, examination, ADVISED if play.advised else HUMAN, **noted)
        self.n_done += 1
        self.complete(agent)

    def complete(self, agent: Opened) -> None:
        """Record what agent and optimum do in the episodes that are done, where that is missing."""
        known = self._recorded()
        for number, play in enumerate(self.plays[: min(self.n_done, len(self.plays) // 2)]):
            for player, opened in ((AGENT, agent), (OPTIMUM, None)):
                if (number, player) not in known:
                    self._append(number, self._played(play, opened), player)

    def _recorded(self) -> list[tuple[int, str]]:
        """Return number of the play and player of every row; ConfigurationError if a row is damaged."""
        try:
            return [(row["episode"], row["player"]) for row in read_rows(self.folder / EVALUATIONS)]
        except (*UNREADABLE, KeyError, TypeError) as error:
            raise damaged(self.folder, error) from error

    def _played(self, play: Play, agent: Opened | None) -> Examination:
        """Return the episode as an agent plays it, by default the optimum."""
        from usbench.guide.agents import open_oracle

        examination = Examination(
            self.setting, play.episode.seed, agent or open_oracle(self.setting), options=play.episode.options
        )
        while not examination.over:
            examination.follow()
        return examination

    def _append(self, number: int, examination: Examination, player: str, **noted: object) -> None:
        """Add a row to the record, with what is `noted` of it beside its evaluation."""
        line = Evaluation(
            episode=number,
            eval_episode=self.plays[number].episode.number,
            step=0,
            checkpoint=0,
            deterministic=True,
            **examination.facts,
        )
        append_all(self.folder / EVALUATIONS, [line.as_row() | {"player": player, **noted}])

    def _begin(self, runs: Path, record: dict[str, Any]) -> None:
        """Write the record of the study, unless it has begun."""
        if has_begun(runs, self.name, record):
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with atomic_file(self.folder / STUDY) as file:
                file.write(json.dumps(record, indent=1).encode())
        except OSError as error:
            raise unwritable(self.folder, error) from error
