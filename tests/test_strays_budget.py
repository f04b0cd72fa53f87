"""One point far from all others: told, and neither the memory nor the volume is its."""

import functools
import io
import struct

import numpy as np
import pytest
from bounded import measured as bounded
from clouds import write_las
from test_outline_budget import X, Y, areas, ring, site, spiked

from quantify_client import measure
from quantify_client.errors import CloudError

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

FAR = [3e2, 1e4, 1e6, 1e8, 9e9, 1e15, 1e18, 1e300]
OFF_THE_MAP = "coordinate beyond any map"
COUNT = 25_000


def written(path, xyz):
    np.savetxt(path, xyz, fmt="%.17g")
    return path


@functools.lru_cache(maxsize=2)
def text_of_site(count):
    out = io.StringIO()
    np.savetxt(out, site(count), fmt="%.17g")
    return out.getvalue()


def beside(path, *strays, count=COUNT):
    """Write the site's points and others."""
    rows = ["{:.17g} {:.17g} {:.17g}\n".format(*stray) for stray in strays]
    path.write_text(text_of_site(count) + "".join(rows))
    return path


def sphere(count=6000):
    directions = np.random.default_rng(1).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1)[:, None] + [100.0, 200.0, 50.0]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Give the volumes of the whole cloud and of an area, without any stray."""
    path = beside(tmp_path_factory.mktemp("plain") / "plain.xyz")
    whole = only(measure(path, shape="terrain"))
    area = only(measure(path, shape="terrain", area=outlines(ring())))
    return whole.volume_m3, area.volume_m3


def only(measurement):
    (result,) = measurement.results
    return result


def outlines(*rings):
    area = areas(*rings)
    del area["crs"]
    return area


@pytest.mark.parametrize("far", FAR)
def test_a_stray_changes_no_volume_of_a_whole_cloud(far, plain, tmp_path):
    east, north = [(1, 1), (-1, 0), (0, 1)][FAR.index(far) % 3]
    stray = [X + 50 + east * far, Y + 50 + north * far, 10.0]
    told = measure(beside(tmp_path / "far.xyz", stray), shape="terrain")
    assert only(told).volume_m3 == pytest.approx(plain[0], rel=2e-3)
    said = " ".join(told.warnings) + str(only(told).points_left_out)
    assert "1 point lies far from nearly all others" in said or OFF_THE_MAP in said


@pytest.mark.parametrize("far", FAR)
def test_a_stray_changes_no_volume_of_an_area(far, plain, tmp_path):
    stray = [X + 50 + far, Y + 50 - far, 10.0]
    path = beside(tmp_path / "far.xyz", stray)
    told = measure(path, shape="terrain", area=outlines(ring()))
    assert only(told).volume_m3 == pytest.approx(plain[1], rel=1e-3)
    assert (OFF_THE_MAP in only(told).points_left_out) == (far > 1e10)


@pytest.mark.parametrize("far", [-1e300, -1e9, 1e4, 1e15])
def test_a_stray_high_or_low_changes_no_volume(far, plain, tmp_path):
    path = beside(tmp_path / "far.xyz", [X + 50, Y + 50, far])
    told = measure(path, shape="terrain", area=outlines(ring()))
    assert only(told).volume_m3 == pytest.approx(plain[1], rel=1e-4)
    assert sum(only(told).points_left_out.values()) == 1


@pytest.mark.parametrize("far", FAR)
def test_a_stray_changes_no_volume_of_a_body(far, tmp_path):
    path = written(tmp_path / "far.xyz", [*sphere(), [100.0 + far, 200.0, 50.0 - far]])
    told = only(measure(path, shape="object"))
    assert told.volume_m3 == pytest.approx(4 / 3 * np.pi, rel=2e-3)
    assert sum(told.points_left_out.values()) == 1


@pytest.mark.parametrize("far", [1e5, 6e9])
def test_a_stray_does_not_spoil_a_small_cloud(far, tmp_path):
    alone = only(measure(beside(tmp_path / "a.xyz", count=500), shape="terrain")).volume_m3
    path = beside(tmp_path / "b.xyz", [far, far, 10.0], count=500)
    told = only(measure(path, shape="terrain"))
    assert told.volume_m3 == pytest.approx(alone, rel=0.1)


@pytest.mark.parametrize(("far", "east"), [(1e6, 3e5), (1e9, 3e5), (1e6, 4e3)])
def test_an_outline_to_a_stray_is_refused_and_its_neighbour_measure(far, east, plain, tmp_path):
    path = beside(tmp_path / "far.xyz", [far + 576_700, 5_188_140 + far, 10.0])
    area = outlines(spiked(east, east / 3), ring())
    bad, good = measure(path, shape="terrain", area=area).results
    assert "outside the cloud" in bad.error
    assert good.volume_m3 == pytest.approx(plain[1], rel=1e-4)


@pytest.mark.parametrize("top", [1e8, 1e12, 1e300, np.nan])
@pytest.mark.parametrize("drawn", [False, True])
def test_a_box_in_the_header_that_is_no_box_changes_no_volume(top, drawn, plain, tmp_path):
    path = write_las(tmp_path / "site.las", site(COUNT), 6, "1.4")
    data = bytearray(path.read_bytes())
    struct.pack_into("<6d", data, 179, top, -top, top, -top, top, -top)
    path.write_bytes(data)
    told = measure(path, shape="terrain", area=outlines(ring()) if drawn else None)
    assert only(told).volume_m3 == pytest.approx(plain[drawn], rel=3e-3)


def test_a_cloud_of_nothing_but_absurd_points_is_refused(tmp_path):
    path = written(tmp_path / "far.xyz", site(100) * 1e12)
    with pytest.raises(CloudError, match="beyond any map"):
        measure(path, shape="terrain")


@pytest.mark.parametrize("far", [9e9, 1e15])
def test_a_stray_along_one_axis_costs_little(far, tmp_path):
    stray = [far, 5_188_190.0, 10.0]
    path = beside(tmp_path / "far.xyz", stray)
    assert bounded(path, shape="terrain").only["error"] is None
