"""Small clouds in every format, for tests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Iterable, Optional, Tuple

import laspy
import lazrs
import numpy as np
import pyproj

ORIGIN = np.array([576_700.0, 5_188_140.0, 160.0])
"""Where a real survey lies: eastings and northings of UTM, which single precision cannot hold."""


def points(count: int = 5000, seed: int = 1) -> np.ndarray:
    """Random points at UTM coordinates, whole millimetres. Returns (count, 3) float64."""
    generator = np.random.default_rng(seed)
    steps = generator.integers(0, [100_000, 100_000, 10_000], size=(count, 3))
    return np.round(ORIGIN + steps / 1000.0, 3)


def write_las(
    path: Path,
    xyz: np.ndarray,
    point_format: int = 3,
    version: str = "1.2",
    classes: Any = None,
    withheld: Any = None,
    crs: Optional[str] = None,
    vlrs: Iterable[Any] = (),
    scale: float = 0.001,
) -> Path:
    """Write LAS or LAZ, by the ending of the path."""
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales = [scale] * 3
    header.offsets = np.floor(ORIGIN)
    if crs is not None:
        header.add_crs(pyproj.CRS.from_user_input(crs), keep_compatibility=False)
    header.vlrs.extend(vlrs)
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.asarray(xyz).T
    if classes is not None:
        las.classification = np.asarray(classes, dtype=np.uint8)
    if withheld is not None:
        las.withheld = np.asarray(withheld, dtype=np.uint8)
    las.write(str(path))
    return path


def write_ply(
    path: Path,
    xyz: np.ndarray,
    order: str = "binary_little_endian",
    kind: str = "double",
    before: str = "",
    before_data: bytes = b"",
    extra: bool = True,
) -> Path:
    """Write PLY with colours; `before` is header text of elements whose data comes first."""
    byte_order = ">" if "big" in order else "<"
    number = byte_order + ("f8" if kind == "double" else "f4")
    fields = [("x", number), ("y", number), ("z", number)]
    lines = [f"property {kind} {axis}" for axis in "xyz"]
    if extra:
        fields += [("red", "u1"), ("views", byte_order + "i4")]
        lines += ["property uchar red", "property int views"]
    rows = np.zeros(len(xyz), dtype=fields)
    for index, axis in enumerate("xyz"):
        rows[axis] = np.asarray(xyz)[:, index]
    head = f"ply\nformat {order} 1.0\ncomment made by a test\n{before}"
    head += f"element vertex {len(xyz)}\n" + "".join(line + "\n" for line in lines)
    after = "element face 1\nproperty list uchar int vertex_indices\n"
    head += after + "end_header\n"
    if order == "ascii":
        text = "".join(" ".join(repr(v) for v in row.tolist()) + "\n" for row in rows)
        data, faces = text.encode(), b"3 0 1 2\n"
    else:
        data = rows.tobytes()
        faces = np.uint8(3).tobytes() + np.array([0, 1, 2], byte_order + "i4").tobytes()
    path.write_bytes(head.encode() + before_data + data + faces)
    return path


def write_text(
    path: Path, xyz: np.ndarray, delimiter: str = ",", header: Optional[str] = None
) -> Path:
    """Write rows of x, y, z with three decimals."""
    rows = "".join(delimiter.join(f"{v:.3f}" for v in row) + "\n" for row in np.asarray(xyz))
    path.write_text((header + "\n" if header else "") + rows)
    return path


def write_ept(root: Path, xyz: np.ndarray, data_type: str = "laszip", srs: Any = None) -> Path:
    """Write an EPT set of two levels, with the lower one in a hierarchy file of its own."""
    xyz = np.asarray(xyz)
    (root / "ept-data").mkdir(parents=True)
    (root / "ept-hierarchy").mkdir()
    low = np.floor(xyz.min(axis=0))
    edge = float(np.ceil((xyz.max(axis=0) - low).max())) + 1.0
    coarse = np.arange(len(xyz)) % 5 == 0
    fine = xyz[~coarse]
    place = np.floor((fine - low) / (edge / 2)).astype(int)
    tiles = {"0-0-0-0": xyz[coarse]}
    for key in sorted(set(map(tuple, place.tolist()))):
        name = "1-" + "-".join(map(str, key))
        tiles[name] = fine[(place == key).all(axis=1)]
    top = {"0-0-0-0": len(tiles["0-0-0-0"])}
    for name, part in tiles.items():
        if name != "0-0-0-0":
            top[name] = -1
            sub = root / "ept-hierarchy" / f"{name}.json"
            sub.write_text(json.dumps({name: len(part)}))
        if data_type == "laszip":
            write_las(root / "ept-data" / f"{name}.laz", part)
        else:
            steps = np.round((part - low) / 0.001).astype("<i4")
            (root / "ept-data" / f"{name}.bin").write_bytes(steps.tobytes())
    (root / "ept-hierarchy" / "0-0-0-0.json").write_text(json.dumps(top))
    schema = [
        {"name": axis, "type": "signed", "size": 4, "scale": 0.001, "offset": offset}
        for axis, offset in zip("XYZ", low.tolist())
    ]
    about = {
        "version": "1.0.0",
        "dataType": data_type,
        "hierarchyType": "json",
        "points": len(xyz),
        "bounds": [*low.tolist(), *(low + edge).tolist()],
        "boundsConforming": [*xyz.min(axis=0).tolist(), *xyz.max(axis=0).tolist()],
        "schema": schema,
        "srs": {"authority": "EPSG", "horizontal": "32615"} if srs is None else srs,
    }
    (root / "ept.json").write_text(json.dumps(about))
    return root / "ept.json"


def write_copc(path: Path, xyz: np.ndarray) -> Path:
    """Write a COPC file of two levels: a LAZ 1.4 file, the octree's description and its index."""
    xyz = np.asarray(xyz)
    low = np.floor(xyz.min(axis=0))
    half = (float(np.ceil((xyz.max(axis=0) - low).max())) + 1.0) / 2
    coarse = np.arange(len(xyz)) % 5 == 0
    place = np.floor((xyz - low) / half).astype(int)
    nodes = [((0, 0, 0, 0), xyz[coarse])]
    for key in sorted(set(map(tuple, place[~coarse].tolist()))):
        nodes.append(((1, *key), xyz[~coarse & (place == key).all(axis=1)]))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, low
    records = [laspy.LasData(header) for _ in nodes]
    for las, (_, part) in zip(records, nodes):
        las.x, las.y, las.z = part.T
    vlr = lazrs.LazVlr.new_for_compression(6, 0, True)
    header.vlrs.append(laspy.VLR("copc", 1, "", bytes(160)))
    header.vlrs.append(laspy.vlrs.known.LasZipVlr(vlr.record_data()))
    header.point_count = len(xyz)
    header.mins, header.maxs = xyz.min(axis=0), xyz.max(axis=0)
    header.are_points_compressed = True
    with path.open("wb+") as stream:
        header.write_to(stream)
        _write_copc_points(stream, vlr, header, nodes, records, (*(low + half), half))
    return path


