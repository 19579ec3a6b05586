"""A pose seen: the pixels of the scanner itself, to scale, and a refusal where there is nothing to see."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from usbench import cli, read_probe
from usbench.envs.bmode import DEFAULT_IMAGING, Imaging, log_compress
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY, LinearArray
from usbench.envs.rf import simulate_iq
from usbench.envs.scanner import scan, view
from usbench.envs.settings import Setup
from usbench.envs.tasks.random_phantoms import ProbePlaneRandomEnv
from usbench.records import ConfigurationError
from usbench.watch import snapshot, snapshot_figure, snapshot_files
from usbench.watch.snapshot_option import Source

OFF_GRID = Pose(7, 37, 63)
SETUP = Setup(0, 50, 0, frequency_khz=3_000, dynamic_range_db=40)
# 60 mm wide, and square frames of pixels of half a millimetre.
WIDE = Source(Phantom(), "", LinearArray(n_lines=96), Imaging(height_px=128, width_px=128, pixel_size=0.5e-3))


@pytest.fixture(scope="module")
def taken():
    return {kind: snapshot.take(Source(), OFF_GRID, kind) for kind in snapshot.KINDS}


def test_a_kind_that_there_is_not_is_refused():
    with pytest.raises(ConfigurationError, match="unknown kind 'doppler': allowed are 'frame', 'envelope'"):
        snapshot.take(Source(), OFF_GRID, "doppler")


def test_frame_is_the_scanners(taken):
    np.testing.assert_array_equal(taken["frame"].values, scan(Phantom(), OFF_GRID))


def test_frame_with_settings_is_the_scanners():
    frame = snapshot.take(Source(), SETUP)
    np.testing.assert_array_equal(frame.values, scan(Phantom(), SETUP))
    shown = snapshot_figure.figure(frame).axes[0]
    assert shown.images[0].get_clim() == (-40.0, 0.0) and shown.get_title().endswith("3 MHz, 40 dB")


def test_envelope_of_tissue_that_attenuates_is_the_simulators():
    phantom = Phantom(attenuation_db_per_cm_mhz=0.5)
    positions, amplitudes = phantom.in_view(SETUP, *view(DEFAULT_ARRAY, DEFAULT_IMAGING))
    array = replace(DEFAULT_ARRAY, center_frequency=3e6)
    iq, _ = simulate_iq(positions, amplitudes, array, 50e-3, max_depth=90e-3, attenuation_db_per_cm_mhz=0.5)
    np.testing.assert_allclose(
        snapshot.take(Source(phantom), SETUP, "envelope").values, np.abs(iq), rtol=1e-5
    )


def test_rf_and_envelope_are_of_the_same_echoes(taken):
    rf, envelope = taken["rf"], taken["envelope"]
    assert rf.values.shape[1] == envelope.values.shape[1] == 64
    # 25 MHz and 5 MHz from the same instant: no sample of RF can exceed the envelope by more than rounding.
    peaks = np.abs(rf.values).max(), envelope.values.max()
    assert peaks[0] == pytest.approx(peaks[1], rel=0.1)
    # Depth 0 is half a pulse after time 0, and the envelope ends where the frame does.
    assert -1.0 < envelope.rows[0] < 0.0 and envelope.rows[1] == pytest.approx(90.0, abs=1.5)


def test_bare_pixels_are_the_frame(taken, tmp_path):
    snapshot_files.write(taken["frame"], tmp_path / "a.png", plain=True)
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (40, 90)
        np.testing.assert_array_equal(np.asarray(image), taken["frame"].values)


@pytest.mark.parametrize("kind", snapshot.KINDS)
def test_numbers_and_figure(taken, tmp_path, kind):
    snapshot_files.write(taken[kind], tmp_path / "a.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), taken[kind].values)
    snapshot_files.write(taken[kind], tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        np.testing.assert_array_equal(arrays[kind], taken[kind].values)
        assert (len(arrays["z"]), len(arrays["x"])) == arrays[kind].shape and arrays["focal_depth"] == 37e-3
    if kind == "iq":
        return
    snapshot_files.write(taken[kind], tmp_path / "a.png")
    assert len(np.unique(imread(tmp_path / "a.png"))) > 20


@pytest.mark.parametrize("suffix", [".npz", ".uff"])
def test_a_frame_of_one_row_is_written(tmp_path, suffix):
    taken = snapshot.take(Source(imaging=Imaging(height_px=1)), OFF_GRID)
    snapshot_files.write(taken, tmp_path / f"a{suffix}")
    assert (tmp_path / f"a{suffix}").stat().st_size > 0
    # As in a frame of more rows, whose pixels are as high.
    assert taken.sampling_frequency == pytest.approx(1540 / 2 / 1e-3)


def test_figure_is_to_scale_and_names_units(taken):
    axes = snapshot_figure.figure(taken["frame"]).axes[0]
    assert (axes.get_xlim(), axes.get_ylim()) == ((-20.0, 20.0), (90.0, 0.0))
    assert axes.get_aspect() == 1.0
    assert axes.get_xlabel().endswith("(mm)") and axes.get_ylabel().endswith("(mm)")
    assert snapshot_figure.figure(taken["rf"]).axes[0].get_ylabel() == "depth (mm)"


def test_rf_is_drawn_over_depth_and_ends_where_the_frame_does(taken):
    axes = snapshot_figure.figure(taken["rf"]).axes[0]
    bottom, top = axes.get_ylim()
    assert -1.0 < top < 0.0 and bottom == pytest.approx(90.0, abs=1.5)
    (time,) = axes.child_axes
    assert time.get_ylabel() == "time (µs)"
    # The middle of the echo from 50 mm comes 2 z / c + the pulse's delay after time 0.
    microseconds = time._functions[0](50.0)  # matplotlib has no public name for it
    assert microseconds == pytest.approx(0.1 / 1540 * 1e6 + DEFAULT_ARRAY.pulse_delay * 1e6)
    # Every period reaches the page.
    assert len(taken["rf"].values) / 25e6 * 1540 / 2 == pytest.approx(91e-3, abs=1e-3)


def test_envelope_shows_the_decibels_of_the_frames_chain(taken):
    shown = snapshot_figure.figure(taken["envelope"]).axes[0].images[0].get_array()
    expected = log_compress(taken["envelope"].values, 60.0) - 60.0
    np.testing.assert_allclose(shown, expected, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "kind", "plain", "said"),
    [
        ("a.gif", "frame", False, r"\.png, \.npy, \.npz, \.uff, not 'a\.gif'"),
        ("no/a.png", "frame", False, "folder that exists"),
        ("a.png", "rf", True, "only a frame as .png has bare pixels"),
        ("a.png", "iq", False, "I/Q has no picture of its own"),
        ("a.npy", "frame", True, "only a frame as .png has bare pixels"),
    ],
)
def test_files_that_cannot_be_are_refused(tmp_path, name, kind, plain, said):
    with pytest.raises(ConfigurationError, match=said):
        snapshot_files.path(tmp_path / name, kind, Source(), OFF_GRID, plain=plain)


def test_another_probe_and_imaging_are_what_is_seen_named_and_drawn(tmp_path, monkeypatch):
    frame = snapshot.take(WIDE, OFF_GRID)
    np.testing.assert_array_equal(frame.values, scan(Phantom(), OFF_GRID, WIDE.probe, WIDE.imaging))
    drawn = snapshot_figure.figure(frame)
    axes = drawn.axes[0]
    assert (axes.get_xlim(), axes.get_ylim()) == ((-32.0, 32.0), (64.0, 0.0))
    title = axes.get_title().replace("\n", " ")
    assert title.endswith("n_lines 96, height_px 128, width_px 128, pixel_size 0.0005")
    assert drawn.get_figwidth() > 7 > snapshot_figure.figure(snapshot.take(Source(), OFF_GRID)).get_figwidth()
    for kind in ("envelope", "rf"):
        seen = snapshot.take(WIDE, OFF_GRID, kind)
        assert seen.values.shape[1] == 96
        assert snapshot_figure.figure(seen).axes[0].get_xlim() == pytest.approx((-30.0, 30.0))
    preset = Source(probe=read_probe("l7-4"), imaging=Imaging(pixel_size=0.5e-3, median_size=1))
    assert preset.changes == ["probe l7-4", "pixel_size 0.0005", "median_size 1"]
    # Nothing of another probe or imaging takes the place of the default's file.
    monkeypatch.chdir(tmp_path)
    plain, wide = (snapshot_files.path(None, "frame", source, OFF_GRID).name for source in (Source(), WIDE))
    assert plain == "frame_x7_depth37_angle63.png"
    assert wide == f"frame_{WIDE.names[0]}_x7_depth37_angle63.png" and len(WIDE.names[0]) == 8


def test_command_takes_a_probe_and_an_imaging(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "probe.toml").write_text("n_lines = 96")
    (tmp_path / "imaging.toml").write_text("height_px = 64\nwidth_px = 60")
    argv = ["frame", "--probe", "probe.toml", "--imaging", "imaging.toml"]
    assert cli.main([*argv, "--plain", "--out", "a.png"]) == 0
    assert capsys.readouterr().out.startswith("a.png: frame, (64, 60) uint8, ")
    (tmp_path / "probe.toml").write_text("sampling_frequency = 30e6\ncenter_frequency = 3e6")
    assert cli.main([*argv, "--frequency", "9"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


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


def test_a_dynamic_range_alone_leaves_the_frequency_of_the_probe(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "probe.toml").write_text("center_frequency = 5.2083e6")
    argv = ["frame", "--probe", "probe.toml", "--out", "a.npy", "--dynamic-range", "40"]
    assert cli.main(argv) == 0
    probe, imaging = LinearArray(center_frequency=5.2083e6), Imaging(dynamic_range_db=40)
    np.testing.assert_array_equal(np.load("a.npy"), scan(Phantom(), Pose(), probe, imaging))


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--x", "900"], "--x must be in [-40, 40], where the phantom is, not 900."),
        (["--depth", "0"], "--depth must be at least 1, not 0."),
        (["--angle", "up"], "--angle must be a whole number, not 'up'"),
        (["--frequency", "99"], "--frequency must be a number in [1, 10], not 99"),
        (["--dynamic-range", "0"], "--dynamic-range must be a whole number in [1, 200], not 0"),
        (["--pixel", "0"], "--pixel must be a number in [0.01, 10], not 0"),
        (["--median", "2"], "--median must be odd, not 2"),
    ],
)
def test_a_wrong_value_is_told_by_its_option(capsys, argv, said):
    assert cli.main(["frame", *argv]) == 2
    assert f"usbench: error: {said}" in capsys.readouterr().err


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


def test_command_shows_points_of_a_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wire.csv").write_text("x_mm,y_mm,z_mm,amplitude\n3,0,20,1\n")
    argv = ["frame", "--scatterers", "wire.csv", "--depth", "20", "--pixel", "0.25", "--out", "wire.npy"]
    assert cli.main(argv) == 0
    frame = np.load("wire.npy")
    assert frame.shape == (92, 160) and np.unravel_index(frame.argmax(), frame.shape)[0] in (79, 80)
    assert cli.main([*argv, "--x", "90"]) == 2
    assert "none of the 1 scatterers is in view" in capsys.readouterr().err
    assert cli.main([*argv, "--task", "pp"]) == 2
    assert "--scatterers is in place of a task's phantom" in capsys.readouterr().err
    assert cli.main([*argv, "--phantom", "spine.mha"]) == 2
    assert "exclude each other" in capsys.readouterr().err
