"""Change between two surveys, and a survey as the base of another: against closed forms."""

from __future__ import annotations

import json
import math
import shutil
import zipfile

import laspy
import numpy as np
import pytest
from pyproj import CRS, Transformer

import quantify_client
from quantify_client.errors import QuantifyError, UsageError
from quantify_client.types import AreaFailure, AreaResult

EAST, NORTH, LEVEL = 412_000.0, 5_204_000.0, 1_900.0

#: Middle, radius and height of what was added, or lost: h (1 - (d / r)^2) has the volume
#: pi r^2 h / 2.
GAINED, LOST = (-28.0, 22.0, 16.0, 2.5), (30.0, -18.0, 20.0, -3.5)
SHIFT, TILT = (0.4, -0.3, 0.1), (3e-4, -2e-4)


def ground(x, y):
    return LEVEL + 0.1 * x + 5 * np.sin(x / 19) * np.cos(y / 27) + np.sin(x / 6 + 1) * np.sin(y / 8)


def change_of(x, y):
    forms = (GAINED, LOST)
    return sum(
        h * np.clip(1 - ((x - a) ** 2 + (y - b) ** 2) / r**2, 0, None) for a, b, r, h in forms
    )


def volume_of(form):
    return math.pi * form[2] ** 2 * form[3] / 2


def survey(form, count=80_000, seed=0, noise=0.03, half=75.0):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-half, half, (2, count))
    return np.stack([x, y, form(x, y) + noise * rng.standard_normal(count)])


def displaced(points):
    x, y, z = points
    x, y = x + SHIFT[0], y + SHIFT[1]
    return np.stack([x, y, z + SHIFT[2] + TILT[0] * x + TILT[1] * y])


