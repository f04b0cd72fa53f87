"""One small honest input for every reader, and the commands that read it."""

from __future__ import annotations

import json
import os
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, List, Sequence, Tuple

import laspy
import numpy as np
import pyproj
import shapely
from clouds import write_copc, write_ept, write_las, write_ply, write_text
from commands import PILE, UTM, features
from known_task import CENTRE, SITE, TERRAIN, control_of, delivered, places
from pyogrio.raw import write
from sfm.odm_photos import flight, picks_of
from terrains import EAST, LEVEL, NORTH, Errors, survey

OUT = "../out"
REFUSED = "http://127.0.0.1:9"  # discard: nothing listens there
_POINTS = 1500
_LOCAL = ("ascii.ply", "big.ply", "table.csv", "rows.xyz")  # near their own zero
_SILENT = ("little.ply", "note.txt", "tree.copc.laz")  # in UTM, without saying so


@dataclass(frozen=True)
class Case:
    """A folder of files; `targets` are those to damage, `commands` read them.

    Commands run in a folder beside that of the inputs, ``../in``.
    """

    name: str
    targets: Sequence[str]
    commands: Sequence[Sequence[str]]


def write_cases(root: Path) -> List[Case]:
    """Write every input below a folder."""
    cases: List[Case] = []
    for make in (_las_files, _tables, _sets, _areas, _controls, _projects, _jobs):
        cases += make(root)
    return cases


# --- clouds


def _case(root: Path, name: str, cloud: str, targets: Sequence[str] = ()) -> Case:
    """Complete a cloud by an area and control, and list what can be done with it."""
    folder = root / name
    moved = (-EAST, -NORTH) if name in _LOCAL else (0.0, 0.0)
    crs = None if name in (*_LOCAL, *_SILENT) else UTM
    drawn = shapely.affinity.translate(PILE.area, *moved)
    (folder / "area.geojson").write_text(features(drawn, names=["pile"], crs=crs))
    (folder / "scale.json").write_text(json.dumps(_taped(*moved)))
    path = f"../in/{cloud}"
    area, control = ("--area", "../in/area.geojson"), ("--gcp", "../in/scale.json")
    return Case(
        name,
        tuple(targets) or (cloud,),
        (
            ("info", path),
            ("info", path, "--json"),
            ("volume", path),
            ("volume", path, "--json", *area),
            ("volume", path, *area),
            ("volume", path, *area, *control),
            ("volume", path, *area, "--out", OUT),
            ("scale", path, *control, "--out", f"{OUT}/scaled.laz"),
        ),
    )


def _taped(east: float, north: float) -> Dict[str, Any]:
    at = {"A": [5.0, 5.0], "B": [35.0, 5.0], "C": [20.0, 35.0]}
    xyz = {name: [x + east + EAST, y + north + NORTH, LEVEL] for name, (x, y) in at.items()}
    return {
        "unit": "m",
        "cloud": {name: {"xyz": place} for name, place in xyz.items()},
        "distances": [{"from": "A", "to": "B", "length": 30.3, "accuracy": 0.01}],
    }


def _points() -> np.ndarray:
    return np.round(survey(PILE.height, Errors(0.01, 0.0), _POINTS), 3)


def _folder(root: Path, name: str) -> Path:
    (root / name).mkdir(parents=True)
    return root / name


