"""Figures from results alone: drawn where there is something to draw, the same bytes again."""

import json

import numpy as np
import pytest
from made_tables import made, seeds, trial
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.markers import MarkerStyle
from matplotlib.text import Text
from PIL import Image

from usbench.figures import comparison, looks, paper, score_axis, style
from usbench.figures.cells import cell_panels
from usbench.results import scores
from usbench.results.scores import Cell

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


def test_figures_of_a_part_that_is_gone_are_removed(tmp_path):
    exam = [row for algo in ("vpg", "ppo") for row in seeds(algo, [0.1, 0.2, 0.3], task="exam")]
    comparison.write(made(*GRID, *exam), tmp_path)
    assert (tmp_path / "other_scores.png").exists()
    comparison.write(made(*GRID), tmp_path)
    assert sorted(path.stem for path in tmp_path.iterdir()) == sorted(NAMES)


def test_every_figure_is_drawn(tmp_path):
    # And the same bytes again: see tests/compare/test_compare.py.
    paths = comparison.write(made(*GRID, trial("random", 0.0)), tmp_path)
    assert [path.name for path in paths] == [f"{name}.png" for name in NAMES]
    for path in paths:
        with Image.open(path) as image:
            assert image.width >= 800 and len(image.convert("L").getcolors()) > 10


def lines_of(figure):
    """Horizontal and vertical coordinates of all lines in the first panel of a figure."""
    (axis,) = figure.axes[:1]
    return [
        (pytest.approx(line.get_xdata(), nan_ok=True), pytest.approx(line.get_ydata())) for line in axis.lines
    ]


def test_what_is_drawn_is_what_follows_from_the_scores():
    low, high = [0.2, 0.4, 0.6], [0.5, 0.7, 0.9]
    drawn = comparison.draw(made(*seeds("vpg", low), *seeds("ppo", high)))
    found = lines_of(drawn["scores"])
    for height, own in enumerate((low, high)):
        # Seeds above, the mean of the middle half, which of three is that of all.
        assert (own, [height + 0.28] * 3) in found and ([np.mean(own)], [height]) in found
    steps = [0, 8032, 16_064]
    found = lines_of(drawn["learning_curves"])
    assert (steps, [0, 0.35, 0.7]) in found and (steps, [0, 0.2, 0.4]) in found
    # Of the 9 pairs of seeds, ppo has less in one.
    assert ([8 / 9], [0]) in lines_of(drawn["improvement"])
    profiles = {line.get_label(): line for line in drawn["performance_profiles"].axes[0].lines}
    for name, own in (("vpg", low), ("ppo", high)):
        above = [np.mean(np.array(own) > threshold) for threshold in profiles[name].get_xdata()]
        assert profiles[name].get_ydata() == pytest.approx(above)


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


def test_names_with_settings_are_folded_and_leave_the_panels_their_width():
    settings = '{"environment": "e", "gamma": 0.95, "initial_value": -26.0}'
    other = [trial("vpg", 0.4, seed=seed, settings=settings, configuration="00000002") for seed in (100, 101)]
    figure = comparison.final_scores(made(*seeds("vpg", [0.5, 0.6, 0.7]), *other))
    figure.canvas.draw()
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert "vpg gamma=0.95,\ninitial_value=-26.0" in labels and "vpg" in labels
    assert figure.axes[0].get_position().width > 0.7


def test_panels_with_names_of_their_own_have_room_beside_them():
    # As on unseen phantoms: five cells of unlike agents, one with a setting in its name.
    settings = '{"environment": "e", "gamma": 0.99, "max_shift_px": 2}'
    trials = [
        *seeds("double_dqn", [0.5, 0.6, 0.7]),
        trial("double_dqn", settings=settings, configuration="2"),
    ]
    trials += [trial("double_dqn", task=task) for task in ("pp", "exam", "fp-random", "pp-random")]
    figure = comparison.final_scores(made(*trials))
    figure.canvas.draw()
    labels = [label.get_text() for label in figure.axes[1].get_yticklabels()]
    assert labels == ["double_dqn\nmax_shift_px=2", "double_dqn"]
    assert len(figure.axes) == 5 and all(axis.get_position().width > 0.35 for axis in figure.axes)
    assert all(axis.get_xlim()[0] == 0 for axis in figure.axes)


