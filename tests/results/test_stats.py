"""Statistics: numbers worked out by hand, rliable's definitions, and how often intervals cover the truth."""

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, trim_mean

from usbench.results import stats

# Two tasks, four seeds. All sorted: 0.0 0.1 | 0.2 0.3 0.5 0.6 | 0.7 1.2.
SCORES = [[0.0, 0.5], [0.1, 0.6], [0.2, 0.7], [0.3, 1.2]]


def test_metrics_by_hand():
    assert stats.iqm(SCORES) == pytest.approx((0.2 + 0.3 + 0.5 + 0.6) / 4)
    assert stats.mean(SCORES) == pytest.approx(3.6 / 8)
    # Task means 0.15 and 0.75; the median of two is their mean.
    assert stats.median(SCORES) == pytest.approx(0.45)
    # 1.2 counts as 1: the mean is 3.4 / 8.
    assert stats.optimality_gap(SCORES) == pytest.approx(1 - 3.4 / 8)


def test_median_is_over_tasks_of_means_over_seeds():
    # Task means 1, 2, 30; a median over all nine scores would be 2 as well only by chance.
    assert stats.median([[0, 2, 0], [0, 2, 0], [3, 2, 90]]) == pytest.approx(2)
    assert stats.median([[0, 5, 0], [0, 5, 0], [3, 5, 90]]) == pytest.approx(5)


@pytest.mark.parametrize(
    ("n", "expected"),
    # A quarter of the number of scores, rounded down, is cut at each end (scipy's and rliable's convention).
    [(1, 0.0), (2, 0.5), (3, 1.0), (4, 1.5), (5, 2.0), (8, 3.5)],
)
def test_iqm_of_few_scores(n, expected):
    assert stats.iqm(np.arange(n)[:, np.newaxis]) == pytest.approx(expected)


@pytest.mark.parametrize("n", range(1, 14))
def test_iqm_is_scipys_to_the_last_bit(n):
    stack = np.random.default_rng(n).normal(size=(5, n, 3))
    assert np.array_equal(stats.iqm(stack), trim_mean(stack.reshape(5, -1), 0.25, axis=-1))


def test_iqm_ignores_outliers_on_both_sides():
    assert stats.iqm([[-1e9], [1], [2], [1e9]]) == pytest.approx(1.5)


def test_rliable_definitions():
    """The formulas of rliable's metrics.py and library.py, written out on a random matrix."""
    scores = np.random.default_rng(0).normal(size=(7, 3))
    ordered = np.sort(scores, axis=None)
    assert stats.iqm(scores) == pytest.approx(ordered[5:-5].mean())
    assert stats.mean(scores) == pytest.approx(np.mean(np.mean(scores, axis=0)))
    assert stats.median(scores) == pytest.approx(np.median(np.mean(scores, axis=0)))
    assert stats.optimality_gap(scores) == pytest.approx(1 - np.mean(np.minimum(scores, 1)))
    profile = [sum(value > level for value in ordered) / 21 for level in (-1.0, 0.0, 1.0)]
    assert stats.performance_profile(scores, [-1.0, 0.0, 1.0]) == pytest.approx(profile)


def test_stack_of_matrices_gives_one_value_each():
    stack = np.random.default_rng(1).normal(size=(5, 4, 3))
    for metric in (stats.iqm, stats.mean, stats.median, stats.optimality_gap):
        assert metric(stack) == pytest.approx([float(metric(matrix)) for matrix in stack])


def test_performance_profile_counts_what_is_strictly_above():
    profile = stats.performance_profile(SCORES, [-1, 0.0, 0.5, 1.2])
    assert profile == pytest.approx([1, 7 / 8, 3 / 8, 0])


def test_probability_of_improvement_by_hand():
    # Task 0: of the pairs (1,1) (1,0) (3,1) (3,0) one is a tie: 3.5 / 4. Task 1: x always loses: 0.
    x, y = [[1, 0], [3, 0]], [[1, 1], [0, 2]]
    assert stats.probability_of_improvement(x, y) == pytest.approx((3.5 / 4 + 0) / 2)
    assert stats.probability_of_improvement(y, x) == pytest.approx(1 - 3.5 / 8)
    assert stats.probability_of_improvement(x, x) == pytest.approx(0.5)


def test_probability_of_improvement_is_mann_whitney_per_task():
    generator = np.random.default_rng(2)
    x, y = generator.integers(6, size=(5, 3)), generator.integers(6, size=(8, 3))
    u = [mannwhitneyu(x[:, task], y[:, task]).statistic / (5 * 8) for task in range(3)]
    assert stats.probability_of_improvement(x, y) == pytest.approx(np.mean(u))


def test_area_under_curve_by_hand():
    # Trapezoids: 10 * 0.5 + 30 * 1 = 35, over a range of 40.
    assert stats.area_under_curve([0, 10, 40], [0, 1, 1]) == pytest.approx(35 / 40)
    curves = [[0.5, 0.5, 0.5], [0, 1, 1]]
    assert stats.area_under_curve([0, 10, 40], curves) == pytest.approx([0.5, 0.875])
    # The mean over the range of the curve, wherever it begins.
    assert stats.area_under_curve([10, 20, 50], curves) == pytest.approx([0.5, 0.875])


def test_interval_covers_the_truth_as_often_as_it_says():
    """30 normal scores around 0.7: some 95 of 100 intervals hold it (percentile intervals a little fewer)."""
    generator = np.random.default_rng(3)
    held = 0
    for _ in range(400):
        scores = generator.normal(0.7, 0.2, size=(30, 1))
        interval = stats.stratified_bootstrap(stats.mean, scores, generator=generator, n_resamples=500)
        held += interval.low <= 0.7 <= interval.high
    assert 0.91 <= held / 400 <= 0.98


