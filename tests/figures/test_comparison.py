"""Figures from results alone: drawn where there is something to draw, the same bytes again."""

import pytest
from made_tables import made, seeds, trial
from PIL import Image

from usbench.figures import comparison, paper, style

GRID = [
    row
    for algo, score in (("vpg", 0.5), ("ppo", 0.9))
    for task in ("fp", "pp")
    for noise in (0.0, 0.5)
    for row in seeds(algo, [score - noise / 5, score - noise / 4, score], task=task, noise=noise)
]
NAMES = [
    "scores",
    "learning_curves",
    "learning_curves_cpu",
    "performance_profiles",
    "improvement",
    "figure4",
    "figure5",
]


def test_every_figure_is_drawn(tmp_path):
    # And the same bytes again: see tests/compare/test_compare.py.
    paths = comparison.write(made(*GRID, trial("random", 0.0)), tmp_path)
    assert [path.name for path in paths] == [f"{name}.png" for name in NAMES]
    for path in paths:
        with Image.open(path) as image:
            assert image.width >= 800 and len(image.convert("L").getcolors()) > 10


@pytest.mark.parametrize("kind", ["svg", "pdf"])
def test_vector_formats_are_the_same_bytes_again(tmp_path, kind):
    figure = comparison.draw(made(*GRID))["performance_profiles"]
    first = style.save(figure, tmp_path / f"a.{kind}").read_bytes()
    assert style.save(figure, tmp_path / f"b.{kind}").read_bytes() == first


@pytest.mark.parametrize(
    ("trials", "names"),
    [
        ([], []),
        ([trial("vpg", status="running")], []),
        ([trial("oracle", 1.0)], ["scores"]),
        ([trial("vpg", 0.5)], [name for name in NAMES if name != "improvement"]),
        # One seed each: no interval anywhere.
        ([trial("vpg", 0.5), trial("ppo", 0.7)], NAMES),
    ],
    ids=["nothing", "unfinished", "not learned", "one agent", "one seed"],
)
def test_only_what_there_is_to_draw(tmp_path, trials, names):
    assert [path.stem for path in comparison.write(made(*trials), tmp_path)] == names


def test_paper_figures_draw_mean_and_deviation_over_seeds():
    figure = paper.figure4(made(*seeds("vpg", [0.2, 0.4])))
    (axis,) = figure.axes
    (bars,) = axis.containers
    line, _, (sticks,) = bars.lines
    # The last fiftieth: returns -21 + 16 * 0.2 and -21 + 16 * 0.4, so that they lie 3.2 apart.
    assert line.get_ydata()[-1] == pytest.approx(-21 + 16 * 0.3)
    low, high = sticks.get_segments()[-1][:, 1]
    assert len(sticks.get_segments()) == paper.BARS
    assert (high - low) / 2 == pytest.approx(3.2 / 2**0.5)


def test_paper_figures_have_a_row_per_agent_and_a_line_per_noise():
    figure = paper.figure5(made(*GRID))
    titles = [axis.get_title() for axis in figure.axes]
    assert titles[:3] == [
        "ppo: (a) probe's plane: distance",
        "ppo: (b) probe's plane: angle",
        "ppo: focal point: distance",
    ]
    assert titles[3].startswith("vpg") and len(titles) == 6
    assert all(len(axis.containers) == 2 for axis in figure.axes)


def test_axes_tell_their_units():
    known = made(*GRID)
    for draw in (paper.figure4, paper.figure5):
        assert draw(known).axes[-1].get_xlabel() == "training steps"
    drawn = comparison.draw(known)
    assert drawn["learning_curves"].axes[-1].get_xlabel() == "training steps"
    assert drawn["learning_curves_cpu"].axes[-1].get_xlabel() == "minutes of CPU time in training"
    assert "0 random, 1 optimum" in drawn["learning_curves"].get_supylabel()
    assert "0 random, 1 optimum" in drawn["scores"].axes[-1].get_xlabel()
    assert "(mm)" in paper.figure5(known).axes[0].get_ylabel()


def test_styles_differ_in_colour_line_and_marker():
    looks = style.styles(["g", "f", "e", "d", "c", "b", "a"])
    for key in ("color", "linestyle", "marker"):
        assert len({str(look[key]) for look in looks.values()}) == 7
    assert list(looks) == sorted(looks)


def test_more_agents_than_colours_differ_all_the_same():
    looks = style.styles(f"agent{k}" for k in range(30))
    assert len({str(look) for look in looks.values()}) == 30


def test_an_agent_looks_the_same_in_all_figures():
    others = [row for task in ("exam", "setup") for row in seeds("vpg", [0.3, 0.4], task=task)]
    drawn = comparison.draw(made(*GRID, *others))
    color = style.styles(["ppo", "vpg"])["vpg"]["color"]
    for name in ("other_learning_curves", "other_performance_profiles"):
        assert {line.get_color() for line in drawn[name].axes[0].lines[:1]} == {color}


def test_tasks_of_one_noise_stand_beside_each_other():
    tasks = ("exam", "exam-stop", "fp-random", "pp-random", "setup")
    drawn = comparison.draw(made(*(row for task in tasks for row in seeds("vpg", [0.3, 0.4], task=task))))
    titles = [axis.get_title() for axis in drawn["scores"].axes]
    assert titles == [*(f"{task}, noise 0" for task in tasks), ""]
    tops = [axis.get_subplotspec().rowspan.start for axis in drawn["scores"].axes]
    assert tops == [0, 0, 0, 1, 1, 1]
    assert not drawn["scores"].axes[-1].axison


def test_unknown_format_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"png, svg, pdf, not 'a\.bmp'"):
        style.save(comparison.draw(made(*GRID))["performance_profiles"], tmp_path / "a.bmp")


@pytest.mark.parametrize(("n_seeds", "said"), [(1, True), (2, False)])
def test_hollow_points_are_explained_where_there_are_any(n_seeds, said):
    known = made(*seeds("vpg", [0.5, 0.6][:n_seeds]), *seeds("ppo", [0.7, 0.8][:n_seeds]))
    assert ("hollow" in comparison.improvement(known).axes[0].get_xlabel()) == said
