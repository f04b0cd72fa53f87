"""measure() and describe() as a library, and what the order of the stages has to get right."""

from __future__ import annotations

import dataclasses
import json
import threading

import numpy as np
import pytest
import shapely
from clouds import write_copc, write_las, write_ply
from commands import PILE, UTM
from terrains import LEVEL, Errors, circle, placed, survey

import quantify_client
from quantify_client import AreaFailure, describe, measure, to_json
from quantify_client.errors import CloudError, SupportError, UsageError
from quantify_client.pipeline.streaming import thread_count
from quantify_client.volcalc.terrain.integrate import above_mask

POINTS = np.round(survey(PILE.height, Errors(0.01, 0.0), 30_000), 3)


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    return write_las(tmp_path_factory.mktemp("pipeline") / "pile.laz", POINTS, crs=UTM)


def only(measurement):
    (result,) = measurement.results
    return result


# --- the library


def test_public_names_are_there():
    for name in quantify_client.__all__:
        assert getattr(quantify_client, name) is not None


def test_area_may_be_a_shapely_polygon_or_a_mapping(cloud):
    drawn = only(measure(cloud, area=PILE.area, grid=True))
    outline = {"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": {"name": "p"}, "geometry": shapely.geometry.mapping(
            PILE.area)}]}  # fmt: skip
    given = only(measure(cloud, area=outline, grid=True))
    assert (drawn.name, given.name) == ("area-1", "p")
    assert given.volume_m3 == drawn.volume_m3 == pytest.approx(PILE.volume, rel=0.01)


def test_provenance_tells_what_decided(cloud):
    told = measure(cloud, area=PILE.area, base="plane", threads=1).provenance
    assert told["options"]["area"] == "given as an object"
    assert told["options"]["base"] == "plane"
    assert told["input"][0]["path"] == str(cloud)
    assert told["seconds"] > 0


def test_progress_rises_from_stage_to_stage(cloud):
    seen = {}
    lock = threading.Lock()

    def progress(stage, share):
        with lock:
            seen.setdefault(stage, []).append(share)

    measure(cloud, area=PILE.area, progress=progress)
    assert list(seen) == ["reading points", "measuring areas"]
    for shares in seen.values():
        assert shares == sorted(shares)
        assert shares[-1] == 1.0


def test_an_unknown_option_is_a_type_error(cloud):
    with pytest.raises(TypeError, match="bse"):
        measure(cloud, bse="plane")


@pytest.mark.parametrize(
    "wrong",
    [
        {"slices": "many"},
        {"slices": 2.5},
        {"slices": 0},
        {"threads": -1},
        {"density": 1.0, "density_sigma": -0.1},
        {"base": float("nan")},
        {"shape": "blob"},
        {"method": "hull"},
        {"max_gap": -1.0},
        {"floor": "cellar"},
    ],
)
def test_options_out_of_range_are_refused_before_the_cloud_is_opened(wrong, tmp_path, cloud):
    with pytest.raises(UsageError):
        measure(cloud, **wrong)
    if "shape" not in wrong:  # which the source helps to decide
        with pytest.raises(UsageError):
            measure(tmp_path / "gone.laz", **wrong)


def test_a_failed_area_is_a_value(cloud):
    measurement = measure(cloud, area=placed(circle(3, 500, 500)))
    assert not measurement.complete
    assert isinstance(only(measurement), AreaFailure)
    assert measurement.grid_scale_factor is None


def test_threads_default_to_the_processor_s():
    assert thread_count(7) == 7
    assert 1 <= thread_count(0) <= 4


def test_measurement_survives_json(cloud):
    measurement = measure(cloud, area=PILE.area)
    told = json.loads(json.dumps(to_json(measurement), allow_nan=False))
    assert told["results"][0]["volume_m3"] == pytest.approx(only(measurement).volume_m3, rel=1e-14)
    assert dataclasses.is_dataclass(only(measurement))


def test_describe_an_empty_file_s_neighbour(tmp_path):
    told = describe(write_ply(tmp_path / "p.ply", POINTS[:1000]), source_unit="ft")
    assert (told["points"], told["crs"], told["length_unit"]) == (1000, None, "m")
    assert told["bounds"]["min_x"] == pytest.approx(POINTS[:1000, 0].min() * 0.3048)


# --- the site