def _las_files(root: Path) -> List[Case]:
    xyz = _points()
    keys = laspy.vlrs.known.GeoKeyDirectoryVlr()
    keys.geo_keys = [laspy.vlrs.known.GeoKeyEntryStruct(*k) for k in _GEO_KEYS]
    keys.geo_keys_header.number_of_keys = len(_GEO_KEYS)
    old = laspy.VLR("LASF_Projection", 34735, "", keys.record_data_bytes())
    doubles = laspy.VLR("LASF_Projection", 34736, "", np.array([1.0, 500000.0]).tobytes())
    written: Dict[str, Callable[[Path], Any]] = {
        "old.las": lambda path: write_las(path, xyz, 1, "1.2", vlrs=[old, doubles]),
        "new.las": lambda path: write_las(path, xyz, 6, "1.4", crs=UTM),
        "old.laz": lambda path: write_las(path, xyz, 3, "1.2", crs=UTM),
        "new.laz": lambda path: write_las(path, xyz, 7, "1.4", crs=UTM),
        "tree.copc.laz": lambda path: write_copc(path, xyz),
    }
    for name, make in written.items():
        make(_folder(root, name) / name)
    return [_case(root, name, name) for name in written]


_GEO_KEYS = (
    *((1024, 0, 1, 1), (2048, 0, 1, 4326), (3072, 0, 1, 32615), (3076, 0, 1, 9001)),
    *((4096, 0, 1, 5103), (4099, 0, 1, 9001), (3077, 34736, 1, 0)),
)


def _tables(root: Path) -> List[Case]:
    xyz = _points()
    local = xyz - [EAST, NORTH, 0.0]
    faces = "element face 2\nproperty list uchar int vertex_indices\n"
    rows = np.array([(3, 0, 1, 2)] * 2, "u1,<i4,<i4,<i4").tobytes()
    written: Dict[str, Callable[[Path], Any]] = {
        "ascii.ply": lambda path: write_ply(path, local, "ascii"),
        "little.ply": lambda path: write_ply(path, xyz, before=faces, before_data=rows),
        "big.ply": lambda path: write_ply(path, local, "binary_big_endian", "float"),
        "table.csv": lambda path: write_text(path, local[:800], header="x,y,z"),
        "rows.xyz": lambda path: write_text(path, local[:800], " "),
        "note.txt": lambda path: write_text(path, xyz[:800], ";", "# easting;northing;height"),
    }
    for name, make in written.items():
        make(_folder(root, name) / name)
    return [_case(root, name, name) for name in written]


def _sets(root: Path) -> List[Case]:
    cases = []
    for kind, ending in (("laszip", "laz"), ("binary", "bin")):
        folder = root / f"ept-{kind}"
        srs = {"wkt": pyproj.CRS(UTM).to_wkt()}
        write_ept(folder, _points(), kind, srs=srs if kind == "laszip" else None)
        targets = ["ept.json", "ept-hierarchy/0-0-0-0.json", f"ept-data/0-0-0-0.{ending}"]
        cases.append(_case(root, folder.name, "ept.json", targets))
    return cases


# --- areas


def _areas(root: Path) -> List[Case]:
    made = {
        "area.geojson": ["area.geojson"],
        "area.shp": [f"area.{ending}" for ending in ("shp", "shx", "dbf", "prj")],
        "area.gpkg": ["area.gpkg"],
        "area.kml": ["area.kml"],
        "area.dxf": ["area.dxf"],
        "area.fgb": ["area.fgb"],
    }
    for name in made:
        folder = _folder(root, name)
        write_las(folder / "cloud.las", _points(), crs=UTM)
        _write_area(folder / name)
    return [
        Case(
            name,
            tuple(targets),
            (
                ("volume", "../in/cloud.las", "--area", f"../in/{name}"),
                ("volume", "../in/cloud.las", "--area", f"../in/{name}", "--json"),
                ("volume", "../in/cloud.las", "--area", f"../in/{name}", "--out", OUT),
            ),
        )
        for name, targets in made.items()
    ]


