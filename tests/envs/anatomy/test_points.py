"""Scatterers of a user: read from both kinds of files, refused in one sentence, shown where they are."""

import io
import re
import zipfile

import numpy as np
import pytest

import usbench
from usbench import (
    Imaging,
    LinearArray,
    PointScatterers,
    Pose,
    read_points,
    scan,
    simulate_rf,
    simulated_bmode,
)
from usbench.checks import ConfigurationError
from usbench.envs.anatomy import point_file

NARROW = LinearArray(n_elements=96, n_active=24, n_lines=33, line_spacing=0.3e-3)
FINE = Imaging(height_px=200, width_px=50, pixel_size=0.2e-3, median_size=1)
POINTS = np.array([(0, 0, 20e-3), (2e-3, 0, 30e-3)])


@pytest.mark.parametrize("scale, names", [(1, "x,y,z,amplitude"), (1e3, "amplitude , z_mm, y_mm,x_mm, note")])
def test_both_units_and_any_order_of_columns(scale, names, tmp_path):
    values = {
        "x": POINTS[:, 0] * scale,
        "y": POINTS[:, 1] * scale,
        "z": POINTS[:, 2] * scale,
        "amplitude": [1, 2],
    }
    ordered = [values.get(name.strip().removesuffix("_mm"), [7, 7]) for name in names.split(",")]
    rows = [",".join(map(str, row)) for row in zip(*ordered, strict=True)]
    (tmp_path / "wires.csv").write_text("# wires\n" + "\n".join([names, *rows]) + "\n")
    found = read_points(tmp_path / "wires.csv")
    assert found.positions == pytest.approx(POINTS) and list(found.amplitudes) == [1, 2]
    assert found.label == "wires"


def test_arrays_of_numpy(tmp_path):
    x, y, z = POINTS.T
    np.savez(tmp_path / "wires.npz", x=x, y=y, z=z, amplitude=[1, 2])
    found = read_points(str(tmp_path / "wires.npz"))
    np.testing.assert_array_equal(found.positions, POINTS)
    assert repr(found) == repr(PointScatterers(POINTS, [1, 2])) != repr(PointScatterers(POINTS, [1, 3]))


def test_a_single_point_is_seen_where_it_is():
    frame = scan(PointScatterers([(2e-3, 0, 30e-3)], [1.0]), Pose(focal_depth_mm=30), NARROW, FINE)
    row, column = np.unravel_index(frame.argmax(), frame.shape)
    assert frame.max() > 240
    assert ((row + 0.5) * 0.2, (column + 0.5) * 0.2 - 5) == pytest.approx((30, 2), abs=0.2)


def test_a_frame_is_made_of_the_signals_of_simulate_rf():
    points = PointScatterers(POINTS, [1.0, 1.0])
    rf, _ = simulate_rf(POINTS, [1.0, 1.0], NARROW, 25e-3)
    frame = scan(points, Pose(focal_depth_mm=25), NARROW, FINE)
    whole = simulated_bmode(rf, NARROW, FINE)
    # The frame comes from I/Q, with samples as far apart as pixels: decibels between them are interpolated.
    difference = whole.astype(float) - frame
    assert np.abs(difference[frame > 128]).max() <= 12 and frame.max() > 240
    some = simulated_bmode(rf[:, 8:25], NARROW, FINE, NARROW.line_positions[8:25])
    np.testing.assert_array_equal(some[:, 14:36], whole[:, 14:36])
    assert (some[:, :12] == 0).all()


