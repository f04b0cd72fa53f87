"""Headers of pictures of any size, honest or not: read in little time, and nothing is decoded."""

import os
import struct
import time
import zlib
from contextlib import closing

import numpy as np
import pytest
from photographs import photograph, photographs
from PIL import Image

from quantify_client.errors import InputError, JobError
from quantify_client.sfm.photos.check import check_photos
from quantify_client.sfm.photos.formats import header, kind_of
from quantify_client.sfm.servers.upload_body import UploadBody

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python


def tiff(entries, tail=b"", *, following=0):
    """A little-endian TIFF of one directory: (tag, type, count, value or offset) each."""
    table = b"".join(struct.pack("<HHII", *entry) for entry in entries)
    head = b"II*\0" + struct.pack("<IH", 8, len(entries))
    return head + table + struct.pack("<I", following) + tail


GOLETA = (-(119 + 52 / 60 + 47.6 / 3600), 34 + 24 / 60 + 29.9 / 3600)


def headed(path):
    return header(path, kind_of(path))


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".png"])
@pytest.mark.parametrize("camera", [("DJI", "FC220"), ("Hasselblad", "L1D-20c"), None])
@pytest.mark.parametrize("gps", [True, False])
def test_header_is_what_pillow_wrote(tmp_path, suffix, camera, gps):
    path = photograph(tmp_path / f"a{suffix}", gps=gps, camera=camera, size=(640, 32))
    found = headed(path)
    assert found[:3] == (640, 32, " ".join(camera or ["unknown camera"]))
    assert found.lonlat == (pytest.approx(GOLETA) if gps else None)


@pytest.mark.parametrize("place", [(11.586, 50.927), (-119.88, 34.41), (151.2, -33.87), (0, 51.5)])
def test_the_place_is_that_of_all_four_quarters(tmp_path, place):
    assert headed(photograph(tmp_path / "a.jpg", gps=place)).lonlat == pytest.approx(place)


@pytest.mark.parametrize("suffix", [".jpg", ".tif"])
@pytest.mark.parametrize("altitude", [312.25, 0.0, -2.5])
def test_the_altitude_is_positive_upwards(tmp_path, suffix, altitude):
    path = photograph(tmp_path / f"a{suffix}", gps=(11.586, 50.927, altitude))
    assert headed(path).altitude == pytest.approx(altitude)
    assert headed(photograph(tmp_path / f"b{suffix}", gps=(11.586, 50.927))).altitude is None


@pytest.mark.parametrize("place", [(9.0, 95.0), (300.0, 48.0)])
def test_a_place_that_is_on_no_globe_is_none(tmp_path, place):
    assert headed(photograph(tmp_path / "a.jpg", gps=place)).lonlat is None


