"""How hard each row is to tune: order statistics by hand, and records that are complete or are not."""

import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_tables import made, seeds

from usbench import cli
from usbench.checks import ConfigurationError
from usbench.compare import protocol
from usbench.figures import score_axis
from usbench.figures import tuning as drawn
from usbench.results import leaderboard, tables
from usbench.results.protocol import tuning

TOP = Path(__file__).parents[2]
PROTOCOL = protocol.read().digest
CELLS = [(task, noise) for task in ("fp", "pp") for noise in (0.0, 0.5)]


def record(folder, row, scores, *, cells=CELLS, later=()):
    """Write the record of a search: the score of a candidate in all cells, None where it diverged."""
    trials = [
        {"rung": 0, "candidate": number, "task": task, "noise": noise, "seed": 1000, "score": score}
        for number, score in enumerate(scores)
        for task, noise in cells
    ]
    lines = [{"row": row, "protocol": PROTOCOL, "candidates": [{} for _ in scores]}, *trials, *later]
    (folder / f"{row}.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in lines))


def test_expected_best_is_the_mean_over_all_subsets():
    scores = np.random.default_rng(0).normal(size=7)
    by_hand = [np.mean([max(own) for own in combinations(scores, n)]) for n in range(1, 8)]
    assert tuning.expected_best(scores) == pytest.approx(by_hand)


def test_expected_best_of_stacks_and_of_what_diverged():
    found = tuning.expected_best(np.array([[0.2, 0.6], [np.nan, 0.6]]))
    assert found == pytest.approx(np.array([[0.4, 0.6], [0.3, 0.6]]))


def test_the_best_of_more_than_4_has_no_interval():
    best = tuning.expected(np.linspace(0.1, 0.9, 16))
    for end in (best.low, best.high):
        assert np.isnan(end).tolist() == [False] * 4 + [True] * 12
    known = pd.DataFrame(
        [["vpg", number, "fp", 0.0, 1000, number / 10, 0] for number in range(8)],
        columns=list(tuning.COLUMNS),
    )
    four, eight = tuning.section(known).splitlines()[-1].split(" | ")[6:8]
    assert "[" in four and eight == "0.70"


def test_interval_rises_and_ends_at_the_best():
    best = tuning.resampled(np.linspace(0.1, 0.9, 16))
    assert (np.diff(best.estimate) > 0).all()
    assert (best.low <= best.estimate).all() and (best.estimate <= best.high).all()
    assert best.estimate[-1] == best.high[-1] == pytest.approx(0.9)


def test_the_winner_has_its_score_with_the_whole_budget_where_all_finalists_are_finished(tmp_path):
    later = [
        {"rung": 1, "candidate": one, "task": task, "noise": noise, "seed": seed, "score": 0.1 * one}
        for one in (3, 5, 7)
        for task, noise in CELLS
        for seed in (1001, 1002)
    ]
    record(tmp_path, "vpg", [0.5] * 8, later=later)
    record(tmp_path, "ppo", [0.4] * 8, later=later[:-1])
    known = tuning.gather(tmp_path)
    assert tuning.winners(known) == {"vpg": pytest.approx(0.7)}
    vpg, ppo = tuning.section(known).splitlines()[-2:]
    assert vpg.endswith("| 0.70 |") and ppo.endswith("| – |")
    assert len(tuning.candidates(known)["vpg"]) == 8


def test_tables_without_the_finalists_are_read(tmp_path):
    record(tmp_path, "vpg", [0.1, 0.3])
    known = tuning.gather(tmp_path)
    tuning.write(known.drop(columns="rung"), tmp_path)
    assert tuning.section(tuning.read(tmp_path)) == tuning.section(known)


def test_the_winners_are_those_of_the_committed_records():
    chosen = json.loads((TOP / "agents" / "winners.json").read_text())
    known = tuning.gather(TOP / "search")
    last = (
        known[known["rung"] == len(protocol.read().search.rungs) - 1]
        .groupby(["row", "candidate"])["score"]
        .mean()
    )
    assert set(chosen) == set(last.index.get_level_values("row"))
    for row, winner in chosen.items():
        head = json.loads((TOP / "search" / f"{row}.jsonl").read_text().splitlines()[0])
        assert last[row].idxmax() == winner["candidate"]
        assert last[row].max() == pytest.approx(winner["score"], abs=5e-5)
        assert head["candidates"][winner["candidate"]] == winner["hyperparameters"]


def test_only_complete_first_rungs_count(tmp_path):
    later = {"rung": 1, "candidate": 0, "task": "fp", "noise": 0.0, "seed": 1001, "score": 1.0}
    record(tmp_path, "vpg", [0.1, 0.5], later=[later])
    record(tmp_path, "ppo", [0.1, 0.5], cells=CELLS[:3])
    known = tuning.gather(tmp_path)
    assert {row: list(own) for row, own in tuning.candidates(known).items()} == {"vpg": [0.1, 0.5]}
    assert "`vpg-tuned`, `a2c`, `ppo`" in tuning.section(known)


def test_a_trial_that_was_recorded_twice_counts_once(tmp_path):
    record(tmp_path, "vpg", [0.1, 0.5])
    once = tuning.gather(tmp_path)
    path = tmp_path / "vpg.jsonl"
    path.write_text(path.read_text() + path.read_text().splitlines(keepends=True)[-1])
    pd.testing.assert_frame_equal(tuning.gather(tmp_path), once)


def test_the_row_with_the_best_candidate_comes_first(tmp_path):
    record(tmp_path, "a2c", [0.7, 0.7])
    record(tmp_path, "ppo", [0.1, 0.9])
    assert list(tuning.candidates(tuning.gather(tmp_path))) == ["ppo", "a2c"]


def test_a_candidate_that_diverged_in_one_cell_diverged(tmp_path):
    record(tmp_path, "dqn", [0.4, 0.8])
    text = (tmp_path / "dqn.jsonl").read_text()
    (tmp_path / "dqn.jsonl").write_text(text.replace("0.8", "null", 1))
    row = tuning.section(tuning.gather(tmp_path)).splitlines()[-1]
    assert row.startswith("| `dqn` | 2 | 1 | 0.00 / 0.10 / 0.20 / 0.30 / 0.40 | 0.20 [")
    assert row.endswith("| – | – | – | – |")


def test_table_is_read_as_it_was_written(tmp_path):
    record(tmp_path, "vpg", [0.1, None])
    known = tuning.gather(tmp_path)
    tuning.write(known, tmp_path)
    assert tuning.section(tuning.read(tmp_path)) == tuning.section(known)
    assert tuning.read(tmp_path / "nowhere").empty


def test_folder_without_records_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="there is no record of a search in"):
        tuning.gather(tmp_path)


