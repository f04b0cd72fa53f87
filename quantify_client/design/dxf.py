"""Read the faces of a DXF: 3DFACEs, polyface meshes and MESHes of its model space, by ezdxf.

They are read one after the other from a copy, and nothing that they refer to is opened. A face of
four corners is two triangles. Faces of blocks (INSERT) are not read.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from pathlib import Path
from typing import Any, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from ..errors import DesignError, MissingExtraError
from ..files.reading import private_copy, read_small, real_path
from ..types import Notice
from ..version import how_to_add
from .surface import MAX_BYTES, MAX_POINTS, MAX_TRIANGLES, WHAT, Design, bounded, made

__all__ = ["read_dxf"]

#: Entities that each take a kilobyte of memory and a twentieth of a millisecond.
_MOST_ENTITIES = 500_000

_BEGIN = re.compile(
    rb"(?:\xef\xbb\xbf)?(?:\s*999[ \t]*\r?\n[^\n]*\n)*\s*0[ \t]*\r?\n[ \t]*SECTION\s"
)
_END = re.compile(rb"\s0\s+EOF\s*\Z")
_INSERT = re.compile(rb"\n[ \t]*0[ \t]*\r?\n[ \t]*INSERT\s")
_UNIT = re.compile(rb"\$INSUNITS\s+70\s+(\d{1,3})\s")
_UNITS = {2: "ft", 4: "mm", 5: "cm", 6: "m", 21: "us-ft"}
_TYPES = ("3DFACE", "POLYLINE", "VERTEX", "SEQEND", "MESH")
_FACE = ("vtx0", "vtx1", "vtx2", "vtx3")
_SHOWN = 5

_Corners = Sequence[Sequence[float]]


def read_dxf(path: Path) -> Design:
    """Read all faces of a DXF as one surface; it says nothing of a CRS.

    Raises
    ------
    DesignError
        It is no ASCII DXF, is damaged, too large, or has no faces.
    MissingExtraError
        When ezdxf is not installed.
    """
    name, data = path.name, _checked(path)
    iterdxf = _library(name)
    corners: List[float] = []
    layers: Counter[str] = Counter()
    try:
        with private_copy(real_path(path), data, most=MAX_BYTES, error=DesignError) as copy:
            for layer, face in _faces(iterdxf.modelspace(copy, types=_TYPES)):
                for triangle in _triangles(face):
                    for place in triangle:
                        corners.extend(place)
                    layers[layer] += 1
                    bounded(name, len(corners) // 9, MAX_TRIANGLES, "faces")
    except DesignError:
        raise
    except Exception as error:  # ezdxf raises whatever its loops meet in a damaged file
        said = " ".join(str(error).split())[:80] or type(error).__name__
        raise DesignError(
            f"{name} cannot be read ({said}); export it again, or as LandXML"
        ) from error
    inserts = len(_INSERT.findall(data))
    if not corners:
        blocks = (
            f", and {inserts} blocks, whose faces are not read: explode them" if inserts else ""
        )
        raise DesignError(
            f"{name}: holds no faces (3DFACE, MESH or polyface){blocks}; expected {WHAT}"
        )
    points, number = np.unique(np.array(corners).reshape(-1, 3), axis=0, return_inverse=True)
    bounded(name, len(points), MAX_POINTS, "points")
    triangles = number.reshape(-1, 3).astype(np.int64)
    unit, notes = _unit_of(name, data)
    if inserts:
        text = f"{name}: {inserts} blocks (INSERT) are not read: explode them if they have faces"
        notes.append(Notice("design-blocks", text, file=name, blocks=inserts))
    return made(name, points, triangles, unit=unit, warnings=[*notes, *_of_layers(name, layers)])


def _checked(path: Path) -> bytes:
    """Return what a file holds; DesignError where it is no complete ASCII DXF, or too large."""
    name = path.name
    data = read_small(path, most=MAX_BYTES, what=WHAT, error=DesignError, label=name)
    if not _BEGIN.match(data):
        raise DesignError(
            f"{name} is not a DXF in text form: it begins with {data[:12]!r}, expected a section; "
            "export it as ASCII DXF or LandXML"
        )
    if not _END.search(data[-100:]):
        raise DesignError(f"{name} is truncated (no EOF at its end); copy or export it again")
    for kind in (b"3DFACE", b"VERTEX"):
        bounded(name, data.count(kind), _MOST_ENTITIES, kind.decode())
    return data


def _library(name: str) -> Any:
    # It would look for all fonts of the system otherwise, and keep a list in the user's folder.
    os.environ.setdefault("EZDXF_AUTO_LOAD_FONTS", "FALSE")
    try:
        from ezdxf.addons import iterdxf
    except ImportError as error:
        raise MissingExtraError(
            f"{name} needs ezdxf, which is missing: export the surface as LandXML, or add it "
            f"({how_to_add('design')})"
        ) from error
    return iterdxf


def _faces(entities: Any) -> Iterator[Tuple[str, _Corners]]:
    """Yield each face of entities with its layer: three corners or more."""
    for entity in entities:
        kind, layer = entity.dxftype(), str(entity.dxf.layer)
        if kind == "3DFACE":
            names = [name for name in _FACE if entity.dxf.hasattr(name)]
            yield layer, [entity.dxf.get(name).xyz for name in names]
        elif kind == "POLYLINE" and entity.is_poly_face_mesh:
            for face in entity.faces():
                # The last of a face's vertices is its record.
                yield layer, [vertex.dxf.location.xyz for vertex in face[:-1]]
        elif kind == "MESH":
            places = [tuple(map(float, place)) for place in entity.vertices]
            for face in entity.faces:
                yield layer, [places[corner] for corner in face]


def _triangles(face: _Corners) -> Iterator[_Corners]:
    """Yield the triangles of a face, without those that repeated corners would make."""
    for second, third in zip(face[1:], face[2:]):
        if face[0] != second and second != third and third != face[0]:
            yield face[0], second, third


def _unit_of(name: str, data: bytes) -> Tuple[Optional[str], List[Notice]]:
    found = _UNIT.search(data[: 1 << 20])
    code = int(found.group(1)) if found else 0
    if code == 0 or code in _UNITS:
        return _UNITS.get(code), []
    text = f"{name}: its unit ($INSUNITS {code}) is none of m, cm, mm and feet, and not used"
    return None, [Notice("design-unit-unknown", text, file=name, unit=code)]


def _of_layers(name: str, layers: Counter[str]) -> Iterator[Notice]:
    """Yield a warning where faces are on several layers, which may be several surfaces."""
    if len(layers) > 1:
        each = ", ".join(f"{layer[:40]!r} {n}" for layer, n in layers.most_common(_SHOWN))
        text = (
            f"{name}: has faces on {len(layers)} layers ({each}): all of them are taken for one "
            "surface; where they are several, export the one that is meant alone"
        )
        yield Notice("design-layers", text, file=name, layers=len(layers))
