"""Submissions: trials are verified from their records, and what was changed by hand is found."""

import dataclasses
import json
import shutil
from pathlib import Path

import pytest
from quick_trials import speed_up
from state_files import read_state, write_state
from trials import SMALL

from usbench import cli, records, released, suite
from usbench.checks import ConfigurationError
from usbench.compare import submission
from usbench.records import checksums
from usbench.records.lock import locked
from usbench.results import additions, collecting, leaderboard, tables
from usbench.setting import Setting
from usbench.trials import runner
from usbench.trials.configuration import resolve

STEPS = 64


def shorter(monkeypatch):
    """Quick trials on tasks whose whole budget is that short."""
    speed_up(monkeypatch)
    rows = {name: dataclasses.replace(row, steps=STEPS) for name, row in suite.TASKS.items()}
    monkeypatch.setattr(suite, "TASKS", rows)


@pytest.fixture(scope="module")
def _made(tmp_path_factory):
    runs = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as monkeypatch:
        shorter(monkeypatch)
        for algo, noise in (("vpg", 0.5), ("dqn", 0.0)):
            config = resolve(algo, "pp", seed=100, noise=noise, overrides=SMALL[algo])
            runner.run_trial(config, runs)
    return runs


@pytest.fixture
def runs(_made, tmp_path, monkeypatch):
    """A folder with two whole trials, a copy for this test alone."""
    shorter(monkeypatch)
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(_made, tmp_path / "mine"))


def rewrite(folder, name, change):
    """Change the rows of a journal as `change` does, with checksums as a forger would write them."""
    rows = [json.loads(line) for line in (folder / name).read_text().splitlines()]
    change(rows)
    (folder / name).write_text("".join(json.dumps(row) + "\n" for row in rows))
    state = read_state(folder)
    state["checksums"] = checksums.of(folder, (records.EPISODES, records.EVALUATIONS))
    write_state(folder, state)


def better(rows):
    rows[-1]["return"] += 1.0


def other_action(rows):
    rows[-1]["actions"][0] = (rows[-1]["actions"][0] + 1) % 5


def too_short(rows):
    rows[-1]["actions"].pop()


def too_long(rows):
    rows[-1]["actions"].append(0)


def left_out(rows):
    rows.pop()


def no_sampled(rows):
    rows[:] = [row for row in rows if row["deterministic"] or row["checkpoint"] < STEPS]


def elsewhere(rows):
    rows[-1]["final_x_mm"] += 5


def beyond_any_float(rows):
    rows[-1]["final_x_mm"] = 10**400


def at_the_goal(rows):
    rows[-1]["is_success"] = not rows[-1]["is_success"]


def nearer(rows):
    rows[-1]["final_distance_mm"] += 1.0


def flatter(rows):
    rows[-1]["final_sin_angle"] += 0.1


def sooner(rows):
    rows[-1]["steps_to_goal"] = 1 if rows[-1]["steps_to_goal"] is None else None


def long_after(rows):
    for row in rows:
        row["step"] *= 100


def at_once(rows):
    for row in rows:
        row["step"] = 0


def infinite(rows):
    rows[-1]["actions"][0] = float("inf")


def of_no_list(rows):
    rows[-1]["eval_episode"] = 10_000


def of_fractions(rows):
    """Other numbers, which all mean the easiest episode where they are cut to whole ones."""
    easiest = {row["deterministic"]: row for row in rows if row["eval_episode"] == 0}
    for row in rows:
        row |= easiest[row["deterministic"]] | {
            "eval_episode": row["eval_episode"] / 1000,
            "checkpoint": row["checkpoint"],
        }


def from_the_end(rows):
    """One episode twice: the list's last one, by a number that counts from its end."""
    rows[-2] |= rows[-1] | {"eval_episode": -1}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (better, "come out otherwise, as evaluation episode"),
        (other_action, "come out otherwise"),
        (too_short, "its actions end before the episode does"),
        (too_long, "there are actions after its end"),
        (left_out, "with greedy actions are not"),
        (no_sampled, "with sampled actions are not"),
        (elsewhere, "has the final x mm "),
        (beyond_any_float, "a line of it has a number beyond 64 bits"),
        (at_the_goal, "come out otherwise"),
        (nearer, "has the final distance mm "),
        (flatter, "has the final sin angle "),
        (sooner, "has the steps to goal "),
        (infinite, "cannot be played again"),
        (long_after, "do not take place at growing training steps, the last at 64."),
        (at_once, "do not take place at growing training steps, the last at 64."),
        (of_no_list, "cannot be played again"),
        (of_fractions, "are not the episodes 0 to"),
        (from_the_end, "are not the episodes 0 to"),
    ],
)
def test_a_forged_evaluation_is_found(runs, change, said):
    folder = records.trial_folders(runs)[0]
    assert submission.problems(folder) == []
    rewrite(folder, records.EVALUATIONS, change)
    assert said in " ".join(submission.problems(folder))