@pytest.mark.parametrize(
    "where",
    [
        *[pytest.param(p, marks=pytest.mark.one_python) for p in [(1e6, 0, 0), (-1e6, 1e6, 0)]],
        *[pytest.param((0, 0, 1e6), marks=pytest.mark.one_python), (3e5, 2e5, -1e5)],
    ],
)
def test_one_stray_point_changes_nothing(where, cloud, tmp_path):
    """A point a thousand kilometres away must decide neither the cells nor the grid's scale."""
    stray = np.vstack([POINTS, POINTS[:1] + where])
    path = write_las(tmp_path / "stray.laz", stray, crs=UTM)
    for area in (PILE.area, None):
        clean, dirty = measure(cloud, area=area), measure(path, area=area)
        assert only(dirty).volume_m3 == pytest.approx(only(clean).volume_m3, rel=2e-3)
        assert only(dirty).coverage == pytest.approx(only(clean).coverage, abs=0.02)
        assert dirty.grid_scale_factor == pytest.approx(clean.grid_scale_factor, rel=1e-7)
        if where[:2] != (0, 0):
            far = "1 point lies far from nearly all others"
            assert any(far in warning for warning in dirty.warnings) == (area is None)


def test_a_stray_that_an_index_never_shows_is_counted_too(tmp_path):
    path = write_copc(tmp_path / "a.copc.laz", np.vstack([POINTS, POINTS[:1] + (1e6, 0, 0)]))
    (said,) = [w for w in measure(path, shape="terrain").warnings if "far from nearly" in w]
    assert said.startswith("1 point lies")


def test_noise_and_withheld_points_are_counted(tmp_path):
    classes = np.zeros(len(POINTS), dtype=np.uint8)
    classes[:300] = 7
    withheld = np.zeros(len(POINTS), dtype=np.uint8)
    withheld[1000:1020] = 1
    path = write_las(tmp_path / "c.laz", POINTS, classes=classes, withheld=withheld, crs=UTM)
    result = only(measure(path, area=PILE.area))
    assert result.points_left_out == {"noise class": 300, "withheld": 20}
    with pytest.raises(CloudError, match="noise or withheld"):
        measure(write_las(tmp_path / "n.laz", POINTS, classes=np.full(len(POINTS), 18), crs=UTM))


def test_whole_cloud_is_measured_without_an_area(cloud):
    result = only(measure(cloud, grid=True, base=LEVEL))
    assert result.name == "pile"
    # The cells along the edge are left out.
    assert result.area_m2 == pytest.approx((40 - 2 * result.cell_m) ** 2, rel=0.01)
    assert result.volume_m3 == pytest.approx(PILE.volume, rel=0.01)


def test_a_cloud_of_scattered_points_is_refused(tmp_path):
    scattered = POINTS[:6] * [1, 1, 0] + np.arange(6)[:, None] * [[300, 200, 1]]
    path = write_las(tmp_path / "s.laz", scattered, crs=UTM)
    with pytest.raises(SupportError, match="draw an area"):
        measure(path)


def test_grid_factor_is_that_of_the_area(tmp_path):
    """Two sites 200 km apart in one file: k differs by 0.0005 between them."""
    far = POINTS + np.array([200_000, 0, 0])
    path = write_las(tmp_path / "two.laz", np.vstack([POINTS, far]), crs=UTM)
    here = measure(path, area=PILE.area).grid_scale_factor
    there = measure(path, area=shapely.affinity.translate(PILE.area, 200_000))
    assert here == pytest.approx(0.999584, abs=2e-6)
    assert there.grid_scale_factor == pytest.approx(
        here + 0.9996 * 0.5 * (200 / 6378) ** 2, abs=3e-6
    )
    assert only(there).name == "area-1"


# --- cut and fill are never negative


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("tilt", [-0.01, 0.0, 0.01])
def test_cut_and_fill_are_not_negative_and_leave_net_alone(seed, tilt):
    rng = np.random.default_rng(seed)
    r = rng.normal(tilt, 0.01, (40, 40))
    r[10:20, 10:20] += 0.5 * rng.integers(-1, 2)
    a = np.full(r.shape, 0.25)
    above = above_mask(r, a, np.full(r.shape, 0.01))
    cut, fill = (a * r)[above].sum(), -(a * r)[~above].sum()
    assert cut >= 0
    assert fill >= 0
    assert cut - fill == pytest.approx((a * r).sum(), rel=1e-9)
    mirrored = above_mask(-r, a, np.full(r.shape, 0.01))
    assert np.array_equal(mirrored, ~above)
