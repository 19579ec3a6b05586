"""Plain scripts beside the agents here: both are trained and scored, once, and compared as samples."""

import sys

import same_scores

STEPS = 32


def test_both_programs_are_scored_once_and_compared(quick, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(same_scores, "ROWS", tmp_path / "scores.csv")
    monkeypatch.setattr(same_scores, "SEEDS", range(2))
    monkeypatch.setattr(sys, "argv", ["same_scores.py", "--algos", "vpg", "a2c", "--steps", str(STEPS)])
    same_scores.main()
    rows = same_scores.known()
    assert [(row["algo"], row["program"], row["seed"]) for row in rows] == [
        (algo, program, seed) for seed in "01" for algo in ("vpg", "a2c") for program in ("here", "plain")
    ]
    # From the same weights and draws, less than a rollout makes the same agent.
    ours, theirs = ([row["score"] for row in rows[2:4]], [row["score"] for row in rows[6:8]])
    assert len(set(ours)) == len(set(theirs)) == 1
    capsys.readouterr()
    same_scores.main()
    shown = capsys.readouterr().out
    assert same_scores.known() == rows and "of 8:" not in shown
    assert "a2c" in shown and "+0.000" in shown


def test_differences_have_welchs_interval():
    # Student's interval, since variances and sizes are equal: t(0.975, 2) = 4.3027.
    assert same_scores.difference([0.0, 1.0], [1.0, 2.0]) == "+1.000 [-2.042, +4.042]"