@pytest.mark.parametrize(
    "text", ["a b", "vpg gamma=0.95, initial_value=-26.0: distance", "vpg-tuned", "x" * 40, "W"]
)
def test_folded_lines_are_as_wide_as_there_is_room_as_measured(text):
    for inches in (0.4, 1.2, 5.0):
        lines = style.folded(text, inches, style.TEXT).split("\n")
        assert "".join(lines).replace(" ", "") == text.replace(" ", "")
        figure = style.panels(1, 1)[0]
        renderer = FigureCanvasAgg(figure).get_renderer()
        drawn = [figure.text(0, 0, line, fontsize=style.TEXT).get_window_extent(renderer) for line in lines]
        assert max(extent.width for extent in drawn) / figure.dpi <= 1.05 * inches
    assert len(lines) == 1


def test_a_figure_of_earlier_results_does_not_stay(tmp_path):
    comparison.write(made(*GRID), tmp_path)
    assert (tmp_path / "improvement.png").exists() and (tmp_path / "performance_profiles.png").exists()
    comparison.write(made(trial("vpg"), trial("ppo", task="pp")), tmp_path)
    assert not (tmp_path / "improvement.png").exists()
    assert not (tmp_path / "performance_profiles.png").exists() and (tmp_path / "scores.png").exists()


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
    wide = comparison.final_scores(
        made(*(row for noise in (0, 0.2, 0.5) for row in seeds("vpg", [0.5], noise=noise)))
    )
    assert [axis.get_xlabel() for axis in wide.axes] == ["normalised score"] * 3
    assert "(mm)" in paper.figure5(known).axes[0].get_ylabel()


def test_an_agent_looks_the_same_in_all_figures():
    others = [row for task in ("exam", "setup") for row in seeds("vpg", [0.3, 0.4], task=task)]
    drawn = comparison.draw(made(*GRID, *others))
    for name in ("learning_curves", "other_learning_curves", "other_performance_profiles"):
        lines = {line.get_color(): line.get_marker() for line in drawn[name].axes[0].lines}
        assert lines[looks.KNOWN["vpg"]["color"]] in (looks.KNOWN["vpg"]["marker"], "v")


def test_variants_of_one_score_are_seen_both():
    settings = '{"environment": "e", "gamma": 0.95}'
    other = [row | {"settings": settings, "configuration": "2"} for row in seeds("vpg", [0.5, 0.6])]
    drawn = comparison.draw(made(*seeds("vpg", [0.5, 0.6, 0.7]), *other))
    for name in ("learning_curves", "performance_profiles"):
        curves = [line for line in drawn[name].axes[0].lines if len(line.get_xdata()) > 2]
        assert len(curves) == 2 and len({line.get_linestyle() for line in curves}) == 2
        (first, every), (second, again) = (line.get_markevery() for line in curves)
        assert every == again > 1 and first != second
    # The marks of the means lie on bars of their colour.
    means = [line for line in drawn["scores"].axes[0].lines if line.get_markeredgecolor() == "white"]
    assert len({str(line.get_marker()) for line in means}) == 2
    assert all(MarkerStyle(line.get_marker()).is_filled() for line in means)


def texts(figure):
    """All texts of a figure that are shown, with their sizes in CSS pixels where the figure is shown."""
    FigureCanvasAgg(figure).draw()
    scale = style.SHOWN_PX / figure.get_figwidth() / 72
    return {
        text.get_text(): text.get_fontsize() * scale
        for text in figure.findobj(Text)
        if text.get_text() and text.get_visible()
    }


@pytest.mark.parametrize("name", NAMES)
def test_every_text_is_nine_pixels_high_at_least_where_it_is_shown(name):
    figure = comparison.draw(made(*GRID, trial("oracle", 0.99)))[name]
    found = texts(figure)
    assert len(found) > 5
    assert {text: size for text, size in found.items() if size < 9} == {}
    assert figure.get_figwidth() * 96 <= style.SHOWN_PX + 1e-9


