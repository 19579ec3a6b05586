"""Frames from poses: where things show, and how frames follow the probe."""

import dataclasses

import numpy as np
import pytest

from usbench.envs.bmode import Imaging
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf
from usbench.envs.scanner import scan, scan_batch, view

PHANTOM = Phantom()


class Scene:
    """Stands in for a phantom: the given scatterers are all that is in view."""

    attenuation_db_per_cm_mhz = 0.0

    def __init__(self, positions):
        self.positions = np.reshape(np.asarray(positions, float), (-1, 3))

    def in_view(self, pose, half_width_m, half_thickness_m):
        return pose.to_probe(self.positions), np.ones(len(self.positions))


def correlation(a, b):
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


@pytest.fixture(scope="module")
def frame():
    return scan(PHANTOM, Pose())


def test_shape_and_type(frame):
    assert frame.shape == (90, 40) and frame.dtype == np.uint8
    assert frame.max() > 127 and (frame == 0).mean() < 0.5
    assert np.array_equal(frame, scan(Phantom(), Pose()))


@pytest.mark.parametrize("depth_mm", [30, 50])
@pytest.mark.parametrize("x_mm", [0, 8])
def test_a_point_shows_at_its_place(depth_mm, x_mm):
    point = Scene([(x_mm * 1e-3, 0, depth_mm * 1e-3)])  # between two pixels
    image = scan(point, Pose(0, depth_mm, 0), imaging=Imaging(median_size=1))
    row, column = np.unravel_index(image.argmax(), image.shape)
    assert row in (depth_mm - 1, depth_mm) and column in (x_mm + 19, x_mm + 20)


def test_a_wire_shows_at_its_place_through_the_median():
    # A single point at the focus is two pixels high: the median takes it for noise.
    image = scan(Scene([(0, 0, 50e-3 + dz) for dz in (-1.2e-3, 0, 1.2e-3)]), Pose(0, 50, 0))
    rows, columns = np.nonzero(image == image.max())
    assert image.max() > 0 and 49 <= rows.mean() + 0.5 <= 51 and 19 <= columns.mean() + 0.5 <= 21


def test_a_wide_probe_sees_as_far_as_its_image():
    """Beyond 20 mm, where the default image ends, wider ones once were black."""
    array, imaging = LinearArray(n_lines=96), Imaging(width_px=60, median_size=1)
    assert view(array, imaging) == (0.030, 0.005)
    image = scan(Phantom(), Pose(), array, imaging)
    assert image.shape == (90, 60)
    # Speckle of the tissue, as far to the sides as in the middle.
    assert min((image[:, :6] > 0).mean(), (image[:, -6:] > 0).mean()) > 0.7

    class Point(Scene):
        def in_view(self, pose, half_width_m, half_thickness_m):
            positions, amplitudes = super().in_view(pose, half_width_m, half_thickness_m)
            seen = np.abs(positions[:, 0]) <= half_width_m
            return positions[seen], amplitudes[seen]

    middle, aside = (scan(Point([(x, 0, 50e-3)]), Pose(), array, imaging) for x in (0.0, 25e-3))
    row, column = np.unravel_index(aside.argmax(), aside.shape)
    assert row in (49, 50) and column in (54, 55)
    # A pixel is a mean over its millimetre, in which a point's echo is short: as bright as in the middle.
    assert aside.max() > 80 and abs(int(aside.max()) - int(middle.max())) <= 2


def test_the_view_follows_probe_and_imaging():
    assert view(LinearArray(), Imaging()) == (20e-3, 5e-3)
    assert view(LinearArray(n_lines=32), Imaging(width_px=80, pixel_size=0.25e-3)) == (10e-3, 5e-3)
    assert view(LinearArray(slice_thickness=4e-3), Imaging(width_px=128)) == (64e-3, 2e-3)


def test_a_thick_slice_sees_what_lies_beside_the_image_plane(frame):
    thick = scan(Phantom(), Pose(), LinearArray(slice_thickness=20e-3))
    assert not np.array_equal(frame, thick)


def test_moving_the_probe_moves_a_point_the_other_way():
    point = Scene([(3e-3, 0, 50e-3)])
    imaging = Imaging(median_size=1)
    frames = [scan(point, Pose(x, 50, 0), imaging=imaging) for x in (-10, 0, 10)]
    columns = [frame[45:55].max(axis=0).argmax() for frame in frames]
    assert np.diff(columns) == pytest.approx([-10, -10], abs=1)


def test_every_coordinate_of_the_pose_counts(frame):
    for pose in (Pose(5, 50, 0), Pose(0, 45, 0), Pose(0, 50, 15)):
        difference = frame.astype(int) - scan(PHANTOM, pose)
        assert np.abs(difference).mean() > 3


