"""Photographs before they are sent."""

import os

import numpy as np
import pytest
from photographs import photograph, photographs
from PIL import Image

from quantify_client.errors import InputError
from quantify_client.sfm.photos.check import check_photos

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python


def test_folder_is_summarised(tmp_path):
    photographs(tmp_path, 5)
    found = check_photos([tmp_path])
    assert [photo.name for photo in found.photos] == [f"IMG_000{n}.JPG" for n in range(5)]
    assert found.with_gps == 5
    assert dict(found.cameras) == {"DJI FC220": 5}
    assert found.size == sum(path.stat().st_size for path in tmp_path.iterdir())
    assert (found.photos[0].width, found.photos[0].height) == (64, 48)
    assert found.warnings == ()


def test_file_given_twice_counts_once(tmp_path):
    paths = photographs(tmp_path, 3)
    assert len(check_photos([tmp_path, *paths, tmp_path / "."]).photos) == 3


@pytest.mark.parametrize("suffix", [".jpg", ".JPEG", ".tif", ".TIFF", ".png", ".dng"])
def test_kinds(tmp_path, suffix):
    photographs(tmp_path, 2)
    path = tmp_path / f"other{suffix}"
    photograph(tmp_path / ("o.tif" if suffix == ".dng" else path.name))
    if suffix == ".dng":
        (tmp_path / "o.tif").rename(path)
    found = check_photos([tmp_path])
    assert len(found.photos) == 3
    assert found.with_gps == 3


def test_bytes_after_the_end_are_the_cameras_business(tmp_path):
    photographs(tmp_path, 3, pad=1000)
    assert len(check_photos([tmp_path]).photos) == 3


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".png"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.999])
def test_truncated_at_any_place(tmp_path, suffix, share):
    photographs(tmp_path, 3)
    path = photograph(tmp_path / f"cut{suffix}")
    data = path.read_bytes()
    path.write_bytes(data[: max(1, int(len(data) * share))])
    with pytest.raises(InputError, match=r"1 of 4 photographs.*cut"):
        check_photos([tmp_path])


def test_truncated_jpeg_with_a_whole_thumbnail(tmp_path):
    # The thumbnail's end marker must not pass for the picture's.
    photographs(tmp_path, 3)
    thumb, path = tmp_path / "t.jpg", tmp_path / "cut.jpg"
    photograph(thumb, size=(16, 16))
    photograph(path)
    data, inner = path.read_bytes(), thumb.read_bytes()
    thumb.unlink()
    segment = b"\xff\xe2" + (len(inner) + 2).to_bytes(2, "big") + inner
    path.write_bytes(data[:2] + segment + data[2:])
    assert len(check_photos([tmp_path]).photos) == 4
    path.write_bytes((data[:2] + segment + data[2:])[:-500])
    with pytest.raises(InputError, match="is truncated"):
        check_photos([tmp_path])


def test_zero_filled_tail_is_truncated_too(tmp_path):
    # What a card reader leaves when it is pulled out: the right size, and nothing in it.
    (path,) = photographs(tmp_path, 1)
    data = path.read_bytes()
    path.write_bytes(data[:-1000] + bytes(1000))
    with pytest.raises(InputError, match="is truncated"):
        check_photos([path])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"GIF89a" + bytes(50), "is no JPEG, TIFF"),
        (b"\xff\xd8\xff\xd9", "trunc"),
    ],
)
def test_not_a_photograph(tmp_path, content, said):
    photographs(tmp_path, 3)
    (tmp_path / "bad.JPG").write_bytes(content)
    with pytest.raises(InputError, match=said):
        check_photos([tmp_path])


def test_damaged_header_never_raises_anything_else(tmp_path):
    path = photograph(tmp_path / "a.tif")
    whole = path.read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(200):
        data = bytearray(whole)
        for place in rng.integers(0, len(data), 8):
            data[place] = rng.integers(256)
        path.write_bytes(bytes(data))
        with pytest.raises(InputError):
            check_photos([path])  # a lone one is too few even when it is still sound


def test_faulty_ones_can_be_left_out(tmp_path):
    photographs(tmp_path, 3)
    (tmp_path / "bad.JPG").write_bytes(b"")
    found = check_photos([tmp_path], allow_faulty=True)
    assert len(found.photos) == 3
    assert "left out" in found.warnings[0]


def test_missing_file_folder_and_too_few(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        check_photos([tmp_path / "nothing.jpg"])
    with pytest.raises(InputError, match="0 photographs"):
        check_photos([tmp_path])
    photographs(tmp_path, 2)
    with pytest.raises(InputError, match="at least 3"):
        check_photos([tmp_path])


def test_names_that_a_node_cannot_keep_apart(tmp_path):
    photographs(tmp_path / "a", 3)
    (tmp_path / "b").mkdir()
    photograph(tmp_path / "b" / "img_0001.jpg")
    with pytest.raises(InputError, match=r"IMG_0001.JPG and .*img_0001.jpg have the same name"):
        check_photos([tmp_path / "a", tmp_path / "b"])


def test_gps_and_cameras_are_told(tmp_path):
    photographs(tmp_path, 3)
    photograph(tmp_path / "no.JPG", gps=False, camera=None)
    found = check_photos([tmp_path])
    assert found.with_gps == 3
    assert any("1 of 4 photographs have no GPS" in note for note in found.warnings)
    assert any("2 cameras" in note for note in found.warnings)


def test_without_any_gps(tmp_path):
    photographs(tmp_path, 3, gps=False)
    assert "no true size" in check_photos([tmp_path]).warnings[0]


def test_place_zero_zero_is_a_receiver_without_satellites(tmp_path, monkeypatch):
    monkeypatch.setattr("photographs.PLACE", {2: (0.0, 0.0, 0.0), 4: (0.0, 0.0, 0.0)})
    photographs(tmp_path, 3)
    assert check_photos([tmp_path]).with_gps == 0


def test_text_files_in_a_folder_are_not_sent(tmp_path):
    # A node takes every *.txt for GCPs.
    photographs(tmp_path, 3)
    (tmp_path / "notes.txt").write_text("hello")
    (tmp_path / ".hidden.jpg").write_text("x")
    (tmp_path / "deeper").mkdir()
    found = check_photos([tmp_path])
    assert [path.name for path in found.ignored] == ["deeper", "notes.txt"]
    assert "notes.txt" in found.warnings[0]


def test_right_kind_without_its_suffix(tmp_path):
    paths = photographs(tmp_path, 3)
    other = paths[0].rename(tmp_path / "IMG_0000.dat")
    with pytest.raises(InputError, match="rename it"):
        check_photos([*paths[1:], other])


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="needs a user who is refused")
def test_unreadable_file(tmp_path):
    paths = photographs(tmp_path, 3)
    paths[0].chmod(0)
    with pytest.raises(InputError, match="cannot be read"):
        check_photos([tmp_path])


def test_large_sensor_is_no_bomb(tmp_path):
    photographs(tmp_path, 2)
    Image.new("1", (12000, 9000)).save(tmp_path / "big.png")
    assert len(check_photos([tmp_path]).photos) == 3
