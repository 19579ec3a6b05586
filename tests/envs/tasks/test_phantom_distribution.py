"""What a distribution of phantoms draws, refuses and is named by."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from usbench.envs.tasks import phantom_distribution
from usbench.envs.tasks.phantom_distribution import PhantomDistribution
from usbench.envs.tasks.random_phantoms import FocalPointRandomEnv, ProbePlaneRandomEnv

ENVS = (FocalPointRandomEnv, ProbePlaneRandomEnv)


@pytest.mark.parametrize("env_class", ENVS)
def test_all_of_a_phantom_follows_from_its_number(env_class):
    distribution = env_class.distribution
    assert distribution.phantom(5) == distribution.phantom(5)
    assert distribution.phantom(5) != distribution.phantom(6)
    assert distribution.phantom(5).seed == 5


@pytest.mark.parametrize("env_class", ENVS)
def test_objects_take_every_place_evenly_and_stay_within_bounds(env_class):
    distribution = env_class.distribution
    objects = [distribution.phantom(seed).object_of_interest for seed in range(2_000)]
    for name in ("x_mm", "depth_mm", "angle_deg"):
        values, counts = np.unique([getattr(ooi, name) for ooi in objects], return_counts=True)
        assert tuple(values) == tuple(sorted(getattr(distribution, name)))
        expected = len(objects) / len(values)
        # 4.5 standard deviations of a multinomial count, over some 40 values.
        assert np.abs(counts - expected).max() < 4.5 * np.sqrt(expected)
    scales, contrasts = (np.array([getattr(ooi, name) for ooi in objects]) for name in ("scale", "contrast"))
    assert 0.7 <= scales.min() < 0.71 and 1.09 < scales.max() <= 1.1
    assert contrasts.min() >= 5 and contrasts.max() <= 20
    # Even in the logarithm: as many below the geometric mean as above.
    assert abs((contrasts < 10).mean() - 0.5) < 4.5 * 0.5 / np.sqrt(len(objects))


@pytest.mark.parametrize("env_class", ENVS)
def test_object_and_tissue_are_drawn_apart(env_class):
    phantoms = [env_class.distribution.phantom(seed) for seed in range(60)]
    objects = [phantom.object_of_interest for phantom in phantoms]
    drawn = [[ooi.x_mm, ooi.depth_mm, ooi.scale, ooi.contrast] for ooi in objects]
    tissue = [phantom.positions[:4].ravel() for phantom in phantoms]
    table = stats.spearmanr(np.hstack([np.array(drawn), tissue])).statistic
    # 4.5 standard deviations: drawn from one stream, some agree in all 60.
    assert np.nanmax(np.abs(table[:4, 4:])) < 4.5 / np.sqrt(60)


@pytest.mark.parametrize(
    ("values", "error", "said"),
    [
        ({"x_mm": ()}, ValueError, "x_mm must be at least one whole number, not ()."),
        ({"depth_mm": [50, 50.5]}, ValueError, "depth_mm must be a whole number, not 50.5."),
        ({"angle_deg": 30}, TypeError, "angle_deg must be a sequence of numbers, not 30."),
        ({"angle_deg": ("30",)}, TypeError, "angle_deg must be a whole number, not '30'."),
        ({"x_mm": "05"}, TypeError, "x_mm must be a sequence of numbers, not '05'."),
        ({"contrast": (0, 20)}, ValueError, "contrast must be a positive number, not 0."),
        ({"contrast": 5.0}, TypeError, "contrast must be a sequence of numbers, not 5.0."),
        ({"scale": (1.1, 0.7)}, ValueError, "scale must be two numbers, the least first, not (1.1, 0.7)."),
        ({"scale": (0.7,)}, ValueError, "scale must be two numbers, the least first, not (0.7,)."),
        ({"scale": (0.7, np.inf)}, ValueError, "scale must be a positive number, not inf."),
    ],
)
def test_distributions_from_which_nothing_can_be_drawn_are_refused(values, error, said):
    with pytest.raises(error) as refused:
        PhantomDistribution(**{"x_mm": (0,), "depth_mm": (50,), "angle_deg": (0,), **values})
    assert str(refused.value) == said


@pytest.mark.parametrize(("x_mm", "depth_mm"), [(25, 50), (0, 5), (0, -5)])
def test_distributions_with_objects_outside_of_the_phantom_are_refused(x_mm, depth_mm):
    with pytest.raises(ValueError, match="the object must lie inside the phantom"):
        PhantomDistribution((0, x_mm), (50, depth_mm), (0, 90))


def test_a_distribution_holds_plain_numbers_in_tuples():
    plain = PhantomDistribution((0, 5), (50,), (0, 90), (1.0, 1.0), (5.0, 10.0), count=3)
    same = PhantomDistribution([0, 5.0], np.array([50]), range(0, 91, 90), [1, 1], np.array([5, 10]), count=3)
    assert same == plain and hash(same) == hash(plain) and same.digest == plain.digest


def test_the_digests_of_the_tasks_sets_stay():
    # Trials record them.
    digests = [replace(env_class.distribution, count=20).digest for env_class in ENVS]
    assert digests == ["c50ed9ab78ac7f3c", "ea59e8b520f26142"]


@pytest.mark.parametrize("side", [-np.inf, np.inf])
def test_a_processor_whose_exponential_differs_in_the_last_digit_names_sets_alike(side, monkeypatch):
    few = replace(ProbePlaneRandomEnv.distribution, count=20)
    here, exact = few.digest, np.exp
    phantom_distribution._digest.cache_clear()
    monkeypatch.setattr(np, "exp", lambda value: np.nextafter(exact(value), side))
    assert few.digest == here
