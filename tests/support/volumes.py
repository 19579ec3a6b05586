"""Small volumes written by the tests: SimpleITK is the independent reference of where a voxel lies."""

import numpy as np
import SimpleITK as sitk

# Turned about two axes, with other spacings along each: nothing can be mixed up unnoticed.
SPACING = (1.5, 2.0, 2.5)
ORIGIN = (-20.0, 35.0, 7.0)


def turned(degrees=(30.0, 20.0)):
    """Directions of i, j, k as columns: a rotation about z, then about x."""
    (a, b) = np.radians(degrees)
    about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return about_x @ about_z


def image(voxels, spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0), directions=None):
    """An image of voxels (n_k, n_j, n_i)."""
    made = sitk.GetImageFromArray(voxels)
    made.SetSpacing(spacing)
    made.SetOrigin(origin)
    made.SetDirection((np.eye(3) if directions is None else directions).ravel().tolist())
    return made


def write(path, *args, **kwargs):
    """Write an image and return its path."""
    sitk.WriteImage(image(*args, **kwargs), str(path))
    return path


def of_world(value, size, spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0), directions=None):
    """An image whose voxels are `value(x, y, z)` of the places where SimpleITK puts them; size (i, j, k)."""
    turn = (np.eye(3) if directions is None else directions).ravel().tolist()
    places = sitk.PhysicalPointSource(sitk.sitkVectorFloat64, size, origin, spacing, turn)
    voxels = value(*np.moveaxis(sitk.GetArrayFromImage(places), -1, 0))
    return image(voxels.astype(np.float32), spacing, origin, directions)


def block(path, size=(81, 61, 91), **kwargs):
    """Write a block of tissue with x, y around 0 and z from 0, 1 mm voxels: brighter to the right."""
    half = [(n - 1) / 2 for n in size]
    made = of_world(lambda x, y, z: 100 + x, size, origin=(-half[0], -half[1], 0.0), **kwargs)
    sitk.WriteImage(made, str(path))
    return path
