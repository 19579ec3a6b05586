"""What each command does, given its arguments; everything heavy is imported when a command runs."""

from __future__ import annotations

import argparse
import contextlib
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from usbench.records import TrialConfig
    from usbench.results import Results
    from usbench.sweep import Outcome


def run(args: argparse.Namespace) -> None:
    """Train and evaluate one agent on one task."""
    from usbench import console, own_anatomy, plots, records, replay, runner, training, wandb_run

    config = runner.resolve(
        args.algo,
        args.task,
        noise=args.noise,
        seed=args.seed,
        steps=args.steps,
        n_frames=args.n_frames,
        reward=args.reward,
        anatomy=own_anatomy.asked(args.phantom),
        preset=args.preset,
        overrides=dict(args.set),
    )
    progress: training.Progress = training.Silent() if args.quiet else console.Bars()
    folder = args.out / config.folder_name
    follow = args.wandb and (args.overwrite or records.read_state(folder).get("status") != "finished")
    try:
        with wandb_run.followed(config) if follow else contextlib.nullcontext():
            result = runner.run_trial(config, args.out, overwrite=args.overwrite, progress=progress)
    finally:
        progress.close()
    if result.skipped:
        print("This trial is finished already; here are its results (--overwrite runs it again).")
    figures = {
        "learning curve": plots.learning_curve(result.folder),
        "replay": replay.write_gif(result.folder),
    }
    console.print_trial(result.folder, figures)


def compare(args: argparse.Namespace) -> None:
    """Run what is missing of a comparison, then write its leaderboard and figures."""
    from usbench import comparison, sweep_console

    jobs = None if args.jobs is None else comparison.positive("jobs", args.jobs)
    planned = comparison.plan(args.algos, args.tasks, args.noise, args.seeds, args.steps)
    comparison.prepare(args.leaderboard)
    outcomes = [] if args.report_only else _run_missing(args, planned, jobs)
    # First: damaged records make no leaderboard.
    failed = sweep_console.failures(outcomes)
    for line in failed:
        print(line, file=sys.stderr)
    for path in comparison.report(planned, args.out, args.leaderboard):
        print(path)
    if failed:
        raise RuntimeError(
            f"{len(failed)} of {len(planned)} trials failed; the same command tries them again."
        )


def _run_missing(args: argparse.Namespace, planned: list[TrialConfig], jobs: int | None) -> list[Outcome]:
    from usbench import sweep, sweep_console
    from usbench.envs.threads import n_threads

    with sweep_console.SweepBars(args.quiet) as bars:
        if args.cluster is None:
            return sweep.run(planned, args.out, bars, jobs=jobs or n_threads())
        from usbench.cluster import Cluster

        with Cluster(args.cluster) as workers:
            return sweep.run(
                planned,
                args.out,
                bars,
                jobs=jobs or workers.n_workers,
                executor=lambda: workers,
                # All at once, for workers that are still to come.
                submitted=jobs or len(planned),
            )


def leaderboard(args: argparse.Namespace) -> None:
    """Write a leaderboard and its figures again: of its tables, of a folder's trials, or of both."""
    from usbench import comparison, figures, leaderboard, results

    folder = leaderboard.files(args.leaderboard)
    if args.runs is not None or args.add is not None:
        known, others = comparison.gather(args.runs or args.add)
        for name, task in others[["trial", "task"]].itertuples(index=False, name=None):
            print(
                f"left out, as it is not {task} as it stands in the table of tasks: {name}", file=sys.stderr
            )
        if args.add is not None:
            known = _added(results.read(folder), known)
        results.write(known, comparison.prepare(args.leaderboard))
    known = results.read(folder)
    for path in [*leaderboard.write(folder, args.leaderboard), *figures.write(known, folder)]:
        print(path)


def _added(before: Results, known: Results) -> Results:
    """Add trials to those of the tables, and say of those that were there whether they came out the same."""
    from usbench import results

    same, other = results.repeated(before, known)
    if same or other:
        n = len(same) + len(other)
        print(f"in the tables already, with the same numbers: {len(same)} of {n}", file=sys.stderr)
    for name in other:
        print(f"in the tables already, with other numbers: {name}", file=sys.stderr)
    return results.joined(before, known)


