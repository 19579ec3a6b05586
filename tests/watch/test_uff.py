"""UFF files: what the reference package pyuff_ustb reads back of them, values and geometry."""

import h5py
import numpy as np
import pytest
import pyuff_ustb

from usbench import cli
from usbench.envs.bmode import bmode
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.records import ConfigurationError
from usbench.watch import snapshot, snapshot_files
from usbench.watch.snapshot_option import Source

POSE = Pose(5, 50, 30)


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    """What is written, and what the reference package reads of it, by kind."""
    found = {}
    for kind in snapshot.KINDS:
        taken = snapshot.take(Source(), POSE, kind)
        path = tmp_path_factory.mktemp("uff") / f"{kind}.uff"
        snapshot_files.write(taken, path)
        found[kind] = taken, pyuff_ustb.Uff(str(path)).read("b_data")
    return found


@pytest.mark.parametrize("kind", ["rf", "envelope", "iq"])
def test_lines_come_back_pixel_by_pixel(read, kind):
    taken, data = read[kind]
    assert type(data) is pyuff_ustb.BeamformedData and data.N_pixels == taken.values.size
    values = data.data.reshape(data.scan.N_x_axis, data.scan.N_z_axis).T
    np.testing.assert_array_equal(values, taken.values)
    assert values.dtype == taken.values.dtype
    # USTB's list of pixels.
    np.testing.assert_allclose(data.scan.x.reshape(-1, len(values)).T[0], DEFAULT_ARRAY.line_positions)
    assert data.scan.z_step * data.sampling_frequency * 2 == pytest.approx(1540)


def test_a_frame_comes_back_in_decibels(read):
    taken, data = read["frame"]
    decibels = 20 * np.log10(data.data.reshape(40, 90).T)
    assert decibels == pytest.approx(taken.values / 255 * 60 - 60)
    assert data.scan.x_axis == pytest.approx(np.arange(-19.5, 20) * 1e-3)
    assert data.scan.z_axis == pytest.approx(np.arange(0.5, 90) * 1e-3)


def test_probe_and_focused_waves_come_back(read):
    for _, data in read.values():
        x, _, _, _, _, width, height = data.probe.geometry
        assert x == pytest.approx((np.arange(192) - 95.5) * 0.49e-3)
        assert (set(width), set(height)) == ({0.44e-3}, {5e-3})
        assert len(data.sequence) == 64
        for wave, x in zip(data.sequence, DEFAULT_ARRAY.line_positions, strict=True):
            assert wave.wavefront == pyuff_ustb.Wavefront.spherical
            assert wave.source.xyz == pytest.approx([x, 0, 50e-3])
            assert wave.origin.xyz == pytest.approx([x, 0, 0], abs=1e-12)


def test_rf_is_the_carrier_times_iq(read):
    rf, iq = read["rf"][1], read["iq"][1]
    assert iq.modulation_frequency == DEFAULT_ARRAY.iq_center_frequency and rf.modulation_frequency == 0
    n = iq.scan.N_z_axis
    lines, z = iq.data.reshape(-1, n), iq.scan.z_axis
    expected = np.real(lines * np.exp(2j * np.pi * iq.modulation_frequency * 2 * z / 1540))
    every = rf.data.reshape(64, -1)[:, ::5][:, :n]
    np.testing.assert_allclose(every, expected[:, : every.shape[1]], atol=1e-3 * np.abs(every).max())


def test_the_image_of_what_is_read_is_the_frame(read):
    _, data = read["iq"]
    lines = data.data.reshape(data.scan.N_x_axis, -1).T
    first = 2 * float(data.scan.z_axis[0]) / 1540
    image = bmode(lines, float(data.sampling_frequency), data.scan.x_axis, time_zero=first)
    assert np.abs(image.astype(int) - read["frame"][0].values).max() <= 1


def test_the_file_is_hdf5_as_ustb_lays_it_out(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["frame", "--rf", "--out", "rf.uff"]) == 0
    assert "rf.uff: rf, " in capsys.readouterr().out
    with h5py.File("rf.uff") as file:
        assert file["b_data"].attrs["class"] == "uff.beamformed_data"
        assert file["b_data/scan"].attrs["class"] == "uff.linear_scan"
        assert file["b_data/probe"].attrs["class"] == "uff.linear_array"


def test_without_the_package_one_sentence_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr("usbench.watch.uff.find_spec", lambda name: None)
    with pytest.raises(ConfigurationError, match=r"pip install 'usbench\[uff\]'"):
        snapshot_files.path(tmp_path / "a.uff", "rf", Source(), POSE)