def _write_area(path: Path) -> None:
    second = shapely.affinity.translate(shapely.affinity.scale(PILE.area, 0.5, 0.5), 3.0, 0.0)
    if path.suffix == ".geojson":
        path.write_text(features(PILE.area, second, names=["pile", "half"]))
        return
    shapes, crs = [PILE.area, second], UTM
    if path.suffix == ".kml":
        to = pyproj.Transformer.from_crs(UTM, 4326, always_xy=True)
        shapes = [
            shapely.transform(s, lambda xy: np.column_stack(to.transform(*xy.T))) for s in shapes
        ]
        crs = "EPSG:4326"
    driver = {".kml": "KML", ".dxf": "DXF"}.get(path.suffix)
    named = path.suffix != ".dxf"
    if not named:
        shapes = [shapely.LineString(shape.exterior.coords) for shape in shapes]
    write(
        path,
        geometry=shapely.to_wkb(np.array(shapes)),
        field_data=[np.array(["pile", "half"], dtype=object)] if named else [],
        fields=["name"] if named else [],
        geometry_type=shapes[0].geom_type,
        crs=crs,
        driver=driver,
    )


# --- control and projects


def _controls(root: Path) -> List[Case]:
    marks = places()
    at = delivered(marks)
    given = control_of(marks)
    del given["images"]
    given["cloud"] = {f"M{i}": {"xyz": [float(v) for v in p]} for i, p in enumerate(at)}
    folder = _folder(root, "control")
    (folder / "control.json").write_text(json.dumps(given))
    (folder / "control.yaml").write_text(_as_yaml(given))
    (folder / "points.csv").write_text(_as_rows(given, SITE[2] + (marks - CENTRE)[:, 2]))
    rows = [f"{x:.3f} {y:.3f} {z:.3f} 700 800 I{i}.jpg M{i}" for i, (x, y, z) in enumerate(at)]
    (folder / "gcp_list.txt").write_text("\n".join(["EPSG:32617", *rows]) + "\n")
    write_las(folder / "cloud.las", delivered(_site()), crs="EPSG:32617")
    (folder / "table.json").write_text(json.dumps({**given, "points": "points.csv"}))
    cases = []
    for name in ("control.json", "control.yaml", "points.csv", "gcp_list.txt"):
        path = f"../in/{'table.json' if name == 'points.csv' else name}"
        commands: List[Sequence[str]] = [("gcp", path), ("gcp", path, "--json")]
        if name != "gcp_list.txt":
            with_cloud = ("../in/cloud.las", "--gcp", path)
            commands.append(("scale", *with_cloud, "--out", f"{OUT}/scaled.las"))
            commands.append(("volume", *with_cloud, "--json"))
        cases.append(Case(name, (name,), tuple(commands)))
        os.symlink(folder, root / name)
    return cases


def _site() -> np.ndarray:
    return survey(TERRAIN.height, Errors(0.01, 0.0), _POINTS)


def _as_yaml(given: Any) -> str:
    lines = []
    for key, value in given.items():
        if isinstance(value, (str, int, float)):
            lines.append(f"{key}: {value}")
            continue
        lines.append(f"{key}:")
        items = value.items() if isinstance(value, dict) else ((None, item) for item in value)
        lines += [f"  {'-' if k is None else f'{k}:'} {json.dumps(v)}" for k, v in items]
    return "\n".join(lines) + "\n"


def _as_rows(given: Any, heights: np.ndarray) -> str:
    rows = [
        f"{name},{point['lat']},{point['lon']},{height:.3f},{point['accuracy']}"
        for (name, point), height in zip(given["points"].items(), heights)
    ]
    return "\n".join(["name,lat,lon,elevation (m),accuracy", *rows]) + "\n"


