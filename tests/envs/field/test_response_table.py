"""The table of responses: what it covers, and what theory says about the beam in it."""

from functools import lru_cache

import numpy as np
import pytest

from usbench.envs.field import response_table as module
from usbench.envs.field.response_table import depth_grid, keep_tables, response_table
from usbench.envs.probe import LinearArray

ARRAY = LinearArray(n_elements=96, n_active=32)
FOCUS = 30e-3


@pytest.fixture(scope="module")
def table():
    return response_table(ARRAY, FOCUS, 40e-3, 90e-3)


def energy(table, depth):
    """Energy of the waveforms at the table's depth nearest to `depth`, of all orders, (n_u - 1,)."""
    row = np.abs(table.depths[:-1] - depth).argmin()
    result = np.zeros(table.cells.shape[1])
    for column, (first, n_parts, _, _) in enumerate(table.cells[row]):
        for part in table.parts[first : first + n_parts]:
            here = slice(part[0] + part[4], part[0] + part[4] + part[5])
            result[column] += np.square(np.abs(table.waveforms[here])).sum()
    return result


@pytest.mark.parametrize("focal_depth", [5e-3, 50e-3, 90e-3, 0.3])
def test_depths_cover_the_scene_and_are_dense_at_the_focus(focal_depth):
    depths = depth_grid(focal_depth, 90e-3)
    steps = np.diff(depths)
    assert depths[0] <= 0.5e-3 and depths[-1] > 90e-3 and (steps > 0).all() and steps.max() <= 1.001e-3
    if focal_depth < 90e-3:
        assert steps[np.abs(depths[:-1] - focal_depth).argmin()] <= 0.45e-3


def test_covers_the_scene(table):
    assert table.cells.shape[1] * table.u_step >= 40e-3 - 1e-9
    assert table.depths[-1] >= 90e-3
    assert np.isfinite(table.waveforms).all() and np.isfinite(table.waves).all()


def test_beam_is_narrowest_at_the_focus(table):
    widths = {}
    for depth in (15e-3, 30e-3, 60e-3):
        profile = energy(table, depth)
        widths[depth] = table.u_step * np.count_nonzero(profile >= profile[0] / 4)  # both ways: -6 dB
        assert profile.argmax() * table.u_step < 1e-3
    assert widths[30e-3] < widths[15e-3] and widths[30e-3] < widths[60e-3]


def test_a_short_focus_keeps_the_table_small():
    assert response_table(LinearArray(), 5e-3, 40e-3, 90e-3).waveforms.nbytes < 64 * 2**20


def test_parts_lie_within_their_cell_and_the_waveforms():
    table = response_table(LinearArray(n_elements=96, n_active=32), 8e-3, 40e-3, 90e-3)
    assert (table.cells[..., 1] > 1).any()  # lobes overlap
    for first, n_parts, start, length in table.cells.reshape(-1, 4):
        for part in table.parts[first : first + n_parts]:
            assert start <= part[4] and part[4] + part[5] <= start + length
    begin, end = (
        table.parts[:, :4] + table.parts[:, 4:5],
        table.parts[:, :4] + table.parts[:, 4:6].sum(1)[:, None],
    )
    assert begin.min() >= 0 and end.max() <= len(table.waveforms)
    assert table.span[0] == table.cells[..., 2][table.cells[..., 1] > 0].min()


def test_every_part_has_a_local_plane_wave():
    # At 5 mm there are orders that of a block's depths only the one below hears.
    table = response_table(LinearArray(), 5e-3, 40e-3, 90e-3)
    assert np.square(table.waves[:, 2:4]) + np.square(table.waves[:, 4:6]) == pytest.approx(1.0, abs=1e-5)


def test_is_made_once():
    assert response_table(ARRAY, FOCUS, 40e-3, 90e-3) is response_table(ARRAY, FOCUS, 40e-3, 90e-3)


def test_tables_are_kept_of_so_many_depths_as_were_asked_for(monkeypatch):
    made = []
    monkeypatch.setattr(module, "_tabulated", lambda *where: made.append(where[1]))
    monkeypatch.setattr(module, "_tables", lru_cache(maxsize=4)(module._tabulated))
    depths = [1e-3 * k for k in range(1, 7)]
    keep_tables(6)
    keep_tables(2)  # fewer than are kept already
    for depth in depths * 2:
        response_table(ARRAY, depth, 40e-3, 90e-3)
    assert made == depths
