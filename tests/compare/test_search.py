"""The search: draws of each row's own, halving, records that are enough to go on from, one winner."""

import json
import re
import shutil
import tomllib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import protocols
import pytest
import torch
import trials
from filelock import Timeout

from usbench import records
from usbench.agents import search_space, zoo
from usbench.agents.hyperparameters import check
from usbench.agents.search_space import SPACES, Choice, Endless, Log, candidates
from usbench.compare import protocol, search, search_record
from usbench.compare.search_record import SearchRecord
from usbench.records.lock import lock_of
from usbench.trials import runner
from usbench.trials.configuration import resolve


class Quiet:
    expected = None

    def frames(self, done, total):
        pass

    def rung(self, number, n_rungs, scores):
        pass

    def started(self, n_finished, expected):
        self.expected = expected

    def ended(self, outcome):
        pass

    def retried(self, config):
        pass


class Stopping(Quiet):
    """Ctrl-C when so many trials have ended."""

    def __init__(self, n_trials):
        self.left = n_trials

    def ended(self, outcome):
        self.left -= 1
        if not self.left:
            raise KeyboardInterrupt


@pytest.fixture
def rules(tmp_path):
    return protocol.read(protocols.write(tmp_path))


def run(rules, folder, progress=None, row="a2c"):
    executor = {"executor": lambda: ThreadPoolExecutor(1)}
    return search.run(row, rules, folder / "search", folder / "runs", progress or Quiet(), **executor)


def lines(folder, row="a2c"):
    return [json.loads(line) for line in (folder / "search" / f"{row}.jsonl").read_text().splitlines()]


def scored(folder):
    names = ("rung", "candidate", "task", "noise", "seed", "steps", "score")
    return [tuple(one[name] for name in names) for one in lines(folder)[1:]]


@pytest.mark.parametrize("row", SPACES)
def test_space_holds_only_values_in_range(row):
    for name, space in SPACES[row].items():
        match space:
            case Log(low, high):
                assert check(name, low) == low < high == check(name, high)
            case Choice(values):
                assert [check(name, value) for value in values] == list(values)
            case Endless(rewards):
                assert all(check(name, reward / (1 - 0.99)) == reward / (1 - 0.99) for reward in rewards)


def test_every_row_that_learns_has_a_space_and_every_one_but_table_ii_searches_gamma():
    assert set(SPACES) == {row for row, entry in zoo.ZOO.items() if entry.learns and entry.compared}
    assert {row for row in SPACES if "gamma" not in SPACES[row]} == {"vpg"}


@pytest.mark.parametrize("row", SPACES)
def test_candidates_of_a_row_are_different_usable_and_of_its_own(row):
    drawn = candidates(row, 16)
    assert len({json.dumps(one) for one in drawn}) == 16
    assert candidates(row, 5) == drawn[:5]
    for one in drawn:
        assert set(one) == set(SPACES[row])
        for task in ("fp", "pp"):
            resolve(row, task, overrides=one)
    others = [candidates(other, 16) for other in SPACES if other != row]
    shared = Counter(one.get("learning_rate") for other in others for one in other)
    assert sum(one.get("learning_rate") in shared for one in drawn if "learning_rate" in one) <= 1


def test_value_starts_from_what_a_reward_per_step_sums_up_to():
    for one in candidates("vpg-tuned", 16):
        per_step = one["initial_value"] * (1 - one["gamma"])
        assert any(per_step == pytest.approx(reward) for reward in (0.0, -0.65, -1.3))


def test_space_that_is_too_small_is_refused(monkeypatch):
    monkeypatch.setattr(search_space, "SPACES", {"a2c": {"gamma": Choice((0.9, 0.99))}})
    with pytest.raises(ValueError, match="holds 2 different candidates, not 3"):
        candidates("a2c", 3)


def test_the_best_of_a_rung_go_on_and_the_best_of_the_last_wins(quick, rules, tmp_path):
    winner = run(rules, tmp_path)
    done = scored(tmp_path)
    first = [one for one in done if one[0] == 0]
    assert {one[1:4] for one in first} == {(k, "pp", noise) for k in range(3) for noise in (0.0, 0.5)}
    assert {one[4:6] for one in first} == {(1000, 32)}
    means = {k: sum(one[6] for one in first if one[1] == k) / 2 for k in range(3)}
    last = [one for one in done if one[0] == 1]
    assert {one[1] for one in last} == set(sorted(means, key=means.get, reverse=True)[:2])
    assert {one[4:6] for one in last} == {(1001, 64)}
    finals = {k: sum(one[6] for one in last if one[1] == k) / 2 for k in {one[1] for one in last}}
    assert winner.score == pytest.approx(max(finals.values()))
    assert winner.candidate == max(finals, key=finals.get)
    assert winner.hyperparameters == candidates("a2c", 3)[winner.candidate]
    rows = records.load(tmp_path / "runs")
    greedy = rows[rows["deterministic"] & (rows["checkpoint"] == rows["step"])]
    for one, line in zip(done, lines(tmp_path)[1:], strict=True):
        own = greedy[(greedy["trial"] == line["trial"]) & (greedy["step"] == one[5])]
        assert own["normalized_score"].mean() == pytest.approx(one[6], abs=1e-6)


