"""The one-way field of an aperture against the sum over its elements, written out."""

import numpy as np
import pytest

from usbench.envs.field.aperture import aperture
from usbench.envs.field.slow_sum import one_way
from usbench.envs.probe import LinearArray

ARRAY = LinearArray()
FREQUENCIES = np.linspace(1.5e6, 5.5e6, 48)
DEPTHS = np.array([8e-3, 20e-3, 50e-3, 80e-3])


def prepared(focal_depth, array=ARRAY):
    return aperture(array, focal_depth, FREQUENCIES, 30e-3, 90e-3, 5, 2, orders=(-2, -1, 0, 1, 2))


def expected_fields(beam, focal_depth, offset, columns, array=ARRAY):
    """Of the line at `offset` from its aperture, (n_depths, n_columns, n_frequencies)."""
    line = float(array.aperture_centers(np.zeros(1))[0]) + offset
    return np.array(
        [
            [one_way((line + beam.u[j], 0.0, z), array, focal_depth, line, FREQUENCIES) for j in columns]
            for z in DEPTHS
        ]
    )


def difference(fields, expected):
    """Energy of the difference over that of the expected, the largest of all depths."""
    error = np.square(np.abs(fields - expected)).sum(axis=(1, 2))
    return float((error / np.square(np.abs(expected)).sum(axis=(1, 2))).max())


@pytest.mark.parametrize("focal_depth", [5e-3, 20e-3, 50e-3])
@pytest.mark.parametrize("offset", [0.0, 0.11e-3, -0.24e-3])
def test_lobes_add_up_to_the_sum_over_elements(focal_depth, offset):
    beam = prepared(focal_depth)
    columns = np.arange(0, len(beam.u), 17)
    turns = np.array(beam.orders)[:, np.newaxis, np.newaxis, np.newaxis] * offset / ARRAY.pitch
    fields = (beam.fields(DEPTHS)[:, :, columns] * np.exp(-2j * np.pi * turns)).sum(axis=0)
    assert difference(fields, expected_fields(beam, focal_depth, offset, columns)) <= 5e-3


def test_all_elements_are_in_phase_at_the_focus():
    # |H| = sum of a w_n / (2 pi r_n) sinc, the largest that it can be; the echo's one-way delay is F / c.
    flat = LinearArray(n_elevation=1, element_height=1e-6)
    spectrum = prepared(50e-3, flat).fields(np.array([50e-3]))[:, 0, 0].sum(axis=0)
    x = (np.arange(64) - 31.5) * flat.pitch
    r = np.hypot(x, 50e-3)
    directivity = np.sinc(FREQUENCIES[:, np.newaxis] * flat.element_width * x / (r * 1540))
    area = flat.element_width * flat.element_height
    largest = (flat.apodization / r * directivity).sum(axis=1) * area / (2 * np.pi)
    assert np.abs(spectrum) == pytest.approx(largest, rel=1e-3, abs=0)
    in_phase = spectrum * np.exp(2j * np.pi * FREQUENCIES * 50e-3 / 1540)
    assert np.angle(in_phase) == pytest.approx(0, abs=2e-2)


def test_moved_gives_the_field_beside():
    beam = prepared(20e-3)
    columns = slice(0, -1)
    beside = beam.moved(float(beam.u[1])).fields(DEPTHS)[:, :, columns]
    expected = beam.fields(DEPTHS)[:, :, 1:]
    assert np.abs(beside - expected).max() <= 1e-2 * np.abs(expected).max()


def test_moment_is_the_field_times_the_distance():
    # Of a single element, r is the same for all of it.
    array = LinearArray(n_elements=1, n_active=1)
    beam = aperture(array, 50e-3, FREQUENCIES, 10e-3, 90e-3, 5, 2, orders=(-2, -1, 0, 1, 2))
    r = np.hypot(beam.u, DEPTHS[:, np.newaxis])[:, :, np.newaxis]
    moment, field = beam.fields(DEPTHS, moment=True).sum(axis=0), beam.fields(DEPTHS).sum(axis=0)
    assert moment == pytest.approx(field * r, rel=1e-3, abs=0)