def inside(figure):
    """Say whether all that is drawn lies within the figure: no label is cut off."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    drawn = figure.get_tightbbox(canvas.get_renderer())
    width, height = figure.get_size_inches()
    return drawn.x0 >= 0 and drawn.y0 >= 0 and drawn.x1 <= width and drawn.y1 <= height


@pytest.mark.parametrize("name", NAMES)
def test_no_label_is_cut_off_even_of_long_names_and_few_trials(name):
    long = "my_algorithm_with_a_long_name"
    assert inside(comparison.draw(made(trial("vpg", 0.5), trial(long, 0.7)))[name])


def test_scores_begin_at_0_and_what_lies_below_is_marked_with_its_number():
    figure = comparison.final_scores(made(*seeds("ppo", [-0.38, 0.7]), *seeds("vpg", [0.5, 0.6])))
    (axis,) = figure.axes
    assert axis.get_xlim()[0] == 0
    assert [text.get_text() for text in axis.texts] == ["-0.38"]
    known = made(*seeds("ppo", [-0.38, -0.2]))
    curves = comparison.learning_curves(known, scores.learning_curves(known))
    (axis,) = curves.axes
    assert axis.get_ylim()[0] == 0
    # Below 0 at half of the budget and at its end; at its start the score is 0.
    assert [(line.get_xdata()[0], line.get_color()) for line in below(axis)] == [
        (8032, looks.KNOWN["ppo"]["color"]),
        (16064, looks.KNOWN["ppo"]["color"]),
    ]
    assert not axis.texts


def below(axis):
    """Return the arrows that stand for scores below 0."""
    return [line for line in axis.lines if line.get_marker() == score_axis.DOWN]


def test_arrows_that_would_cover_each_other_are_a_square_with_their_number():
    # At the end vpg alone lies below 0; at half of the budget all do.
    scores_of = {"a2c": (-0.5, 0.1), "ppo": (-0.4, 0.2), "vpg": (-0.3, -0.1)}
    figure = style.panels(1, 1)[0]
    (axis,) = figure.axes
    steps = np.array([8000, 16000])
    score_axis.mark_below(axis, [(steps, own, looks.KNOWN[algo]["color"]) for algo, own in scores_of.items()])
    (mark,) = below(axis)
    assert (mark.get_xdata()[0], mark.get_color()) == (16000, looks.KNOWN["vpg"]["color"])
    (number,) = axis.texts
    assert number.get_text() == "3" and number.xy == (8000, 0)
    # A square of a colour that no agent has.
    assert number.get_bbox_patch().get_boxstyle().__class__.__name__ == "Square"
    grey = to_hex(number.get_bbox_patch().get_facecolor())
    assert grey not in {to_hex(look["color"]) for look in looks.KNOWN.values()}
    # Over CPU time, evaluations of two agents may be near each other: they are one mark, too.
    (axis,) = style.panels(1, 1)[0].axes
    score_axis.mark_below(axis, [([0, 1.00, 9], [1, -1, 1], "red"), ([0, 1.02, 9], [1, -1, 1], "blue")])
    (number,) = axis.texts
    assert number.get_text() == "2" and not below(axis)
    assert number.xy[0] == pytest.approx(1.01)


def test_agents_on_new_phantoms_have_learning_curves_with_optimum_and_ceiling():
    tasks = ("pp-random", "pp-tracked")
    trials = [row for task in tasks for row in seeds("double_dqn", [0.7, 0.8], task=task, steps=100_000)]
    known = made(*GRID, *trials, *(trial("oracle", 0.98, task=task) for task in tasks))
    drawn = comparison.draw(known)
    for name in ("unseen-phantoms_learning_curves", "unseen-phantoms_learning_curves_cpu"):
        first, second = drawn[name].axes
        assert [axis.get_title() for axis in (first, second)] == ["pp-random, noise 0", "pp-tracked, noise 0"]
        level = {line.get_ydata()[0] for line in first.lines if len(set(line.get_ydata())) == 1}
        assert {1.0, 0.98, 0.891} <= level
        words = [text.get_text() for text in drawn[name].legends[0].get_texts()]
        assert words[:2] == ["double_dqn", "optimum"] and words[-1].startswith("ceiling")
        assert min(texts(drawn[name]).values()) >= 9 and inside(drawn[name])


@pytest.mark.parametrize(("n_cells", "columns"), [(1, 1), (2, 2), (3, 3), (4, 2), (5, 3), (7, 3)])
def test_rows_of_panels_are_as_long_as_each_other_where_they_can_be(n_cells, columns):
    figure, panels = cell_panels({Cell(f"task-{number}", 0.0): 1.9 for number in range(n_cells)}, "score")
    assert len(panels) == n_cells
    assert figure.axes[0].get_gridspec().ncols == columns


def test_oracle_and_ceiling_are_lines_beside_those_that_learn():
    trials = (*seeds("vpg", [0.2, 0.3], task="pp-random"), trial("oracle", 0.98, task="pp-random"))
    figure = comparison.final_scores(made(*trials, trial("stay", -0.1, task="pp-random")))
    (axis,) = figure.axes
    assert [label.get_text() for label in axis.get_yticklabels()] == ["vpg"]
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert words == [
        "optimum",
        "oracle in these episodes",
        "ceiling of what agents are told, or a bound of it",
    ]
    upright = [line.get_xdata()[0] for line in axis.lines if len(set(line.get_xdata())) == 1]
    assert {1.0, 0.98, 0.891} <= set(upright)


def test_rows_and_legends_are_ranked():
    drawn = comparison.draw(made(*GRID))
    rows = [label.get_text() for label in drawn["scores"].axes[0].get_yticklabels()]
    assert rows == ["vpg", "ppo"]  # from below
    for name in ("learning_curves", "performance_profiles"):
        assert [text.get_text() for text in drawn[name].legends[0].get_texts()][:2] == ["ppo", "vpg"]


def test_rows_are_in_the_order_of_the_table_and_not_of_medians():
    # ppo has the larger median, 0.6, and the smaller interquartile mean, 0.45.
    low, even = [0.0, 0.0, 0.0, 0.6, 0.6, 0.6, 0.6, 0.6], [0.5] * 8
    # Of qrdqn, seeds that are not finished in both tasks do not count.
    early = [*seeds("qrdqn", [0.4, 0.4, 1.0, 1.0, 1.0, 1.0]), *seeds("qrdqn", [0.4, 0.4], task="pp")]
    tasks = [
        row
        for task in ("fp", "pp")
        for algo, own in (("ppo", low), ("vpg", even))
        for row in seeds(algo, own, task=task)
    ]
    drawn = comparison.draw(made(*tasks, *early))
    ranked = ["vpg", "ppo", "qrdqn"]
    assert [label.get_text() for label in drawn["scores"].axes[0].get_yticklabels()] == ranked[::-1]
    for name in ("learning_curves", "performance_profiles"):
        assert [text.get_text() for text in drawn[name].legends[0].get_texts()][:3] == ranked


def test_pairs_are_sentences():
    (axis,) = comparison.improvement(made(*GRID)).axes
    assert [label.get_text() for label in axis.get_yticklabels()] == ["P(ppo beats vpg)"]


def test_there_is_no_panel_and_no_row_without_data():
    # ppo in one task with two noises, vpg in another task without noise: a grid would have empty panels.
    trials = [row for noise in (0.0, 0.5) for row in seeds("ppo", [0.5, 0.6], noise=noise)]
    drawn = comparison.draw(made(*trials, *seeds("vpg", [0.7, 0.8], task="pp")))
    for name in ("scores", "learning_curves"):
        titles = [axis.get_title() for axis in drawn[name].axes]
        assert titles == ["fp, noise 0", "fp, noise 0.5", "pp, noise 0"]
    rows = [[label.get_text() for label in axis.get_yticklabels()] for axis in drawn["scores"].axes]
    assert rows == [["ppo"], ["ppo"], ["vpg"]]
    titles = [axis.get_title() for axis in drawn["figure4"].axes]
    assert titles == ["ppo: (a) focal point", "vpg: (b) probe's plane"]


def test_panels_of_the_papers_figures_are_those_there_are_beside_each_other():
    # a2c has the two panels of pp, ppo that of fp, and the three of vpg do not fit beside qrdqn's.
    trials = [*seeds("a2c", [0.5], task="pp"), *seeds("ppo", [0.5]), *seeds("qrdqn", [0.5])]
    figure = paper.figure5(made(*trials, *seeds("vpg", [0.5]), *seeds("vpg", [0.4], task="pp")))
    lines = {}
    for axis in figure.axes:
        assert axis.axison and axis.containers
        place = axis.get_subplotspec()
        lines.setdefault(place.rowspan.start, []).append((place.colspan.start, axis.get_title()))
    assert {row: [column for column, _ in line] for row, line in lines.items()} == {
        0: [0, 1, 2],
        1: [0],
        2: [0, 1, 2],
    }
    agents = [[title.partition(":")[0] for _, title in line] for line in lines.values()]
    assert agents == [["a2c", "a2c", "ppo"], ["qrdqn"], ["vpg"] * 3]
    # The lowest panel of each column has the steps, and what is measured alike has axes alike.
    assert [axis.get_xlabel() for axis in figure.axes] == [""] * 4 + ["training steps"] * 3
    assert figure.axes[2].get_ylim() == figure.axes[3].get_ylim() == figure.axes[6].get_ylim()


def test_the_lowest_panel_of_each_column_is_labelled():
    trials = [*seeds("recurrent_ppo", [0.5]), *seeds("vpg", [0.5], task="pp"), *seeds("zoo", [0.5])]
    panels = paper.figure4(made(*trials)).axes
    assert [axis.get_xlabel() for axis in panels] == ["", "training steps", "training steps"]
    assert all(axis.xaxis.get_tick_params()["labelbottom"] for axis in panels[1:])


def test_policy_updates_stand_over_those_whose_updates_have_so_many_steps():
    def rows(algo, **settings):
        text = json.dumps({"environment": "e"} | settings)
        return seeds(algo, [0.5], settings=text) + seeds(algo, [0.5], task="pp", settings=text)

    trials = [*rows("a2c", n_steps=16), *rows("dqn", n_steps=64, exploration_final_eps=0.05)]
    trials += [*rows("vpg", n_steps=64), *seeds("ppo", [0.5])]
    for draw in (paper.figure4, paper.figure5):
        above = {
            axis.get_title().partition(":")[0]: [one.get_xaxis().get_label_text() for one in axis.child_axes]
            for axis in draw(made(*trials)).axes
        }
        assert above == {"a2c": [], "dqn": [], "ppo": [], "vpg": ["policy updates of 64 steps"]}


@pytest.mark.parametrize("draw", [paper.figure4, paper.figure5])
@pytest.mark.parametrize(
    "long", ["my_algorithm_with_a_name_that_is_very_long_indeed", "MMMMMMMMMM WWWWWWWWWW MMMMMMMMMM"]
)
def test_long_titles_of_the_papers_figures_are_folded(draw, long):
    both = [row for task in ("fp", "pp") for row in seeds(long, [0.5], task=task)]
    figure = draw(made(*seeds("vpg", [0.5], task="fp"), *both))
    assert inside(figure)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    for axis in figure.axes:
        title = axis.title.get_window_extent(canvas.get_renderer())
        assert title.x0 >= 0 and title.x1 <= figure.bbox.width and title.width <= 1.05 * axis.bbox.width
        assert ("\n" in axis.get_title()) == (not axis.get_title().startswith("vpg"))
    assert not any("\n" in axis.get_title() for axis in draw(made(*GRID)).axes)


def test_tasks_of_one_noise_stand_beside_each_other():
    tasks = ("exam", "exam-stop", "fp-random", "pp-random", "setup")
    drawn = comparison.draw(made(*(row for task in tasks for row in seeds("vpg", [0.3, 0.4], task=task))))
    titles = [axis.get_title() for axis in drawn["scores"].axes]
    assert titles == [f"{task}, noise 0" for task in tasks]
    tops = [axis.get_subplotspec().rowspan.start for axis in drawn["scores"].axes]
    assert tops == [0, 0, 0, 1, 1]


def test_unknown_format_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"png, svg, pdf, not 'a\.bmp'"):
        style.save(comparison.draw(made(*GRID))["performance_profiles"], tmp_path / "a.bmp")


@pytest.mark.parametrize(("n_seeds", "said"), [(1, True), (2, False)])
def test_hollow_points_are_explained_where_there_are_any(n_seeds, said):
    known = made(*seeds("vpg", [0.5, 0.6][:n_seeds]), *seeds("ppo", [0.7, 0.8][:n_seeds]))
    assert ("hollow" in comparison.improvement(known).axes[0].get_xlabel()) == said


def test_figures_of_one_seed_each_name_no_interval():
    words = {
        n_seeds: [
            figure.get_suptitle() or figure.axes[0].get_title()
            for name, figure in comparison.draw(
                made(*seeds("vpg", [0.5] * n_seeds), trial("oracle", 1.0))
            ).items()
            if name in ("scores", "learning_curves", "performance_profiles")
        ]
        for n_seeds in (1, 2)
    }
    assert len(words[1]) == len(words[2]) == 3
    assert all("one seed each" in text and "bootstrap" not in text for text in words[1]), words[1]
    assert all("95 % bootstrap" in text and "one seed" not in text for text in words[2]), words[2]