def test_trials_of_a_search_are_evaluated_at_their_end_alone_and_train_alike(quick, rules, tmp_path):
    run(rules, tmp_path)
    searched = records.load_trials(tmp_path / "runs")[0]
    assert searched.evaluation_points == (searched.config.steps,)
    plain = records.Trial.read(runner.run_trial(searched.config, tmp_path / "plain").folder)
    assert len(plain.evaluation_points) > 1
    assert trials.bits(searched.folder)[-1] == trials.bits(plain.folder)[-1]
    for greedy in (True, False):
        one, other = (each.last_evaluation(deterministic=greedy) for each in (searched, plain))
        assert one.reset_index(drop=True).equals(other.reset_index(drop=True))


def test_search_that_was_stopped_ends_as_one_that_was_not(quick, rules, tmp_path):
    whole = run(rules, tmp_path / "whole")
    for n_trials in (1, 2, 3):
        with pytest.raises(KeyboardInterrupt):
            run(rules, tmp_path / "stopped", Stopping(n_trials))
    assert run(rules, tmp_path / "stopped") == whole
    assert sorted(scored(tmp_path / "stopped")) == sorted(scored(tmp_path / "whole"))


def test_search_goes_on_from_its_record_alone(quick, rules, tmp_path, monkeypatch):
    with pytest.raises(KeyboardInterrupt):
        run(rules, tmp_path / "one", Stopping(4))
    shutil.copytree(tmp_path / "one" / "search", tmp_path / "other" / "search")
    with (tmp_path / "other" / "search" / "a2c.jsonl").open("a") as file:
        file.write('{"rung": 0, "cand')  # torn by a crash
    calls, real = [], runner.run_trial
    monkeypatch.setattr(runner, "run_trial", lambda *args, **kw: (calls.append(args), real(*args, **kw))[1])
    progress = Quiet()
    winner = run(rules, tmp_path / "other", progress)
    assert len(calls) == 10 - 4
    assert progress.expected.seconds > 0 and progress.expected.told and not progress.expected.published
    assert run(rules, tmp_path / "one") == winner
    calls.clear()
    shutil.rmtree(tmp_path / "other" / "runs")
    assert run(rules, tmp_path / "other") == winner and not calls


def test_two_searches_of_a_row_at_once_record_every_trial_once(quick, rules, tmp_path):
    class Another(Quiet):
        """Another search of the row, from beginning to end, when the first trial has ended."""

        winner = None

        def ended(self, outcome):
            self.winner = self.winner or run(rules, tmp_path)

    progress = Another()
    assert run(rules, tmp_path, progress) == progress.winner
    assert len(scored(tmp_path)) == len({one[:5] for one in scored(tmp_path)}) == 10


def test_no_other_search_writes_while_a_torn_line_is_cut(quick, rules, tmp_path, monkeypatch):
    path, real, cuts = tmp_path / "search" / "a2c.jsonl", search_record.cut_torn_line, []

    def cut(record):
        with pytest.raises(Timeout):
            lock_of(path).acquire()
        cuts.append(record)
        real(record)

    monkeypatch.setattr(search_record, "cut_torn_line", cut)
    with pytest.raises(KeyboardInterrupt):
        run(rules, tmp_path, Stopping(2))
    assert cuts == [path, path]
    lock_of(path).acquire().lock.release()


def test_trial_that_ended_in_the_last_moment_before_a_kill_is_not_lost(quick, rules, tmp_path, monkeypatch):
    with pytest.raises(KeyboardInterrupt):
        run(rules, tmp_path, Stopping(2))
    path = tmp_path / "search" / "a2c.jsonl"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:2]))
    calls, real = [], runner.run_trial
    monkeypatch.setattr(runner, "run_trial", lambda *args, **kw: (calls.append(args), real(*args, **kw))[1])
    run(rules, tmp_path)
    assert len(calls) == 10 - 2


# What PyTorch's distributions say of logits that are no numbers.
INVALID = "Expected parameter logits to satisfy the constraint, but found invalid values: tensor([nan])"