def test_tasks_are_resampled_by_themselves():
    """Seeds that rise in one task and fall in the other: resampled together, their mean would never move."""
    scores = np.array([[0.0, 1.0], [1.0, 0.0]])
    interval = stats.stratified_bootstrap(stats.mean, scores, generator=np.random.default_rng(4))
    assert (interval.low, interval.estimate, interval.high) == (0.0, 0.5, 1.0)


def test_seeds_never_cross_tasks():
    scores = np.array([[0.0, 10.0], [0.0, 10.0], [0.0, 10.0]])
    interval = stats.stratified_bootstrap(stats.mean, scores, generator=np.random.default_rng(5))
    assert (interval.low, interval.estimate, interval.high) == (5.0, 5.0, 5.0)


def test_whole_seeds_are_resampled_together():
    scores = np.array([[0.0, 1.0], [1.0, 0.0]])
    generator = np.random.default_rng(4)
    interval = stats.stratified_bootstrap(stats.mean, scores, generator=generator, whole_seeds=True)
    assert (interval.low, interval.estimate, interval.high) == (0.5, 0.5, 0.5)


def test_counts_of_resamples_make_the_improvement_of_these_resamples():
    generator = np.random.default_rng(8)
    x, y = generator.integers(4, size=(5, 3)), generator.integers(4, size=(7, 3))
    of_x, of_y = (stats.draw_counts(len(each), 3, 20, generator) for each in (x, y))
    assert of_x.shape == (3, 20, 5) and (of_x.sum(axis=2) == 5).all()
    found = stats.resampled_improvement(x, y, of_x, of_y)
    for number in range(20):
        again = [
            np.stack(
                [np.repeat(each[:, task], counts[task, number].astype(int)) for task in range(3)], axis=1
            )
            for each, counts in ((x, of_x), (y, of_y))
        ]
        assert found[number] == pytest.approx(stats.probability_of_improvement(*again))


def test_same_generator_same_interval_and_levels_nest():
    def interval(seed, level):
        generator = np.random.default_rng(seed)
        return stats.stratified_bootstrap(stats.iqm, SCORES, generator=generator, level=level)

    assert interval(6, 0.95) == interval(6, 0.95)
    assert interval(6, 0.95).low < interval(6, 0.5).low < interval(6, 0.5).high < interval(6, 0.95).high


def test_bands_and_two_sample_intervals():
    generator = np.random.default_rng(7)
    band = stats.stratified_bootstrap(
        lambda scores: stats.performance_profile(scores, [0.0, 0.4]), SCORES, generator=generator
    )
    assert band.low.shape == band.high.shape == (2,)
    assert (band.low <= band.estimate).all() and (band.estimate <= band.high).all()
    x, y = np.array([[1.0], [2.0], [3.0]]), np.array([[1.5], [2.5]])
    won = stats.stratified_bootstrap(stats.probability_of_improvement, x, y, generator=generator)
    assert won.estimate == pytest.approx(0.5) and won.low == 0.0 and won.high == 1.0


@pytest.mark.parametrize(
    "scores", [[0.1, 0.2], [], [[]], 0.5, np.empty((0, 2))], ids=["row", "none", "empty", "number", "no seed"]
)
@pytest.mark.parametrize("metric", [stats.iqm, stats.mean, stats.median, stats.optimality_gap])
def test_anything_but_a_matrix_is_refused(metric, scores):
    with pytest.raises(ValueError, match=r"matrix \(n_seeds, n_tasks\), not of shape"):
        metric(scores)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_scores_that_are_not_finite_are_refused(value):
    with pytest.raises(ValueError, match="finite"):
        stats.iqm([[0.1], [value]])


def test_stack_is_refused_by_the_bootstrap():
    with pytest.raises(ValueError, match="one matrix"):
        stats.stratified_bootstrap(stats.mean, np.zeros((2, 3, 4)), generator=np.random.default_rng(0))


def test_different_tasks_are_refused():
    with pytest.raises(ValueError, match="same tasks, not 1 and 2"):
        stats.probability_of_improvement([[1.0]], [[1.0, 2.0]])
    with pytest.raises(ValueError, match="same tasks, not 1 and 2"):
        stats.resampled_improvement([[1.0]], [[1.0, 2.0]], np.ones((1, 1, 1)), np.ones((1, 1, 1)))


@pytest.mark.parametrize("thresholds", [[], 0.5, [np.nan]])
def test_thresholds_are_refused(thresholds):
    with pytest.raises(ValueError, match="thresholds must be"):
        stats.performance_profile(SCORES, thresholds)


@pytest.mark.parametrize("steps", [[0], [0, 0], [1, 0], [0, np.nan], [[0, 1]]])
def test_steps_that_do_not_increase_are_refused(steps):
    with pytest.raises(ValueError, match="steps must be"):
        stats.area_under_curve(steps, [0.0, 1.0])


@pytest.mark.parametrize("scores", [[0.0], [0.0, np.nan], 0.5])
def test_curve_that_does_not_fit_the_steps_is_refused(scores):
    with pytest.raises(ValueError, match="scores must be 2 finite"):
        stats.area_under_curve([0, 1], scores)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"generator": 0}, TypeError, "Generator, not int"),
        ({"n_resamples": 0}, ValueError, "n_resamples must be a whole number from 1, not 0"),
        ({"n_resamples": "a"}, TypeError, "n_resamples must be a whole number from 1, not 'a'"),
        ({"level": 95}, ValueError, "level must be between 0 and 1, not 95"),
    ],
)
def test_bootstrap_settings_are_refused(settings, error, message):
    with pytest.raises(error, match=message):
        stats.stratified_bootstrap(stats.mean, SCORES, **{"generator": np.random.default_rng(0), **settings})