@pytest.mark.parametrize("x_mm", [5, -5])
def test_speckle_moves_with_the_tissue(frame, x_mm):
    moved = scan(PHANTOM, Pose(x_mm, 50, 0))
    middle = np.arange(10, 30)  # 10 mm from the edges, behind which nothing is simulated
    assert correlation(frame[:, middle], moved[:, middle - x_mm]) >= 0.9
    # Not just the depth profile or the object: tissue beside and below it alone, and nowhere else.
    rows = slice(68, 88)
    shifts = np.arange(-8, 9)
    fits = [correlation(frame[rows, middle], moved[rows, middle - shift]) for shift in shifts]
    assert shifts[int(np.argmax(fits))] == x_mm and max(fits) >= 0.8


def test_half_a_turn_mirrors_the_frame(frame):
    turned = scan(PHANTOM, Pose(0, 50, 180))
    difference = np.abs(frame.astype(int) - turned[:, ::-1])
    assert difference.max() <= 3 and difference.mean() < 0.2


def test_the_object_is_bright_where_it_is(frame):
    z, x = np.meshgrid(np.arange(90) + 0.5, np.arange(40) - 19.5, indexing="ij")
    inside = np.hypot(x, z - 50) < 9
    beside = (np.abs(x) > 16) & (np.abs(z - 50) < 9)
    assert frame[inside].mean() > frame[beside].mean() + 255 * 10 / 60  # by more than 10 of the 20 dB


def test_array_and_imaging_count(frame):
    for array, imaging in (
        (dataclasses.replace(LinearArray(), n_active=32), Imaging()),
        (LinearArray(), Imaging(dynamic_range_db=40.0)),
    ):
        assert not np.array_equal(frame, scan(PHANTOM, Pose(), array, imaging))
    image = scan(PHANTOM, Pose(), imaging=Imaging(height_px=60, width_px=20, pixel_size=0.5e-3))
    assert image.shape == (60, 20)


def test_nothing_in_view_is_black():
    assert not scan(Scene([]), Pose()).any()
    empty = Phantom(tissue_density_per_mm3=0.0, object_density_per_mm3=0.0)
    assert not scan(empty, Pose()).any()


def test_same_bytes_for_any_number_of_threads(frame, monkeypatch):
    for n in ("1", "2", "3"):
        monkeypatch.setenv("USBENCH_THREADS", n)
        assert np.array_equal(scan(PHANTOM, Pose()), frame)


def test_a_batch_has_the_bits_of_the_frames_one_by_one(monkeypatch):
    scenes = [(Phantom(seed), Pose(x, 50, angle)) for seed in (0, 1) for x, angle in ((0, 0), (10, 45))]
    scenes.append((Phantom(1), Pose(-5, 45, 0)))
    batch = scan_batch(scenes)
    assert batch.shape == (5, 90, 40) and batch.dtype == np.uint8
    for frame, scene in zip(batch, scenes, strict=True):
        assert np.array_equal(frame, scan(*scene))
    monkeypatch.setenv("USBENCH_THREADS", "1")
    assert np.array_equal(scan_batch(scenes), batch)


def test_an_empty_batch_has_no_frames():
    assert scan_batch([]).shape == (0, 90, 40)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((3, Pose()), "phantom must be of type Phantom, Anatomy or PointScatterers, not 3"),
        ((Phantom(), 3), "pose must be of type Pose, not 3"),
        (
            (Phantom(), Pose(), "l7-4"),
            r"array must be of type LinearArray, not 'l7-4': usbench.read_probe\('l7-4'\)",
        ),
        ((Phantom(), Pose(), 3), "array must be of type LinearArray, not 3"),
        ((Phantom(), Pose(), LinearArray(), {}), "imaging must be of type Imaging, not {}"),
    ],
)
def test_refuses_what_is_of_another_type(arguments, said):
    with pytest.raises(TypeError, match=said):
        scan(*arguments)


@pytest.mark.parametrize("call", [simulate_rf, simulate_iq])
def test_rf_refuses_what_is_no_array(call):
    with pytest.raises(TypeError, match="array must be of type LinearArray, not 'l7-4'"):
        call([(0, 0, 0.03)], [1.0], "l7-4", 0.03)


def test_a_batch_may_come_from_a_generator_and_needs_an_imaging():
    scenes = [(Phantom(seed=0), Pose(angle_deg=angle)) for angle in (0, 15)]
    assert np.array_equal(scan_batch(scene for scene in scenes), scan_batch(scenes))
    with pytest.raises(TypeError, match="imaging must be of type Imaging, not None"):
        scan_batch(scenes, imaging=None)