def test_what_is_out_of_view_is_left_out():
    points = PointScatterers([(0, 0, 30e-3), (9e-3, 0, 30e-3), (0, 6e-3, 30e-3)], [1.0, 2.0, 3.0])
    assert list(points.in_view(Pose(), 8e-3, 5e-3)[1]) == [1.0]
    assert list(points.in_view(Pose(x_mm=9), 8e-3, 5e-3)[1]) == [2.0]
    # At 90 degrees the image plane is that of x = 0.
    assert sorted(points.in_view(Pose(angle_deg=90), 8e-3, 5e-3)[1]) == [1.0, 3.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n0,0,0.03\n", "not x, y, z: missing amplitude."),
        ("x_mm,y,z,amplitude\n0,0,0.03,1\n", "not x_mm, y, z, amplitude: missing y_mm, z_mm."),
        ("x_mm,x_mm,y_mm,z_mm,amplitude\n0,1,0,30,1\n", "x_mm must be one of its columns, not 2 of them."),
        # With blanks it is the same name.
        ("x,y,z,amplitude, amplitude \n0,0,0.03,1,1\n", "amplitude must be one of its columns, not 2 of"),
        ("x,y,z,amplitude\n0,0,0.03,1\n0,0,nan,1\n", "z of scatterer 2 must be a finite number."),
        ("x,y,z,amplitude\n0,0,0.03,loud\n", "amplitude of scatterer 1 must be a finite number."),
        ("x,y,z,amplitude\n", "it has no scatterer."),
        (
            "1,2,30,1\n2,0,35,1\n",
            "its first line must name the columns (x, y, z, amplitude), not hold numbers.",
        ),
        ("0,0,0.03,0\n2,0,35,1\n", "its first line must name the columns"),
        ("", "it is empty."),
        ("x,y,z,amplitude\n0,0,0.03,1\n0,0,0.03,1,5,6\n", "it is no table of numbers"),
        # The first value would become an index, and the others would have the wrong names.
        ("x_mm,y_mm,z_mm,amplitude\n0,1,20,3,7\n", "lines have more values than its header has names (4)."),
        ("x,y,z,amplitude\n0,0,0.03,1,\n", "lines have more values than its header has names (4)."),
        (
            "x,y,z,amplitude\n0,0,0.03,1\n0,0,0.03,-1e300\n",
            "amplitude of scatterer 2 must be a number in [-1e+30, 1e+30], not -1e+300.",
        ),
        ("x,y,z,amplitude\n0,0,30,1\n", "within 0.5 m, not 30 m: are the positions in mm?"),
        ("x,y,z,amplitude\n0,0,-0.01,1\n", "below the surface (z > 0), not at z = -0.01 m."),
    ],
)
def test_tables_that_cannot_be_used(text, message, tmp_path):
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(ConfigurationError, match=re.escape(message)) as refused:
        read_points(tmp_path / "points.csv")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"x": [0.0]}, "not x: missing y, z, amplitude."),
        ({name: np.zeros((2, 2)) for name in ("x", "y", "z", "amplitude")}, "one shape (n,), not (2, 2)."),
        ({"x": [0.0], "y": [0.0], "z": [0.1, 0.2], "amplitude": [1.0]}, "one shape (n,), not (1,), (2,)."),
        (
            {"x": [0.0], "y": [0.0], "z": [0.1], "amplitude": [1 + 1j]},
            "amplitude must be real numbers, not complex128.",
        ),
        ({"x": ["0"], "y": [0.0], "z": [0.1], "amplitude": [1]}, "x must be real numbers, not <U1."),
        ({name: np.array(["a"], object) for name in ("x", "y", "z", "amplitude")}, "cannot be used"),
    ],
)
def test_arrays_that_cannot_be_used(arrays, message, tmp_path):
    np.savez(tmp_path / "points.npz", **arrays)
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        read_points(tmp_path / "points.npz")


def test_complex_numbers_are_no_places_and_no_amplitudes():
    for name, arguments in (("positions", (POINTS * 1j, [1, 2])), ("amplitudes", (POINTS, [1, 2j]))):
        with pytest.raises(ValueError, match=f"^{name} must be real numbers, not complex128.$"):
            PointScatterers(*arguments)


def test_the_strongest_scatterers_make_a_frame_and_stronger_ones_are_refused():
    places = np.full((1000, 3), (0, 0, 30e-3))
    frame = scan(PointScatterers(places, np.full(1000, 1e30)), Pose(focal_depth_mm=30), NARROW, FINE)
    weak = scan(PointScatterers(places, np.ones(1000)), Pose(focal_depth_mm=30), NARROW, FINE)
    assert frame.max() > 240 and np.abs(frame.astype(int) - weak).max() <= 1
    with pytest.raises(ValueError, match=r"amplitude of scatterer 2 must be a number in .* not 1e\+31"):
        PointScatterers(POINTS, [1.0, 1e31])


