"""What an outline may cost: bounded by the cloud it lies on, wherever its corners are."""

import importlib
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import shapely
from bounded import measured
from clouds import write_las
from drawn import collection, feature

from quantify_client.crs import geometry_to_wgs84, measuring_frame
from quantify_client.volcalc.terrain.rim import interpolation_along

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

X, Y = 576_700.0, 5_188_140.0
WIDE = 100.0
CONE = np.pi * 20**2 * 3 / 3


def site(count=40_000, seed=1):
    """Points of level ground with a cone on it, 100 m x 100 m."""
    generator = np.random.default_rng(seed)
    x, y = generator.uniform(0, WIDE, (2, count))
    z = 10 + 3 * np.clip(1 - np.hypot(x - 50, y - 50) / 20, 0, None)
    return np.column_stack([x + X, y + Y, z])


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    path = tmp_path_factory.mktemp("site") / "site.las"
    return write_las(path, site(), 6, "1.4", crs="EPSG:32615")


def ring(count=40, radius=30.0):
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return [[X + 50 + radius * np.cos(a), Y + 50 + radius * np.sin(a)] for a in turn]


def spiked(east, north, count=1000):
    """A round outline with one bad corner."""
    corners = ring(count)
    corners[count // 8] = [X + 50 + east, Y + 50 + north]
    return corners


def needle(east, north, width):
    """A round outline with a needle: out, and back beside it."""
    corners = ring(1000)
    foot = corners[125]
    corners[125:126] = [foot, [X + 50 + east, Y + 50 + north], [foot[0], foot[1] + width]]
    return corners


def areas(*rings, crs="EPSG:32615"):
    crs = {"type": "name", "properties": {"name": crs}}
    polygons = [{"type": "Polygon", "coordinates": [[*r, r[0]]]} for r in rings]
    return collection(*map(feature, polygons), crs=crs)


# --- a corner far away


SPIKED = [
    spiked(1e5, 3e4),
    spiked(1e5, 1e5, count=40),
    spiked(1e3, 0),
    spiked(5e6, 5e6, count=8),
    spiked(9e9, 9e9),
    needle(1e5, 0, 0.001),
    needle(1e5, 1e5, 1e-6),
    needle(1e3, 300, 0.001),
]


def test_outline_with_a_corner_far_away_is_refused_with_that_corner(cloud):
    told = measured(cloud, area=areas(*SPIKED))
    assert told.error is None
    assert len(told.results) == len(SPIKED)
    for outline, result in zip(SPIKED, told.results):
        far = outline[int(np.argmax(np.abs(np.array(outline) - [X, Y]).max(axis=1)))]
        assert f"(at {far[0]:.2f}, {far[1]:.2f})" in result["error"]
        assert "outside the cloud" in result["error"]
        assert "m wide; move that corner" in result["error"]


def plugin_checks(monkeypatch):
    """Give the plugin's checks, which need nothing of WebODM."""
    package = types.ModuleType("plugin_alone")
    root = Path(__file__).parents[1]
    package.__path__ = [str(root / "plugin"), str(root)]
    monkeypatch.setitem(sys.modules, "plugin_alone", package)
    return importlib.import_module("plugin_alone.files.inputs")


def test_spike_that_passes_the_plugins_check_is_refused(cloud, monkeypatch):
    frame = measuring_frame("EPSG:32615", None, None)
    drawn = geometry_to_wgs84(shapely.Polygon(ring(400)), frame)
    polygons = []
    for corner in ([0.0, 0.0], [-92.0, 46.9], [-91.99, 46.5], [87.0, -46.8]):
        corners = [list(c) for c in drawn.exterior.coords]
        away = np.hypot(*(np.array(corners[1:-1]) - corner).T)
        corners[1 + int(np.argmin(away))] = corner
        polygons.append({"type": "Polygon", "coordinates": [corners]})
    asked = plugin_checks(monkeypatch).checked_area(
        {"type": "GeometryCollection", "geometries": polygons}
    )
    results = measured(cloud, area=asked).results
    assert len(results) == len(polygons)
    for result in results:
        assert "outside the cloud" in result["error"] or "cannot be placed" in result["error"]


def test_an_outline_with_a_spike_does_not_spoil_its_neighbour(cloud):
    alone = measured(cloud, area=areas(ring())).only
    assert alone["volume_m3"] == pytest.approx(CONE, rel=0.01)
    good, bad = measured(cloud, area=areas(ring(), spiked(1e5, 3e4))).results
    assert good == alone
    assert "outside the cloud" in bad["error"]


def test_an_outline_that_reaches_a_little_beyond_the_cloud_is_measured(cloud):
    east = X + WIDE
    wide = [[X + 5, Y + 5], [east + 60, Y + 5], [east + 60, Y + 95], [X + 5, Y + 95]]
    told = measured(cloud, area=areas(wide)).only
    assert told["error"] is None
    assert told["volume_m3"] == pytest.approx(CONE, rel=0.02)
    wide[1][0] = wide[2][0] = east + 98
    assert "points support 4" in measured(cloud, area=areas(wide)).problem


def test_a_needle_within_the_cloud_costs_little_and_changes_little(cloud):
    told = measured(cloud, area=areas(needle(80, 30, 0.001), needle(45, 45, 1e-7)))
    for result in told.results:
        assert result["volume_m3"] == pytest.approx(CONE, rel=0.01)


# --- outlines that are wound, or of many parts


def test_an_outline_wound_within_its_cells_is_refused(cloud):
    turns = 50_000
    zigzag = [[X + 10 + 80 * i / turns, Y + 10 + 80 * (i % 2)] for i in range(turns)]
    problem = measured(cloud, area=areas([*zigzag, [X + 91, Y + 95], [X + 5, Y + 95]])).problem
    assert "simplify it" in problem


def test_a_comb_costs_no_more_than_its_small_area(cloud):
    teeth = [[X + 45 + 10 * i / 12_000, Y + 45 + 9 * (i % 2)] for i in range(12_000)]
    told = measured(cloud, area=areas([*teeth, [X + 56, Y + 56], [X + 44, Y + 56]]))
    assert "goes back and forth within" in told.problem
    assert "simplify it" in told.problem


def test_an_outline_in_steps_finer_than_the_cells_is_measured(cloud):
    corners = np.repeat(np.array(ring(4000)), 2, axis=0)
    steps = np.column_stack([corners[1:, 0], corners[:-1, 1]])
    told = measured(cloud, area=areas(steps.tolist())).only
    assert told["volume_m3"] == pytest.approx(CONE, rel=1e-2)


def test_an_outline_of_very_many_corners_is_measured(cloud):
    few, many = measured(cloud, area=areas(ring(4000), ring(130_000))).results
    assert many["volume_m3"] == pytest.approx(few["volume_m3"], rel=1e-3)


def test_a_part_off_the_cloud_costs_no_more_than_its_outline(cloud):
    far = [[x + 75, y] for x, y in ring(6000, 8.0)]
    near = ring(6000)
    area = {
        "type": "MultiPolygon",
        "coordinates": [[[*near, near[0]]], [[*far, far[0]]]],
    }
    told = measured(cloud, area=area).only
    assert told["volume_m3"] == pytest.approx(CONE, rel=0.02)


def test_a_ring_without_points_takes_the_mean_of_some_on_the_others():
    keep = np.arange(20_000) < 10_000
    matrix = interpolation_along(keep, (~keep).astype(np.int64))
    assert matrix.nnz < 100 * len(keep)
    heights = np.where(keep, np.linspace(3, 5, 20_000), 0.0)
    assert (matrix @ heights)[~keep] == pytest.approx(np.full(10_000, heights[keep].mean()), 0.02)


def test_a_long_thin_corridor_is_measured(tmp_path):
    generator = np.random.default_rng(2)
    along, across = generator.uniform(0, 2000, 400_000), generator.uniform(-15, 15, 400_000)
    bend = 30 * np.sin(along / 90)
    z = 10 + 0.01 * along + np.where(abs(across) < 5, 1.0, 0.0)
    xyz = np.column_stack([X + along, Y + bend + across, z])
    path = write_las(tmp_path / "road.las", xyz, 6, "1.4", crs="EPSG:32615")
    t = np.arange(0, 2000.1, 0.5)
    sides = [np.column_stack([X + t, Y + 30 * np.sin(t / 90) + off]) for off in (-10, 10)]
    outline = np.concatenate([sides[0], sides[1][::-1]]).tolist()
    told = measured(path, area=areas(outline)).only
    assert told["volume_m3"] == pytest.approx(2000 * 10, rel=0.02)