def test_a_point_that_a_rollout_passed_over_is_not_missing(runs):
    folder = records.trial_folders(runs)[0]
    between = suite.evaluation_points("pp", STEPS)[1]

    def passed_over(rows):
        rows[:] = [row for row in rows if row["checkpoint"] != between]

    rewrite(folder, records.EVALUATIONS, passed_over)
    assert submission.problems(folder) == []


def test_a_record_that_was_changed_without_its_checksum_is_damaged(runs):
    folder = records.trial_folders(runs)[0]
    path = folder / records.EVALUATIONS
    path.write_text(path.read_text().replace('"episode": 0', '"episode": 7', 1))
    assert "is damaged" in submission.problems(folder)[0]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"seed": 1000}, "its seed 1000 is not one of those that are kept for comparisons, 100 to 999"),
        ({"environment": {"senses": ["position"]}}, "or senses are not those of pp."),
        ({"seed": 3}, "its seed 3 is not one of those that are kept for comparisons, 100 to 999"),
        ({"steps": 32}, "it trained for 32 steps: the budget of pp is 64"),
        ({"n_frames": 16}, "its observations have 16 frames: those of pp have 4."),
        (
            {"algo": "mine:Agent"},
            "must have the name of its configuration, pp-p0.5-mine.Agent-s100-",
        ),
        (
            {"task": "setup", "environment": Setting(task="setup-v0").record()},
            "its anatomy, probe, imaging, reward or senses are not those of setup.",
        ),
        ({"noise": 0.25}, "its exact returns (optimum, random, idle agent) are not those"),
    ],
)
def test_another_setting_than_the_comparisons_is_found(runs, changes, said):
    folder = records.trial_folders(runs)[1]
    state = read_state(folder)
    config = state["config"]
    changes = {name: config[name] | new if isinstance(new, dict) else new for name, new in changes.items()}
    write_state(folder, state | {"config": config | changes})
    assert said in " ".join(submission.problems(folder))


@pytest.mark.parametrize("records_alone", [False, True])
@pytest.mark.parametrize("name", ["optimal", "random", "stay"])
def test_forged_exact_returns_are_found(runs, name, records_alone):
    """All scores follow from them: with a low optimum every agent would look good."""
    folder = records.trial_folders(runs)[1]
    state = read_state(folder)
    state["anchors"][name] -= 1.0
    write_state(folder, state)
    (told,) = submission.problems(folder, records_alone=records_alone)
    assert told.startswith("its exact returns (optimum, random, idle agent) are not those")


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("best:pp-tracked", {}, None),  # told its own last actions too
        ("best:pp-random", {}, None),  # with more than the task's budget
        ("best:exam-tracked", {}, None),  # with other frames
        ("best:pp-random", {"senses": ["position"]}, "or senses are not those"),
    ],
)
def test_on_new_phantoms_senses_and_steps_are_those_of_their_table(tmp_path, name, changes, said):
    folder = Path(shutil.copytree(released.folder_of(name), tmp_path / "trial"))
    state = read_state(folder)
    state["config"]["environment"] |= changes
    write_state(folder, state)
    (folder / records.EPISODES).touch()  # a released agent has none
    rewrite(folder, records.EVALUATIONS, list.clear)  # nothing to be played again, which takes minutes
    told = " ".join(submission.problems(folder))
    assert "budget of" not in told and (said in told if said else "senses" not in told)


def test_a_trial_that_trained_too_long_or_never_is_found(runs):
    folder = records.trial_folders(runs)[0]
    rewrite(folder, records.EPISODES, lambda rows: rows[-1].update(step=STEPS + 1))
    assert "beyond the budget" in " ".join(submission.problems(folder))
    rewrite(folder, records.EPISODES, list.clear)
    assert "it has no training episodes" in " ".join(submission.problems(folder))


def test_training_episodes_out_of_order_are_found(runs):
    folder = records.trial_folders(runs)[0]
    rewrite(folder, records.EPISODES, lambda rows: rows.insert(0, rows.pop()))
    assert "out of order" in " ".join(submission.problems(folder))


