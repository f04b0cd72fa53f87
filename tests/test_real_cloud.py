"""A cone put onto, and a pit taken out of, a real photogrammetric cloud."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
import shapely
from clouds import write_las
from terrains import circle

import quantify_client
from quantify_client import measure

# Many points: no different on a second Python.
pytestmark = pytest.mark.one_python

DEMO = Path(quantify_client.__file__).parent / "demo" / "brighton_beach.laz"

#: The middles of open places on grass and road.
PLACES = {
    "a": (576_733.0, 5_188_181.0),
    "b": (576_696.0, 5_188_131.0),
    "c": (576_717.0, 5_188_147.0),
    "d": (576_726.0, 5_188_188.0),
    "e": (576_678.0, 5_188_147.0),
}
RADIUS, HEIGHT = 3.0, 1.5
CONE = np.pi * RADIUS**2 * HEIGHT / 3
PIT = -np.pi * RADIUS**2 * HEIGHT / 2


def cone(distance):
    return HEIGHT * np.clip(1 - distance / RADIUS, 0, None)


def pit(distance):
    return -HEIGHT * np.clip(1 - (distance / RADIUS) ** 2, 0, None)


def areas():
    features = []
    for name, (x, y) in PLACES.items():
        outline = circle(RADIUS + 0.6, x, y)
        geometry = shapely.geometry.mapping(outline)
        features.append({"type": "Feature", "properties": {"name": name}, "geometry": geometry})
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32615"}}
    return {"type": "FeatureCollection", "features": features, "crs": crs}


@pytest.fixture(scope="module")
def clouds(tmp_path_factory):
    """The cloud as it is, with cones, and with pits, at all places."""
    las = laspy.read(DEMO)
    xyz = np.column_stack([las.x, las.y, las.z])
    folder = tmp_path_factory.mktemp("beach")
    paths = {"as it is": write_las(folder / "before.las", xyz, crs="EPSG:32615")}
    for name, shape in (("cone", cone), ("pit", pit)):
        changed = xyz.copy()
        for x, y in PLACES.values():
            changed[:, 2] += shape(np.hypot(xyz[:, 0] - x, xyz[:, 1] - y))
        paths[name] = write_las(folder / f"{name}.las", changed, crs="EPSG:32615")
    return paths


@pytest.mark.parametrize("base", ["triangulate", "plane"])
def test_volumes_put_into_a_real_cloud_are_found(clouds, base):
    found = {
        name: {r.name: r for r in measure(path, area=areas(), base=base, grid=True).results}
        for name, path in clouds.items()
    }
    level = []
    for place in PLACES:
        ground = found["as it is"][place].volume_m3
        for shape, truth in (("cone", CONE), ("pit", PIT)):
            result = found[shape][place]
            assert result.volume_m3 - ground == pytest.approx(truth, rel=0.01), (place, shape)
            # The ground itself is no plane: it has a volume above its rim before anything is done.
            assert abs(result.volume_m3 - truth) < 1.96 * result.std_m3 + 1.05 * abs(ground)
            if abs(ground) < 0.007 * abs(truth):
                level.append((place, shape))
                assert result.volume_m3 == pytest.approx(truth, rel=0.01), (place, shape)
            assert result.coverage > 0.95
    assert base != "plane" or len(level) >= 6
