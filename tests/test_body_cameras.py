"""Where photographs of a body were taken: a file, the ODM project, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, Mapping

import numpy as np
import pytest
from photographs import photograph
from pyproj import Transformer
from scans import Flaws, scan
from solids import sphere

from quantify_client import measure
from quantify_client.errors import QuantifyError
from quantify_client.types import Measurement

POINTS = scan(sphere(), 3_000, 5, Flaws(missing=0.15))
MIDDLE = POINTS.mean(axis=0)
AROUND = 2 * np.pi * np.arange(12) / 12
HEIGHTS = np.where(
    np.arange(12) % 2, -3.0, -0.2
)  # two rings: what one sees from along, the other sees
RING = np.column_stack([4 * np.cos(AROUND), 4 * np.sin(AROUND), HEIGHTS]) + MIDDLE


def written(path: Path, points: np.ndarray) -> Path:
    np.savetxt(path, points, fmt="%.4f")
    return path


def shots(path: Path, places: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    features = [{"type": "Feature", "properties": {"translation": p.tolist()}} for p in places]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


@pytest.fixture(scope="module")
def cloud(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("ball") / "ball.xyz", POINTS)


@pytest.fixture(scope="module")
def without(cloud: Path) -> Measurement:
    """What is measured where no cameras are known."""
    return measure(cloud, shape="object", source_unit="m")


@pytest.fixture(scope="module")
def text(cloud: Path, tmp_path_factory: pytest.TempPathFactory) -> Measurement:
    """What is measured with places in a text file."""
    path = written(tmp_path_factory.mktemp("cameras") / "cameras.txt", RING)
    return measure(cloud, source_unit="m", cameras=path)


def test_text_shots_and_project_tell_the_same(
    cloud: Path, without: Measurement, text: Measurement, tmp_path: Path
) -> None:
    listed = measure(cloud, source_unit="m", cameras=shots(tmp_path / "shots.geojson", RING))
    project = tmp_path / "project"
    (project / "odm_georeferencing").mkdir(parents=True)
    shots(project / "odm_report" / "shots.geojson", RING)
    inside = project / "odm_georeferencing" / "odm_georeferenced_model.csv"
    inside.write_text("X,Y,Z\n" + "\n".join(",".join(f"{v:.4f}" for v in p) for p in POINTS))
    own = measure(project, shape="object", source_unit="m")
    assert text.results[0].volume_m3 == pytest.approx(listed.results[0].volume_m3, rel=1e-3)
    assert own.results[0].volume_m3 == pytest.approx(listed.results[0].volume_m3, rel=1e-3)
    # They see that nothing is below.
    assert listed.results[0].volume_m3 < 0.98 * without.results[0].volume_m3


@pytest.mark.one_python
def test_names_of_photographs_may_stand_before_their_places(
    cloud: Path, text: Measurement, tmp_path: Path
) -> None:
    rows = [(f"DJI {number}.JPG", *place) for number, place in enumerate(RING.tolist())]
    lines = ["\t".join(map(str, row)) for row in rows]
    lost = "lost.JPG\tnan\tnan\tnan"
    by_name = [",".join(map(str, (name, y, x, z))) for name, x, y, z in rows]
    for content in ([*lines, lost], ["label,northing,easting,elevation", *by_name]):
        named = tmp_path / "named.txt"
        named.write_text("\n".join(content))
        found = measure(cloud, source_unit="m", cameras=named)
        assert found.results[0].volume_m3 == pytest.approx(text.results[0].volume_m3, rel=1e-3)
    named.write_text(lost)
    with pytest.raises(QuantifyError, match="0 places; expected positions of cameras"):
        measure(cloud, source_unit="m", cameras=named)


def test_a_list_of_odm_says_in_which_crs_its_places_are(cloud: Path, tmp_path: Path) -> None:
    lon, lat = Transformer.from_crs(32632, 4326, always_xy=True).transform(*RING[:, :2].T)
    rows = [
        f"{n}.jpg {x:.9f} {y:.9f} {z:.3f} 0 0 0"
        for n, (x, y, z) in enumerate(zip(lon, lat, RING[:, 2]))
    ]
    listed = tmp_path / "geo.txt"
    listed.write_text("EPSG:4326\n" + "\n".join(rows))
    plain = written(tmp_path / "cameras.txt", RING)
    one, other = (
        measure(cloud, shape="object", crs="EPSG:32632", cameras=path).results[0].volume_m3
        for path in (plain, listed)
    )
    assert one == pytest.approx(other, rel=1e-3)
    with pytest.raises(QuantifyError, match="and the cloud has no CRS; give positions"):
        measure(cloud, source_unit="m", cameras=listed)
    listed.write_text("EPSG:4326\n" + rows[0] + "\nand so on\n")
    with pytest.raises(QuantifyError, match="line 3 is 'and so on', and no name, x, y and z"):
        measure(cloud, source_unit="m", cameras=listed)


def taken_at(places: np.ndarray, folder: Path) -> Path:
    """Write photographs that say in degrees where they were taken."""
    folder.mkdir()
    lon, lat = Transformer.from_crs(32632, 4326, always_xy=True).transform(*places[:, :2].T)
    for number, place in enumerate(zip(lon, lat, places[:, 2].tolist())):
        photograph(folder / f"{number}.jpg", gps=place)
    return folder


def test_the_gps_of_photographs_tells_where_they_were_taken(tmp_path: Path) -> None:
    """A ball of 24 m, and cameras 48 m from its middle."""
    large = written(tmp_path / "ball.xyz", MIDDLE + 12.0 * (POINTS - MIDDLE))
    ring = MIDDLE + 12.0 * (RING - MIDDLE)
    folder = taken_at(ring, tmp_path / "photographs")
    photograph(folder / "flat.jpg", gps=(9.0, 40.6))  # no altitude
    (folder / "notes.txt").write_text("wind from the west")

    def volume(cameras: Path) -> float:
        found = measure(large, shape="object", crs="EPSG:32632", cameras=cameras)
        assert told(found)["surface-completed"]["cameras"] == 12
        return float(found.results[0].volume_m3)

    plain = volume(written(tmp_path / "cameras.txt", ring))
    assert volume(folder) == pytest.approx(plain, rel=1e-3)
    with pytest.raises(QuantifyError, match="and the cloud has no CRS"):
        measure(large, source_unit="m", cameras=folder)
    small = written(tmp_path / "small.xyz", MIDDLE + 4.0 * (POINTS - MIDDLE))
    near = taken_at(MIDDLE + 4.0 * (RING - MIDDLE), tmp_path / "near")
    with pytest.raises(QuantifyError, match="known to some metres; expected 30 m and more"):
        measure(small, shape="object", crs="EPSG:32632", cameras=near)
    sunk = taken_at(ring - [0.0, 0.0, 200.0], tmp_path / "sunk")
    with pytest.raises(QuantifyError, match="below the cloud"):
        measure(large, shape="object", crs="EPSG:32632", cameras=sunk)
    with pytest.raises(QuantifyError, match="no photograph in it says where it was taken"):
        measure(large, source_unit="m", cameras=tmp_path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"type": "FeatureCollection", "features": []}', "has no features; expected positions"),
        ('{"features": [{"properties": {"translation": [1, 2]}}]}', "no translation of three"),
        ("[1, 2", "cameras.json"),
    ],
)
def test_what_holds_no_positions_is_refused(
    cloud: Path, tmp_path: Path, content: str, said: str
) -> None:
    path = tmp_path / "cameras.json"
    path.write_text(content)
    with pytest.raises(QuantifyError, match=said):
        measure(cloud, source_unit="m", cameras=path)


def test_cameras_of_another_place_are_refused(cloud: Path, tmp_path: Path) -> None:
    path = written(tmp_path / "cameras.txt", RING + np.array([90_000.0, 0.0, 0.0]))
    with pytest.raises(QuantifyError, match="far from the cloud.*give positions in the cloud's"):
        measure(cloud, source_unit="m", cameras=path)
    with pytest.raises(QuantifyError, match="does not exist"):
        measure(cloud, source_unit="m", cameras=tmp_path / "none.txt")


def told(measurement: Measurement) -> Dict[str, Mapping[str, Any]]:
    return {one.code: one.values for one in measurement.results[0].warnings}


@pytest.mark.one_python
def test_it_is_told_how_many_cameras_count(
    cloud: Path, without: Measurement, tmp_path: Path
) -> None:
    assert told(without)["surface-completed"]["cameras"] == 0
    one = measure(cloud, source_unit="m", cameras=written(tmp_path / "one.txt", RING[:1]))
    assert told(one)["surface-completed"]["cameras"] == 1
    assert "cameras-left-out" not in told(one)


@pytest.mark.one_python
def test_cameras_within_the_body_are_left_out(
    cloud: Path, without: Measurement, tmp_path: Path
) -> None:
    """Millimetres that are told for metres, say."""
    path = written(tmp_path / "cameras.txt", MIDDLE + (RING - MIDDLE) / 1000.0)
    measurement = measure(cloud, source_unit="m", cameras=path)
    assert told(measurement)["cameras-left-out"]["count"] == 12
    assert told(measurement)["surface-completed"]["cameras"] == 0
    assert measurement.results[0].volume_m3 == without.results[0].volume_m3


def test_cameras_go_with_objects(cloud: Path, tmp_path: Path) -> None:
    path = written(tmp_path / "cameras.txt", RING)
    with pytest.raises(QuantifyError, match="--cameras.* --shape object"):
        measure(cloud, source_unit="m", shape="terrain", cameras=path)
