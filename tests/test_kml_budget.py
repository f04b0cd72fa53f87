"""What a KML may cost: as much as the polygons that may be in it, whatever else is."""

import pytest
from bounded import measured
from clouds import write_las
from test_outline_budget import site

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

HEAD, TAIL = "<kml><Document><Placemark>", "</Placemark></Document></kml>"
RING = "<Polygon><outerBoundaryIs><LinearRing><coordinates>{}"
END = "</coordinates></LinearRing></outerBoundaryIs></Polygon>"
# Made in the test: each has some 50 MB, which every worker would hold from its start.
HOSTILE = {
    "positions": (
        lambda: HEAD + RING.format("1,1 " * 12_000_000) + END + TAIL,
        "1,000,000 vertices",
    ),
    "no commas": (lambda: HEAD + RING.format("1 " * 20_000_000) + END + TAIL, "1,000,000 vertices"),
    "placemarks": (lambda: f"<kml>{'<Placemark/>' * 3_000_000}</kml>", "10,000 placemarks"),
    "points": (
        lambda: f"{HEAD}<MultiGeometry>{'<Point/>' * 4_000_000}</MultiGeometry>{TAIL}",
        "1,000,000 points and lines",
    ),
    "attributes": (
        lambda: "<kml " + " ".join(f"a{n}=''" for n in range(2_100_000)) + "/>",
        "2,000,000 attributes",
    ),
    "depth": (lambda: "<kml>" + "<a>" * 12_000_000, "nested too deeply"),
}


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    path = tmp_path_factory.mktemp("site") / "site.las"
    return write_las(path, site(500), 6, "1.4", crs="EPSG:32615")


@pytest.mark.parametrize("kind", HOSTILE)
def test_kml_that_holds_more_than_polygons_is_refused_at_once(kind, cloud, tmp_path):
    made, said = HOSTILE[kind]
    path = tmp_path / "areas.kml"
    path.write_text(made())
    told = measured(cloud, area=str(path))
    assert said in told.problem
    assert told.peak_mb < 500  # a file of 100 MB is three times that of 36 MB
