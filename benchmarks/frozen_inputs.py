"""The inputs of frozen.py: clouds, meshes, outlines and control files, made with fixed seeds.

Everything lies at UTM-sized coordinates and is rounded (clouds to 0.1 mm or 1 mm, degrees to
1e-9), so that another version of a library makes the same files.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import laspy
import numpy as np
import numpy.typing as npt
import pyproj
from plyfile import PlyData, PlyElement

FloatArray = npt.NDArray[np.float64]
Height = Callable[[FloatArray, FloatArray], FloatArray]
Ring = FloatArray

SIDE, MIDDLE = 40.0, 20.0
UTM = "EPSG:32615"
ORIGIN = np.array([500_000.0, 5_000_000.0, 100.0])
CENTRE = ORIGIN + np.array([MIDDLE, MIDDLE, 0.0])
GROUND = 0.999584
"""Grid length / ground length at ORIGIN, 100 m above the ellipsoid."""

US_FOOT, FOOT = 1200 / 3937, 0.3048
CALIFORNIA = np.array([6_500_000.0, 1_900_000.0, 0.0])
"""A place in EPSG:2229, US survey feet."""

BODY_AT = np.array([500_000.0, 4_500_000.0, 100.0])


def make_inputs(folder: Path) -> None:
    """Write every input file into a folder."""
    make_terrains(folder)
    make_outlines(folder)
    make_bodies(folder)
    make_meshes(folder)
    make_control(folder)


# --- files


def write_las(path: Path, points: FloatArray, crs: Optional[str] = None) -> None:
    """Write LAS or LAZ, by the ending of the path; degrees to 1e-9, anything else to 0.1 mm."""
    header = laspy.LasHeader(point_format=3, version="1.4" if crs == "EPSG:4326" else "1.2")
    step = 1e-9 if crs == "EPSG:4326" else 1e-4
    header.scales, header.offsets = [step, step, 1e-4], np.floor(points.min(axis=0))
    if crs is not None:
        header.add_crs(pyproj.CRS.from_user_input(crs), keep_compatibility=False)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.write(str(path))


def write_text(path: Path, points: FloatArray, delimiter: str = " ", header: str = "") -> None:
    """Write rows of x, y and z with four decimals."""
    np.savetxt(path, points, "%.4f", delimiter=delimiter, header=header, comments="")


def write_ply(
    path: Path, points: FloatArray, faces: Optional[npt.NDArray[np.int64]] = None
) -> None:
    """Write a cloud or a mesh as binary PLY in double precision."""
    rows = np.zeros(len(points), dtype=[(axis, "f8") for axis in "xyz"])
    for axis, column in zip("xyz", np.round(points, 6).T):
        rows[axis] = column
    elements = [PlyElement.describe(rows, "vertex")]
    if faces is not None:
        corners = np.zeros(len(faces), dtype=[("vertex_indices", "i4", (3,))])
        corners["vertex_indices"] = faces
        elements.append(PlyElement.describe(corners, "face"))
    PlyData(elements, byte_order="<").write(str(path))


def write_areas(
    path: Path, areas: Dict[str, Sequence[Ring]], crs: Optional[str] = UTM, decimals: int = 4
) -> None:
    """Write GeoJSON polygons by name; the first ring of each is its outline, the others holes."""
    features = [
        {
            "type": "Feature",
            "properties": {"name": name},
            "geometry": {
                "type": "Polygon",
                "coordinates": [np.round(ring[:, :2], decimals).tolist() for ring in rings],
            },
        }
        for name, rings in areas.items()
    ]
    document: Dict[str, Any] = {"type": "FeatureCollection", "features": features}
    if crs is not None:
        document["crs"] = {"type": "name", "properties": {"name": crs}}
    path.write_text(json.dumps(document), encoding="utf-8")


def write_control(path: Path, document: Dict[str, Any]) -> None:
    """Write a control file: JSON, or YAML with one line for each entry."""
    if path.suffix == ".json":
        path.write_text(json.dumps(document), encoding="utf-8")
        return
    lines: List[str] = []
    for key, value in document.items():
        if isinstance(value, dict):
            lines += [f"{key}:", *(f"  {name}: {json.dumps(v)}" for name, v in value.items())]
        elif isinstance(value, list):
            lines += [f"{key}:", *(f"  - {json.dumps(entry)}" for entry in value)]
        else:
            lines.append(f"{key}: {json.dumps(value)}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


# --- terrain, over local x and y in 0..40 m


def undulating(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return ground that rises and falls by 10 cm."""
    return 0.10 * np.sin(2 * np.pi * x / 17 + 0.4) * np.cos(2 * np.pi * y / 25)


