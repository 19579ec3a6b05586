"""What the critic is told, by hand."""

import pytest

from usbench.agents.asymmetric.truth import SIZE, state, states


def test_a_state_has_probe_object_and_what_lies_between():
    info = {"x_mm": 5, "focal_depth_mm": 45, "angle_deg": 90, "distance_mm": 15.0}
    target = {"target_x_mm": -10, "target_focal_depth_mm": 90, "target_angle_deg": 60}
    probe, object_ = [0.25, 0.5, 1, 0, 0, 0], [-0.5, 1, 0.75**0.5, 0.5]
    assert state(info | target) == pytest.approx([*probe, *object_, 0.75, -0.5, 0.5, 0.75**0.5])
    # Where there is but one object, it is not told.
    assert state(info) == pytest.approx([*probe, *[0] * 8])
    settings = {"focal_depth_mm": 90, "frequency_khz": 2500, "dynamic_range_db": 45}
    assert state(settings) == pytest.approx([0, 1, 0, 0, 0.5, 0.5, *[0] * 8])
    assert states([info, info | target]).shape == (2, SIZE) == (2, 14)


@pytest.mark.parametrize(("info", "words"), [({}, "nothing"), ({"lives": 3, "ale": 1}, "'lives', 'ale'")])
def test_an_environment_that_tells_no_state_is_refused(info, words):
    with pytest.raises(ValueError, match=rf"must tell a state, any of x_mm, .*is told it, not {words}\.$"):
        state(info)