def _projects(root: Path) -> List[Case]:
    """An ODM output with photographs, as folder and as all.zip, and control that has picks."""
    folder = _folder(root, "project")
    made = folder / "made"
    model = made / "odm_georeferencing" / "odm_georeferenced_model.laz"
    model.parent.mkdir(parents=True)
    write_las(model, delivered(_site()))
    (model.parent / "coords.txt").write_text("WGS84 UTM 17N\n437000 4572800\n")
    (model.parent / "proj.txt").write_text("+proj=utm +zone=17 +datum=WGS84 +units=m +no_defs\n")
    shots = flight(made)
    rows = ["EPSG:32617"]
    for number, place in enumerate(delivered(places())):
        for pick in picks_of(shots, f"M{number}", place, most=5, sigma=0.3, seed=number):
            rows.append(f"nan nan nan {pick.px:.3f} {pick.py:.3f} {pick.image} {pick.name}")
    (folder / "picks.txt").write_text("\n".join(rows) + "\n")
    (folder / "control.json").write_text(json.dumps(control_of(places())))
    rtk = control_of(places(), sigma=0.01, levelled=True)
    (folder / "rtk.json").write_text(json.dumps(rtk))
    with zipfile.ZipFile(folder / "all.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p for p in made.rglob("*") if p.is_file()):
            archive.write(path, path.relative_to(made).as_posix())
    beside = [f"made/{n}" for n in ("cameras.json", "odm_report/shots.geojson")]
    beside += [f"made/odm_georeferencing/{n}" for n in ("coords.txt", "proj.txt")]
    os.symlink(folder, root / "all.zip")
    return [
        Case("project", (*beside, "picks.txt"), _with_photographs("../in/made")),
        Case("all.zip", ("all.zip",), _with_photographs("../in/all.zip")),
    ]


def _with_photographs(source: str) -> Tuple[Sequence[str], ...]:
    control = ("--gcp", "../in/control.json")
    return (
        ("info", source),
        ("gcp", "../in/rtk.json", "--to", "odm", "--out", f"{OUT}/gcp_list.txt"),
        ("volume", source, "--json"),
        ("volume", source, *control),
        ("scale", source, *control, "--out", f"{OUT}/scaled.laz"),
    )


# --- jobs


def _jobs(root: Path) -> List[Case]:
    """Folders of a submit that stopped here and there; the server is a port that refuses."""
    cases = []
    archive = (root / "project" / "all.zip").read_bytes()
    for state in ("ready", "uploading", "committing", "waiting", "fetching", "done", "cancelled"):
        folder = _folder(root, f"job-{state}")
        photo = folder / "photos" / "a.jpg"
        photo.parent.mkdir()
        photo.write_bytes(b"\xff\xd8\xff\xe0 not sent")
        os.utime(photo, ns=(10**18, 10**18))
        entry = {"name": "a.jpg", "path": str(photo), "size": 13, "mtime_ns": 10**18}
        job = folder / "job"
        job.mkdir()
        (job / "job.json").write_text(json.dumps(_journal(state, entry, len(archive)), indent=1))
        targets = ["job/job.json"]
        if state in ("uploading", "committing"):
            (job / "sent-1.jsonl").write_text('{"begin": "a.jpg"}\n{"done": "a.jpg"}\n')
            targets.append("job/sent-1.jsonl")
        if state == "done":
            (job / "all.zip").write_bytes(archive)
            targets.append("job/all.zip")
        resume = ("resume", "../in/job", "--patience", "0")
        more = ((), ("--json",), ("--resubmit",), ("--cancel",))
        cases.append(Case(folder.name, tuple(targets), tuple((*resume, *m) for m in more[:3])))
        if state == "waiting":
            cases[-1] = Case(
                folder.name, tuple(targets), tuple((*resume[:2], *m) for m in more[3:])
            )
    return cases


def _journal(state: str, entry: Any, archive_bytes: int) -> Dict[str, Any]:
    begun = state != "ready"
    return {
        "schema": "quantify-job/1",
        "url": REFUSED,
        "name": "site",
        "options": {"dsm": True},
        "outputs": ["odm_georeferencing"],
        "files": [entry],
        "ca": None,
        "insecure": False,
        "then": {"options": {"slices": "auto", "threads": 1}, "units": "metric"},
        "state": state,
        "uuid": "3d3d3d3d-0000-4000-8000-000000000001" if begun else "",
        "attempt": int(begun),
        "archive_bytes": archive_bytes if state == "done" else None,
        "kind": "node",
        "project": None,
        "marker": "",
    }
