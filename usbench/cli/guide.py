"""`usbench guide`: move the probe in the browser, with advice."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usbench import released
from usbench.checks import (
    ConfigurationError,
    as_configuration_error,
    check_plain_name,
    check_seed,
    probability,
)
from usbench.cli.arguments import add_probe_and_imaging, add_runs, number, probe_and_imaging, runs_or

if TYPE_CHECKING:
    from usbench.guide.session import Session
    from usbench.records import Trial

# A phantom that the best agent of the package has never seen.
OPENING = "pp-tracked"
EXAMPLES = """examples:
  usbench guide
  usbench guide best:fp
      with a trained agent that comes with the package
  usbench guide runs/pp-p0-vpg-s0-f5fd15c6 --noise 0.25
  usbench guide --task fp --port 8000 --no-browser
  usbench guide --study anna --task pp
  usbench guide --probe probe.toml --imaging imaging.toml

Nobody but this machine can reach the page. To see it from elsewhere, start it
with --port 8000 --no-browser, and there: ssh -L 8000:127.0.0.1:8000 HOST
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    guide = subparsers.add_parser(
        "guide",
        parents=[debug],
        epilog=EXAMPLES,
        help="move the probe yourself, in the browser, with an agent's advice",
        description="Serve a page on which you move the probe, or watch an agent do it, with the agent's "
        "advice and the optimum beside; needs usbench[guide]. Ctrl-C ends it.",
    )
    guide.add_argument(
        "trial",
        type=Path,
        nargs="?",
        metavar="TRIAL",
        help="folder of a trial, or an agent that comes with the package: best:TASK, vpg:fp, vpg:pp "
        "(default: the best one for the task, of --runs and of the package)",
    )
    guide.add_argument(
        "--task",
        metavar="NAME",
        help="task to begin with (default: the trial's, or pp-tracked; of a study pp)",
    )
    guide.add_argument(
        "--noise",
        type=number,
        metavar="P",
        help="probability that the probe slips after an action, 0 to 1 (default: the trial's, or 0)",
    )
    add_probe_and_imaging(guide)
    guide.add_argument(
        "--seed", type=number, metavar="N", help="seed of the episodes (default: a random one)"
    )
    add_runs(guide)
    guide.add_argument(
        "--study",
        metavar="NAME",
        help="play a study: the same episodes with and without advice, recorded in --runs",
    )
    guide.add_argument(
        "--port", type=number, default=0, metavar="N", help="port of the page (default: a free one)"
    )
    guide.add_argument("--no-browser", action="store_true", help="print the address, open nothing")
    kept = "the guide has ended; a study or a training that was begun goes on when it is started again."
    guide.set_defaults(call=_call, ends_at_once=True, interrupted=kept, runs=None)


def _call(args: argparse.Namespace) -> None:
    """Serve the page on which a person moves the probe, until Ctrl-C."""
    from usbench.guide import server
    from usbench.records import existing

    if args.runs is not None and (args.study is None or args.runs.exists()):
        existing(args.runs)  # a study makes its folder
    args.runs = runs_or(None, args.runs)
    _check(args)
    made: list[Session] = []

    def make(tell: Callable[[str], None]) -> Session:
        tell("loading PyTorch")
        import torch

        from usbench.guide.session import Session

        torch.set_num_threads(1)  # as fast for one frame, and waits for nobody where other cores are busy
        opening = None if args.trial or args.study else OPENING
        own = {"task": args.task or opening, "noise": args.noise, **files}
        made.append(Session(args.runs, args.trial, seed=args.seed, tell=tell, study=args.study, **own))
        return made[0]

    with server.listening(args.port) as listener:
        files = probe_and_imaging(args)
        try:
            server.serve(make, listener, browser=not args.no_browser)
        finally:
            for session in made:
                session.close()


def _check(args: argparse.Namespace) -> None:
    """Refuse what can be known to be wrong without PyTorch, before an address is told."""
    from usbench.guide import guided

    with as_configuration_error():
        if args.noise is not None:
            probability("noise", args.noise)
        if args.seed is not None:
            check_seed(args.seed)
        if args.study is not None:
            check_plain_name("the name of a study", args.study)
    if args.study is not None and args.seed is not None:
        raise ConfigurationError("--seed has no part in a study, whose episodes are the same for all.")
    if args.task is not None:
        guided.check_task(args.task)
    trial = None if args.trial is None else _trial(args.trial, args.task)
    if args.study is not None:
        _check_study(args, trial)


def _trial(named: Path, task: str | None) -> Trial:
    """Return the trial of an agent; refuse one that no guide asks, or of another task than is asked for."""
    from usbench.guide import guided
    from usbench.records import Trial, no_trial

    folder = released.place(named)
    if not folder.is_dir():
        raise no_trial(named)
    with as_configuration_error():
        trial = Trial.read(folder)
    guided.check_shown(str(named), trial.config.task)
    guided.check_code(str(named), trial.config.algo)
    if not trial.config.steps:
        raise ConfigurationError(f"{str(named)!r} is not the trial of an agent that learns.")
    if task is not None:
        guided.check_task_of_agent(str(named), trial.config.task, task)
    return trial


def _check_study(args: argparse.Namespace, trial: Trial | None) -> None:
    """Refuse a study that has begun with another task, noise or agent than is asked for."""
    from usbench.guide.study_record import has_begun

    asked: dict[str, Any] = {"task": args.task or "pp", "noise": 0.0}
    if trial is not None:
        name = released.agent_in(trial.folder.resolve())
        asked = {"task": trial.config.task, "noise": trial.config.noise, "agent": name}
    if args.noise is not None:
        asked["noise"] = float(args.noise)
    has_begun(args.runs, args.study, asked)
