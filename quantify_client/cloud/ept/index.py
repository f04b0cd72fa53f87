"""The index of an Entwine Point Tile set: ept.json and its hierarchy.

Keys become file names, so they are checked before; files are small, so their size is capped;
nothing outside the set's folder is opened, not even through a link. Where the set lies elsewhere, a
`Fetch` brings the files that are about to be read.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, Mapping, Optional, Tuple

from ...crs.statements import MergedStatements, Statement, merge_statements
from ...crs.wkt import statement_of_wkt
from ...errors import CloudError
from ...files.reading import count_values
from ...types import MAX_COORDINATE, Bounds
from ..base import naming, within

AGAIN = "expected a complete EPT set: copy or export the folder again"
_MAX_JSON = 64 << 20  # bytes
_MAX_VALUES = 3_000_000  # in one file, which is as many tiles as so many bytes hold
_ROUNDING = 1e-3  # of the cube's edge
_MAX_LEVEL = 60
_MAX_TILES = 4_000_000  # a hundred billion points have half of that
_MAX_PARTS = 20_000  # files of a hierarchy that is fetched
_TILE_HEAD = 1 << 20  # bytes of a tile beside its points
_POINT_BYTES = 256  # at most, of one point
_KEY = re.compile(r"(\d{1,2})-(\d{1,18})-(\d{1,18})-(\d{1,18})", re.ASCII)
_SUFFIX = {"laszip": ".laz", "binary": ".bin"}

Fetch = Callable[[Mapping[str, int]], None]
"""Puts files of a set into their places: names within the set, and how many bytes each may have.

What is in place already is left alone; what does not exist stays missing, and whoever reads it
says so.
"""


@dataclass(frozen=True)
class EptIndex:
    """What ept.json and the hierarchy say.

    Attributes
    ----------
    root : the folder of ept.json, resolved.
    tiles : points per tile, by key (level-x-y-z).
    cube : the box of the tile 0-0-0-0.
    conforming : the box of the points.
    schema : the columns of tiles of type ``"binary"``.
    stated : its CRS.
    """

    source: Path
    root: Path
    data_type: str
    cube: Bounds
    conforming: Bounds
    count: int
    tiles: Mapping[str, int]
    schema: Tuple[Mapping[str, Any], ...]
    stated: MergedStatements

    def box(self, key: str) -> Bounds:
        """Return the box of a tile: the cube is halved at each level."""
        level, *place = map(int, key.split("-"))
        low = (self.cube.min_x, self.cube.min_y, self.cube.min_z)
        high = (self.cube.max_x, self.cube.max_y, self.cube.max_z)
        edge = [(top - bottom) / 2.0**level for bottom, top in zip(low, high)]
        start = [low[axis] + edge[axis] * place[axis] for axis in range(3)]
        return Bounds(*start, *(start[axis] + edge[axis] for axis in range(3)))

    @property
    def rounding(self) -> float:
        """How far points may lie outside their cubes: such boxes are often rounded."""
        return _ROUNDING * (self.cube.max_x - self.cube.min_x)

    def holds(self, key: str, box: Optional[Bounds]) -> bool:
        """Whether a tile's cube is around a box of points."""
        return box is None or within(box, self.box(key), self.rounding)

    def conforms(self, box: Bounds) -> bool:
        """Whether the box that ept.json has for all points is around some of them."""
        return within(box, self.conforming, self.rounding)

    def tile(self, key: str) -> Path:
        """Return the file of a tile, which may be missing."""
        return _inside(self.root, self.tile_name(key))

    def existing_tile(self, key: str) -> Path:
        """Return the file of a tile; CloudError when it is missing."""
        path = self.tile(key)
        if not path.is_file():
            raise CloudError(
                f"{path}: is missing; the hierarchy says it holds {self.tiles[key]} points; {AGAIN}"
            )
        return path

    def tile_name(self, key: str) -> str:
        """Return the name of a tile's file within the set."""
        return f"ept-data/{key}{_SUFFIX[self.data_type]}"

    def tile_bytes(self, key: str) -> int:
        """Return how many bytes a tile's file may have."""
        return _TILE_HEAD + self.tiles[key] * _POINT_BYTES