def test_training_that_diverged_is_recorded_and_its_candidate_comes_last(quick, rules, tmp_path, monkeypatch):
    bad = candidates("a2c", 3)[1]["learning_rate"]
    real = runner._Run._train_and_evaluate

    def diverging(self, goes_on):
        if self.config.hyperparameters["learning_rate"] == bad:
            raise ValueError(INVALID)
        real(self, goes_on)

    monkeypatch.setattr(runner._Run, "_train_and_evaluate", diverging)
    run(rules, tmp_path)
    assert {one[1] for one in scored(tmp_path) if one[6] is None} == {1}
    assert {one[1] for one in scored(tmp_path) if one[0] == 1} == {0, 2}


@pytest.mark.parametrize("row", ["a2c", "dqn"])
def test_training_whose_weights_are_no_numbers_is_one_that_diverged(row, quick, tmp_path, monkeypatch):
    trials.diverge(monkeypatch, row)
    longer = ("steps = 32", "steps = 1024"), ("steps = 64", "steps = 1024")
    rules = protocol.read(protocols.write(tmp_path, ('rows = ["a2c", "vpg"]', f'rows = ["{row}"]'), *longer))
    with pytest.raises(RuntimeError, match=f"no candidate of {row} has a score"):
        run(rules, tmp_path, row=row)


@pytest.mark.parametrize("where", ["records", "runs"])
def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_simulated(where, rules, tmp_path):
    class Watching(Quiet):
        def frames(self, done, total):
            raise AssertionError("frames are simulated")

    (tmp_path / "file").write_text("")
    folders = {"records": tmp_path / "search", "runs": tmp_path / "runs", where: tmp_path / "file"}
    what = {"records": "folder of the records", "runs": "output folder"}[where]
    with pytest.raises(
        records.ConfigurationError, match=f"the {what} '.*file' cannot be written .* is a file"
    ):
        search.run("a2c", rules, folders["records"], folders["runs"], Watching())
    assert not (tmp_path / "search").exists() and not (tmp_path / "runs").exists()


def test_candidates_of_a_rung_are_told_with_their_scores(quick, rules, tmp_path):
    told = []

    class Telling(Quiet):
        def rung(self, number, n_rungs, scores):
            told.append((number, n_rungs, scores))

        def ended(self, outcome):
            told.append(outcome.title)

    winner = run(rules, tmp_path, Telling())
    assert told[0] == (1, 2, dict.fromkeys(range(3)))
    assert sorted(title[-11:] for title in told[1:7]) == sorted(2 * [f"candidate {k}" for k in range(3)])
    number, n_rungs, scores = told[7]
    assert (number, n_rungs) == (2, 2) and winner.candidate in scores
    assert [*scores.values()] == sorted(scores.values(), reverse=True)


def test_the_protocol_in_the_documentation_is_one(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    rules = protocol.read(protocols.write(tmp_path, text=example))
    assert rules.search.n_trials() == (4, 2) and not rules.is_of_the_package


def test_search_in_which_every_training_diverged_has_no_winner(quick, rules, tmp_path, monkeypatch):
    def diverging(self, goes_on):
        raise ValueError(INVALID)

    monkeypatch.setattr(runner._Run, "_train_and_evaluate", diverging)
    with pytest.raises(RuntimeError, match="no candidate of a2c has a score"):
        run(rules, tmp_path)


def no_space(*_):
    raise OSError(28, "No space left on device")


def no_memory(*_):
    torch.empty(1 << 52)


def no_thread(*_):
    raise RuntimeError("can't start new thread")


@pytest.mark.parametrize(
    ("fail", "said"),
    [
        (no_space, "No space left"),
        (no_memory, "can't allocate memory"),
        (no_thread, "can't start new thread"),
    ],
)
def test_trial_that_the_machine_failed_is_tried_again(quick, rules, tmp_path, monkeypatch, fail, said):
    with monkeypatch.context() as full:
        full.setattr(runner._Run, "_train_and_evaluate", fail)
        with pytest.raises(RuntimeError, match=f"6 of 6 trials failed.*{said}.*tries them again"):
            run(rules, tmp_path)
    assert not (tmp_path / "search").exists()
    assert len(scored(tmp_path)) == 10 if run(rules, tmp_path) else None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("steps = 64", "steps = 128"), "was begun under another protocol"),
        (("noises = [0.0]", "noises = [0.25]"), "was begun under another protocol"),
    ],
)
def test_protocol_that_changed_after_the_first_trial_is_refused(quick, rules, tmp_path, change, said):
    with pytest.raises(KeyboardInterrupt):
        run(rules, tmp_path, Stopping(1))
    changed = protocol.read(protocols.write(tmp_path, change))
    with pytest.raises(records.ConfigurationError) as refused:
        run(changed, tmp_path)
    assert said in str(refused.value) and str(refused.value).count(".jsonl") == 1


