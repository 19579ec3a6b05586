"""The leaderboard: what a reader sees, and the same bytes from the same results."""

import html
import re

import pandas as pd
import pytest
from made_tables import made, seeds, trial
from markdown_it import MarkdownIt

from usbench.checks import ConfigurationError
from usbench.results import leaderboard, tables

GRID = [
    *seeds("vpg", [0.5, 0.6, 0.7, 0.8]),
    *seeds("ppo", [0.90, 0.91, 0.92, 0.93]),
    trial("ppo", seed=4, status="failed", reason="OSError: disk full"),
    trial("oracle", 1.0),
    trial("random", -0.0001),
]


def lines(text, start):
    return [line for line in text.splitlines() if line.startswith(start)]


def test_same_results_same_bytes_whatever_their_order(tmp_path):
    contents = []
    for name, trials in (("a", GRID), ("b", GRID[::-1]), ("c", GRID)):
        tables.write(made(*sorted(trials, key=lambda row: (row["algo"], row["seed"]))), tmp_path / name)
        paths = leaderboard.write(tmp_path / name, tmp_path / name / "leaderboard.md")
        contents.append([path.read_bytes() for path in paths])
    assert contents[0] == contents[1] == contents[2]


def test_opens_with_the_answer():
    text = leaderboard.markdown(made(*GRID))
    title, answer = text.split("\n\n")[:2]
    assert title == "# Leaderboard"
    assert answer.startswith(
        "So far 8 of 9 trials are finished. A first look and no ranking: only 4 seeds, where"
    )


def test_rows_are_ranked_with_reference_policies_last():
    text = leaderboard.markdown(made(*GRID))
    cell = text.split("## fp, noise 0")[1].split("## How")[0]
    agents = [line.split(" | ")[0].strip("| ") for line in lines(cell, "| `")]
    assert agents == ["`ppo`", "`vpg`", "`oracle` (not learned)", "`random` (not learned)"]


def test_who_has_a_teacher_is_shown_as_a_ceiling_and_ranked_nowhere():
    taught = [*seeds("distilled", [0.97] * 5), *seeds("distilled", [0.9] * 5, noise=0.25)]
    own = [row for algo, score in (("vpg", 0.5), ("ppo", 0.9)) for row in seeds(algo, [score] * 5)]
    plain, with_teacher = leaderboard.markdown(made(*own)), leaderboard.markdown(made(*own, *taught))
    cell = with_teacher.split("## fp, noise 0")[1].split("## ")[0]
    agents = [line.split(" | ")[0].strip("| ") for line in lines(cell, "| `")]
    assert agents == ["`ppo`", "`vpg`", "`distilled` (practical ceiling, not ranked)"]
    # Neither the verdict nor anything that compares agents knows of it.
    answer, compared = (
        [text.split("\n\n")[1], text.split("## Probability of improvement")[1].split("## fp")[0]]
        for text in (plain, with_teacher)
    )
    assert answer == compared and "`ppo` has the highest score" in answer[0]


def test_rows_with_a_trial_that_is_not_verified_say_so_and_no_others_do():
    taught = seeds("distilled", [0.97] * 5)
    others = [
        row for algo in ("vpg", "ppo") for noise in (0.0, 0.25) for row in seeds(algo, [0.5] * 5, noise=noise)
    ]
    wrong = [taught[0]["trial"], others[0]["trial"]]
    text = leaderboard.markdown(made(*others, *taught), unverified=[*wrong, "of another table"])
    together, first, second = (
        text.split(f"## {name}")[1].split("\n## ")[0]
        for name in ("All cells", "fp, noise 0\n", "fp, noise 0.25")
    )
    for part, marked in ((together, True), (first, True), (second, False)):
        assert ("| `vpg` (not verified) |" in part) == marked and "| `ppo` |" in part
    assert "| `distilled` (practical ceiling, not ranked, not verified) |" in first
    assert text.count("(not verified)") == 2
    assert text.rstrip().endswith(f"(`usbench submit`): `{wrong[0]}`, `{wrong[1]}`.")


def test_how_much_seeds_matter_for_single_agents_stands_beside_the_share_of_all():
    cells = [("fp", 0.0), ("fp", 0.25), ("pp", 0.0)]
    lucky, mixed = [0.1, 0.3, 0.5, 0.7, 0.9], [[0.5, 0.1, 0.9, 0.3, 0.7], [0.3, 0.9, 0.5, 0.7, 0.1]]
    trials = [
        row
        for place, (task, noise) in enumerate(cells)
        for algo, own in (("a2c", lucky), ("ppo", [lucky, *mixed][place]))
        for row in seeds(algo, own, task=task, noise=noise)
    ]
    text = leaderboard.markdown(made(*trials))
    shares = re.search(r"(\d+) % are common to all cells of a seed \((\d+) % to (\d+) % for single", text)
    assert shares and int(shares[2]) < int(shares[1]) < int(shares[3]) == 100