def write(path, points, crs="EPSG:32632", to=None):
    """Write points around the middle of the site, in UTM or where another CRS has them."""
    x, y, z = points[0] + EAST, points[1] + NORTH, points[2]
    if to is not None:
        x, y = Transformer.from_crs(crs, to, always_xy=True).transform(x, y)
    header = laspy.LasHeader(point_format=6, version="1.4")
    fine = 1e-9 if to is not None and CRS.from_user_input(to).is_geographic else 1e-3
    header.scales, header.offsets = [fine, fine, 1e-3], [x.min(), y.min(), 0.0]
    if crs is not None:
        header.add_crs(CRS.from_user_input(to or crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = x, y, z
    las.write(str(path))
    return path


def outline(form, room=2.0):
    angle = np.linspace(0, 2 * np.pi, 97)
    a, b, r, _ = form
    ring = np.column_stack(
        [EAST + a + (r + room) * np.cos(angle), NORTH + b + (r + room) * np.sin(angle)]
    )
    ring[-1] = ring[0]
    return ring.tolist()


def areas(*forms, crs="EPSG:32632", room=2.0):
    found = {"type": "FeatureCollection", "features": []}
    if crs:
        found["crs"] = {"type": "name", "properties": {"name": crs}}
    for number, form in enumerate(forms):
        shape = {"type": "Polygon", "coordinates": [outline(form, room)]}
        about = {"type": "Feature", "properties": {"name": f"form {number}"}, "geometry": shape}
        found["features"].append(about)
    return found


BOTH = areas(GAINED, LOST)


@pytest.fixture(scope="module")
def before(tmp_path_factory):
    return write(tmp_path_factory.mktemp("before") / "before.laz", survey(ground))


@pytest.fixture(scope="module")
def moved():
    return displaced(survey(lambda x, y: ground(x, y) + change_of(x, y), seed=1))


@pytest.fixture(scope="module")
def after(tmp_path_factory, moved):
    return write(tmp_path_factory.mktemp("after") / "after.laz", moved)


def holds(result, truth, within=0.003):
    assert isinstance(result, AreaResult), result
    low, high = result.interval95_m3
    assert low < truth < high
    assert result.volume_m3 == pytest.approx(truth, rel=within)
    side = result.cut_m3 if truth > 0 else result.fill_m3
    assert side == pytest.approx(abs(truth), rel=within)


def gained_and_lost(found, grid=True):
    factor = found.grid_scale_factor if grid else 1.0
    for result, form in zip(found.results, (GAINED, LOST)):
        holds(result, volume_of(form) / factor**2)


# --- change


def test_gain_and_loss_of_a_survey_that_lies_elsewhere_are_those_of_the_closed_form(before, after):
    found = quantify_client.change(before, after, area=BOTH)
    gained_and_lost(found)
    assert found.kind == "change"
    assert (found.source, found.results[0].base) == (str(after), "before.laz")
    told = found.alignment
    assert told.shift_m[:2] == pytest.approx((-SHIFT[0], -SHIFT[1]), abs=0.02)
    assert told.tilt == pytest.approx((-TILT[0], -TILT[1]), abs=3e-5)
    assert told.stable_rms_m < 0.05 < told.before_rms_m
    assert [notice.code for notice in found.warnings].count("survey-moved") == 1
    # Each area has a rim of 2 m that did not change: 400 m2 of 1018 (r = 18), and the other one.
    for result, form in zip(found.results, (GAINED, LOST)):
        assert 0.02 < result.level_of_detection_m < 0.12
        assert 0.85 < result.area_changed_m2 / (math.pi * form[2] ** 2) < 1.03
        assert {item.source for item in result.budget} >= {"survey", "base", "alignment"}
        (check,) = result.checks
        assert abs(check.volume_m3 - result.volume_m3) <= check.margin_m3


def test_a_survey_as_the_base_gives_the_same_and_the_other_one_is_moved(before, after):
    found = quantify_client.measure(after, base=str(before), area=BOTH)
    gained_and_lost(found)
    assert (found.kind, found.source) == ("volume", str(after))
    assert found.alignment.moved == str(before)
    assert found.alignment.shift_m[:2] == pytest.approx(SHIFT[:2], abs=0.02)


@pytest.mark.one_python
def test_before_and_after_exchanged_exchange_gain_and_loss(before, after):
    found = quantify_client.change(after, before, area=BOTH)
    for result, form in zip(found.results, (GAINED, LOST)):
        holds(result, -volume_of(form) / found.grid_scale_factor**2)


@pytest.mark.one_python
def test_without_areas_all_that_both_show_is_measured(before, after):
    (result,) = quantify_client.change(before, after).results
    truth = volume_of(GAINED), -volume_of(LOST)
    # Noise makes gains and losses of cells where nothing changed, and their difference is none.
    assert result.cut_m3 == pytest.approx(truth[0], rel=0.08)
    assert result.fill_m3 == pytest.approx(truth[1], rel=0.08)
    low, high = result.interval95_m3
    assert low < truth[0] - truth[1] < high


@pytest.mark.one_python
@pytest.mark.parametrize("to", ["EPSG:32631", "EPSG:4326", "EPSG:2056"])
def test_a_survey_in_another_crs_is_brought_into_that_of_the_first(before, moved, tmp_path, to):
    after = write(tmp_path / "after.laz", moved, to=to)
    gained_and_lost(quantify_client.change(before, after, area=BOTH))


@pytest.mark.one_python
def test_a_survey_in_feet_is_brought_into_metres(before, moved, tmp_path):
    foot = 1200 / 3937
    text = "+proj=utm +zone=32 +datum=WGS84 +units=us-ft +no_defs"
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.add_crs(CRS.from_user_input(text))
    x, y, z = (moved + np.array([[EAST], [NORTH], [0.0]])) / foot
    header.scales, header.offsets = [1e-3] * 3, [x.min(), y.min(), 0.0]
    las = laspy.LasData(header)
    las.x, las.y, las.z = x, y, z
    las.write(str(tmp_path / "after.laz"))
    found = quantify_client.change(before, tmp_path / "after.laz", area=BOTH)
    gained_and_lost(found)
    # What was assumed of the survey that is moved is told as well.
    assert "height-unit-assumed" in [getattr(one, "code", "") for one in found.warnings]


@pytest.mark.one_python
def test_an_odm_folder_and_an_all_zip(before, after, tmp_path):
    project = tmp_path / "odm"
    inner = project / "odm_georeferencing"
    inner.mkdir(parents=True)
    shutil.copy(before, inner / "odm_georeferenced_model.laz")
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.write(after, "odm_georeferencing/odm_georeferenced_model.laz")
    found = quantify_client.change(project, tmp_path / "all.zip", area=BOTH)
    gained_and_lost(found)


def test_rasters_as_epochs(before, after, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    paths, size = [], 300
    for cloud in (before, after):
        las = laspy.read(str(cloud))
        column = np.floor((np.asarray(las.x) - EAST + 75) / 0.5).astype(int)
        row = np.floor((NORTH + 75 - np.asarray(las.y)) / 0.5).astype(int)
        inside = (column >= 0) & (column < size) & (row >= 0) & (row < size)
        flat = (row * size + column)[inside]
        count = np.bincount(flat, minlength=size**2)
        total = np.bincount(flat, np.asarray(las.z)[inside], size**2)
        z = np.where(count > 0, total / np.maximum(count, 1), -9999.0).reshape(size, size)
        paths.append(tmp_path / f"{cloud.stem}.tif")
        place = rasterio.Affine(0.5, 0.0, EAST - 75, 0.0, -0.5, NORTH + 75)
        about = {"driver": "GTiff", "width": size, "height": size, "count": 1, "nodata": -9999.0}
        with rasterio.open(
            paths[-1], "w", dtype="float32", crs="EPSG:32632", transform=place, **about
        ) as file:
            file.write(z.astype(np.float32), 1)
    gained_and_lost(quantify_client.change(*paths, area=BOTH))


# --- no change, and surveys that are left where they are


@pytest.mark.one_python
def test_of_the_same_ground_no_change_is_detected(before, tmp_path):
    other = write(tmp_path / "again.laz", displaced(survey(ground, seed=7)))
    found = quantify_client.change(before, other, area=areas(GAINED, LOST, room=-6.0))
    for result in found.results:
        low, high = result.interval95_m3
        assert low < 0 < high
        assert result.area_changed_m2 / result.area_m2 < 0.1


@pytest.mark.one_python
def test_surveys_that_are_left_where_they_are_are_told_and_their_interval_holds(before, after):
    found = quantify_client.change(before, after, area=BOTH, align=False)
    assert found.alignment.shift_m == (0.0, 0.0, 0.0)
    (notice,) = [one for one in found.warnings if one.code == "surveys-not-aligned"]
    assert "--no-align" in notice
    for result, form in zip(found.results, (GAINED, LOST)):
        low, high = result.interval95_m3
        assert low < volume_of(form) / found.grid_scale_factor**2 < high
        items = {item.source: item.std_m3 for item in result.budget}
        assert items["alignment"] > 20


@pytest.mark.one_python
def test_a_pile_on_its_own_earlier_ground(tmp_path):
    """Ground with 0.3 m of relief under a pile: what no ground around it tells."""

    def uneven(x, y):
        return 50 + 0.42 * np.sin(x / 3) * np.cos(y / 4)

    def piled(x, y):
        return uneven(x, y) + np.maximum(0, 4 * (1 - np.hypot(x, y) / 9))

    bare = write(tmp_path / "bare.laz", survey(uneven, half=30.0, count=60_000, noise=0.02))
    pile = write(tmp_path / "pile.laz", survey(piled, half=30.0, count=60_000, noise=0.02, seed=2))
    area = areas((0.0, 0.0, 9.0, 4.0), room=1.0)
    found = quantify_client.measure(pile, base=bare, area=area)
    truth = math.pi * 81 * 4 / 3 / found.grid_scale_factor**2
    holds(found.results[0], truth, within=0.005)
    by_guess = quantify_client.measure(pile, area=area).results[0]
    base = [
        next(item.std_m3 for item in each.budget if item.source == "base")
        for each in (found.results[0], by_guess)
    ]
    assert base[0] < 0.2 * base[1]


# --- what cannot be compared


def refused(*given, **options):
    with pytest.raises(QuantifyError) as told:
        quantify_client.change(*given, **options)
    text = str(told.value)
    assert "\n" not in text
    return text


def test_surveys_of_different_places(before, tmp_path):
    away = write(tmp_path / "away.laz", survey(ground, count=2_000) + np.array([[900], [0], [0]]))
    assert "do not overlap, they lie 750 m apart" in refused(before, away)


def test_a_survey_without_a_crs(before, tmp_path):
    bare = write(tmp_path / "bare.laz", survey(ground, count=2_000), crs=None)
    assert "bare.laz has no CRS" in refused(before, bare)


def test_no_ground_that_did_not_change(before, after):
    everything = areas((0.0, 0.0, 130.0, 0.0))
    assert "too little ground in common" in refused(before, after, area=everything)


def test_an_area_that_the_other_survey_does_not_show(before, tmp_path):
    points = survey(ground, seed=3)
    half = write(tmp_path / "half.laz", points[:, points[0] > 0])
    seen, unseen = quantify_client.change(before, half, area=areas(LOST, GAINED)).results
    assert isinstance(seen, AreaResult)
    assert isinstance(unseen, AreaFailure)
    assert "half.laz" in unseen.error or "other survey" in unseen.error


def test_a_base_that_is_too_sparse_within_an_area(before, after, tmp_path):
    """Of the earlier survey only a corner of the area is left, and all that is around it."""
    points = survey(ground)
    a, b, r, _ = GAINED
    inside = np.hypot(points[0] - a, points[1] - b) < r + 4.0
    kept = ~inside | (points[0] > a + 0.6 * r)
    sparse = write(tmp_path / "sparse.laz", points[:, kept])
    (failed,) = quantify_client.measure(after, base=str(sparse), area=areas(GAINED)).results
    assert isinstance(failed, AreaFailure)
    assert failed.error.startswith("in sparse.laz, points support ")
    assert "at least 50% are needed" in failed.error


@pytest.mark.one_python
def test_a_dem_without_a_crs_beside_surveys_with_one(before, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    about = {"driver": "GTiff", "width": 60, "height": 60, "count": 1, "dtype": "float32"}
    about["transform"] = rasterio.transform.from_origin(EAST - 30, NORTH + 30, 1, 1)
    with rasterio.open(tmp_path / "dem.tif", "w", **about) as raster:
        raster.write(np.full((60, 60), LEVEL, dtype=np.float32), 1)
    assert "dem.tif has no CRS" in refused(before, tmp_path / "dem.tif")


def test_what_goes_with_one_survey_only(before, after):
    assert "--area auto" in refused(before, after, area="auto")
    with pytest.raises(UsageError):
        quantify_client.measure(after, base=before, toe="auto")


def test_a_base_that_is_nothing(before):
    with pytest.raises(QuantifyError, match=r"no_such\.laz"):
        quantify_client.measure(before, base="no_such.laz")
    with pytest.raises(UsageError, match="kriged"):
        quantify_client.measure(before, base="krigged")


# --- the command


def test_the_command_tells_both_surveys_and_writes_a_report(run, before, after, tmp_path):
    where = tmp_path / "areas.geojson"
    where.write_text(json.dumps(BOTH))
    given = ["change", before, after, "--area", where]
    status, out, _ = run(*given, "--json", "--out", tmp_path / "report")
    assert status == 0
    document = json.loads(out)
    assert (document["kind"], document["alignment"]["aligned"]) == ("change", True)
    assert document["results"][0]["level_of_detection_m"] > 0
    assert {path.name for path in (tmp_path / "report").iterdir()} >= {"report.html"}
    status, out, _ = run("volume", after, "--base", before, "--area", where, "--no-align")
    assert status == 0
    assert "before.laz" in out
    status, out, err = run("change", before, tmp_path / "none.laz")
    assert (status, out) == (1, "")
    assert len(err.strip().splitlines()) == 1
