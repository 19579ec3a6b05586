"""Where the voxels of a file lie, and what is between them, beside SimpleITK's own answers."""

import numpy as np
import pytest
import SimpleITK as sitk
from volumes import ORIGIN, SPACING, image, of_world, turned, write

from usbench.envs.anatomy import volume_file

GENERATOR = np.random.default_rng(0)
SIZE = (9, 7, 6)


def points(made, n=200):
    """Random places within the image, as index and as SimpleITK's position, (n, 3)."""
    index = GENERATOR.uniform(0, np.array(made.GetSize()) - 1, (n, 3))
    return index, np.array([made.TransformContinuousIndexToPhysicalPoint(one) for one in index.tolist()])


@pytest.fixture(
    params=["volume.nii.gz", "volume.nii", "volume.mha", "volume.mhd", "volume.nrrd", "volume.nhdr"]
)
def path(request, tmp_path):
    return tmp_path / request.param


def test_values_between_voxels_are_those_of_simple_itk(path):
    voxels = GENERATOR.integers(0, 255, SIZE[::-1]).astype(np.uint8)
    made = image(voxels, SPACING, ORIGIN, turned())
    sitk.WriteImage(made, str(path))
    volume = volume_file.read(path)
    assert volume.voxels.dtype == np.uint8 and volume.largest == voxels.max()
    _, places = points(made)
    expected = [made.EvaluateAtPhysicalPoint(place.tolist()) for place in places]
    # NIfTI holds places in 32 bits.
    np.testing.assert_allclose(volume.sample(places), expected, atol=0.01)
    assert volume.contains(places).all()


def test_a_linear_function_of_the_world_stays_one(tmp_path):
    made = of_world(lambda x, y, z: 200 + 2 * x - 1.5 * y + 0.5 * z, SIZE, SPACING, ORIGIN, turned())
    sitk.WriteImage(made, str(tmp_path / "ramp.mha"))
    _, places = points(made)
    found = volume_file.read(tmp_path / "ramp.mha").sample(places)
    np.testing.assert_allclose(found, 200 + places @ [2, -1.5, 0.5], rtol=1e-5)


def test_outside_is_nothing_and_the_outermost_voxels_are_inside(tmp_path):
    made = image(np.full(SIZE[::-1], 7, np.int16), SPACING, ORIGIN, turned())
    sitk.WriteImage(made, str(tmp_path / "flat.mha"))
    volume = volume_file.read(tmp_path / "flat.mha")
    corners = [made.TransformIndexToPhysicalPoint(ijk) for ijk in ((0, 0, 0), (8, 6, 5), (8, 0, 5))]
    np.testing.assert_array_equal(volume.sample(np.array(corners)), 7)
    beyond = [(-0.1, 3, 3), (8.1, 3, 3), (4, -0.1, 3), (4, 6.1, 3), (4, 3, -0.1), (4, 3, 5.1)]
    outside = np.array([made.TransformContinuousIndexToPhysicalPoint(one) for one in beyond])
    np.testing.assert_array_equal(volume.sample(outside), 0)
    assert not volume.contains(outside).any() and volume.contains(np.array(corners)).all()
    for corner in corners:
        assert np.isclose(volume.corners_mm, corner).all(axis=1).any()


def test_the_digest_is_of_the_content_and_not_of_the_file(tmp_path):
    voxels = GENERATOR.integers(0, 255, SIZE[::-1]).astype(np.uint8)
    one = volume_file.read(write(tmp_path / "one.mha", voxels, SPACING))
    assert volume_file.read(write(tmp_path / "another.nrrd", voxels, SPACING)).digest == one.digest
    changed = voxels.copy()
    changed[-1, -1, -1] ^= 1
    others = [
        write(tmp_path / "voxel.mha", changed, SPACING),
        write(tmp_path / "type.mha", voxels.astype(np.uint16), SPACING),
        write(tmp_path / "spacing.mha", voxels, (1.5, 2.0, 2.6)),
        write(tmp_path / "origin.mha", voxels, SPACING, (1.0, 0.0, 0.0)),
        write(tmp_path / "directions.mha", voxels, SPACING, directions=turned()),
    ]
    assert len({one.digest, *(volume_file.read(other).digest for other in others)}) == 6
