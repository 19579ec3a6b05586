"""What docs/versions.md promises of every id: walks of today are those on record."""

from pathlib import Path

import numpy as np
import pytest
from walks import WALKS, ids, recorded, table, walk, was_recorded_here

from usbench import released
from usbench.records import Trial

PAGE = Path(__file__).parents[2] / "docs" / "versions.md"
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
    tolerance = 1e-2 if name.startswith("ImagingSetup") else 1e-12
    assert now["rewards"] == pytest.approx(then["rewards"], abs=tolerance)


def test_every_version_is_on_record():
    assert sorted(WALKS) == sorted(ids())
    for name in WALKS:
        frames = recorded(name)["frames"]
        assert len({frame.tobytes() for frame in frames}) >= 3 and (frames.max(axis=(1, 2)) > 100).all()


def test_the_page_states_digests_and_returns_of_the_record():
    assert "\n".join(table()) in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("task", ["fp", "pp"])
def test_the_page_states_the_digest_that_trials_record(task):
    digest = Trial.read(released.FOLDER / f"best-{task}").frames.digest
    assert f"`{task}` has `{digest[:16]}`" in PAGE.read_text(encoding="utf-8")