def test_numbers_of_a_row():
    text = leaderboard.markdown(made(*seeds("vpg", [0.5, 0.5])))
    row = lines(text.split("## fp, noise 0")[1], "| `vpg`")[0]
    assert [entry.strip() for entry in row.strip("|").split("|")] == [
        "`vpg`",
        "2/2",
        "0.500 [0.500, 0.500]",
        "0.400 [0.400, 0.400]",
        "-13.00",
        "25",
    ]
    assert "optimum -5.00 (score 1), random agent -21.00 (score 0), idle agent -22.60 (score -0.10)" in text


def test_missing_seeds_are_seen_and_named():
    text = leaderboard.markdown(made(*GRID))
    assert len(lines(text, "| `ppo` | 4/5 |")) == 2
    assert "`ppo` on fp, noise 0: seed 4 failed (OSError: disk full)." in text


def test_no_number_is_a_dash_and_minus_zero_is_zero():
    text = leaderboard.markdown(made(*GRID, trial("a2c", status="missing")))
    assert "nan" not in text.lower()
    assert "| `a2c` | 0/5 | – | – | – |" in text
    assert (
        "| `random` (not learned) | 1/1 | 0.000 [" not in text
        and "| 1/1 | 0.000 |" in lines(text, "| `random`")[-1]
    )
    assert "-0.000" not in text


def test_improvement_is_bold_where_it_is_sure():
    low, high = [0.1, 0.2, 0.3, 0.4, 0.5], [0.6, 0.7, 0.8, 0.9, 0.95]
    text = leaderboard.markdown(made(*seeds("vpg", low), *seeds("ppo", high)))
    assert "| `ppo` | – | **1.00** |" in text and "| `vpg` | **0.00** | – |" in text
    assert "bold where the 95 % interval leaves out one half" in text
    text = leaderboard.markdown(made(*seeds("vpg", low), *seeds("ppo", low)))
    assert "| `ppo` | – | 0.50 |" in text
    text = leaderboard.markdown(made(*seeds("vpg", low[:4]), *seeds("ppo", high[:4])))
    assert "| `ppo` | – | 1.00 |" in text


def test_level_of_three_agents_is_for_three_pairs():
    trials = [*seeds("vpg", [0.1] * 5), *seeds("ppo", [0.2] * 5), *seeds("a2c", [0.3] * 5)]
    assert "98.33 % interval, which is 1 - 0.05 / 3 for 3 pairs," in leaderboard.markdown(made(*trials))


def test_other_tasks_have_a_table_of_their_own():
    exam = [trial(algo, score, task="exam", steps=32_128) for algo, score in (("vpg", 0.2), ("ppo", 0.3))]
    text = leaderboard.markdown(made(*seeds("vpg", [0.5]), *seeds("a2c", [0.6]), *exam))
    assert lines(text, "## ")[:4] == [
        "## The paper's tasks together",
        "## Probability of improvement: the paper's tasks",
        "## The other tasks together",
        "## Probability of improvement: the other tasks",
    ]
    assert "is not in the table" not in text
    assert "`a2c` has the highest score: 0.60 over 1 of the 6 cells" in text.split("\n\n")[1]
    assert "(fp, noise 0)" in text.split("\n\n")[1]


@pytest.mark.parametrize("n_seeds", [4, 5])
def test_ranks_are_told_of_agents_with_enough_seeds(n_seeds):
    trials = [*seeds("vpg", [0.5] * 5), *seeds("a2c", [0.6] * n_seeds)]
    headings = lines(leaderboard.markdown(made(*trials)), "## ")
    assert ("## Stability of ranks" in headings) == (n_seeds == 5)
    # One with fewer takes them from nobody.
    text = leaderboard.markdown(made(*trials, *seeds("ppo", [0.7] * 5)))
    ranks = text.split("## Stability of ranks")[1].split("</details>")[0]
    assert ("| `a2c` |" in ranks) == (n_seeds == 5) and "| `ppo` |" in ranks


def test_environments_with_exact_returns_of_their_own_are_said():
    mine = trial("a2c", optimal=-2.0, settings='{"environment": "mine"}')
    text = leaderboard.markdown(made(trial("vpg"), mine))
    assert "The trials are from different environments: each has exact returns of its own." in text
    assert "## All cells together" not in text and "no agent can be compared over all cells" in text
    assert "All trials (2) are finished, but trials of fp, noise 0 are from different environments." in text


def test_anchors_that_differ_by_less_than_is_shown_are_the_same():
    trials = [trial("vpg"), trial("vpg", seed=1, random=-21.00004, stay=-22.59996)]
    text = leaderboard.markdown(made(*trials))
    assert "Exact returns: optimum -5.00 (score 1), random agent -21.00 (score 0), idle agent -22.60" in text