def test_shorter_trials_of_one_s_own_are_added_without_a_mark(runs, monkeypatch):
    """What is asked of them is that records are what happened, not the comparison's budget."""
    monkeypatch.setattr("usbench.figures.comparison.write", lambda *_: [])
    rows = {name: dataclasses.replace(row, steps=2 * STEPS) for name, row in suite.TASKS.items()}
    monkeypatch.setattr(suite, "TASKS", rows)
    known = collecting.collect(runs)
    tables.write(known.of(known.trials.head(0)), leaderboard.prepare(Path("leaderboard.md")))
    assert cli.main(["leaderboard", "--add", "mine"]) == 0
    assert additions.unverified(Path("leaderboard_files")) == []


def test_a_training_with_holes_is_found(runs):
    folder = records.trial_folders(runs)[0]
    rewrite(folder, records.EPISODES, lambda rows: rows.__delitem__(slice(1, None)))
    (told,) = submission.problems(folder)
    assert told.startswith("no training episode ends within the 48 steps from step 16 to 64: on pp one does")


def test_trials_that_two_processes_add_at_once_are_all_there(runs, monkeypatch):
    monkeypatch.setattr("usbench.figures.comparison.write", lambda *_: [])
    known = collecting.collect(runs)
    folder = leaderboard.prepare(Path("leaderboard.md"))
    tables.write(known.of(known.trials.head(0)), folder)
    first, second = records.trial_folders(runs)
    shutil.copytree(first, Path("one") / first.name)
    added = additions.add

    def meanwhile(*args, **kwargs):
        """Another process adds a trial after this one has read the tables."""
        monkeypatch.setattr(additions, "add", added)
        with locked(folder / tables.TRIALS):
            tables.write(known.of(known.trials[known.trials["trial"] == second.name]), folder)
        return added(*args, **kwargs)

    monkeypatch.setattr(additions, "add", meanwhile)
    assert cli.main(["leaderboard", "--add", "one"]) == 0
    assert set(tables.read(folder).trials["trial"]) == {first.name, second.name}


def test_other_frames_are_told_and_refuse_nothing(runs, capsys):
    folders = records.trial_folders(runs)
    assert submission.other_frames(folders) == []
    state = read_state(folders[0])
    state["frames"]["digest"] = "0" * 64
    write_state(folders[0], state)
    (told,) = submission.other_frames(folders)
    assert told.startswith(f"{folders[0].name} has seen other frames")
    assert cli.main(["submit", "mine"]) == 0
    assert told in capsys.readouterr().err


def test_frames_of_an_earlier_version_of_a_task_are_compared_with_its_own(runs):
    folder, told = records.trial_folders(runs)[0], []
    state = read_state(folder)
    state["config"] |= {"task": "setup", "environment": Setting(task="setup-v0").record()}
    state["frames"]["digest"] = Setting(task="setup-v0").prepare_frames().digest
    write_state(folder, state)
    assert submission.other_frames([folder], told.append) == []
    assert told[0].startswith("frames of setup-v0, ")


def test_one_that_is_not_finished_is_found(runs):
    folder = records.trial_folders(runs)[0]
    write_state(folder, read_state(folder) | {"status": "interrupted"})
    assert submission.problems(folder) == ["it is not finished, but interrupted."]


def test_a_folder_without_the_record_of_its_trial_is_told(runs, capsys):
    (records.trial_folders(runs)[0] / records.TRIAL).rename(runs / "notes.json")
    (runs / "figures").mkdir()
    assert cli.main(["submit", "mine", "--check"]) == 0
    captured = capsys.readouterr()
    assert captured.out == "verified: 1 of 1 trials\n"
    assert captured.err.startswith("left out: pp-p0-") and captured.err.count("left out") == 1


def test_a_submission_is_written_checked_again_and_added(runs, capsys):
    assert cli.main(["submit", "mine"]) == 0
    captured = capsys.readouterr()
    assert captured.out == "verified: 2 of 2 trials\nsubmission\n" and captured.err.count("verified") == 2
    kept = {path.name for path in Path("submission").rglob("*") if path.is_file()}
    assert kept == set(submission.FILES)
    assert cli.main(["submit", "submission", "--check", "--quiet"]) == 0
    rewrite(records.trial_folders(Path("submission"))[0], records.EVALUATIONS, better)
    capsys.readouterr()
    assert cli.main(["submit", "submission", "--check", "--quiet"]) == 1
    error = capsys.readouterr().err
    assert "1 of 2 trials are not verified, nothing is written; pp-p0-dqn-s100" in error
    wrong = str(records.trial_folders(Path("submission"))[0])
    rewrite(Path(wrong), records.EPISODES, lambda rows: rows[-1].update(step=STEPS + 1))
    told = submission.problems(Path(wrong))
    assert cli.main(["submit", wrong, "--check", "--quiet"]) == 1
    error = capsys.readouterr().err
    assert "the trial is not verified, nothing is written; pp-p0-dqn-s100" in error
    assert len(told) > 1 and " ".join(told) in error