def transfer(args: argparse.Namespace) -> None:
    """Test agents of one phantom on phantoms never seen, and write the leaderboard again."""
    from usbench import leaderboard, transfer

    def tell(text: str) -> None:
        if not args.quiet:
            print(text, file=sys.stderr)

    folder = leaderboard.files(args.leaderboard)
    print(transfer.write(args.out, folder, tell, args.algos))
    for path in leaderboard.write(folder, args.leaderboard):
        print(path)


def search(args: argparse.Namespace) -> None:
    """Search hyperparameters of one algorithm."""
    from usbench import comparison, search, sweep_console
    from usbench.envs.threads import n_threads

    jobs = n_threads() if args.jobs is None else comparison.positive("jobs", args.jobs)
    settings = search.resolve(args.algo, args.tasks, noise=args.noise, seeds=args.seeds, steps=args.steps)
    n_candidates = comparison.positive("candidates", args.candidates)
    n_finalists = 0 if args.finalists is None else comparison.positive("finalists", args.finalists)
    with sweep_console.SweepBars(args.quiet) as bars:
        print(search.run(settings, n_candidates, args.out, bars, n_finalists, jobs=jobs))


def frame(args: argparse.Namespace) -> None:
    """Write what the probe sees from a pose."""
    from usbench import own_anatomy, still, view
    from usbench.records import ConfigurationError

    pose = view.pose(args.x, args.depth, args.angle, args.frequency, args.dynamic_range)
    if args.phantom and (args.task, args.number) != (None, None):
        raise ConfigurationError("--phantom is in place of a task's phantom: leave out --task and --number.")
    phantom = own_anatomy.asked(args.phantom, looking=True) or view.phantom_of(args.task, args.number)
    label = view.label(args.task, args.number)
    path = still.path(args.out, args.kind, pose, args.plain, label)
    taken = still.take(pose, args.kind, phantom, label)
    still.write(taken, path, args.plain)
    print(f"{path}: {taken.kind}, {taken.values.shape} {taken.values.dtype}, {taken.unit}")


def watch(args: argparse.Namespace) -> None:
    """Replay evaluation episodes of a trial."""
    from usbench import watch

    out = args.out if args.out is None else watch.check_file(args.out)
    watched = watch.choose(args.trial, args.episode, drawn=args.drawn)
    if watched.adviser is None:
        print(f"without advice: {watched.silence}", file=sys.stderr)
    if out is None:
        watch.show(watched)
    else:
        watch.write(watched, out)
        print(out)


def plot(args: argparse.Namespace) -> None:
    """Draw figures of any set of trials."""
    from usbench import plots

    for path in plots.write(args.runs, args.out, args.formats):
        print(path)


def guide(args: argparse.Namespace) -> None:
    """Serve the page on which a person moves the probe, until Ctrl-C."""
    from usbench import console, guide_server, runner
    from usbench.guide_session import Session
    from usbench.tasks import PAPER

    with guide_server.listening(args.port) as listener:
        session = Session(args.runs, args.trial, task=args.task, noise=args.noise, seed=args.seed)
        bars = console.Bars()
        # Of other tasks there are thousands: they are simulated as the probe moves.
        for task in sorted({*session.tasks} & {*PAPER}):
            runner.prepare_frames(task, bars.frames, session.anatomy)
        bars.close()
        guide_server.serve(session, listener, browser=not args.no_browser)


def report(args: argparse.Namespace) -> None:
    """Write the page of a set of trials."""
    from usbench import report

    def tell(text: str) -> None:
        if not args.quiet:
            print(text, file=sys.stderr)

    path = report.write(args.runs, args.out, tell)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


def show_suite(args: argparse.Namespace) -> None:
    """Show tasks, algorithms and their defaults."""
    from usbench import console

    console.print_suite()


def cache(args: argparse.Namespace) -> None:
    """Show or clear the frames kept on disk."""
    from usbench import console
    from usbench.envs import cache

    if args.clear:
        n_files, size = cache.clear()
        print(
            f"removed {n_files} file{'s' * (n_files != 1)} ({size / 1e6:.1f} MB) from {cache.cache_folder()}"
        )
    else:
        console.print_cache()