def _write_copc_points(
    stream: Any, vlr: Any, header: Any, nodes: Any, records: Any, cube: Tuple[float, ...]
) -> None:
    compressor = lazrs.LasZipCompressor(stream, vlr)
    for las in records:
        compressor.compress_many(np.frombuffer(las.points.array.tobytes(), np.uint8))
        compressor.finish_current_chunk()
    compressor.done()
    stream.seek(header.offset_to_point_data)
    table = lazrs.read_chunk_table(stream, vlr)
    offset = header.offset_to_point_data + 8
    index = b""
    for (key, part), (_, length) in zip(nodes, table):
        index += np.array(key, "<i4").tobytes() + np.array([offset], "<u8").tobytes()
        index += np.array([length, len(part)], "<i4").tobytes()
        offset += length
    stream.seek(0, 2)
    start = stream.tell()
    head = b"\0\0" + b"copc".ljust(16, b"\0") + (1000).to_bytes(2, "little")
    stream.write(head + len(index).to_bytes(8, "little") + bytes(32) + index)
    stream.seek(235)
    stream.write(start.to_bytes(8, "little") + (1).to_bytes(4, "little"))
    stream.seek(375 + 54)  # the description is the first record
    stream.write(np.array([*cube, 1.0], "<f8").tobytes())
    stream.write(np.array([start + 60, len(index)], "<u8").tobytes())


def read_all(cloud: Any, window: Any = None, size: int = 1_000_000) -> np.ndarray:
    """Return all points of a cloud, (N, 3), in the order in which they come."""
    parts = [np.column_stack([c.x, c.y, c.z]) for c in cloud.chunks(window, size)]
    return np.concatenate(parts) if parts else np.empty((0, 3))


def in_order(xyz: np.ndarray) -> np.ndarray:
    """Sort points, so that clouds can be compared whatever order they come in."""
    xyz = np.asarray(xyz)
    return xyz[np.lexsort(xyz.T[::-1])]
