"""Measures of image quality: by hand, against theory of speckle, and against independent packages."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from usbench.envs.tasks.image_quality import (
    contrast_order,
    contrast_to_noise,
    generalized_contrast_to_noise,
)

MEASURES = (contrast_to_noise, generalized_contrast_to_noise, contrast_order)


def halves():
    inside = np.zeros((90, 40), bool)
    inside[:, :20] = True
    return inside, ~inside


def test_contrast_to_noise_of_four_pixels_worked_out_by_hand():
    frame = np.array([[10, 20, 60, 80]], np.uint8)
    inside = np.array([[True, True, False, False]])
    # Means 15 and 70, variances 25 and 100.
    assert contrast_to_noise(frame, inside, ~inside) == pytest.approx(55 / np.sqrt(125))
    assert contrast_to_noise(frame, ~inside, inside) == pytest.approx(55 / np.sqrt(125))


def test_contrast_to_noise_of_normal_greys_is_that_of_their_distributions():
    inside, around = halves()
    rng = np.random.default_rng(3)
    frame = np.where(inside, rng.normal(60, 9, (90, 40)), rng.normal(130, 12, (90, 40))).astype(np.uint8)
    assert contrast_to_noise(frame, inside, around) == pytest.approx(70 / 15, rel=0.05)


def test_where_there_is_nothing_to_tell_apart_it_is_zero():
    inside, around = halves()
    black = np.zeros((90, 40), np.uint8)
    for measure in MEASURES:
        assert measure(black, inside, around) == 0
        assert measure(black, np.zeros_like(inside), around) == 0
        assert measure(black, inside, np.zeros_like(inside)) == 0


@pytest.mark.parametrize(
    ("greys", "gcnr", "order"),
    [
        ([10, 20, 60, 80], 1.0, -1.0),
        ([60, 80, 10, 20], 1.0, 1.0),
        ([7, 9, 7, 9], 0.0, 0.0),
        # Half of both histograms overlaps; of four pairs three are darker inside and one is equal.
        ([5, 7, 7, 9], 0.5, -0.75),
    ],
)
def test_gcnr_and_contrast_order_of_four_pixels_worked_out_by_hand(greys, gcnr, order):
    inside = np.array([[True, True, False, False]])
    frame = np.array([greys], np.uint8)
    assert generalized_contrast_to_noise(frame, inside, ~inside) == pytest.approx(gcnr)
    assert contrast_order(frame, inside, ~inside) == pytest.approx(order)


def speckle(contrast_db, n=2_000_000):
    """Two halves of Rayleigh speckle, the second `contrast_db` louder, in 0.3 dB per grey level."""
    rng = np.random.default_rng(8)
    halves = np.stack([rng.rayleigh(1.0, n), rng.rayleigh(10 ** (contrast_db / 20), n)])
    greys = np.rint(np.clip(20 * np.log10(halves) / 0.3 + 180, 0, 255)).astype(np.uint8)
    inside = np.zeros(halves.shape, bool)
    inside[0] = True
    return greys, inside, ~inside


@pytest.mark.parametrize("contrast_db", [3.0, 10.0, 20.0])
def test_of_ideal_speckle_both_are_what_theory_says(contrast_db):
    """Intensities are exponential, of the ratio r of their means; see both papers for such speckle."""
    r = 10 ** (contrast_db / 10)
    gcnr = r ** (-1 / (r - 1)) - r ** (-r / (r - 1))
    assert generalized_contrast_to_noise(*speckle(contrast_db)) == pytest.approx(gcnr, abs=2e-3)
    assert contrast_order(*speckle(contrast_db)) == pytest.approx((1 - r) / (1 + r), abs=2e-3)


def test_a_monotone_map_of_the_grey_levels_changes_neither():
    greys, inside, around = speckle(6.0, 10_000)
    order = np.argsort(np.unique(greys))  # of each grey level that occurs, its rank
    mapped = order[np.searchsorted(np.unique(greys), greys)].astype(np.uint8)
    for measure in (generalized_contrast_to_noise, contrast_order):
        assert measure(mapped, inside, around) == pytest.approx(measure(greys, inside, around), abs=1e-12)
        assert measure(255 - greys, inside, around) == pytest.approx(
            measure(greys, inside, around) * (1 if measure is generalized_contrast_to_noise else -1)
        )


def test_the_contrast_order_is_mann_and_whitneys_statistic():
    greys, inside, around = speckle(4.0, 3_000)
    n, m = inside.sum(), around.sum()
    u = stats.mannwhitneyu(greys[inside], greys[around]).statistic
    assert contrast_order(greys, inside, around) == pytest.approx(2 * u / (n * m) - 1, abs=1e-12)


@pytest.mark.parametrize("contrast_db", [1.0, 6.0, 15.0])
def test_gcnr_is_that_of_the_package_ultrasound_metrics(contrast_db):
    package = pytest.importorskip("ultrasound_metrics", reason="needs tests/ultrasound_metrics.txt")
    # Its other modules need JAX.
    path = Path(package.__file__).parent / "metrics" / "gcnr.py"
    spec = importlib.util.spec_from_file_location("ultrasound_metrics_gcnr", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    greys, inside, around = speckle(contrast_db, 2_000)
    bins = np.arange(257) - 0.5
    theirs = module.gcnr(greys[inside].astype(float), greys[around].astype(float), bins=bins)
    assert generalized_contrast_to_noise(greys, inside, around) == pytest.approx(theirs, abs=1e-12)