def test_a_search_by_another_protocol_is_refused(tmp_path):
    record(tmp_path, "vpg", [0.1, 0.5])
    path = tmp_path / "vpg.jsonl"
    path.write_text(path.read_text().replace(PROTOCOL, "0" * 16))
    with pytest.raises(
        ConfigurationError, match=r"^'[^']*vpg.jsonl' is the record of a search by another protocol\.$"
    ):
        tuning.gather(tmp_path)


HEAD = json.dumps({"row": "vpg", "protocol": PROTOCOL, "candidates": [{}]})


@pytest.mark.parametrize("content", ["{}\n", "[]\n", f"{HEAD}\n{{}}\n", "", "no\n"])
def test_damaged_records_are_refused(tmp_path, content):
    (tmp_path / "vpg.jsonl").write_text(content)
    with pytest.raises(ConfigurationError, match="is not the record of a search"):
        tuning.gather(tmp_path)


def test_table_of_something_else_is_refused(tmp_path):
    (tmp_path / tuning.TABLE).write_text("row,candidate\nvpg,0\n")
    with pytest.raises(ValueError, match="is not a table of a search"):
        tuning.read(tmp_path)


def test_committed_records_are_those_of_the_committed_table():
    known = tuning.read(TOP / "leaderboard_files")
    again = tuning.gather(TOP / "search").set_index(list(tuning.COLUMNS[:5]))
    # Rows that were searched since are not in the table before the leaderboard is written again.
    assert len(known) and again.loc[known.set_index(again.index.names).index, "score"].tolist() == (
        known["score"].tolist()
    )


def test_the_command_writes_table_section_and_figure_and_again_the_same_bytes(tmp_path, capsys):
    record(tmp_path, "vpg", [0.1, 0.5, 0.7])
    record(tmp_path, "ppo", [0.2, None, 0.3])
    board = tmp_path / "leaderboard.md"
    tables.write(made(*seeds("vpg", [0.5])), leaderboard.files(board))
    assert cli.main(["leaderboard", "--search", str(tmp_path), "--leaderboard", str(board)]) == 0
    figure = leaderboard.files(board) / "tuning.png"
    assert str(figure) in capsys.readouterr().out.splitlines()
    section = board.read_text().split("## How hard each is to tune\n")[1].split("\n## ")[0]
    assert section.index(tuning.ABOUT) < section.index("<summary>Scores of candidates (2 rows)</summary>")
    assert section.index("<details>") < section.index("| row |") < section.index("</details>")
    before = [path.read_bytes() for path in (board, figure)]
    assert cli.main(["leaderboard", "--leaderboard", str(board)]) == 0
    assert [path.read_bytes() for path in (board, figure)] == before


def test_scores_of_the_figure_begin_at_0_and_the_lowest_below_has_its_number(tmp_path):
    record(tmp_path, "vpg", [-0.7, -0.31, 0.1])
    spread, best = drawn.draw(tuning.gather(tmp_path)).axes
    assert spread.get_xlim()[0] == best.get_ylim()[0] == 0
    assert [text.get_text() for text in spread.texts] == ["-0.70"]
    (circles,) = [line for line in spread.lines if line.get_marker() == "o"]
    assert list(circles.get_xdata()) == pytest.approx([0.1])
    marks = [line for line in best.lines if line.get_marker() == score_axis.DOWN]
    assert [line.get_xdata()[0] for line in marks] == [1, 2]  # -0.91 / 3, (-0.31 + 2 * 0.1) / 3


def test_figure_has_a_line_for_each_row_and_none_without_rows(tmp_path):
    record(tmp_path, "vpg", [0.1, 0.5, 0.7])
    record(tmp_path, "ppo", [0.2, None, 0.3])
    spread, best = drawn.draw(tuning.gather(tmp_path)).axes
    assert [label.get_text() for label in spread.get_yticklabels()] == ["vpg", "ppo"]
    assert [line.get_label() for line in best.lines if not line.get_label().startswith("_")] == ["vpg", "ppo"]
    assert best.lines[0].get_ydata()[-1] == 0.7
    assert drawn.draw(tuning.read(tmp_path)) is None