def test_the_folder_of_a_submission_holds_its_trials_alone_and_is_no_source(runs, capsys):
    one, other = records.trial_folders(runs)
    submission.write([one, other], Path("submission"))
    shutil.rmtree(other)
    assert cli.main(["submit", "mine"]) == 2
    told = f"the folder 'submission' holds trials that are not in 'mine', as {other.name}: remove them"
    assert told in capsys.readouterr().err
    assert cli.main(["submit", "submission"]) == 2
    assert "already: usbench submit submission --check checks them." in capsys.readouterr().err
    Path("file").touch()
    assert cli.main(["submit", "mine", "--out", "file"]) == 2
    assert "'file' is a file: choose a folder with --out." in capsys.readouterr().err
    # Nobody is asked to remove a submission for the sake of a folder that is not there.
    assert cli.main(["submit", "mien"]) == 2
    assert "there is no trial in 'mien'" in capsys.readouterr().err


def test_what_is_added_without_being_verified_is_marked(runs, capsys, monkeypatch):
    monkeypatch.setattr("usbench.figures.comparison.write", lambda *_: [])
    known = collecting.collect(runs)
    tables.write(known.of(known.trials.head(0)), leaderboard.prepare(Path("leaderboard.md")))
    vpg = next(folder for folder in records.trial_folders(runs) if "-vpg-" in folder.name)
    rewrite(vpg, records.EVALUATIONS, better)
    assert cli.main(["leaderboard", "--add", "mine"]) == 0
    assert f"not verified, and marked so: {vpg.name}" in capsys.readouterr().err
    assert additions.unverified(Path("leaderboard_files")) == [vpg.name]
    text = Path("leaderboard.md").read_text()
    assert "| `vpg` (not verified) |" in text and "| `dqn` |" in text and f"`{vpg.name}`" in text
    # The same trial, whole again, has other numbers: it replaces the other, and the mark goes.
    rewrite(vpg, records.EVALUATIONS, lambda rows: rows[-1].update({"return": rows[-1]["return"] - 1.0}))
    assert cli.main(["leaderboard", "--add", "mine"]) == 0
    assert additions.unverified(Path("leaderboard_files")) == [vpg.name]
    assert cli.main(["leaderboard", "--add", "mine", "--replace"]) == 0
    assert additions.unverified(Path("leaderboard_files")) == []
    assert "not verified" not in Path("leaderboard.md").read_text()


@pytest.mark.parametrize(("options", "left"), [([], 1), (["--replace"], 0)])
def test_a_mark_goes_with_the_whole_trial_though_its_scores_are_the_same(runs, monkeypatch, options, left):
    """The recorded actions were damaged, of which no score tells."""
    monkeypatch.setattr("usbench.figures.comparison.write", lambda *_: [])
    known = collecting.collect(runs)
    folder, name = leaderboard.prepare(Path("leaderboard.md")), known.trials["trial"].iloc[0]
    tables.write(known, folder)
    additions.mark_unverified(folder, [name], [name])
    assert cli.main(["leaderboard", "--add", "mine", *options]) == 0
    assert additions.unverified(folder) == [name][:left]


def test_a_marked_trial_in_a_folder_of_another_name_keeps_its_mark(runs, monkeypatch):
    monkeypatch.setattr("usbench.figures.comparison.write", lambda *_: [])
    known = collecting.collect(runs)
    folder, name = leaderboard.prepare(Path("leaderboard.md")), known.trials["trial"].iloc[0]
    tables.write(known, folder)
    additions.mark_unverified(folder, [name], [name])
    (runs / name).rename(runs / "renamed")
    assert cli.main(["leaderboard", "--add", "mine", "--replace"]) == 0
    assert additions.unverified(folder) == [name]


def test_where_there_is_no_trial_one_sentence_says_so(tmp_path):
    with pytest.raises(ConfigurationError, match="there is no trial in"):
        submission.check(tmp_path)
