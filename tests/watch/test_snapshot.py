"""A pose seen: the pixels of the scanner itself, to scale, and a refusal where there is nothing to see."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from usbench import cli
from usbench.envs.bmode import DEFAULT_IMAGING, log_compress
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.rf import simulate_iq
from usbench.envs.scanner import scan, view
from usbench.envs.settings import Setup
from usbench.envs.tasks.random_phantoms import ProbePlaneRandomEnv
from usbench.records import ConfigurationError
from usbench.watch import snapshot

OFF_GRID = Pose(7, 37, 63)


SETUP = Setup(0, 50, 0, 3_000, 40)


@pytest.fixture(scope="module")
def stills():
    return {kind: snapshot.take(OFF_GRID, kind) for kind in snapshot.KINDS}


def test_frame_is_the_scanners(stills):
    np.testing.assert_array_equal(stills["frame"].values, scan(Phantom(), OFF_GRID))


def test_frame_with_settings_is_the_scanners():
    taken = snapshot.take(SETUP)
    np.testing.assert_array_equal(taken.values, scan(Phantom(), SETUP))
    shown = snapshot.figure(taken).axes[0]
    assert shown.images[0].get_clim() == (-40.0, 0.0) and shown.get_title().endswith("3 MHz, 40 dB")


def test_envelope_of_tissue_that_attenuates_is_the_simulators():
    phantom = Phantom(attenuation_db_per_cm_mhz=0.5)
    positions, amplitudes = phantom.in_view(SETUP, *view(DEFAULT_ARRAY, DEFAULT_IMAGING))
    array = replace(DEFAULT_ARRAY, center_frequency=3e6)
    iq, _ = simulate_iq(positions, amplitudes, array, 50e-3, max_depth=90e-3, attenuation_db_per_cm_mhz=0.5)
    np.testing.assert_allclose(snapshot.take(SETUP, "envelope", phantom).values, np.abs(iq), rtol=1e-5)


def test_rf_and_envelope_are_of_the_same_echoes(stills):
    rf, envelope = stills["rf"], stills["envelope"]
    assert rf.values.shape[1] == envelope.values.shape[1] == 64
    # 25 MHz and 5 MHz from the same instant: no sample of RF can exceed the envelope by more than rounding.
    peaks = np.abs(rf.values).max(), envelope.values.max()
    assert peaks[0] == pytest.approx(peaks[1], rel=0.1)
    # Depth 0 is half a pulse after time 0, and the envelope ends where the frame does.
    assert -1.0 < envelope.rows[0] < 0.0 and envelope.rows[1] == pytest.approx(90.0, abs=1.5)


def test_bare_pixels_are_the_frame(stills, tmp_path):
    snapshot.write(stills["frame"], tmp_path / "a.png", plain=True)
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (40, 90)
        np.testing.assert_array_equal(np.asarray(image), stills["frame"].values)


@pytest.mark.parametrize("kind", snapshot.KINDS)
def test_numbers_and_figure(stills, tmp_path, kind):
    snapshot.write(stills[kind], tmp_path / "a.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), stills[kind].values)
    snapshot.write(stills[kind], tmp_path / "a.png")
    assert len(np.unique(imread(tmp_path / "a.png"))) > 20


def test_figure_is_to_scale_and_names_units(stills):
    axes = snapshot.figure(stills["frame"]).axes[0]
    assert (axes.get_xlim(), axes.get_ylim()) == ((-20.0, 20.0), (90.0, 0.0))
    assert axes.get_aspect() == 1.0
    assert axes.get_xlabel().endswith("(mm)") and axes.get_ylabel().endswith("(mm)")
    assert snapshot.figure(stills["rf"]).axes[0].get_ylabel() == "time (µs)"


def test_envelope_shows_the_decibels_of_the_frames_chain(stills):
    shown = snapshot.figure(stills["envelope"]).axes[0].images[0].get_array()
    expected = log_compress(stills["envelope"].values, 60.0) - 60.0
    np.testing.assert_allclose(shown, expected, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "kind", "plain", "said"),
    [
        ("a.gif", "frame", False, r"\.png, \.npy, not 'a\.gif'"),
        ("no/a.png", "frame", False, "folder that exists"),
        ("a.png", "rf", True, "--plain"),
        ("a.npy", "frame", True, "--plain"),
    ],
)
def test_files_that_cannot_be_are_refused(tmp_path, name, kind, plain, said):
    with pytest.raises(ConfigurationError, match=said):
        snapshot.path(tmp_path / name, kind, OFF_GRID, plain)


def test_command_says_where_and_what(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    argv = ["frame", "--x", "-7", "--depth", "37", "--angle", "-63"]
    assert cli.main([*argv, "--plain"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("frame_x-7_depth37_angle297.png: frame, (90, 40) uint8, ")
    assert (tmp_path / "frame_x-7_depth37_angle297.png").exists()
    assert cli.main([*argv, "--rf", "--out", "a.bmp"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert cli.main([*argv, "--rf", "--envelope"]) == 2


def test_command_takes_a_tasks_phantom_and_settings(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    argv = ["frame", "--task", "pp-random", "--number", "7", "--plain"]
    assert cli.main(argv) == 0
    with Image.open(tmp_path / "frame_pp-random-7_x0_depth50_angle0.png") as image:
        env = ProbePlaneRandomEnv()
        seen, _ = env.reset(options={"phantom": 7, "x_mm": 0, "angle_deg": 0})
        np.testing.assert_array_equal(np.asarray(image), seen[:, :, 0])
    assert cli.main(["frame", "--task", "setup", "--frequency", "3", "--dynamic-range", "40"]) == 0
    name = "frame_setup_x0_depth50_angle0_3MHz_40dB.png"
    assert capsys.readouterr().out.splitlines()[-1].startswith(f"{name}: frame, ")


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--phantom", "a.nii", "--task", "pp"], "--phantom is in place of a task's phantom"),
        (["--phantom", "a.nii", "--number", "3"], "--phantom is in place of a task's phantom"),
    ],
)
def test_phantoms_that_exclude_each_other_are_refused(capsys, argv, said):
    assert cli.main(["frame", *argv]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
