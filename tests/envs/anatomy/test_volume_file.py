"""Files that are no volumes of echoes: each is refused in one sentence."""

import gzip
import os
import re
import struct
import sys

import numpy as np
import pytest
import SimpleITK as sitk
from volumes import image, write

from usbench.envs.anatomy import nifti, volume_file

VOXELS = np.arange(60, dtype=np.uint8).reshape(3, 4, 5)
HEADER = {
    "ObjectType": "Image",
    "NDims": "3",
    "BinaryData": "True",
    "BinaryDataByteOrderMSB": "False",
    "TransformMatrix": "1 0 0 0 1 0 0 0 1",
    "Offset": "0 0 0",
    "ElementSpacing": "1 1 1",
    "DimSize": "5 4 3",
    "ElementType": "MET_UCHAR",
}


def meta_image(path, data=None, **changes):
    """Write an MHA file by hand; None leaves an entry out."""
    entries = {**HEADER, **changes, "ElementDataFile": "LOCAL"}
    text = "".join(f"{name} = {value}\n" for name, value in entries.items() if value is not None)
    path.write_bytes(text.encode() + (VOXELS.tobytes() if data is None else data))
    return path


def refusal(path):
    with pytest.raises(ValueError) as refused:
        volume_file.read(path)
    message = str(refused.value)
    assert "\n" not in message and message.endswith(".")
    return message


def test_a_header_by_hand_is_read(tmp_path):
    volume = volume_file.read(meta_image(tmp_path / "volume.mha"))
    np.testing.assert_array_equal(volume.voxels, VOXELS)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"ElementSpacing": "0 1 1"}, "spacing .* from 0.01 to 10 mm .* 0x1x1"),
        ({"ElementSpacing": "-1 1 1"}, "spacing .* -1x1x1"),
        ({"ElementSpacing": "nan 1 1"}, "spacing .* from 0.01 to 10 mm"),
        ({"ElementSpacing": "1 1 10.5"}, "spacing .* 1x1x10.5"),
        ({"ElementSpacing": "0.009 1 1"}, "spacing .* 0.009x1x1"),
        ({"ElementSpacing": None}, "spacing .* not missing"),
        ({"TransformMatrix": "1 0 0 1 0 0 0 0 1"}, "right angles"),
        ({"TransformMatrix": "1 0.5 0 0 1 0 0 0 1"}, "right angles"),
        ({"DimSize": "0 4 3"}, r"at least 2 voxels along every axis, not \(0, 4, 3\)"),
        ({"DimSize": "20 3 1"}, r"at least 2 voxels along every axis, not \(20, 3, 1\)"),
        ({"DimSize": "4000 4000 4000"}, "at most 512 MB, not 64000 MB"),
        ({"DimSize": "800 800 401", "ElementType": "MET_SHORT"}, "at most 512 MB, not 513 MB"),
        ({"ElementNumberOfChannels": "3"}, "1 value, not 3"),
        ({"data": b"cut off"}, "cannot be read: the file is damaged"),
    ],
)
def test_headers_that_cannot_be_meant_are_refused(tmp_path, changes, said):
    assert re.search(said, refusal(meta_image(tmp_path / "volume.mha", **changes)))


@pytest.mark.parametrize("spacing", [0.0, np.nan])
@pytest.mark.parametrize("ending", [".nii", ".nii.gz"])
def test_nifti_without_a_spacing_is_refused(tmp_path, spacing, ending):
    path = write(tmp_path / f"volume{ending}", VOXELS)
    content = bytearray(gzip.decompress(path.read_bytes()) if ending == ".nii.gz" else path.read_bytes())
    struct.pack_into("<f", content, 84, spacing)
    path.write_bytes(gzip.compress(content) if ending == ".nii.gz" else content)
    assert "not missing" in refusal(path)