@pytest.mark.parametrize("options", [{"progressive": True}, {"optimize": True}, {"quality": 100}])
def test_every_kind_of_jpeg_tells_its_size(tmp_path, options):
    noise = np.random.default_rng(1).integers(0, 255, (90, 130, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "a.jpg", **options)
    assert headed(tmp_path / "a.jpg")[:2] == (130, 90)


def test_big_endian_tiff(tmp_path):
    rows = [(256, 3, 1, 70 << 16), (257, 4, 1, 50)]
    table = b"".join(struct.pack(">HHII", *row) for row in rows)
    data = b"MM\0*" + struct.pack(">IH", 8, 2) + table + bytes(4)
    (tmp_path / "a.tif").write_bytes(data)
    assert headed(tmp_path / "a.tif")[:2] == (70, 50)


def test_film_scan_is_accepted_and_not_decoded(tmp_path):
    # 900 megapixels; Pillow refuses to open more than 179.
    photographs(tmp_path, 2)
    rows = zlib.compress(bytes(30_000 * 3751), 1)

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    size = struct.pack(">IIBBBBB", 30_000, 30_000, 1, 0, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    (tmp_path / "scan.png").write_bytes(data)
    big = tmp_path / "scan.tif"
    big.write_bytes(tiff([(256, 4, 1, 40_000), (257, 4, 1, 30_000)]))
    begun = time.perf_counter()
    found = {photo.name: photo for photo in check_photos([tmp_path]).photos}
    assert time.perf_counter() - begun < 0.5
    assert (found["scan.png"].width, found["scan.png"].height) == (30_000, 30_000)
    assert found["scan.tif"].width * found["scan.tif"].height == 1_200_000_000


def test_exif_after_the_picture_of_a_png(tmp_path):
    path = photograph(tmp_path / "a.png")
    data = path.read_bytes()
    place = data.index(b"eXIf") - 4
    length = 12 + struct.unpack(">I", data[place : place + 4])[0]
    exif, end = data[place : place + length], data.index(b"IEND") - 4
    path.write_bytes(data[:place] + data[place + length : end] + exif + data[end:])
    assert headed(path).lonlat == pytest.approx(GOLETA)


# Each entry claims all of the file, in each directory, of which each is in the next.
MANY = [(tag, 4, 1 << 20, 8) for tag in (273, 279, 324, 325, 330)] * 13_000


def nested(count=5000):
    """Directories that begin within one another, each of which claims to be as long as can be."""
    return b"II*\0" + struct.pack("<I", 8) + b"\xff\xff" * (6 * count) + bytes(4 << 20)


def chained(count=64):
    """Directories one after another, each of which has all of the file for its strips' places."""
    length = 2 + 5 * 12 + 4
    data = b"II*\0" + struct.pack("<I", 8)
    zeros = 8 + count * length
    for number in range(count):
        table = (struct.pack("<HHII", tag, 4, 1 << 20, zeros) for tag in (273, 279, 324, 325, 330))
        following = 8 + (number + 1) * length if number + 1 < count else 0
        data += struct.pack("<H", 5) + b"".join(table) + struct.pack("<I", following)
    return data + bytes(4 << 20)


HOSTILE = {
    "chained": chained(),
    "entries": tiff(MANY, bytes(4 << 20)),
    "nested": nested(),
    "itself": bytes(
        tiff([(256, 4, 1, 9), (257, 4, 1, 9), (330, 4, 1, 8), (0x8825, 4, 1, 8)], following=8)
    ),
    "counts": bytes(tiff([(256, 4, 0xFFFFFFFF, 8), (257, 4, 1 << 20, 8)], bytes(5 << 20))),
    "padding": b"\xff\xd8" + b"\xff" * (5 << 20) + b"\xff\xd9",
    "segments": b"\xff\xd8\xff\xe0" + b"\x00\x02\xff\xe0" * (1 << 20),
    "no lengths": b"\xff\xd8\xff" + b"\x01\xff" * (5 << 19),
    "chunks": b"\x89PNG\r\n\x1a\n" + (bytes(4) + b"aaaa" + bytes(4)) * (5 << 17),
}


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("block", [False, True])
def test_header_that_leads_in_circles_takes_no_time(tmp_path, name, block):
    data = HOSTILE[name]
    path = tmp_path / "a.jpg"
    if block:  # the same as the EXIF block of a picture
        sound = photograph(tmp_path / "sound.png").read_bytes()
        path, place = tmp_path / "a.png", sound.index(b"IDAT") - 4
        chunk = struct.pack(">I", len(data)) + b"eXIf" + data + bytes(4)
        path.write_bytes(sound[:place] + chunk + sound[place:])
        (tmp_path / "sound.png").unlink()
    else:
        path.write_bytes(data)
    begun = time.perf_counter()
    with pytest.raises(InputError) as caught:
        check_photos([path])
    assert time.perf_counter() - begun < 2.0
    assert "\n" not in str(caught.value)


def test_random_headers_never_raise_anything_else(tmp_path):
    rng = np.random.default_rng(5)
    for suffix in (".jpg", ".png", ".tif"):
        whole = photograph(tmp_path / f"a{suffix}").read_bytes()
        path = tmp_path / f"a{suffix}"
        for _ in range(60):
            data = bytearray(whole)
            for place in rng.integers(0, min(len(data), 400), 6):
                data[place] = rng.integers(256)
            path.write_bytes(bytes(data))
            with pytest.raises(InputError):
                check_photos([path])


# --- what is not sent is said


@pytest.mark.parametrize(
    ("suffix", "kind"), [(".HEIC", "HEIC"), (".avif", "AVIF"), (".CR3", "raw")]
)
def test_photographs_of_other_kinds_are_told(tmp_path, suffix, kind):
    photographs(tmp_path, 3)
    for number in range(12):
        (tmp_path / f"IMG_{number}{suffix}").write_bytes(b"\0\0\0\x18ftypheic")
    found = check_photos([tmp_path])
    (note,) = [note for note in found.warnings if kind in note]
    assert "12 files" in note
    assert "convert them to JPEG" in note
    with pytest.raises(InputError, match="convert it to JPEG"):
        check_photos([tmp_path, tmp_path / f"IMG_1{suffix}"])


def test_photographs_in_folders_within_are_told(tmp_path):
    photographs(tmp_path, 3)
    photographs(tmp_path / "101MEDIA", 4)
    photographs(tmp_path / "102MEDIA" / "deeper", 5)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "a.docx").write_text("x")
    found = check_photos([tmp_path])
    assert len(found.photos) == 3
    (note,) = [note for note in found.warnings if "101MEDIA" in note]
    assert "9 photographs in 2 folders" in note
    assert "give these folders, too" in note
    assert "notes" not in note


def test_folder_that_holds_nothing_else_says_what_it_holds(tmp_path):
    photographs(tmp_path / "DCIM" / "100MEDIA", 4)
    with pytest.raises(InputError, match=r"0 photographs.*4 photographs in 1 folders.*100MEDIA"):
        check_photos([tmp_path / "DCIM"])


@pytest.mark.skipif(os.name == "nt", reason="such names cannot be made there")
@pytest.mark.parametrize("name", ["a\nb.JPG", "a\x1b[31m.JPG", "a\\b.JPG", "a\udcff.JPG"])
def test_names_that_no_server_can_keep(tmp_path, name):
    paths = photographs(tmp_path, 4)
    paths[0].rename(tmp_path / name)
    with pytest.raises(InputError, match="rename it") as caught:
        check_photos([tmp_path])
    assert "\n" not in str(caught.value).replace(name, "")


# --- what changes while it is sent


@pytest.mark.parametrize(
    "change",
    [
        lambda path: path.write_bytes(b"b" * 1_000_000),
        lambda path: os.truncate(path, 999_999),
        lambda path: os.truncate(path, 1_000_001),
        lambda path: os.utime(path, ns=(1, 1)),
    ],
)
@pytest.mark.parametrize("after", [0, 2])
def test_file_that_changes_while_it_is_sent_is_not_sent_to_its_end(tmp_path, change, after):
    path = tmp_path / "a.JPG"
    path.write_bytes(b"a" * 1_000_000)
    os.utime(path, ns=(5, 5))
    with closing(UploadBody(path, "a.JPG")) as body:
        blocks = iter(body)
        for _ in range(after):
            next(blocks)
        change(path)
        sent = []
        with pytest.raises(JobError, match=r"a.JPG: .*changed"):
            sent.extend(blocks)
    assert not sent or not sent[-1].endswith(b"--\r\n")