def read_index(source: Path, fetch: Optional[Fetch] = None) -> EptIndex:
    """Read ept.json and its whole hierarchy, which `fetch` brings where it is given.

    Raises
    ------
    CloudError
        Not EPT, a compression that is not read, a path that leaves the folder, a hierarchy that
        does not hold the points ept.json promises.
    """
    with naming(source, AGAIN):
        root = source.resolve().parent
        about = _json(_inside(root, source.resolve().name))
        data_type = str(about.get("dataType"))
        if data_type not in _SUFFIX:
            raise CloudError(
                f"{source}: its tiles are of type {data_type[:40]!r}; expected laszip (or "
                "binary): convert the set, or give the LAZ file it was made from"
            )
        promised = int(about["points"])
        tiles = _hierarchy(root, promised, fetch)
        index = EptIndex(
            source=source,
            root=root,
            data_type=data_type,
            cube=_box(source, about["bounds"]),
            conforming=_box(source, about.get("boundsConforming", about["bounds"])),
            count=promised,
            tiles=tiles,
            schema=tuple(about["schema"]),
            stated=_stated(about.get("srs")),
        )
    # Tiles are found by their place in the cube: one elsewhere would lose points quietly.
    if not within(index.conforming, index.cube, index.rounding):
        raise CloudError(
            f"{source}: its points reach beyond its cube (bounds and boundsConforming); {AGAIN}"
        )
    held = sum(tiles.values())
    if held != index.count:
        raise CloudError(
            f"{source}: promises {index.count} points, its hierarchy holds {held}; {AGAIN}"
        )
    return index


def _inside(root: Path, name: str) -> Path:
    """Return a path below the root, after following links."""
    path = (root / name).resolve()
    if root not in path.parents:
        raise CloudError(f"{root / name}: leads out of its EPT folder; {AGAIN}")
    return path


def _json(path: Path) -> Dict[str, Any]:
    with naming(path, AGAIN):
        if path.stat().st_size > _MAX_JSON:
            raise CloudError(
                f"{path}: is larger than {_MAX_JSON >> 20} MB, which no EPT index is; {AGAIN}"
            )
        data = path.read_bytes()
        if count_values(data) > _MAX_VALUES:
            raise CloudError(
                f"{path}: holds more than {_MAX_VALUES} values, which no EPT index does; {AGAIN}"
            )
        content = json.loads(data)
    if not isinstance(content, dict):
        raise CloudError(f"{path}: holds no JSON object; {AGAIN}")
    return content


def _hierarchy(root: Path, promised: int, fetch: Optional[Fetch]) -> Dict[str, int]:
    """Return the points per tile.

    A count of -1 says that a file of the tile's name goes on from there. What holds more
    than it promises is given up at once: it might never end.
    """
    tiles: Dict[str, int] = {}
    held = 0
    waiting, known = ["0-0-0-0"], {"0-0-0-0"}
    new = list(waiting)
    while waiting:
        if fetch is not None and new:
            if len(known) > _MAX_PARTS:
                raise CloudError(f"{root}: its index has more than {_MAX_PARTS} parts; {AGAIN}")
            fetch({_part(name): _MAX_JSON for name in new})
            new = []
        path = _inside(root, _part(waiting.pop()))
        for key, count in _json(path).items():
            if not _is_key(key) or not isinstance(count, int) or count < -1:
                raise CloudError(
                    f"{path}: has the entry {key[:40]!r}: {str(count)[:20]}; expected "
                    f"'level-x-y-z' and a number of points; {AGAIN}"
                )
            if count == -1 and key not in known:
                known.add(key)
                waiting.append(key)
                new.append(key)
            elif count > 0:
                held += count
                tiles[key] = count
        if held > promised or len(tiles) + len(waiting) > _MAX_TILES:
            raise CloudError(
                f"{path}: brings the index to {len(tiles)} tiles with {held} points; ept.json "
                f"promises {promised}, and {_MAX_TILES} tiles are read at most; {AGAIN}"
            )
    return tiles


def _part(name: str) -> str:
    return f"ept-hierarchy/{name}.json"


def _is_key(key: str) -> bool:
    if not _KEY.fullmatch(key):
        return False
    level, *place = map(int, key.split("-"))
    return level <= _MAX_LEVEL and max(place) < 2**level


def _box(source: Path, values: Any) -> Bounds:
    box = [float(value) for value in values]
    if (
        len(box) != 6
        or not all(abs(value) <= MAX_COORDINATE for value in box)
        or any(low > high for low, high in zip(box[:3], box[3:]))
    ):
        raise CloudError(f"{source}: its bounds {str(values)[:80]} are no box; {AGAIN}")
    return Bounds(*box)


def _stated(srs: Any) -> MergedStatements:
    """Bring together WKT and the codes of an authority; a WKT without heights may stand beside
    a code that has them.
    """
    if isinstance(srs, str):  # Entwine 1
        srs = {"wkt": srs}
    if not isinstance(srs, dict):
        return MergedStatements()
    statements = []
    if srs.get("wkt"):
        statements.append(statement_of_wkt(str(srs["wkt"]), "WKT in ept.json"))
    authority = str(srs.get("authority") or "EPSG")
    codes = [
        f"{authority}:{srs[part]}" if srs.get(part) else None for part in ("horizontal", "vertical")
    ]
    if any(codes):
        places = {"CRS": "ept.json srs.horizontal", "heights": "ept.json srs.vertical"}
        places["vertical unit"] = places["heights"]
        statements.append(Statement("code in ept.json", codes[0], vertical=codes[1], places=places))
    return merge_statements(statements)
