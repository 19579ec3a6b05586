"""The table of ceilings that comes with the package."""

import pytest

from usbench.results.ceilings import ceiling


def test_more_senses_allow_more_and_actions_are_known_anyway():
    nothing, heading, both = (
        ceiling("pp-random", one) for one in ((), ("heading",), ("position", "heading"))
    )
    assert 0.5 < nothing < heading < both < 1
    assert ceiling("pp-tracked", ("actions", "heading", "position")) == both


@pytest.mark.parametrize("task", ["pp", "exam-random", "setup"])
def test_other_tasks_have_none(task):
    assert ceiling(task, ()) is None
