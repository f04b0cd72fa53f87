"""Photographs that cameras could have taken, and an all.zip that ODM could have packed."""

import io
import zipfile

import numpy as np
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

#: Near Goleta, California.
PLACE = {1: "N", 2: (34.0, 24.0, 29.9), 3: "W", 4: (119.0, 52.0, 47.6)}


def photograph(path, *, seed=0, gps=True, camera=("DJI", "FC220"), pad=0, size=(64, 48)):
    """Write a small picture with a header; `pad` bytes follow its end, as with some cameras.

    `gps` may be a longitude and latitude in degrees, and an altitude; True is the same place for
    all.
    """
    rng = np.random.default_rng(seed)
    image = Image.fromarray(rng.integers(0, 255, (size[1], size[0], 3), dtype=np.uint8))
    exif = Image.Exif() if path.suffix.lower() not in (".tif", ".tiff") else ImageFileDirectory_v2()
    if camera:
        exif[271], exif[272] = camera
    if gps:
        exif[0x8825] = dict(PLACE) if gps is True else place_of(*gps)
    image.save(path, **({"exif": exif} if isinstance(exif, Image.Exif) else {"tiffinfo": exif}))
    if pad:
        with path.open("ab") as file:
            file.write(rng.bytes(pad))
    return path


def place_of(lon, lat, *altitude):
    """Return the GPS directory of a place in degrees, and metres above the sea."""

    def parts(angle):
        degrees, rest = divmod(abs(float(angle)), 1.0)
        minutes, rest = divmod(60.0 * rest, 1.0)
        return degrees, minutes, 60.0 * rest

    found = {1: "S" if lat < 0 else "N", 2: parts(lat), 3: "W" if lon < 0 else "E", 4: parts(lon)}
    for height in altitude:
        found.update({5: b"\1" if height < 0 else b"\0", 6: abs(height)})
    return found


def photographs(folder, count=6, pad=0, **rest):
    """Write a folder of them."""
    folder.mkdir(parents=True, exist_ok=True)
    return [
        photograph(folder / f"IMG_{number:04}.JPG", seed=number, pad=pad, **rest)
        for number in range(count)
    ]


def all_zip(seed=0, size=200_000):
    """Pack what looks like an output."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        noise = np.random.default_rng(seed).bytes(size)
        archive.writestr("odm_georeferencing/odm_georeferenced_model.laz", noise)
        archive.writestr("odm_report/shots.geojson", "{}")
        archive.writestr("odm_orthophoto/odm_orthophoto.tif", noise[:1000])
    return out.getvalue()
