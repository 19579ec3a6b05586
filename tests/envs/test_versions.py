"""What docs/versions.md promises of every id that ends with -v0: walks of today are those on record."""

import numpy as np
import pytest
from walks import WALKS, ids, recorded, walk, was_recorded_here

# Processors round differently, and a pixel between two grey levels falls to either.
MOST_PIXELS = 4  # of the 3600 of a frame


@pytest.mark.parametrize("name", WALKS)
def test_frames_states_and_rewards_of_a_version_stay(name):
    then, now = recorded(name), walk(name)
    assert np.array_equal(now["states"], then["states"]) and np.array_equal(now["ends"], then["ends"])
    assert now["senses"] == pytest.approx(then["senses"], abs=1e-6)
    differ = np.abs(now["frames"].astype(int) - then["frames"])
    assert differ.max() <= 1 and np.count_nonzero(differ, axis=(1, 2)).max() <= MOST_PIXELS
    if was_recorded_here():
        assert not differ.any()
    # The reward of the imaging setup follows from frames.
    tolerance = 1e-2 if name == "ImagingSetup-v0" else 1e-12
    assert now["rewards"] == pytest.approx(then["rewards"], abs=tolerance)


def test_every_version_is_on_record():
    assert sorted(WALKS) == sorted(ids())
    for name in WALKS:
        frames = recorded(name)["frames"]
        assert len({frame.tobytes() for frame in frames}) >= 3 and (frames.max(axis=(1, 2)) > 100).all()
