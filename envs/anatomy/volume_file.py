"""Volumes read from files: what cannot be meant is refused in one sentence, by the header where it tells."""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from usbench.checks import install
from usbench.envs.anatomy import nifti
from usbench.envs.anatomy.volume import Volume

ENDINGS = (*nifti.ENDINGS, ".mha", ".mhd", ".nrrd", ".nhdr")
MAX_BYTES = 512_000_000
SPACING_MM = (0.01, 10.0)
# What the largest voxel can be, so that tissue fits single precision.
LARGEST = (1e-20, 1e30)
# Of NRRD, whose units ITK does not look at.
_UNITS = re.compile(rb"^space units:([^\r\n]*)", re.MULTILINE)
# Where headers of text hold the spacing.
_SPACING = re.compile(rb"^(ElementSpacing|ElementSize|spacings|space directions)\s*[=:]", re.MULTILINE)
_HEADER_BYTES = 65_536


def read(path: str | Path) -> Volume:
    """Read a volume from a NIfTI, MHA or NRRD file.

    Raises:
        FileNotFoundError: If there is no such file.
        IsADirectoryError: If it is a folder.
        ModuleNotFoundError: If SimpleITK is not installed.
        ValueError: If it is no volume of echoes; one sentence says what is wrong and what is allowed.
    """
    path = Path(path)
    if not path.name.lower().endswith(ENDINGS):
        raise ValueError(f"a volume must be a file {', '.join(ENDINGS)}, not {path.name!r}.")
    if path.is_dir():
        raise IsADirectoryError(f"a volume must be a file, not the folder {str(path)!r}.")
    if not path.is_file():
        raise FileNotFoundError(f"there is no volume {str(path)!r}.")
    itk = _simple_itk()
    reader = itk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        with _silent():
            reader.ReadImageInformation()
    except RuntimeError as error:
        raise ValueError(f"{str(path)!r} is not a readable NIfTI, MHA or NRRD file.") from error
    _check_voxels(path, itk, reader)
    _check_places(path, reader)
    if _is_nifti(path):
        # ITK reads as 0 what is cut off, and what is not finite.
        _check_finite(path, nifti.read_voxels(path, math.prod(reader.GetSize())))
    try:
        with _silent():
            image = reader.Execute()
    except RuntimeError as error:
        raise ValueError(f"the voxels of {str(path)!r} cannot be read: the file is damaged.") from error
    voxels = itk.GetArrayFromImage(image)
    _check_values(path, voxels)
    # Adding 0 turns -0 into 0.
    places = (
        np.array(values) + 0.0 for values in (image.GetSpacing(), image.GetOrigin(), image.GetDirection())
    )
    spacing, origin, directions = places
    return Volume(voxels, spacing, origin, directions.reshape(3, 3))


def _simple_itk() -> Any:
    try:
        import SimpleITK
    except ImportError:
        raise ModuleNotFoundError(f"reading a volume needs SimpleITK: {install('anatomy')}.") from None
    return SimpleITK


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Keep from the terminal what ITK's readers print beside their errors, past Python's sys.stderr."""
    stderr, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(nowhere)


def _check_voxels(path: Path, itk: Any, header: Any) -> None:
    """Refuse what is no 3-D image of single values, or too large, before any voxel is read."""
    size = header.GetSize()
    if len(size) != 3:
        raise ValueError(f"a volume must have 3 dimensions, not {len(size)} as {str(path)!r}.")
    if header.GetNumberOfComponents() != 1:
        raise ValueError(
            f"a voxel must be 1 value, not {header.GetNumberOfComponents()} (colours, vectors, complex "
            f"numbers) as in {str(path)!r}."
        )
    if min(size) < 2:
        raise ValueError(
            f"a volume must have at least 2 voxels along every axis, not {size} as {str(path)!r}."
        )
    n_bytes = int(np.prod(size, dtype=object)) * _bytes_of(itk, header)
    if n_bytes > MAX_BYTES:
        raise ValueError(
            f"a volume must take at most {MAX_BYTES / 1e6:.0f} MB, not {n_bytes / 1e6:.0f} MB as "
            f"{str(path)!r}: crop it or resample it."
        )


def _bytes_of(itk: Any, header: Any) -> int:
    return int(itk.Image([1, 1, 1], header.GetPixelIDValue()).GetSizeOfPixelComponent())


def _check_places(path: Path, header: Any) -> None:
    """Refuse a spacing that is not said or cannot be meant, and axes that are not at right angles."""
    for unit in _units(path):
        if unit not in ("", "mm"):
            raise ValueError(f"the space units of {str(path)!r} must be mm, not {unit!r}: convert the file.")
    spacing, low, high = header.GetSpacing(), *SPACING_MM
    if not _says_spacing(path) or not all(low <= value <= high for value in spacing):
        said = "x".join(f"{value:g}" for value in spacing) if _says_spacing(path) else "missing"
        raise ValueError(
            f"the spacing of {str(path)!r} must be from {low:g} to {high:g} mm along every axis, not {said}."
        )
    directions = np.array(header.GetDirection()).reshape(3, 3)
    if not np.allclose(directions.T @ directions, np.eye(3), rtol=0, atol=1e-4):
        raise ValueError(
            f"the axes of {str(path)!r} must be unit vectors at right angles, not {directions.T.tolist()}."
        )
    if not np.isfinite(header.GetOrigin()).all():
        raise ValueError(f"the origin of {str(path)!r} must be finite, not {header.GetOrigin()}.")


def _is_nifti(path: Path) -> bool:
    return path.name.lower().endswith(nifti.ENDINGS)


def _says_spacing(path: Path) -> bool:
    """Return whether the header holds a spacing; where it does not, ITK takes 1 mm."""
    if not _is_nifti(path):
        return bool(_SPACING.search(_beginning(path)))
    return all(math.isfinite(value) and value != 0 for value in nifti.read_header(path).spacing)


def _units(path: Path) -> list[str]:
    """Return the units of an NRRD file's axes; none where the file does not tell, or has another format."""
    told = None if _is_nifti(path) else _UNITS.search(_beginning(path))
    return re.findall(r'"([^"]*)"', told[1].decode("utf-8", "replace")) if told else []


def _beginning(path: Path) -> bytes:
    """Return the part of a file that holds its header, where that is text."""
    with path.open("rb") as file:
        return file.read(_HEADER_BYTES)


def _check_finite(path: Path, voxels: npt.NDArray[Any]) -> None:
    if not np.isfinite([voxels.min(), voxels.max()]).all():
        raise ValueError(f"the voxels of {str(path)!r} must be finite numbers: some are NaN or infinite.")


def _check_values(path: Path, voxels: npt.NDArray[Any]) -> None:
    _check_finite(path, voxels)
    low, high = voxels.min(), voxels.max()
    if low < 0:
        raise ValueError(
            f"the voxels of {str(path)!r} must be 0 or more, as the strength of an echo is, not {low:g}."
        )
    if high == 0:
        raise ValueError(f"the volume {str(path)!r} is empty: all its voxels are 0.")
    least, most = LARGEST
    if not least <= high <= most:
        raise ValueError(
            f"the largest voxel of {str(path)!r} must be from {least:g} to {most:g}, not {high:g}: rescale "
            "the image."
        )