def tilted(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a plane that slopes by 12 %."""
    return 0.10 * x - 0.07 * y


def cone(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a heap 4 m high, of 8 m radius."""
    return np.maximum(0.0, 4.0 * (1 - np.hypot(x - MIDDLE, y - MIDDLE) / 8.0))


def pit(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a paraboloid 2 m deep, of 8 m radius."""
    return -2.0 * np.maximum(0.0, 1 - ((x - MIDDLE) ** 2 + (y - MIDDLE) ** 2) / 64.0)


def gully(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a winding V 6 m wide and 1.5 m deep that ends inside the survey."""
    along = np.sin(np.pi * np.clip(y - 5, 0, 30) / 30)
    return -1.5 * np.maximum(0.0, 1 - np.abs(x - MIDDLE - np.sin(y / 5)) / 3) * along


def two_heaps(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a heap in the west and a pit in the east."""
    return cone(x + 9, y) * 0.6 + pit(x - 9, y) * 0.7


def survey(height: Height, ground: Height, count: int, seed: int) -> FloatArray:
    """Return (count, 3) local points with 2 cm of noise, 1 % of them up to 5 m off."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, SIDE, (2, count))
    z = height(x, y) + ground(x, y) + rng.normal(0, 0.02, count)
    off = rng.random(count) < 0.01
    z[off] += rng.uniform(-5, 5, np.count_nonzero(off))
    return np.column_stack([x, y, z])


def circle(radius: float, x: float = MIDDLE, y: float = MIDDLE, sides: int = 48) -> Ring:
    """Return a closed local ring, (sides + 1, 3)."""
    angle = np.arange(sides + 1) % sides * 2 * np.pi / sides
    across, up = radius * np.cos(angle), radius * np.sin(angle)
    return np.column_stack([x + across, y + up, np.zeros(sides + 1)])


def rectangle(left: float, bottom: float, right: float, top: float) -> Ring:
    """Return a closed local ring, (5, 3)."""
    x, y = [left, right, right, left, left], [bottom, bottom, top, top, bottom]
    return np.column_stack([x, y, np.zeros(5)])


def to_degrees(points: FloatArray) -> FloatArray:
    """Return longitude, latitude and the same height of points in UTM."""
    transformer = pyproj.Transformer.from_crs(UTM, 4326, always_xy=True)
    lon, lat = transformer.transform(points[:, 0], points[:, 1])
    return np.column_stack([np.round(lon, 9), np.round(lat, 9), points[:, 2]])


def to_feet(points: FloatArray) -> FloatArray:
    """Return local points at a place in California, in US survey feet."""
    return CALIFORNIA + (points + np.array([0, 0, 100])) / US_FOOT


def make_terrains(folder: Path) -> None:
    """Write the surveys, the same few surfaces in many formats and frames."""
    heap = survey(cone, undulating, 40_000, 1)
    plain = survey(cone, tilted, 30_000, 2)
    write_las(folder / "heap.las", ORIGIN + heap, UTM)
    write_las(folder / "plain.laz", ORIGIN + plain, UTM)
    write_ply(folder / "pit.ply", ORIGIN + survey(pit, undulating, 30_000, 3))
    write_text(folder / "gully.xyz", ORIGIN + survey(gully, tilted, 30_000, 4))
    write_text(folder / "heap.csv", ORIGIN + heap[:20_000], ",", "X,Y,Z")
    write_las(folder / "both.las", ORIGIN + survey(two_heaps, undulating, 40_000, 5), UTM)
    west = heap[:, 0] < 18.0
    write_las(folder / "west.laz", ORIGIN + heap[west], UTM)
    write_las(folder / "east.laz", ORIGIN + heap[~west], UTM)
    write_las(folder / "feet.las", to_feet(plain), "EPSG:2229")
    write_text(folder / "feet.xyz", to_feet(plain))
    write_las(folder / "degrees.las", to_degrees(ORIGIN + plain), "EPSG:4326")
    write_las(folder / "twice.las", ORIGIN + np.vstack([heap, heap[::2]]), UTM)
    high = ORIGIN + heap
    high[:, 2] /= FOOT
    write_las(folder / "heights.las", high, UTM)


def make_outlines(folder: Path) -> None:
    """Write the polygons of the surveys."""
    ring = circle(9.5)
    write_areas(folder / "heap.geojson", {"heap": [ORIGIN + ring]})
    write_areas(folder / "no-crs.geojson", {"heap": [ORIGIN + ring]}, None)
    write_areas(folder / "gully.geojson", {"gully": [ORIGIN + rectangle(14, 3, 26, 37)]})
    write_areas(folder / "feet.geojson", {"heap": [to_feet(ring)]}, "EPSG:2229")
    write_areas(folder / "degrees.geojson", {"heap": [to_degrees(ORIGIN + ring)]}, None, 9)
    west, east = (ORIGIN + circle(8.5, x) for x in (11.0, 29.0))
    write_areas(folder / "both.geojson", {"heap": [west], "pit": [east]})
    hole = ORIGIN + circle(3.0)[::-1]
    write_areas(folder / "hole.geojson", {"ring": [ORIGIN + ring, hole]})
    write_areas(folder / "off.geojson", {"edge": [ORIGIN + rectangle(-2, 11, 30, 29)]})
    far = ORIGIN + circle(8.0, 400.0)
    write_areas(folder / "far.geojson", {"heap": [ORIGIN + ring], "far": [far]})


# --- bodies, about 1 m wide


def ball(count: int, rng: np.random.Generator, radius: float = 0.5) -> FloatArray:
    """Return (count, 3) points of a sphere about 0."""
    away = rng.normal(size=(count, 3))
    return np.asarray(radius * away / np.linalg.norm(away, axis=1)[:, None])


def cube(count: int, rng: np.random.Generator) -> FloatArray:
    """Return (count, 3) points of a cube with the edge 1."""
    points = rng.uniform(-0.5, 0.5, (count, 3))
    points[np.arange(count), rng.integers(0, 3, count)] = rng.choice([-0.5, 0.5], count)
    return points


def torus(count: int, rng: np.random.Generator) -> FloatArray:
    """Return about 0.7 count points of a lying torus with the radii 0.35 and 0.15."""
    around, across = 2 * np.pi * rng.random((2, count))
    away = 0.35 + 0.15 * np.cos(across)
    points = np.column_stack([away * np.cos(around), away * np.sin(around), 0.15 * np.sin(across)])
    return points[rng.random(count) < away / 0.5]


def cup(count: int, rng: np.random.Generator) -> FloatArray:
    """Return (count, 3) points of a cup: radii 0.5 and 0.35, height 1, bottom 0.2 thick."""
    outer, inner, low = 0.5, 0.35, 0.2
    # side, inner side, bottom, inner bottom, rim: areas divided by pi
    areas = [2 * outer, 2 * inner * (1 - low), outer**2, inner**2, outer**2 - inner**2]
    part = rng.choice(5, count, p=np.array(areas) / sum(areas))
    least = np.array([outer, inner, 0.0, 0.0, inner])[part]
    most = np.array([outer, inner, outer, inner, outer])[part]
    away = np.sqrt(rng.uniform(least**2, most**2))
    bottom = np.array([0.0, low, 0.0, low, 1.0])[part]
    z = rng.uniform(bottom, np.array([1.0, 1.0, 0.0, low, 1.0])[part])
    angle = 2 * np.pi * rng.random(count)
    return np.column_stack([away * np.cos(angle), away * np.sin(angle), z])


def with_ground(body: FloatArray, rng: np.random.Generator, count: int) -> FloatArray:
    """Return a ball whose foot is hidden, and the ground around it, 3 m wide."""
    flat = rng.uniform(-1.5, 1.5, (count, 2))
    flat = flat[np.hypot(*flat.T) > 0.33]
    ground = np.column_stack([flat, np.full(len(flat), -0.5)])
    points = np.vstack([body[body[:, 2] > -0.4], ground])
    return points + rng.normal(0, 0.002, points.shape)


def make_bodies(folder: Path) -> None:
    """Write scans of bodies, without a CRS."""
    rng = np.random.default_rng(6)
    sphere = ball(20_000, rng)
    write_las(folder / "sphere.laz", BODY_AT + sphere)
    write_las(folder / "cube.las", BODY_AT + cube(24_000, rng))
    write_ply(folder / "torus.ply", BODY_AT + torus(24_000, rng))
    write_las(folder / "cup.laz", BODY_AT + cup(24_000, rng))
    second = ball(8_000, rng, 0.3) + np.array([0.9, 0.1, 0.2])
    write_las(folder / "two.laz", BODY_AT + np.vstack([ball(12_000, rng, 0.4), second]))
    noisy = ball(20_000, rng) + rng.normal(0, 0.01, (20_000, 3))
    strays = rng.uniform(-1, 1, (200, 3))
    write_las(folder / "noisy.laz", BODY_AT + np.vstack([noisy, strays]))
    grid = np.unique(np.round(ball(60_000, rng) / 0.02).astype(int), axis=0) * 0.02
    write_text(folder / "thinned.xyz", BODY_AT + grid)
    write_las(folder / "standing.laz", BODY_AT + with_ground(ball(15_000, rng), rng, 40_000))
    hole = np.linalg.norm(sphere - [0.5, 0.0, 0.0], axis=1) < 0.1
    write_las(folder / "holed.laz", BODY_AT + sphere[~hole])
    write_las(folder / "dome.laz", BODY_AT + sphere[sphere[:, 2] > 0.0])
    shell = np.vstack([ball(16_000, rng), ball(6_000, rng, 0.3)])
    write_las(folder / "shell.laz", BODY_AT + shell)
    write_text(folder / "millimetres.xyz", 1000.0 * (sphere + np.array([20, 30, 1])))


# --- meshes


def icosphere(divisions: int, radius: float = 1.0) -> Tuple[FloatArray, npt.NDArray[np.int64]]:
    """Return the corners and the triangles of an octahedron divided and blown up to a sphere."""
    faces = [(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
    triangles = np.array(
        [np.diag(signs)[:: 1 if np.prod(signs) > 0 else -1] for signs in faces], dtype=float
    )
    for _ in range(divisions):
        a, b, c = triangles.transpose(1, 0, 2)
        ab, bc, ca = a + b, b + c, c + a
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
        triangles /= np.linalg.norm(triangles, axis=2)[:, :, None]
    corners, numbers = np.unique(np.round(triangles.reshape(-1, 3), 9), axis=0, return_inverse=True)
    return radius * corners, numbers.reshape(-1, 3)


def make_meshes(folder: Path) -> None:
    """Write meshes: closed, with a missing face, and two that run into each other."""
    corners = np.vstack([np.zeros(3), np.eye(3)])
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    write_ply(folder / "tetrahedron.ply", BODY_AT + corners, tetrahedron)
    points, faces = icosphere(5)
    write_ply(folder / "icosphere.ply", BODY_AT + points, faces)
    write_ply(folder / "open.ply", BODY_AT + points, faces[1:])
    both = np.vstack([points, points + np.array([1.1, 0.3, 0.2])])
    crossing = np.vstack([faces, faces + len(points)])
    write_ply(folder / "crossing.ply", BODY_AT + both, crossing)
    inner = np.vstack([points, 0.5 * points])
    hollow = np.vstack([faces, faces[:, ::-1] + len(points)])
    write_ply(folder / "hollow.ply", BODY_AT + inner, hollow)


# --- control of a site that the cloud shows too small


def small(points: FloatArray) -> FloatArray:
    """Return places in a cloud at 0.9 of their true distance from the site's centre."""
    return CENTRE + 0.9 * (points - CENTRE)


def in_own_frame(points: FloatArray) -> FloatArray:
    """Return places in a cloud of half the size, turned in space, at a place of its own."""
    a, b = np.radians(70.0), np.radians(11.0)
    about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return 0.5 * (points - CENTRE) @ (about_x @ about_z).T + [1000.0, 2000.0, 50.0]


def marks(count: int = 9, steepness: float = 1.0) -> FloatArray:
    """Return (count, 3) places on the heap, in the grid."""
    x, y = np.random.default_rng(7).uniform(2, 38, (2, count))
    return np.round(ORIGIN + np.column_stack([x, y, steepness * (cone(x, y) + tilted(x, y))]), 4)


def places(cloud: FloatArray) -> Dict[str, Any]:
    """Return the part `cloud` of a control file."""
    rounded = np.round(cloud, 4).tolist()
    return {f"M{i}": {"xyz": place, "accuracy": 0.005} for i, place in enumerate(rounded)}


def tapes(truth: FloatArray, count: int = 14, unit: float = 1.0) -> List[Dict[str, Any]]:
    """Return the part `distances` of a control file: the longest ones, with 5 mm of noise."""
    rng = np.random.default_rng(8)
    ground = truth / [GROUND, GROUND, 1.0]
    first, second = np.triu_indices(len(truth), 1)
    apart = np.linalg.norm(ground[first] - ground[second], axis=1)
    return [
        {
            "from": f"M{first[i]}",
            "to": f"M{second[i]}",
            "length": round(float(apart[i] + rng.normal(0, 0.005)) / unit, 4),
            "accuracy": round(0.005 / unit, 4),
        }
        for i in np.argsort(-apart)[:count]
    ]


def positions(truth: FloatArray, gps: float, levels: int = 0) -> Dict[str, Any]:
    """Return the part `points` of a control file; the first `levels` have an elevation."""
    rng = np.random.default_rng(9)
    seen = to_degrees(
        truth + np.column_stack([rng.normal(0, gps, (len(truth), 2)), 0 * truth[:, 0]])
    )
    points: Dict[str, Any] = {
        f"M{i}": {"lat": lat, "lon": lon, "accuracy": gps}
        for i, (lon, lat, _) in enumerate(seen.tolist())
    }
    for i in range(levels):
        height = round(float(truth[i, 2] + rng.normal(0, 0.01)), 4)
        points[f"M{i}"].update(elevation=height, elevation_accuracy=0.01)
    return points


def make_control(folder: Path) -> None:
    """Write the site's clouds, its outlines and its control files."""
    site = ORIGIN + survey(cone, tilted, 25_000, 10)
    write_las(folder / "site.las", small(site), UTM)
    write_text(folder / "own.xyz", in_own_frame(site))
    write_areas(folder / "site.geojson", {"heap": [small(ORIGIN + circle(9.5))]})
    write_areas(folder / "surveyed.geojson", {"heap": [ORIGIN + circle(9.5)]})
    for name, document in {**scale_documents(), **other_documents()}.items():
        write_control(folder / name, document)
    write_tables(folder)
    write_picks(folder)


def scale_documents() -> Dict[str, Dict[str, Any]]:
    """Return the control files of the site's cloud, by name."""
    truth = marks()
    taped = {"unit": "m", "cloud": places(small(truth)), "distances": tapes(truth)}
    phone = {**taped, "crs": "EPSG:4326", "points": positions(truth, 3.0)}
    levelled = {**taped, "crs": "EPSG:4326", "points": positions(truth, 0.02, 6)}
    alone = {key: value for key, value in levelled.items() if key != "distances"}
    wrong = tapes(truth)
    wrong[2]["length"] = round(wrong[2]["length"] + 0.5, 4)
    checked = [{**tape, "check": i in (1, 5)} for i, tape in enumerate(tapes(truth))]
    own = {**levelled, "cloud": places(in_own_frame(truth)), "height": 100}
    return {
        "tapes.json": taped,
        "phone.yaml": phone,
        "levelled.yaml": levelled,
        "positions.json": alone,
        "wrong.json": {**phone, "distances": wrong},
        "checked.yaml": {**phone, "distances": checked},
        "feet.json": {"unit": "us-ft", "cloud": places(small(truth))}
        | {"distances": tapes(truth, unit=US_FOOT)},
        "own.yaml": own,
        "design.yaml": {key: value for key, value in levelled.items() if key != "cloud"},
    }


def other_documents() -> Dict[str, Dict[str, Any]]:
    """Return control of a body by scale bars, and a site's that names tables."""
    ends = {"P": [-0.5, 0, 0], "Q": [0.5, 0, 0], "R": [0, -0.5, 0], "S": [0, 0.5, 0]}
    cloud = {
        name: {"xyz": (BODY_AT + place).tolist(), "accuracy": 0.001} for name, place in ends.items()
    }
    bars = [
        {"from": "P", "to": "Q", "length": 1.2503, "accuracy": 0.0005},
        {"from": "R", "to": "S", "length": 1.2496, "accuracy": 0.0005},
    ]
    tables = {"points": "points.csv", "distances": "distances.csv", "cloud": "cloud.csv"}
    return {
        "bars.json": {"unit": "m", "cloud": cloud, "scale_bars": bars},
        "tables.yaml": {"crs": "EPSG:4326", "unit": "m", **tables},
    }


def write_tables(folder: Path) -> None:
    """Write points, distances and cloud places as CSV."""
    truth = marks()
    points = [
        f"{n},{p['lat']},{p['lon']},{p['accuracy']}" for n, p in positions(truth, 3.0).items()
    ]
    lengths = [f"{t['from']},{t['to']},{t['length']},{t['accuracy']}" for t in tapes(truth)]
    cloud = [",".join(map(str, [n, *c["xyz"], 0.005])) for n, c in places(small(truth)).items()]
    for name, heading, rows in (
        ("points.csv", "name,lat,lon,accuracy", points),
        ("distances.csv", "from,to,length,accuracy", lengths),
        ("cloud.csv", "name,x,y,z,accuracy", cloud),
    ):
        (folder / name).write_text("\n".join([heading, *rows]) + "\n", encoding="utf-8")


def write_picks(folder: Path) -> None:
    """Write control with picks in photographs for ODM, and an ODM list without any lengths."""
    truth = marks(6, 2.5)
    lengths = tapes(truth)
    for tape in lengths:
        up = [truth[int(tape[end][1:]), 2] for end in ("from", "to")]
        tape["higher"] = tape["to"] if up[1] > up[0] else tape["from"]
    document = {"crs": "EPSG:4326", "unit": "m", "height": 100, "images": "picks.txt"}
    document.update(points=positions(truth, 0.02, 2), distances=lengths)
    write_control(folder / "odm.yaml", document)
    rows = [f"nan nan nan {100 + n}.5 200.25 IMG_{k}.JPG M{n}" for n in range(6) for k in (1, 2)]
    (folder / "picks.txt").write_text("\n".join(["EPSG:4326", *rows]) + "\n", encoding="utf-8")
    rows = [
        f"{x:.4f} {y:.4f} 0 10 20 IMG_{k}.JPG P{n}"
        for n, (x, y, _) in enumerate(truth)
        for k in (1, 2)
    ]
    (folder / "gcp_list.txt").write_text("\n".join([UTM, *rows]) + "\n", encoding="utf-8")
