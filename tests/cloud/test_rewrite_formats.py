"""A cloud written through a move: PLY, text, EPT and tiles keep what they know of their points."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, List, Sequence, Tuple

import laspy
import numpy as np
import pytest
from clouds import in_order, points, write_ept, write_las, write_ply, write_text

from quantify_client.cloud.writing import RewriteReport, rewrite_cloud
from quantify_client.errors import CloudError
from quantify_client.types import Bounds

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

HALF_MM = 0.5e-3
LIFT = 1000.0


def lifted(paths: Sequence[Path], out: Path) -> Tuple[Any, RewriteReport]:
    """Write a cloud a kilometre higher. Returns what laspy reads, and the report."""
    xyz = points(5000) + np.array([0, 0, LIFT])
    bounds = Bounds(*xyz.min(axis=0).tolist(), *xyz.max(axis=0).tolist())
    report = rewrite_cloud(paths, out, lambda x, y, z: (x, y, z + LIFT), bounds, "EPSG:32615")
    las = laspy.read(out)
    assert report.points == len(las)
    return las, report


def placed(las: Any) -> np.ndarray:
    return np.asarray(las.xyz) - [0, 0, LIFT]


def ply(path: Path, order: str, columns: Sequence[Tuple[str, str]], rows: np.ndarray) -> Path:
    """Write PLY with any properties: (name, numpy type)."""
    names = {"u1": "uchar", "u2": "ushort", "i4": "int", "f4": "float", "f8": "double"}
    head = f"ply\nformat {order} 1.0\nelement vertex {len(rows)}\n"
    head += "".join(f"property {names[kind]} {name}\n" for name, kind in columns) + "end_header\n"
    if order == "ascii":
        data = "".join(" ".join(repr(v) for v in row.tolist()) + "\n" for row in rows).encode()
    else:
        data = rows.astype(rows.dtype.newbyteorder(">" if "big" in order else "<")).tobytes()
    path.write_bytes(head.encode() + data)
    return path


def filled(columns: Sequence[Tuple[str, str]], count: int = 300) -> np.ndarray:
    """Random values of each type, and points."""
    generator = np.random.default_rng(3)
    rows = np.zeros(count, columns)
    for name, kind in columns:
        if "f" in kind:
            rows[name] = np.round(generator.normal(size=count), 3)
        else:
            limits = np.iinfo(kind)
            rows[name] = generator.integers(limits.min, limits.max, count, endpoint=True)
    for axis, values in zip("xyz", points(count).T):
        rows[axis] = values
    return rows


ORDERS = ["ascii", "binary_little_endian", "binary_big_endian"]
PLACES = [("x", "f8"), ("y", "f8"), ("z", "f8")]


@pytest.mark.parametrize("order", ORDERS)
def test_properties_of_ply_are_kept(order: str, tmp_path: Path) -> None:
    columns = [
        *PLACES,
        *(("nx", "f4"), ("ny", "f4"), ("nz", "f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")),
        *(("views", "u1"), ("class", "u1"), ("scalar_Intensity", "f4"), ("quality", "i4")),
        ("confidence", "f8"),
    ]
    rows = filled(columns)
    rows["scalar_Intensity"] = np.arange(300) * 200
    path = ply(tmp_path / "a.ply", order, columns, rows)
    las, report = lifted([path], tmp_path / "o.laz")
    assert np.abs(placed(las) - points(300)).max() < HALF_MM
    assert las.point_format.id == 7
    extras = {name: las[name].dtype.str[1:] for name in las.point_format.extra_dimension_names}
    assert extras == {"nx": "f4", "ny": "f4", "nz": "f4", "quality": "i4", "confidence": "f8"}
    for name in (*extras, "red", "green", "blue"):
        assert np.array_equal(las[name], rows[name]), name
    assert np.array_equal(las.user_data, rows["views"])
    assert np.array_equal(las.classification, rows["class"])
    assert np.array_equal(las.intensity, rows["scalar_Intensity"])
    assert (las.return_number == 1).all()
    assert (las.number_of_returns == 1).all()
    assert report.warnings == ("normals are not rotated with the points: nx, ny, nz",)


@pytest.mark.parametrize("order", ORDERS)
def test_values_that_do_not_fit_their_field_stay_as_they_are(order: str, tmp_path: Path) -> None:
    columns = [*PLACES, ("intensity", "f4"), ("views", "i4"), ("red", "f4"), ("class", "i4")]
    columns += [("again", "u1")]
    source = filled(columns)
    path = ply(tmp_path / "a.ply", order, columns, source)
    path.write_bytes(path.read_bytes().replace(b" again", b" intensity"))  # a name used twice
    las, _ = lifted([path], tmp_path / "o.laz")
    assert las.point_format.id == 6
    assert list(las.point_format.extra_dimension_names) == [
        *("original-intensity", "views", "original-red", "class", "original-intensity-2"),
    ]
    for name in ("intensity", "red"):
        assert np.array_equal(las[f"original-{name}"], source[name])
    for name in ("views", "class"):
        assert np.array_equal(las[name], source[name])
        assert las[name].dtype == np.int32


def test_ply_of_the_other_tests_too(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", points(300), before="", kind="double")
    las, _ = lifted([path], tmp_path / "o.las")
    assert np.abs(placed(las) - points(300)).max() < HALF_MM


@pytest.mark.parametrize("order", ORDERS)
def test_truncated_ply_is_an_error(order: str, tmp_path: Path) -> None:
    path = ply(tmp_path / "a.ply", order, PLACES, filled(PLACES))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) - 100])
    with pytest.raises(CloudError, match=r"truncated|differ|columns"):
        lifted([path], tmp_path / "o.laz")
    assert list(tmp_path.iterdir()) == [path]


def test_number_that_its_type_cannot_hold_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\n"
        "property double z\nproperty uchar red\nend_header\n1 2 3 255\n1 2 3 256\n"
    )
    with pytest.raises(CloudError, match="'red' has a value that is no uint8"):
        lifted([path], tmp_path / "o.laz")


def _text(path: Path, head: str, columns: List[np.ndarray], mark: str = ",") -> Path:
    rows = [mark.join(repr(float(v)) for v in row) for row in zip(*points(300).T, *columns)]
    path.write_text("\n".join([head, *rows] if head else rows) + "\n")
    return path


def test_columns_of_text_are_kept(tmp_path: Path) -> None:
    generator = np.random.default_rng(5)
    colours = list(generator.integers(0, 256, (3, 300)))
    time, mood, tone = generator.normal(size=300), generator.normal(size=300), np.arange(300) * 100
    head = "X,Y,Z,R,G,B,Intensity (raw),GPS Time,Classification,mood"
    columns = [*colours, tone, time, np.arange(300) % 256, mood]
    las, report = lifted([_text(tmp_path / "a.csv", head, columns)], tmp_path / "o.laz")
    assert np.abs(placed(las) - points(300)).max() < HALF_MM
    assert np.array_equal([las.red, las.green, las.blue], colours)
    assert np.array_equal(las.intensity, tone)
    assert np.array_equal(las.gps_time, time)
    assert np.array_equal(las.classification, np.arange(300) % 256)
    assert list(las.point_format.extra_dimension_names) == ["mood"]
    assert np.array_equal(las.mood, mood)
    assert report.warnings == ()


def test_columns_without_names_are_numbered(tmp_path: Path) -> None:
    more = [np.arange(300) / 7, np.arange(300) / 9]
    las, _ = lifted([_text(tmp_path / "a.xyz", "", more, " ")], tmp_path / "o.laz")
    assert list(las.point_format.extra_dimension_names) == ["column-4", "column-5"]
    assert np.array_equal(las["column-5"], more[1])


def test_values_of_text_that_do_not_fit_stay_numbers(tmp_path: Path) -> None:
    tone = np.arange(300.0)
    tone[-1] = 0.5
    las, _ = lifted([_text(tmp_path / "a.csv", "x,y,z,intensity", [tone])], tmp_path / "o.laz")
    assert np.array_equal(las["original-intensity"], tone)
    assert not las.intensity.any()


def test_words_and_gaps_of_text_are_told(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        "name,x,y,z,value,nothing\n"
        "p1,576700,5188140,160,5,\np2,576701,5188141,161,,\n# aside\np3,576702,5188142,162\n"
    )
    las, report = lifted([path], tmp_path / "o.laz")
    assert list(las.point_format.extra_dimension_names) == ["value"]
    assert np.array_equal(las.value, [5, np.nan, np.nan], equal_nan=True)
    assert placed(las)[:, 2] == pytest.approx([160, 161, 162])
    assert "columns of text are left out: name" in report.warnings[0]
    assert "fields are empty or not a number" in report.warnings[1]


def test_bad_row_of_text_is_named(tmp_path: Path) -> None:
    path = _text(tmp_path / "a.csv", "x,y,z,value", [np.arange(300)])
    for line in ("1,2,three,4", "1,2,3,4,5", "1,2"):
        path.write_text("x,y,z,value\n1,2,3,4\n" + line + "\n")
        with pytest.raises(CloudError, match=f"line 3 is '{line}'"):
            lifted([path], tmp_path / "o.laz")
    path.write_text("x,y,value,z\n1,2,3\n")
    with pytest.raises(CloudError, match="line 2 has 3 fields, fewer than the names"):
        lifted([path], tmp_path / "o.laz")


def test_ept_is_written_tile_by_tile(tmp_path: Path) -> None:
    path = write_ept(tmp_path / "ept", points(1000))
    las, report = lifted([path], tmp_path / "o.laz")
    assert np.abs(in_order(placed(las).round(3)) - in_order(points(1000))).max() < HALF_MM
    assert report.warnings == ()
    tile = path.parent / "ept-data" / "0-0-0-0.laz"
    write_las(tile, points(199))
    with pytest.raises(CloudError, match="holds 199 points, the hierarchy promises 200"):
        lifted([path], tmp_path / "o.laz")
    tile.unlink()
    with pytest.raises(CloudError, match="is missing"):
        lifted([path], tmp_path / "o.laz")


def test_binary_ept_keeps_its_columns(tmp_path: Path) -> None:
    path = write_ept(tmp_path / "ept", points(1000), "binary")
    about = json.loads(path.read_text())
    about["schema"] += [
        {"name": "Intensity", "type": "unsigned", "size": 2},
        {"name": "ReturnNumber", "type": "unsigned", "size": 1},
        {"name": "Deviation", "type": "signed", "size": 2, "scale": 0.01},
    ]
    path.write_text(json.dumps(about))
    tones = []
    for tile in json.loads((path.parent / "ept-hierarchy" / "0-0-0-0.json").read_text()):
        data = path.parent / "ept-data" / f"{tile}.bin"
        rows = np.fromfile(data, "<i4").reshape(-1, 3)
        full = np.zeros(len(rows), "<3i4,<u2,u1,<i2")
        full["f0"], full["f1"], full["f2"], full["f3"] = (
            rows,
            rows[:, 0] % 60000,
            3,
            rows[:, 1] % 99,
        )
        full.tofile(data)
        tones.append(full)
    las, _ = lifted([path], tmp_path / "o.laz")
    assert np.abs(in_order(placed(las).round(3)) - in_order(points(1000))).max() < HALF_MM
    assert sorted(las.intensity) == sorted(np.concatenate([t["f1"] for t in tones]))
    assert (las.return_number == 3).all()
    assert sorted(las.Deviation) == sorted(np.concatenate([t["f3"] for t in tones]) * 0.01)


def _tile(path: Path, point_format: int, version: str, seed: int, extra: str = "") -> Path:
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [0.001] * 3, np.floor(points(1)[0])
    if extra:
        header.add_extra_dim(laspy.ExtraBytesParams("value", extra))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points(200, seed).T
    generator = np.random.default_rng(seed)
    las.return_number, las.number_of_returns = generator.integers(0, 8, (2, 200))
    las.classification = generator.integers(0, 32, 200)
    for flag in ("synthetic", "key_point", "withheld", "scan_direction_flag"):
        las[flag] = generator.integers(0, 2, 200)
    las.user_data = generator.integers(0, 256, 200)
    if point_format < 6:
        las.scan_angle_rank = generator.integers(-90, 90, 200)
    if "red" in las.point_format.dimension_names:
        las.red = generator.integers(0, 65536, 200)
    if extra:
        las.value = np.arange(200)
    las.write(path)
    return path


def test_tiles_of_several_formats_become_one(tmp_path: Path) -> None:
    files = [
        _tile(tmp_path / "a.laz", 2, "1.2", 1),
        _tile(tmp_path / "b.las", 6, "1.4", 2, "f8"),
        _tile(tmp_path / "c.laz", 1, "1.1", 3, "u2"),
        _tile(tmp_path / "d.laz", 6, "1.4", 4, "f8"),
        write_text(tmp_path / "e.csv", points(200, 5)),
    ]
    las, report = lifted(files, tmp_path / "o.laz")
    assert las.point_format.id == 7
    wanted = np.concatenate([points(200, seed) for seed in (1, 2, 3, 4, 5)])
    assert np.abs(placed(las) - wanted).max() < HALF_MM
    parts = [las[start : start + 200] for start in range(0, 1000, 200)]
    for part, path in zip(parts[:4], files):
        tile = laspy.read(path)
        names = ["return_number", "number_of_returns", "classification", "synthetic", "key_point"]
        for name in (*names, "withheld", "scan_direction_flag", "user_data"):
            assert np.array_equal(part[name], tile[name]), name
        if tile.point_format.id < 6:
            degrees = np.asarray(part.scan_angle) * 0.006
            assert np.abs(degrees - tile.scan_angle_rank).max() <= 0.003 + 1e-9
    assert np.array_equal(parts[0].red, laspy.read(files[0]).red)
    assert list(las.point_format.extra_dimension_names) == ["value", "value-2"]
    assert np.array_equal(parts[1]["value"], np.arange(200))
    assert np.array_equal(parts[3]["value"], np.arange(200))
    assert np.array_equal(parts[2]["value-2"], np.arange(200))
    assert not parts[1]["value-2"].any()
    assert "have point formats 1, 2, 6" in report.warnings[0]
    assert "extra attributes" in report.warnings[1]
    assert report.warnings[2].endswith("were renamed: value-2")


def test_tiles_of_one_format_keep_it(tmp_path: Path) -> None:
    files = [_tile(tmp_path / f"{i}.laz", 3, "1.2", i, "f4") for i in (1, 2, 3)]
    las, report = lifted(files, tmp_path / "o.laz")
    assert report.warnings == ()
    assert las.point_format == laspy.read(files[0]).point_format
    assert np.array_equal(las.value, np.tile(np.arange(200), 3))


def test_extra_bytes_in_another_order_go_where_they_belong(tmp_path: Path) -> None:
    files = []
    for names in (("one", "two"), ("two", "one")):
        las = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
        las.header.scales, las.header.offsets = [0.001] * 3, np.floor(points(1)[0])
        las.add_extra_dims([laspy.ExtraBytesParams(name, "f8") for name in names])
        las.x, las.y, las.z = points(50).T
        las.one, las.two = np.full(50, 1.0), np.full(50, 2.0)
        las.write(tmp_path / f"{names[0]}.laz")
        files.append(tmp_path / f"{names[0]}.laz")
    las, report = lifted(files, tmp_path / "o.laz")
    assert (las.one == 1).all()
    assert (las.two == 2).all()
    assert report.warnings == ()


def test_records_that_differ_between_tiles_are_told(tmp_path: Path) -> None:
    files = []
    for name in ("one", "two", "one"):
        record = laspy.VLR("someone", 5, "", name.encode())
        files.append(write_las(tmp_path / f"{len(files)}.laz", points(10), vlrs=[record]))
    las, report = lifted(files, tmp_path / "o.laz")
    (kept,) = las.header.vlrs.get_by_id("someone")
    assert kept.record_data == b"one"
    assert report.warnings == (
        "records of the cloud that differ between the files, and are taken from the first: "
        "someone 5",
    )


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ([], "no point cloud"),
        (["a.laz", "a.laz"], "given twice"),
        (["missing.laz"], "does not exist"),
        (["folder"], "is not a file"),
        (["a.pdf"], "unknown ending"),
        (["empty.laz"], "is empty"),
        (["none.laz"], "holds no points"),
    ],
)
def test_inputs_that_are_none_are_named(names: List[str], message: str, tmp_path: Path) -> None:
    write_las(tmp_path / "a.laz", points(10))
    write_las(tmp_path / "none.laz", points(0))
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.pdf").write_text("pdf")
    (tmp_path / "empty.laz").write_text("")
    with pytest.raises(CloudError, match=message) as caught:
        lifted([tmp_path / name for name in names], tmp_path / "o.laz")
    assert "\n" not in str(caught.value)