def test_agent_outside_the_table_of_all_cells_is_explained():
    known = made(*seeds("vpg", [0.5, 0.6]), *seeds("vpg", [0.5, 0.6], task="pp"), trial("ppo", 0.9))
    assert (
        "`ppo` has no row that covers all cells: no finished trial in pp, noise 0."
        in leaderboard.markdown(known)
    )


def test_another_configuration_is_a_row_of_its_own_and_leaves_the_headline_as_it_was():
    grid = [*seeds("vpg", [0.5, 0.6]), *seeds("ppo", [0.9, 0.8])]
    other = trial(
        "vpg", 0.7, configuration="00000002", trial="b", settings='{"environment": "e", "gamma": 0.9}'
    )
    before, after = leaderboard.markdown(made(*grid)), leaderboard.markdown(made(*grid, other))
    for row in ("| `vpg` | 2/2 |", "| `ppo` | 2/2 |"):
        assert lines(before, row)[0] == lines(after, row)[0]
    assert "| `vpg gamma=0.9` | 1/2 | 0.700 |" in after
    assert (
        "`vpg` on fp, noise 0 ran in 2 configurations, each in a row of its own: `vpg` has gamma=0.99; "
        "`vpg gamma=0.9` has gamma=0.9." in after
    )


def test_nothing_finished_is_a_leaderboard_too(tmp_path):
    tables.write(made(trial("vpg", status="missing", optimal=float("nan"))), tmp_path)
    text = leaderboard.write(tmp_path, tmp_path / "leaderboard.md")[0].read_text()
    assert "No trial has begun." in text and "| `vpg` | 0/1 |" in text
    tables.write(made(), tmp_path)
    assert leaderboard.write(tmp_path, tmp_path / "leaderboard.md")[0].read_text().startswith("# Leaderboard")


def test_scores_open_in_pandas_in_one_line(tmp_path):
    tables.write(made(*GRID), tmp_path)
    leaderboard.write(tmp_path, tmp_path / "leaderboard.md")
    table = pd.read_csv(tmp_path / "scores.csv", dtype={"configuration": str})
    row = table.query("algo == 'vpg' and actions == 'greedy'").iloc[0]
    assert (row["seeds"], row["seeds_asked"], row["score"]) == (4, 5, 0.65)


def test_leaderboards_in_one_folder_have_scores_of_their_own(tmp_path):
    tables.write(made(*GRID), tmp_path)
    leaderboard.write(tmp_path, tmp_path / "leaderboard.md")
    before = (tmp_path / "scores.csv").read_bytes()
    tables.write(made(*seeds("vpg", [0.1])), tmp_path)
    text, table = leaderboard.write(tmp_path, tmp_path / "mine.md")
    assert table.name == "mine_scores.csv" and "`mine_scores.csv` has sampled actions" in text.read_text()
    assert (tmp_path / "scores.csv").read_bytes() == before != table.read_bytes()


@pytest.mark.parametrize("name", ["scores.csv", "board.txt", "board"])
def test_a_leaderboard_is_markdown(tmp_path, name):
    with pytest.raises(ConfigurationError, match=rf"must end with \.md, not '.*{name}'"):
        leaderboard.prepare(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_folder_without_results_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no trials\.csv"):
        leaderboard.write(tmp_path, tmp_path / "leaderboard.md")


def test_tables_of_cells_are_folded_and_have_six_columns():
    text = leaderboard.markdown(made(*GRID))
    cell = text.split("## fp, noise 0")[1].split("## How")[0]
    assert cell.index("<details>") < cell.index("| agent |") < cell.index("</details>")
    assert lines(cell, "| agent |") == [
        "| agent | seeds | score, greedy | score, sampled | return | success (%) |"
    ]
    assert text.count("<details>") == text.count("</details>") >= 3


def test_figures_that_are_drawn_stand_after_the_verdict(tmp_path):
    tables.write(made(*GRID), tmp_path / "board_files")
    for name in ("scores", "improvement"):
        (tmp_path / "board_files" / f"{name}.png").write_bytes(b"")
    leaderboard.write(tmp_path / "board_files", tmp_path / "board.md")
    text = (tmp_path / "board.md").read_text()
    *_, first, second, _ = text[: text.index("<details>")].split("\n\n")
    assert first.startswith("![Score of every agent") and first.endswith("(board_files/scores.png)")
    assert second.startswith("![How likely") and second.endswith("(board_files/improvement.png)")
    assert "learning_curves.png" not in text


@pytest.mark.parametrize("name", ["a|b", "a`b", "<img src=x>", "a &amp; b", "a\nb"])
def test_a_name_breaks_neither_its_table_nor_the_page(name):
    text = leaderboard.markdown(made(*seeds(name, [0.5] * 5), *seeds("vpg", [0.6] * 5)))
    shown = MarkdownIt().enable("table").render(text)
    assert f"<td><code>{html.escape(name)}</code></td>" in " ".join(shown.split("\n")) or "\n" in name
    assert "<img" not in shown
    for row in lines(text, "| "):
        assert row.count("|") in {5, 4, 7, 9}
