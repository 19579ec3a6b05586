"""The table of ceilings that comes with the package."""

import pytest

from usbench import ceilings
from usbench.ceilings import ceiling
from usbench.tasks import row_of


def test_more_senses_allow_more_and_actions_are_known_anyway():
    nothing, heading, both = (
        ceiling("pp-random", one) for one in ((), ("heading",), ("position", "heading"))
    )
    assert 0.5 < nothing < heading < both < 1
    assert ceiling("pp-tracked", ("actions", "heading", "position")) == both


def test_whoever_is_told_the_whole_pose_knows_nearly_all_that_matters_at_any_noise():
    whole = {"fp-random": ("position", "focus"), "pp-tracked": None, "exam-tracked": None}
    for task, senses in whole.items():
        assert all(0.97 < ceiling(task, senses, noise) <= 1 for noise in (0.0, 0.25, 0.5))
    assert ceiling("exam-random", row_of("exam-tracked").senses, 0.25) == ceiling("exam-tracked", noise=0.25)
    assert ceiling("pp-tracked", noise=0.1) is None


@pytest.mark.parametrize("task", ["pp", "exam-random", "setup"])
def test_other_tasks_have_none(task):
    assert ceiling(task, ()) is None


def test_whoever_is_told_less_is_bound_by_whoever_is_told_more():
    assert ceilings.bound("pp-random", ("heading",)) == ceiling("pp-random", ("heading",))
    assert ceilings.bound("exam-tracked", ("heading",), 0.25) == ceiling("exam-tracked", noise=0.25)
    assert ceilings.bound("fp-random") == ceiling("fp-random", ("position", "focus"))
    assert ceilings.bound("pp-random", ("focus",)) is None
    assert ceilings.bound("exam-random", noise=0.1) is None and ceilings.bound("pp") is None


def test_by_default_the_senses_are_those_of_the_task():
    assert ceiling("pp-tracked") == ceiling("pp-tracked", ("position", "heading")) > ceiling("pp-random")
    assert ceiling("pp-random") == ceiling("pp-random", ()) < ceiling("pp-random", ("heading",))
