"""SVHN's formats, on files made as MATLAB makes them; and the errors for files that differ."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

from modules.signs import svhn
from modules.signs.boxes import Box, around, square
from modules.signs.svhn import SvhnError

PICTURE = np.zeros((20, 40, 3), np.uint8)
PICTURE[:, :, 0] = 200  # blue: BGR


@pytest.fixture
def folder(tmp_path):
    boxes = [[Box("1", 3, 2, 6, 12), Box("0", 10, 2, 7, 12)], [Box("7", -1, 4, 8, 14)]]
    svhn.write_numbers(tmp_path, [(PICTURE, one) for one in boxes])
    return tmp_path


def digit_struct(folder):
    return folder / "digitStruct.mat"


def test_numbers_of_several_digits_and_of_one(folder):
    first, second = svhn.numbers(digit_struct(folder))
    assert (first.text, second.text) == ("10", "7")
    assert first.boxes[1] == Box("0", 10, 2, 7, 12)
    assert second.boxes == (Box("7", -1, 4, 8, 14),)
    assert first.path == folder / "1.png"
    assert np.array_equal(first.picture(), PICTURE)


def test_the_file_is_laid_out_as_matlab_lays_it_out(folder):
    content = digit_struct(folder).read_bytes()
    assert content.startswith(b"MATLAB 7.3 MAT-file")
    assert content[124:128] == b"\x00\x02IM"
    assert content[512:520] == b"\x89HDF\r\n\x1a\n"
    with h5py.File(digit_struct(folder)) as file:
        several, single = (file[file["digitStruct/bbox"][index][0]]["label"] for index in (0, 1))
        assert several.shape == (2, 1)
        assert file[several[1][0]][()].tolist() == [[10.0]]  # the digit 0
        assert single[()].tolist() == [[7.0]]
        assert file[file["digitStruct/name"][0][0]][()].tolist() == [[ord(letter)] for letter in "1.png"]


def test_digits_are_put_in_the_order_of_reading(tmp_path):
    svhn.write_numbers(tmp_path, [(PICTURE, [Box("4", 30, 2, 6, 12), Box("2", 3, 2, 6, 12)])])
    assert [number.text for number in svhn.numbers(digit_struct(tmp_path))] == ["24"]


def test_a_missing_picture_is_reported(folder):
    (folder / "1.png").unlink()
    number = next(svhn.numbers(digit_struct(folder)))
    with pytest.raises(SvhnError, match=r"1\.png: not a picture"):
        number.picture()


def test_a_missing_file(tmp_path):
    with pytest.raises(SvhnError, match=r"digitStruct\.mat"):
        list(svhn.numbers(digit_struct(tmp_path)))


@pytest.mark.parametrize("kept", [0, 100, 600, 0.5, 0.9, 0.99])
def test_a_truncated_file(folder, kept):
    content = digit_struct(folder).read_bytes()
    digit_struct(folder).write_bytes(content[: kept if kept > 1 else round(kept * len(content))])
    with pytest.raises(SvhnError, match=r"digitStruct\.mat"):
        list(svhn.numbers(digit_struct(folder)))


@given(st.binary(max_size=200), st.booleans())
def test_garbage(tmp_path_factory, garbage, headed):
    path = tmp_path_factory.mktemp("garbage") / "digitStruct.mat"
    path.write_bytes((b"\x89HDF\r\n\x1a\n" if headed else b"") + garbage)
    with pytest.raises(SvhnError):
        list(svhn.numbers(path))


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("label", 11.0, "label: invalid value 11: expected 1 to 10"),
        ("label", 0.0, "label: invalid value 0: expected"),
        ("width", 0.0, "a box of 0 x 14"),
        ("left", np.nan, "nan"),
    ],
)
def test_an_invalid_box_is_reported_with_its_entry(folder, field, value, said):
    with h5py.File(digit_struct(folder), "r+") as file:
        file[file["digitStruct/bbox"][1][0]][field][0, 0] = value
    with pytest.raises(SvhnError, match=f"entry 2.*{said}"):
        list(svhn.numbers(digit_struct(folder)))


def test_a_field_that_is_missing_is_reported(folder):
    with h5py.File(digit_struct(folder), "r+") as file:
        del file[file["digitStruct/bbox"][0][0]]["top"]
    with pytest.raises(SvhnError, match=r"entry 1.*top"):
        list(svhn.numbers(digit_struct(folder)))


def test_a_name_cannot_lead_out_of_the_folder(folder):
    with h5py.File(digit_struct(folder), "r+") as file:
        file[file["digitStruct/name"][0][0]][:, 0] = [ord(letter) for letter in "../ab"]
    with pytest.raises(SvhnError, match="is not a file of this folder"):
        list(svhn.numbers(digit_struct(folder)))


def cropped(path, count=3, **changes):
    pictures = np.arange(32 * 32 * 3 * count, dtype=np.uint64).reshape(32, 32, 3, count).astype(np.uint8)
    content = {"X": pictures, "y": np.array([[1], [10], [9]], np.uint8)} | changes
    scipy.io.savemat(path, {name: value for name, value in content.items() if value is not None})
    return pictures


def test_cropped_digits(tmp_path):
    stored = cropped(tmp_path / "test_32x32.mat")
    pictures, labels = svhn.digits(tmp_path / "test_32x32.mat")
    assert labels == ["1", "0", "9"]
    assert pictures.shape == (3, 32, 32, 3)
    assert np.array_equal(pictures[1, :, :, 2], stored[:, :, 0, 1])  # red


def test_cropped_digits_are_written_as_they_are_read(tmp_path):
    written = np.random.default_rng(1).integers(0, 255, (2, 32, 32, 3), np.uint8)
    svhn.write_digits(tmp_path / "x_32x32.mat", written, ["0", "5"])
    pictures, labels = svhn.digits(tmp_path / "x_32x32.mat")
    assert np.array_equal(pictures, written)
    assert labels == ["0", "5"]
    assert scipy.io.loadmat(tmp_path / "x_32x32.mat")["y"].tolist() == [[10], [5]]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"X": np.zeros((32, 32, 3, 3))}, "X is float64"),
        ({"X": np.zeros((3, 32, 32, 3), np.uint8)}, r"\(3, 32, 32, 3\): expected uint8 \(32, 32, 3, count\)"),
        ({"y": np.array([[1], [2]], np.uint8)}, "3 pictures and 2 labels"),
        ({"y": np.array([[0], [2], [3]], np.uint8)}, "label: invalid value 0: expected"),
        ({"y": None}, "X and y"),
    ],
)
def test_invalid_cropped_digits(tmp_path, changes, said):
    cropped(tmp_path / "test_32x32.mat", **changes)
    with pytest.raises(SvhnError, match=rf"test_32x32\.mat.*{said}"):
        svhn.digits(tmp_path / "test_32x32.mat")


@pytest.mark.parametrize("kept", [0, 0.01, 0.3, 0.9])
def test_truncated_cropped_digits(tmp_path, kept):
    path = tmp_path / "test_32x32.mat"
    cropped(path)
    content = path.read_bytes()
    path.write_bytes(content[: round(kept * len(content))])
    with pytest.raises(SvhnError, match=r"test_32x32\.mat"):
        svhn.digits(path)


@given(st.binary(max_size=400))
def test_garbage_instead_of_cropped_digits(tmp_path_factory, garbage):
    path = tmp_path_factory.mktemp("garbage") / "test_32x32.mat"
    path.write_bytes(garbage)
    with pytest.raises(SvhnError):
        svhn.digits(path)


def test_boxes_around_digits():
    boxes = [Box("1", 10, 20, 5, 10), Box("2", 20, 22, 6, 10)]
    assert around(boxes, 0, 0).tolist() == [[10, 20], [26, 20], [26, 32], [10, 32]]
    assert around(boxes, 0.5, 0).tolist()[0] == [4, 20]
    assert square(boxes[0], 1).tolist() == [[7.5, 20], [17.5, 20], [17.5, 30], [7.5, 30]]