def nifti_file(path, voxels=VOXELS, order="<", version=1):
    """Write a NIfTI file by hand."""
    code = {"uint8": 2, "float32": 16, "float64": 64}[voxels.dtype.name]
    header, n_bits = bytearray({1: 352, 2: 544}[version]), 8 * voxels.dtype.itemsize
    dims, pixdim = (3, *voxels.shape[::-1], 1, 1, 1, 1), (1, 1, 1, 1, 0, 0, 0, 0)
    # From nifti1.h and nifti2.h: dim, datatype and bitpix, pixdim, vox_offset, qform_code, magic.
    entries = {
        1: [("i", 0, 348), ("8h", 40, *dims), ("2h", 70, code, n_bits), ("8f", 76, *pixdim), ("f", 108, 352),
            ("h", 252, 1), ("4s", 344, b"n+1")],
        2: [("i", 0, 540), ("8q", 16, *dims), ("2h", 12, code, n_bits), ("8d", 104, *pixdim),
            ("q", 168, 544), ("i", 344, 1), ("8s", 4, b"n+2\0\r\n\x1a\n")],
    }  # fmt: skip
    for kind, place, *values in entries[version]:
        struct.pack_into(order + kind, header, place, *values)
    content = bytes(header) + voxels.astype(voxels.dtype.newbyteorder(order)).tobytes()
    path.write_bytes(gzip.compress(content) if path.name.endswith(".gz") else content)
    return path


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("ending", [".nii", ".nii.gz"])
def test_nifti_of_either_byte_order_is_read(tmp_path, order, ending):
    path = nifti_file(tmp_path / f"volume{ending}", VOXELS.astype(np.float32), order)
    np.testing.assert_array_equal(volume_file.read(path).voxels, VOXELS)


# ITK 5.4 itself does not read NIfTI-2.
@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("order", ["<", ">"])
def test_the_voxels_of_either_nifti_are_found(tmp_path, order, version):
    path = nifti_file(tmp_path / "volume.nii", VOXELS.astype(np.float64), order, version)
    assert nifti.read_header(path).spacing == (1, 1, 1)
    np.testing.assert_array_equal(nifti.read_voxels(path, 60), VOXELS.ravel())
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ValueError, match="the file is damaged"):
        nifti.read_voxels(path, 60)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_nifti_that_is_cut_off_is_refused(tmp_path, order):
    path = nifti_file(tmp_path / "volume.nii", VOXELS.astype(np.float32), order)
    path.write_bytes(path.read_bytes()[:-1])
    assert "cannot be read: the file is damaged" in refusal(path)


