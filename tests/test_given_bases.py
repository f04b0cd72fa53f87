"""Bases that are given: designs, floor points, elevations of corners. Against closed forms."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS, Transformer
from scipy.spatial import Delaunay

import quantify_client
from quantify_client.cli import main
from quantify_client.errors import CrsError, DesignError, QuantifyError, UsageError
from quantify_client.types import AreaFailure, Window
from quantify_client.volcalc.terrain.given_base import GivenBase, scatter_of, through_points
from quantify_client.volcalc.terrain.grid import CellWindow

EAST, NORTH = 412_000.0, 5_204_000.0


def ground(x, y):
    return 300.0 + 0.06 * x - 0.04 * y


def tent(x, y):
    """A roof over the ground: 2 m above it at x = 0, on it at 5 m, 2 m below it at 10 m."""
    return ground(x, y) + 2.0 - 0.4 * abs(x)


#: Between x, y = -10 and 10 the ground lies below the roof by 200 m3 and above it by 200 m3.
CUT = FILL = 200.0
CORNERS = [(x, y) for x in (-20.0, 0.0, 20.0) for y in (-20.0, 0.0, 20.0)]
FACES = [
    face
    for a in (0, 1, 3, 4)
    for face in ((a, a + 3, a + 4), (a, a + 4, a + 1))
]  # fmt: skip


def square(half, z=None):
    ring = [(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)]
    heights = [[]] * 5 if z is None else [[float(z(x, y))] for x, y in ring]
    return [[EAST + x, NORTH + y, *height] for (x, y), height in zip(ring, heights)]


def areas(*rings, crs="EPSG:32632"):
    features = [
        {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [ring]}}
        for ring in rings
    ]
    found = {"type": "FeatureCollection", "features": features}
    return {**found, "crs": {"type": "name", "properties": {"name": crs}}} if crs else found


def landxml(path, z=tent, to=None, unit="meter", factor=1.0, epsg=None):
    x, y = (np.array(side) for side in zip(*CORNERS))
    east, north, up = x + EAST, y + NORTH, z(x, y)
    if to is not None:
        east, north = Transformer.from_crs("EPSG:32632", to, always_xy=True).transform(east, north)
    rows = "".join(
        f'<P id="{i}">{n!r} {e!r} {h!r}</P>'
        for i, (e, n, h) in enumerate(
            np.column_stack([east, north, up]).__truediv__(factor).tolist()
        )
    )
    faces = "".join(f"<F>{' '.join(map(str, face))}</F>" for face in FACES)
    system = f'<CoordinateSystem epsgCode="{epsg}"/>' if epsg else ""
    units = f'<Units><Metric linearUnit="{unit}"/></Units>'
    path.write_text(
        f'<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">{units}{system}'
        f'<Surfaces><Surface name="roof"><Definition surfType="TIN"><Pnts>{rows}</Pnts>'
        f"<Faces>{faces}</Faces></Definition></Surface></Surfaces></LandXML>"
    )
    return str(path)


def cloud_at(path, z=ground, half=28.0, count=60_000, noise=0.01, crs="EPSG:32632", seed=5):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-half, half, (2, count))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [1e-4] * 3, [EAST, NORTH, 0.0]
    if crs:
        header.add_crs(CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y = x + EAST, y + NORTH
    las.z = z(x, y) + noise * rng.standard_normal(count)
    las.write(str(path))
    return str(path)


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    # The line where cut turns into fill is found to a fraction of a cell.
    return cloud_at(tmp_path_factory.mktemp("ground") / "ground.laz", count=400_000)


def cone(x, y):
    return ground(x, y) + np.clip(4.0 - 0.4 * np.hypot(x, y), 0.0, None)


CONE = math.pi * 10.0**2 * 4.0 / 3.0


@pytest.fixture(scope="module")
def pile(tmp_path_factory):
    return cloud_at(tmp_path_factory.mktemp("pile") / "pile.laz", cone)


def the_only(found):
    (result,) = found.results
    assert not isinstance(result, AreaFailure), result.error
    return result


def is_right(found, within=1e-3):
    result, factor = the_only(found), found.grid_scale_factor or 1.0
    assert result.cut_m3 * factor**2 == pytest.approx(CUT, rel=within)
    assert result.fill_m3 * factor**2 == pytest.approx(FILL, rel=within)
    low, high = result.interval95_m3
    assert low < 0.0 < high
    return result


# --- design surfaces


def test_a_landxml_design_gives_cut_and_fill_of_the_closed_form(cloud, tmp_path):
    path = landxml(tmp_path / "roof.xml")
    found = quantify_client.measure(cloud, area=areas(square(10.0)), base=path)
    result = is_right(found)
    assert result.base == "roof.xml"
    assert {item.source: item.std_m3 for item in result.budget}["base"] == 0.0
    assert found.provenance["input"][-1]["path"] == path
    (check,) = result.checks
    assert abs(check.volume_m3 - result.volume_m3) <= check.margin_m3
    assert [notice.code for notice in found.warnings] == ["base-crs-assumed"]


def test_a_dxf_design_gives_the_same(cloud, tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new(units=6)
    corners = [(EAST + x, NORTH + y, tent(x, y)) for x, y in CORNERS]
    for face in FACES:
        drawing.modelspace().add_3dface([corners[i] for i in face])
    drawing.saveas(tmp_path / "roof.dxf")
    is_right(quantify_client.measure(cloud, area=areas(square(10.0)), base=tmp_path / "roof.dxf"))


@pytest.mark.one_python
def test_a_geotiff_design_gives_the_same_where_it_is_left_as_it_is(cloud, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    cell, half = 0.08, 22.0
    side = np.arange(-half + cell / 2, half, cell)
    x, y = np.meshgrid(side, side[::-1])
    about = {"driver": "GTiff", "width": x.shape[1], "height": x.shape[0], "count": 1}
    about |= {"dtype": "float64", "crs": "EPSG:32632"}
    about["transform"] = rasterio.transform.from_origin(EAST - half, NORTH + half, cell, cell)
    with rasterio.open(tmp_path / "roof.tif", "w", **about) as raster:
        raster.write(tent(x, y), 1)
    found = quantify_client.measure(
        cloud, area=areas(square(10.0)), base=str(tmp_path / "roof.tif"), align=False
    )
    result, factor = the_only(found), found.grid_scale_factor
    assert result.cut_m3 * factor**2 == pytest.approx(CUT, rel=1e-3)
    assert result.fill_m3 * factor**2 == pytest.approx(FILL, rel=1e-3)


def test_a_design_in_another_zone_and_one_in_feet_lie_on_the_cloud(cloud, tmp_path):
    zone = landxml(tmp_path / "zone.xml", to="EPSG:32633", epsg=32633)
    is_right(quantify_client.measure(cloud, area=areas(square(10.0)), base=zone))
    feet = landxml(tmp_path / "feet.xml", unit="foot", factor=0.3048)
    is_right(quantify_client.measure(cloud, area=areas(square(10.0)), base=feet))


def test_a_unit_that_puts_a_design_elsewhere_is_not_believed(cloud, tmp_path):
    path = landxml(tmp_path / "roof.xml", unit="millimeter")
    found = quantify_client.measure(cloud, area=areas(square(10.0)), base=path)
    is_right(found)
    assert "base-unit-contradicted" in [notice.code for notice in found.warnings]


@pytest.mark.one_python
def test_without_areas_all_that_lies_over_the_design_is_measured(cloud, tmp_path):
    path = landxml(tmp_path / "roof.xml")
    result = the_only(quantify_client.measure(cloud, base=path))
    assert result.area_m2 == pytest.approx(1600.0, rel=2e-3)
    # From x = 5 to 20 on both sides: 15 m x 6 m / 2.
    assert result.cut_m3 == pytest.approx(2 * 45.0 * 40.0, rel=3e-3)


@pytest.mark.one_python
def test_a_design_around_which_the_ground_lies_off_is_told(cloud, tmp_path):
    path = landxml(tmp_path / "low.xml", z=lambda x, y: ground(x, y) - 0.5)
    result = the_only(quantify_client.measure(cloud, area=areas(square(6.0)), base=path))
    (notice,) = [one for one in result.warnings if one.code == "base-off-ground"]
    assert notice.values["off_m"] == pytest.approx(0.5, abs=0.01)
    assert "above" in notice
    path = landxml(tmp_path / "flush.xml", z=ground)
    result = the_only(quantify_client.measure(cloud, area=areas(square(6.0)), base=path))
    assert "base-off-ground" not in [one.code for one in result.warnings]


@pytest.mark.parametrize(
    ("options", "kind", "said"),
    [
        (
            {"area": areas(square(22.0))},
            AreaFailure,
            "roof.xml covers 82.6% of the area; expected",
        ),
        ({"shape": "object"}, UsageError, "goes with terrain"),
        ({"gcp": "control.yaml"}, UsageError, "does not go with --gcp"),
    ],
)
def test_what_a_design_cannot_be_the_base_of_is_one_line(cloud, tmp_path, options, kind, said):
    path = landxml(tmp_path / "roof.xml")
    if kind is AreaFailure:
        (failed,) = quantify_client.measure(cloud, base=path, **options).results
        assert said in failed.error
        return
    with pytest.raises(kind, match=said) as caught:
        quantify_client.measure(cloud, base=path, **options)
    assert "\n" not in str(caught.value)


def test_a_design_elsewhere_is_refused_with_both_places(cloud, tmp_path):
    path = landxml(tmp_path / "far.xml", to="EPSG:32633")
    with pytest.raises(DesignError, match=r"far.xml lies outside the cloud: it covers x -44214"):
        quantify_client.measure(cloud, base=path)


@pytest.mark.one_python
def test_a_raster_with_a_crs_is_no_base_of_a_cloud_without_one(tmp_path):
    bare = cloud_at(tmp_path / "bare.laz", crs=None)
    area, raster = areas(square(9.0), crs=None), tiff(tmp_path)
    with pytest.raises(CrsError, match="no CRS"):
        quantify_client.measure(bare, area=area, source_unit="m", base=raster)


def tiff(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    about = {"driver": "GTiff", "width": 50, "height": 50, "count": 1, "dtype": "float32"}
    about |= {"crs": "EPSG:32632"}
    about["transform"] = rasterio.transform.from_origin(EAST - 25, NORTH + 25, 1, 1)
    with rasterio.open(tmp_path / "dem.tif", "w", **about) as raster:
        raster.write(np.full((50, 50), 300.0, dtype=np.float32), 1)
    return str(tmp_path / "dem.tif")


# --- floor points


def floor_file(path, noise=0.0, step=5.0, half=25.0, seed=3):
    side = np.arange(-half, half + 1e-9, step)
    x, y = (v.ravel() for v in np.meshgrid(side, side))
    z = ground(x, y) + noise * np.random.default_rng(seed).standard_normal(x.size)
    table = np.column_stack([x + EAST, y + NORTH, z])
    np.savetxt(path, table, delimiter=",", header="x,y,z", comments="", fmt="%.5f")
    return str(path)


def test_a_pile_on_floor_points_is_that_of_the_closed_form(pile, tmp_path):
    path = floor_file(tmp_path / "floor.csv")
    found = quantify_client.measure(pile, area=areas(square(12.0)), base_points=path)
    result = the_only(found)
    assert result.base == "floor.csv"
    assert result.volume_m3 * found.grid_scale_factor**2 == pytest.approx(CONE, rel=2e-3)
    assert {item.source: item.std_m3 for item in result.budget}["base"] < 0.05
    assert found.provenance["input"][-1]["path"] == path


@pytest.mark.one_python
def test_errors_of_floor_points_are_in_the_interval(pile, tmp_path):
    scores = []
    for seed in range(12):
        path = floor_file(tmp_path / f"floor{seed}.csv", noise=0.05, seed=seed)
        found = quantify_client.measure(pile, area=areas(square(12.0)), base_points=path)
        result = the_only(found)
        scores.append((result.volume_m3 * found.grid_scale_factor**2 - CONE) / result.std_m3)
    assert 0.5 < math.sqrt(np.mean(np.square(scores))) < 1.5


def test_floor_points_that_span_no_area_and_too_few_are_refused(pile, tmp_path):
    line = tmp_path / "line.csv"
    line.write_text("x,y,z\n" + "".join(f"{EAST + i},{NORTH + i},300\n" for i in range(5)))
    with pytest.raises(QuantifyError, match=r"line.csv holds 5 points that span no area"):
        quantify_client.measure(pile, area=areas(square(9.0)), base_points=str(line))
    with pytest.raises(UsageError, match="exclude each other"):
        quantify_client.measure(pile, base="plane", base_points=str(line))


@given(st.floats(0.001, 2.0), st.integers(0, 1000))
def test_the_scatter_of_points_about_a_plane_is_their_noise_and_a_sixth(noise, seed):
    """A point is off the plane through six neighbours by noise x sqrt(1 + 1 / 6)."""
    rng = np.random.default_rng(seed)
    x, y = (v.ravel() for v in np.meshgrid(np.arange(20.0), np.arange(20.0)))
    x = x + np.repeat(np.arange(20) % 2, 20) * 0.5
    z = ground(x, y) + noise * rng.standard_normal(x.size)
    points = np.column_stack([x + EAST, y + NORTH, z])
    triangles = Delaunay(points[:, :2] - points[:, :2].mean(axis=0)).simplices
    assert scatter_of(points, triangles) == pytest.approx(noise * math.sqrt(7 / 6), rel=0.25)


def test_of_four_corners_the_scatter_is_that_about_a_plane():
    points = np.array([(0, 0, 0.1), (9, 0, -0.1), (9, 9, 0.1), (0, 9, -0.1)])
    points += np.array([EAST, NORTH, 0.0])
    # sqrt(4 x 0.01 / 1), times Student's t of one degree of freedom at 97.5 % over 1.96
    assert through_points("floor", points).std == pytest.approx(0.2 * 12.7062 / 1.96, rel=1e-4)
    assert through_points("floor", points[:3]).std == 0.0


# --- elevations of corners


def test_elevations_of_corners_are_the_base(pile):
    found = quantify_client.measure(pile, area=areas(square(12.0, ground)), base="vertices")
    result = the_only(found)
    assert result.base == "vertices"
    assert result.volume_m3 * found.grid_scale_factor**2 == pytest.approx(CONE, rel=2e-3)
    higher = square(12.0, lambda x, y: ground(x, y) + 0.2)
    above = the_only(quantify_client.measure(pile, area=areas(higher), base="vertices"))
    lower_by = (result.volume_m3 - above.volume_m3) * found.grid_scale_factor**2
    assert lower_by == pytest.approx(0.2 * 24.0**2, rel=1e-3)
    # The ground around the outline tells that these elevations are not on it.
    assert above.std_m3 > 0.9 * 0.2 * 24.0**2 > 50 * result.std_m3


def test_elevations_of_a_kml_and_beside_longitudes_are_metres(pile, tmp_path):
    move = Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True).transform
    ring = [(*move(x, y), z) for x, y, z in square(12.0, ground)]
    places = " ".join(f"{x!r},{y!r},{z!r}" for x, y, z in ring)
    path = tmp_path / "area.kml"
    path.write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>a</name><Polygon>'
        f"<outerBoundaryIs><LinearRing><coordinates>{places}</coordinates></LinearRing>"
        "</outerBoundaryIs></Polygon></Placemark></kml>"
    )
    for area in (str(path), areas([list(place) for place in ring], crs=None)):
        found = quantify_client.measure(pile, area=area, base="vertices")
        volume = the_only(found).volume_m3 * found.grid_scale_factor**2
        assert volume == pytest.approx(CONE, rel=2e-3)


@pytest.mark.parametrize(
    ("ring", "said"),
    [
        (square(9.0), "have no elevations; expected x, y and z"),
        (square(9.0, lambda x, y: 0.0), "all have the elevation 0; expected x, y and z"),
    ],
)
def test_corners_without_elevations_are_refused(pile, ring, said):
    (failed,) = quantify_client.measure(pile, area=areas(ring), base="vertices").results
    assert said in failed.error


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, "goes with outlines"),
        ({"area": "auto"}, "goes with outlines"),
        ({"area": areas(square(9.0, ground)), "toe": "auto"}, "leave one out"),
    ],
)
def test_vertices_without_drawn_outlines_is_wrong_usage(pile, options, said):
    with pytest.raises(UsageError, match=said):
        quantify_client.measure(pile, base="vertices", **options)


# --- the surface itself


def test_a_surface_goes_on_beyond_its_edge_as_a_plane_and_no_further():
    x, y = (v.ravel() for v in np.meshgrid([0.0, 30.0], [0.0, 30.0]))
    points = np.column_stack([x + EAST, y + NORTH, ground(x, y)])
    base = GivenBase("pad", points, np.array([(0, 1, 3), (0, 3, 2)]))
    window = CellWindow.around(Window(EAST - 2, NORTH - 2, EAST + 32, NORTH + 32), 0.7, 1)
    everything = np.ones(window.shape, dtype=bool)
    u, v = (side.reshape(window.shape) for side in window.middles(everything))
    inside = (u > EAST) & (u < EAST + 30) & (v > NORTH) & (v < NORTH + 30)
    z = base.over(window, inside)
    near = (abs(u - EAST - 15) < 15 + 0.7) & (abs(v - NORTH - 15) < 15 + 0.7)
    assert np.abs(z - ground(u - EAST, v - NORTH))[near].max() < 1e-6
    assert np.isnan(z[0, 0])
    assert base.footprint().area == pytest.approx(900.0)


def test_the_command_takes_a_design_and_floor_points(pile, tmp_path, capsys):
    area = tmp_path / "area.geojson"
    area.write_text(json.dumps(areas(square(12.0))))
    given = SimpleNamespace(design=landxml(tmp_path / "d.xml", ground))
    assert main(["volume", pile, "--area", str(area), "--base", given.design, "--json"]) == 0
    first = json.loads(capsys.readouterr().out)["results"][0]
    floor = floor_file(tmp_path / "floor.csv")
    assert main(["volume", pile, "--area", str(area), "--base-points", floor, "--json"]) == 0
    second = json.loads(capsys.readouterr().out)["results"][0]
    assert first["volume_m3"] == pytest.approx(second["volume_m3"], rel=1e-3)
    assert main(["volume", pile, "--base", str(tmp_path / "none.xml")]) == 1
    assert capsys.readouterr().err.count("\n") == 1


# --- what is told of them


def holed(path):
    """The ground as a fine TIN, without its triangles over 2 m x 2 m in the middle."""
    side = np.linspace(-20.0, 20.0, 41)
    x, y = (v.ravel() for v in np.meshgrid(side, side))
    triangles = Delaunay(np.column_stack([x, y])).simplices
    middle = np.column_stack([x, y])[triangles].mean(axis=1)
    kept = triangles[(np.abs(middle) > 1.0).any(axis=1)]
    rows = "".join(
        f'<P id="{i}">{b + NORTH!r} {a + EAST!r} {ground(a, b)!r}</P>'
        for i, (a, b) in enumerate(zip(x.tolist(), y.tolist()))
    )
    faces = "".join(f"<F>{' '.join(map(str, face))}</F>" for face in kept.tolist())
    path.write_text(
        '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2"><Surfaces>'
        f'<Surface name="a"><Definition surfType="TIN"><Pnts>{rows}</Pnts><Faces>{faces}</Faces>'
        "</Definition></Surface></Surfaces></LandXML>"
    )
    return str(path)


def codes(result):
    return [notice.code for notice in result.warnings]


def test_holes_of_a_design_are_told_with_their_area_or_refused(pile, tmp_path):
    path = holed(tmp_path / "holed.xml")
    small, large = quantify_client.measure(
        pile, area=areas(square(4.0), square(15.0)), base=path
    ).results
    assert "holed.xml covers 93.8% of the area" in small.error  # 4 of 64 m2
    (notice,) = [one for one in large.warnings if one.code == "base-extrapolated"]
    assert notice.values["area_m2"] == pytest.approx(4.0, rel=1e-3)


@pytest.mark.one_python
@pytest.mark.parametrize("count", [4, 6, 9])
def test_few_floor_points_have_wide_intervals(tmp_path, count):
    # The floor points alone make these intervals: a third of the pile's points says as much.
    pile = cloud_at(tmp_path / "pile.laz", cone, count=8_000)
    inside = 0
    for seed in range(20):
        rng = np.random.default_rng([seed, count])
        angle = 2 * np.pi * (np.arange(count) + 0.3 * rng.random()) / count
        x, y = 22.0 * np.cos(angle), 22.0 * np.sin(angle)
        z = ground(x, y) + 0.05 * rng.standard_normal(count)
        table = np.column_stack([x + EAST, y + NORTH, z])
        np.savetxt(tmp_path / "f.csv", table, delimiter=",", header="x,y,z", comments="")
        found = quantify_client.measure(
            pile, area=areas(square(10.5)), base_points=str(tmp_path / "f.csv"), grid=True
        )
        low, high = the_only(found).interval95_m3
        inside += low < CONE < high
    assert inside >= 16  # of 20; 95 % of them hold 16 or more in 997 of 1000


@pytest.mark.one_python
def test_blunders_doubles_and_losses_of_floor_points_are_told(pile, tmp_path):
    table = np.loadtxt(floor_file(tmp_path / "floor.csv", noise=0.01), delimiter=",", skiprows=1)
    area = areas(square(12.0))

    def told(rows):
        np.savetxt(tmp_path / "f.csv", rows, delimiter=",", header="x,y,z", comments="")
        found = quantify_client.measure(pile, area=area, base_points=str(tmp_path / "f.csv"))
        return {notice.code: notice for notice in found.warnings}

    assert not {*told(table)} & {"base-points-far-off", "base-points-doubled"}
    wrong = table.copy()
    wrong[60, 2] += 5.0
    assert told(wrong)["base-points-far-off"].values["off_m"] == pytest.approx(5.0, abs=0.05)
    again = np.vstack([table, table[:7] + np.array([0.0, 0.0, 0.3])])
    assert "7 places have several heights, up to 0.3 m apart" in told(again)["base-points-doubled"]
    assert told(np.vstack([table, [[EAST, NORTH, -9999.0]]]))["base-points-left-out"]


def test_floor_points_on_one_line_up_to_rounding_are_refused(pile, tmp_path):
    rows = [[EAST + 3.3 * i, NORTH + 1.7 * i, 300.0] for i in range(-9, 9)]
    np.savetxt(tmp_path / "line.csv", rows, delimiter=",", header="x,y,z", comments="")
    with pytest.raises(QuantifyError, match="holds 18 points that span no area"):
        quantify_client.measure(
            pile, area=areas(square(9.0)), base_points=str(tmp_path / "line.csv")
        )


@pytest.mark.one_python
def test_elevations_off_the_ground_and_corners_without_are_told(pile):
    ring = square(12.0, ground)
    ring[2] = ring[2][:2]
    found = the_only(quantify_client.measure(pile, area=areas(ring), base="vertices"))
    assert "corners-without-elevation" in codes(found)
    for wrong in (square(12.0, lambda x, y: ground(x, y) * 3.28), square(12.0, ground)):
        if wrong[1][2] < 400.0:
            wrong[1][2] = 0.0
        result = the_only(quantify_client.measure(pile, area=areas(wrong), base="vertices"))
        assert "base-off-ground" in codes(result)
    right = the_only(
        quantify_client.measure(pile, area=areas(square(12.0, ground)), base="vertices")
    )
    assert not {"base-off-ground", "corners-without-elevation"} & {*codes(right)}


def test_elevations_are_in_the_unit_of_the_outline(pile):
    """New York Central in US feet, beside a cloud in metres."""
    move = Transformer.from_crs("EPSG:32632", "EPSG:32633", always_xy=True).transform
    local = "+proj=utm +zone=33 +datum=WGS84 +units=us-ft +no_defs"
    us = 3937 / 1200
    ring = [[v * us for v in (*move(x, y), z)] for x, y, z in square(12.0, ground)]
    found = quantify_client.measure(pile, area=areas(ring, crs=local), base="vertices", grid=True)
    assert the_only(found).volume_m3 == pytest.approx(CONE, rel=2e-3)


@pytest.mark.parametrize("mode", ["relativeToGround", "clampToGround"])
def test_heights_of_a_kml_above_the_ground_are_no_elevations(pile, tmp_path, mode):
    move = Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True).transform
    places = " ".join("{!r},{!r},1".format(*move(x, y)) for x, y in square(9.0))
    path = tmp_path / "area.kml"
    path.write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><Polygon>'
        f"<altitudeMode>{mode}</altitudeMode><outerBoundaryIs><LinearRing><coordinates>{places}"
        "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
    )
    (failed,) = quantify_client.measure(pile, area=str(path), base="vertices").results
    assert "have no elevations" in failed.error


def test_a_design_and_floor_points_exclude_each_other(cloud, tmp_path):
    path = landxml(tmp_path / "roof.xml")
    with pytest.raises(UsageError, match="exclude each other"):
        quantify_client.measure(cloud, base=path, base_points="floor.csv")
    with pytest.raises(DesignError, match="none.xml: does not exist; check the path"):
        quantify_client.measure(cloud, base="none.xml")


@pytest.mark.parametrize(
    "code",
    [
        "urn:ogc:def:crs:EPSG::32632",
        *(pytest.param(c, marks=pytest.mark.one_python) for c in ("EPSG:32632+5703", "32632")),
    ],
)
def test_codes_of_a_landxml_are_read_however_they_are_spelled(cloud, tmp_path, code):
    path = landxml(tmp_path / "roof.xml", epsg=code)
    found = quantify_client.measure(cloud, area=areas(square(10.0)), base=path)
    is_right(found)
    assert "base-crs-assumed" not in [notice.code for notice in found.warnings]


def test_a_code_that_is_none_is_told_with_the_file(cloud, tmp_path):
    path = landxml(tmp_path / "roof.xml", epsg="banana")
    with pytest.raises(CrsError, match=r"^roof.xml: .*banana"):
        quantify_client.measure(cloud, area=areas(square(10.0)), base=path)


@pytest.mark.one_python
def test_feet_of_a_landxml_beside_a_crs_in_metres_are_its_coordinates(cloud, tmp_path):
    path = landxml(tmp_path / "feet.xml", unit="foot", factor=0.3048, epsg=32632)
    is_right(quantify_client.measure(cloud, area=areas(square(10.0)), base=path))


def test_floor_points_and_control_are_refused_before_anything_is_read():
    with pytest.raises(UsageError, match="--base-points does not go with --gcp yet"):
        quantify_client.measure("missing.laz", base_points="floor.csv", gcp="missing.yml")
