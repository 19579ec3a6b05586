"""`usbench run`: train and evaluate one agent on one task."""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usbench.cli.arguments import (
    GOES_ON,
    add_probe_and_imaging,
    add_senses,
    each_once,
    number,
    probe_and_imaging,
    setting,
)
from usbench.cli.phantom import add_phantom, custom_anatomy

if TYPE_CHECKING:
    from usbench.records import Trial, TrialConfig

EXAMPLES = """examples:
  usbench run --algo vpg --task pp
  usbench run --algo vpg --task fp --noise 0.25 --seed 3
  usbench run --algo vpg --task pp --preset spinup --set gamma=0.95 --out mine
  usbench run --algo dqn --task pp --phantom spine.mha frames=recorded \\
      target_x_mm=0 target_angle_deg=0
      in a custom anatomy (docs/anatomy.md)
  usbench run --algo dqn --task pp --probe probe.toml --imaging imaging.toml
      with another probe and other frames (usbench defaults probe > probe.toml)
  usbench run --algo dqn --task pp-random --senses position heading
      told where the probe is and how it is turned, beside the frames
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    run = subparsers.add_parser(
        "run",
        parents=[debug],
        epilog=EXAMPLES,
        help="train and evaluate one agent on one task",
        description="Train and evaluate one agent on one task; leave records, replay, and the learning "
        "curve of an agent that learns.",
    )
    run.add_argument("--algo", required=True, help="algorithm, for example vpg (see usbench list)")
    run.add_argument("--task", required=True, help="task, for example pp (see usbench list)")
    run.add_argument(
        "--noise",
        type=number,
        default=0.0,
        metavar="P",
        help="probability that the probe slips after an action, 0 to 1 (default 0)",
    )
    run.add_argument("--seed", type=number, default=0, metavar="N", help="trial seed (default 0)")
    run.add_argument("--steps", type=number, metavar="N", help="training steps (default: the task's budget)")
    run.add_argument(
        "--n-frames", type=number, default=4, metavar="N", help="frames in one observation (default 4)"
    )
    run.add_argument(
        "--n-envs",
        type=number,
        metavar="N",
        help="environments that are stepped together (default: the algorithm's own, most have 1)",
    )
    run.add_argument(
        "--n-phantoms",
        type=number,
        metavar="N",
        help="phantoms that there are in training, in a task that draws them (default: no limit)",
    )
    add_senses(run)
    run.add_argument(
        "--reward",
        default="normalized",
        metavar="KIND",
        help="what is trained on: normalized (default), or image, computed from the frame alone; "
        "scores are those of the true reward",
    )
    add_phantom(run, "target_x_mm and target_angle_deg or target_focal_depth_mm say where it is seen best")
    add_probe_and_imaging(run)
    run.add_argument("--preset", metavar="NAME", help="named hyperparameters, for example spinup")
    run.add_argument(
        "--set",
        action="extend",
        nargs="+",
        type=setting,
        default=[],
        metavar="NAME=VALUE",
        help="hyperparameters, for example n_value_steps=80",
    )
    run.add_argument(
        "--out", type=Path, default=Path("runs"), metavar="FOLDER", help="folder for trials (default runs)"
    )
    run.add_argument("--overwrite", action="store_true", help="run again even if finished")
    run.add_argument(
        "--wandb", action="store_true", help="let Weights & Biases follow the training; needs usbench[wandb]"
    )
    run.add_argument("--quiet", action="store_true", help="no progress")
    run.set_defaults(call=_call, interrupted=GOES_ON)


def _call(args: argparse.Namespace) -> None:
    """Train and evaluate one agent on one task."""
    from usbench.trials.configuration import resolve

    if args.overwrite:
        args.interrupted = GOES_ON.replace("the same command", "the same command without --overwrite")
    examined = {"anatomy": custom_anatomy(args.phantom), **probe_and_imaging(args)}
    config = resolve(
        args.algo,
        args.task,
        noise=args.noise,
        seed=args.seed,
        steps=args.steps,
        n_frames=args.n_frames,
        n_envs=args.n_envs,
        senses=args.senses,
        n_phantoms=args.n_phantoms,
        reward=args.reward,
        **examined,
        preset=args.preset,
        overrides=each_once("--set", args.set),
    )
    trial = _begin(config, args)
    # Now, as these take seconds: what is refused has been refused.
    from usbench.cli.output import trial_output
    from usbench.cli.output.trial_bars import Bars
    from usbench.figures import learning_curve
    from usbench.trials import callback, runner, wandb_run
    from usbench.watch import replay

    progress: callback.Progress = callback.Silent() if args.quiet else Bars()
    follow = args.wandb and (trial is None or trial.status != "finished")
    try:
        with wandb_run.followed(config) if follow else contextlib.nullcontext():
            result = runner.run_trial(
                config, args.out, overwrite=args.overwrite, progress=progress, rehearse=not args.quiet
            )
    finally:
        progress.close()
    if result.has_other_code:
        print(
            "This trial is finished, but its algorithm's code has changed since: --overwrite runs it again."
        )
    elif result.skipped:
        print("This trial is finished already; here are its results (--overwrite runs it again).")
    pictures = {"learning curve": learning_curve.write(result.folder)} if config.steps else {}
    pictures["replay"] = replay.write_gif(result.folder)
    trial_output.print_trial(result.folder, pictures)


def _begin(config: TrialConfig, args: argparse.Namespace) -> Trial | None:
    """Say what is going to be done, within a second; return the trial that stands there, if one is to stay.

    Raises:
        ConfigurationError: If the folder for trials cannot be written, or what is to follow the trial is not
            installed.
    """
    from usbench import records

    records.check_writable(args.out)
    # What is overwritten is not read: it may be damaged.
    trial = None if args.overwrite else records.Trial.find(args.out / config.folder_name)
    if trial is not None and trial.status == "finished":
        return trial
    if args.wandb:
        from usbench.trials import wandb_run

        wandb_run.check_installed()
    if not args.quiet:
        where = f" on {config.phantom_set}" if config.phantom_set else ""
        how = f"{config.steps} training steps{where}" if config.steps else "evaluation alone"
        told = f"{config.title}: {how}; frames that are not on disk yet are simulated first"
        print(told, file=sys.stderr, flush=True)
        _hint(config.seed, dict(args.set))
    return trial


def _hint(seed: int, overrides: dict[str, str]) -> None:
    """Say what seeds of comparisons are for, where hyperparameters are tried with one."""
    from usbench import seed_pools

    pools = seed_pools.own()
    if overrides and pools.of(seed) == "comparison":
        print(
            f"seed {seed} is one of those kept for what is reported ({pools.comparison}): seeds "
            f"{pools.development} are for trying hyperparameters",
            file=sys.stderr,
        )