@pytest.mark.parametrize("damage", ["half", "checksum", "cut off before"])
def test_a_compressed_nifti_that_is_damaged_is_refused(tmp_path, damage):
    voxels = np.random.default_rng(0).random((40, 40, 40))
    path = nifti_file(tmp_path / "volume.nii.gz", voxels)
    content = path.read_bytes()
    damaged = {
        "half": content[: len(content) // 2],
        "checksum": content[:-8] + bytes(8),
        "cut off before": gzip.compress(gzip.decompress(content)[:-1]),
    }
    path.write_bytes(damaged[damage])
    assert "cannot be read: the file is damaged" in refusal(path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_voxels_of_a_nifti_that_are_not_finite_are_refused(tmp_path, value, kind):
    path = nifti_file(tmp_path / "volume.nii.gz", np.where(VOXELS == 7, value, VOXELS).astype(kind))
    assert "some are NaN or infinite" in refusal(path)


@pytest.mark.parametrize("offset", [np.nan, np.inf, 1e30])
def test_a_nifti_whose_voxels_are_nowhere_is_refused(tmp_path, offset):
    path = nifti_file(tmp_path / "volume.nii")
    content = bytearray(path.read_bytes())
    struct.pack_into("<f", content, 108, offset)
    path.write_bytes(content)
    with pytest.raises(ValueError, match="cannot be read: the file is damaged"):
        nifti.read_header(path)
    refusal(path)


def test_a_plain_nifti_with_a_compressed_ones_name_is_refused(tmp_path):
    plain = nifti_file(tmp_path / "volume.nii").rename(tmp_path / "volume.nii.gz")
    assert re.search(r"volume.nii.gz' is not compressed by gzip: .* must be named \.nii", refusal(plain))


def test_nrrd_without_a_spacing_is_refused(tmp_path):
    path = tmp_path / "volume.nrrd"
    header = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n\n"
    path.write_bytes(header + VOXELS.tobytes())
    assert "not missing" in refusal(path)
    path.write_bytes(header.replace(b"encoding", b"spacings: 1 2 3\nencoding") + VOXELS.tobytes())
    np.testing.assert_array_equal(volume_file.read(path).spacing_mm, [1, 2, 3])


@pytest.mark.parametrize("unit", ["cm", "m", "um"])
def test_nrrd_in_another_unit_is_refused_since_itk_reads_it_as_mm(tmp_path, unit):
    path = tmp_path / "volume.nrrd"
    sitk.WriteImage(sitk.GetImageFromArray(VOXELS), str(path))
    written = path.read_bytes()
    for given in ("mm", unit):
        line = f'space units: "{given}" "{given}" "{given}"\n'.encode()
        path.write_bytes(written.replace(b"space directions", line + b"space directions"))
        if given == "mm":
            np.testing.assert_array_equal(volume_file.read(path).spacing_mm, [1, 1, 1])
    assert f"must be mm, not '{unit}'" in refusal(path)


@pytest.mark.parametrize(
    ("voxels", "said"),
    [
        (VOXELS[0], "3 dimensions, not 2"),
        (np.stack([VOXELS] * 2), "3 dimensions, not 4"),
        (VOXELS.astype(np.complex64), "1 value, not 2"),
        (np.where(VOXELS == 7, np.nan, VOXELS), "some are NaN or infinite"),
        (np.where(VOXELS == 7, np.inf, VOXELS), "some are NaN or infinite"),
        (VOXELS.astype(np.int16) - 10, "0 or more, .* not -10"),
        (np.zeros_like(VOXELS), "is empty: all its voxels are 0"),
        (VOXELS * 1e300, r"from 1e-20 to 1e\+30, not 5.9e\+301"),
        (VOXELS * 1e-44, r"from 1e-20 to 1e\+30, not 5.9e-43"),
    ],
)
def test_voxels_that_are_no_echoes_are_refused(tmp_path, voxels, said):
    path = tmp_path / "volume.nrrd"
    sitk.WriteImage(sitk.GetImageFromArray(voxels, isVector=False), str(path))
    assert re.search(said, refusal(path))


@pytest.mark.parametrize("name", ["volume.mha", "volume.nii", "volume.nii.gz", "volume.nrrd"])
def test_a_file_of_another_kind_is_refused(tmp_path, name):
    (tmp_path / name).write_text("nothing of the sort")
    assert "not a readable NIfTI, MHA or NRRD file" in refusal(tmp_path / name)


@pytest.mark.parametrize(("name", "content"), [("cut.mha", None), ("empty.mhd", "NDims = 3\n")])
def test_itk_prints_nothing_beside_the_refusal(tmp_path, capfd, name, content):
    path = tmp_path / name
    if content is None:
        meta_image(path, b"cut off")
    else:
        path.write_text(content)
    refusal(path)
    assert capfd.readouterr().err == ""
    os.write(2, b"heard again")
    assert capfd.readouterr().err == "heard again"


@pytest.mark.parametrize("name", ["volume.png", "volume", "volume.dcm"])
def test_unknown_endings_are_refused(tmp_path, name):
    assert ".nii.gz" in refusal(tmp_path / name) and name in refusal(tmp_path / name)


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no volume '.*missing.mha'"):
        volume_file.read(tmp_path / "missing.mha")


def test_a_folder_is_refused(tmp_path):
    (tmp_path / "folder.nii").mkdir()
    with pytest.raises(IsADirectoryError, match=r"must be a file, not the folder '.*folder.nii'\.$"):
        volume_file.read(tmp_path / "folder.nii")


def test_without_simple_itk_the_extra_is_named(tmp_path, monkeypatch):
    path = write(tmp_path / "volume.mha", VOXELS)
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'usbench\[anatomy\]'"):
        volume_file.read(path)


def test_an_origin_nowhere_is_refused(tmp_path):
    path = tmp_path / "volume.nii"
    sitk.WriteImage(image(VOXELS, origin=(1.0, 2.0, 3.0)), str(path))
    content = bytearray(path.read_bytes())
    # qoffset_x and the last of srow_x.
    for offset in (268, 292):
        struct.pack_into("<f", content, offset, np.nan)
    path.write_bytes(content)
    assert refusal(path).startswith("the origin of ")