@pytest.mark.parametrize("name", ["points.npz", "points.csv"])
def test_noise_is_no_file(name, tmp_path):
    (tmp_path / name).write_bytes(bytes(range(128, 256)) * 9)
    with pytest.raises(ConfigurationError, match="it is no (file of arrays|table of numbers)"):
        read_points(tmp_path / name)


def overwritten(name):
    """Return what overwrites the beginning of a packed array with ones."""

    def damage(data):
        start = data.index(name.encode()) + 50
        return data[:start] + b"\xff" * 100 + data[start + 100 :]

    return damage


# Version, flags and packing, as both headers of every array in the archive have them.
HEADER = bytes([45, 0, 0, 0, 8, 0])


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (overwritten("x.npy"), "Error -3 while decompressing data"),
        (overwritten("amplitude.npy"), "Error -3 while decompressing data"),
        (lambda data: data.replace(HEADER, bytes([45, 0, 1, 0, 8, 0])), "is encrypted"),
        (
            lambda data: data.replace(HEADER, bytes([45, 0, 0, 0, 99, 0])),
            "compression method is not supported",
        ),
    ],
)
@pytest.mark.parametrize("read", [read_points, point_file.read])
def test_an_archive_that_cannot_be_unpacked_is_refused(damage, said, read, tmp_path):
    values = np.random.default_rng(0).uniform(0.01, 0.02, (4, 100))
    path = tmp_path / "points.npz"
    np.savez_compressed(path, **dict(zip(("x", "y", "z", "amplitude"), values, strict=True)))
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ValueError, match=f"it is no file of arrays .*{said}"):
        read(path)


def test_other_files_and_missing_ones(tmp_path):
    (tmp_path / "points.txt").write_text("x,y,z,amplitude\n0,0,0.03,1\n")
    with pytest.raises(ConfigurationError, match="unknown suffix '.txt': allowed are '.csv', '.npz'."):
        read_points(tmp_path / "points.txt")
    with pytest.raises(ConfigurationError, match="cannot be read \\(No such file or directory\\)"):
        read_points(tmp_path / "none.csv")


def array_file(path, n):
    """An .npz file that says of its arrays that they have `n` values, and holds none."""
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("x", "y", "z", "amplitude"):
            header = io.BytesIO()
            np.lib.format.write_array_header_1_0(
                header, {"descr": "<f8", "fortran_order": False, "shape": (n,)}
            )
            archive.writestr(f"{name}.npy", header.getvalue())


def table_file(path, n):
    """A .csv file as long as one of `n` rows; the disk holds a few of them."""
    row = b"0.001,0.001,0.03,1.00\n"
    with path.open("wb") as file:
        file.write(b"x,y,z,amplitude\n" + row * 5000)
        file.truncate(n * len(row))


@pytest.mark.parametrize("make, name", [(array_file, "points.npz"), (table_file, "points.csv")])
def test_memory_is_stated_before_it_starts(make, name, tmp_path, monkeypatch):
    monkeypatch.setattr("usbench.envs.anatomy.points.memory_bytes", lambda: 25e9)
    make(tmp_path / name, 10**8)
    with pytest.raises(ConfigurationError, match=r"1e\+08 scatterers need some 30 GB of memory, .* 25 GB\.$"):
        read_points(tmp_path / name)
    make(tmp_path / name, 2 * 10**6)
    told = []
    with pytest.raises(ConfigurationError):  # as there are no numbers
        read_points(tmp_path / name, tell=told.append)
    assert told == [f"{tmp_path / name}: some 2e+06 scatterers need some 0.6 GB of memory."]


@pytest.mark.parametrize(
    ("positions", "amplitudes", "message"),
    [
        ([(0, 0)], [1.0], "positions must have shape (n, 3) with n >= 1, not (1, 2)."),
        ([], [], "positions must have shape (n, 3) with n >= 1, not (0,)."),
        (POINTS, [1.0], "amplitudes must have shape (2,) like positions, not (1,)."),
        (POINTS * np.nan, [1.0, 1.0], "positions must be finite, without NaN."),
    ],
)
def test_refuses_points(positions, amplitudes, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        usbench.PointScatterers(positions, amplitudes)