@pytest.mark.parametrize(
    ("place", "name", "value", "said"),
    [
        (SPACES, "a2c", {**SPACES["a2c"], "gamma": Choice((0.9, 0.99))}, "with another search space"),
        (zoo.ZOO, "a2c", zoo.ZOO["ppo"], "with other values of what is not searched"),
    ],
)
def test_search_resumed_with_another_space_is_refused(
    quick, rules, tmp_path, monkeypatch, place, name, value, said
):
    with pytest.raises(KeyboardInterrupt):
        run(rules, tmp_path, Stopping(1))
    if place is SPACES:
        monkeypatch.setattr(search_space, "SPACES", {**SPACES, name: value})
        monkeypatch.setattr("usbench.compare.search_record.SPACES", search_space.SPACES)
    else:
        monkeypatch.setitem(place, name, value)
    with pytest.raises(records.ConfigurationError, match=said):
        run(rules, tmp_path)


def test_row_that_the_protocol_does_not_search_is_refused(rules, tmp_path):
    with pytest.raises(records.ConfigurationError, match="did you mean 'a2c'"):
        run(rules, tmp_path, row="a2")


def test_damaged_record_is_refused(quick, rules, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(rules, tmp_path, Stopping(1))
    path = tmp_path / "search" / "a2c.jsonl"
    path.write_text("nonsense\n" + path.read_text())
    with pytest.raises(ValueError, match="line 1"):
        run(rules, tmp_path)


def test_record_of_a_trial_that_lacks_something_is_refused(quick, rules, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(rules, tmp_path, Stopping(1))
    path = tmp_path / "search" / "a2c.jsonl"
    head, one = path.read_text().splitlines()
    for missing in ("candidate", "score", "training_s"):
        rest = {name: value for name, value in json.loads(one).items() if name != missing}
        path.write_text(f"{head}\n{json.dumps(rest)}\n")
        with pytest.raises(ValueError, match=rf"a2c.jsonl' is damaged: a trial has no '{missing}'"):
            run(rules, tmp_path)
    path.write_text(f"{head}\n{json.dumps(json.loads(one) | {'candidate': [1]})}\n")
    with pytest.raises(ValueError, match=r"a2c.jsonl' is damaged: unhashable type: 'list'"):
        run(rules, tmp_path)


def test_folder_that_cannot_be_written_is_refused(quick, rules, tmp_path):
    (tmp_path / "runs").write_text("")
    with pytest.raises(records.ConfigurationError, match="choose another folder"):
        run(rules, tmp_path)


def test_the_table_of_algorithms_takes_the_winner_of_the_own_protocol_alone(
    quick, rules, tmp_path, monkeypatch
):
    for module in (zoo, search):
        monkeypatch.setattr(module, "WINNERS", tmp_path / "winners.json")
    zoo.WINNERS.write_text('{"ppo": {"hyperparameters": {"gamma": 0.5}}}')
    run(rules, tmp_path)
    assert set(zoo.winners()) == {"ppo"}
    # The same search, of the benchmark's own protocol now.
    own = tomllib.loads((tmp_path / "protocol.toml").read_text())
    monkeypatch.setattr(protocol, "own_protocol", lambda: own)
    winner = run(rules, tmp_path)
    assert set(zoo.winners()) == {"ppo", "a2c"} and zoo.winners()["a2c"]["protocol"] == rules.digest
    rows = zoo._with_winners(zoo.UNSEARCHED)
    assert rows["ppo"].hyperparameters["gamma"] == 0.5
    assert rows["a2c"].hyperparameters == {**zoo.UNSEARCHED["a2c"].hyperparameters, **winner.hyperparameters}


def test_winners_that_cannot_be_written_are_refused_before_the_first_trial(
    quick, rules, tmp_path, monkeypatch
):
    (tmp_path / "agents").touch()
    winners = tmp_path / "agents" / "winners.json"
    monkeypatch.setattr(search, "WINNERS", winners)
    own = tomllib.loads((tmp_path / "protocol.toml").read_text())
    monkeypatch.setattr(protocol, "own_protocol", lambda: own)
    with pytest.raises(
        records.ConfigurationError, match=f"the table of winners '{winners}' cannot be written"
    ):
        run(rules, tmp_path)
    assert not (tmp_path / "runs").exists()


def test_record_says_what_was_searched(quick, rules, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(rules, tmp_path, stopping := Stopping(1))
    # Before the first trial of the search; of 6, 2 and 2 trials in its rungs, 4 come later.
    assert stopping.expected.published and len(stopping.expected.each) == 6 and stopping.expected.later > 0
    head, one = lines(tmp_path)
    assert head["row"] == "a2c" and head["protocol"] == rules.digest
    assert head["candidates"] == list(candidates("a2c", 3))
    assert one["training_s"] > 0 and SearchRecord(tmp_path / "search", "a2c", rules).seconds_per_step() > 0
