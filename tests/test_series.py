"""Three surveys and more as a series, and surveys in the wrong order of time."""

from __future__ import annotations

import json
from datetime import datetime, timedelta, timezone

import laspy
import numpy as np
import pytest
from pyproj import CRS
from test_change import EAST, GAINED, LOST, NORTH, areas, ground, survey, volume_of, write

import quantify_client
from quantify_client.cli import main
from quantify_client.cloud.las.times import time_of_points
from quantify_client.errors import InputError, QuantifyError
from quantify_client.types import AreaFailure

pytestmark = pytest.mark.one_python

#: What was there of each form at each time, as a share of it, and where the survey lies.
STEPS = ((0.0, 0.0), (0.5, 0.25), (1.0, 1.0))
MOVED = ((0.0, 0.0, 0.0), (2.4, -1.8, 0.3), (-0.7, 0.9, -0.2))


def form_of(shares):
    def form(x, y):
        z = ground(x, y)
        for share, (a, b, r, h) in zip(shares, (GAINED, LOST)):
            z = z + share * h * np.clip(1 - ((x - a) ** 2 + (y - b) ** 2) / r**2, 0, None)
        return z

    return form


@pytest.fixture(scope="module")
def epochs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("series")
    paths = []
    for number, (shares, by) in enumerate(zip(STEPS, MOVED)):
        points = survey(form_of(shares), count=60_000, seed=number) + np.array(by)[:, None]
        to = "EPSG:32631" if number == 1 else None
        paths.append(str(write(folder / f"epoch{number}.laz", points, to=to)))
    return paths


def expected(one, other):
    """Return what changed of both forms, m3."""
    return [
        (STEPS[other][k] - STEPS[one][k]) * volume_of(form) for k, form in enumerate((GAINED, LOST))
    ]


def holds(result, truth):
    low, high = result.interval95_m3
    assert low - 0.5 * (high - low) < truth < high + 0.5 * (high - low)
    assert result.volume_m3 == pytest.approx(truth, rel=0.01)


def test_a_series_has_each_pair_and_the_first_with_the_last(epochs):
    found = quantify_client.change(*epochs, area=areas(GAINED, LOST), grid=True)
    assert [(one.before, one.after) for one in found.series] == [
        (epochs[0], epochs[1]),
        (epochs[1], epochs[2]),
        (epochs[0], epochs[2]),
    ]
    for one, (first, last) in zip(found.series, ((0, 1), (1, 2), (0, 2))):
        assert [result.name for result in one.results] == ["form 0", "form 1"]
        # A survey in another zone is measured on its own grid there.
        for result, truth in zip(one.results, expected(first, last)):
            holds(result, truth)
    assert found.results[0].volume_m3 == found.series[-1].results[0].volume_m3
    assert found.alignment.shift_m[0] == pytest.approx(-MOVED[2][0], abs=0.03)
    assert found.series[0].alignment.moved == epochs[1]
    document = found.to_dict()
    assert set(document["series"][0]) == {"before", "after", "results", "failures", "alignment"}
    assert document["series"][1]["results"][0]["name"] == "form 0"


def test_without_areas_what_the_first_and_the_last_show_is_frozen(epochs):
    found = quantify_client.change(*epochs, grid=True)
    (whole,) = found.results
    assert whole.volume_m3 == pytest.approx(sum(expected(0, 2)), abs=3 * whole.std_m3)
    for one in found.series[:-1]:
        (result,) = one.results
        # The second survey's own grid is 0.3 % larger there.
        assert result.area_m2 == pytest.approx(whole.area_m2, rel=4e-3)


def test_a_pair_that_fails_leaves_the_others(epochs, tmp_path):
    far = survey(ground, count=20_000) + np.array([900.0, 0.0, 0.0])[:, None]
    away = str(write(tmp_path / "away.laz", far))
    found = quantify_client.change(epochs[0], away, epochs[2], area=areas(GAINED, LOST), grid=True)
    first, second, whole = found.series
    assert [failed.name for failed in first.failures] == ["form 0", "form 1"]
    for one in (first, second):
        assert "do not overlap" in one.failures[0].error
    holds(whole.results[0], expected(0, 2)[0])
    assert not any(isinstance(result, AreaFailure) for result in found.results)


def test_the_command_writes_table_and_picture_of_a_series(epochs, tmp_path, capsys):
    area = tmp_path / "areas.geojson"
    area.write_text(json.dumps(areas(GAINED, LOST)))
    out = tmp_path / "out"
    assert main(["change", *epochs, "--area", str(area), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    for words in ("First to last", "Gain", "Series"):
        assert words in shown
    rows = (out / "series.csv").read_text().splitlines()
    assert len(rows) == 1 + 3 * 2
    for name in ("series.png", "alignment.png", "report.html"):
        assert (out / name).stat().st_size > 5_000


# --- times


def timed(path, when, standard=True):
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.add_crs(CRS.from_user_input("EPSG:32632"))
    if standard:  # laspy 2.6 sets WEEK_TIME, which is where it starts, to STANDARD
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    header.scales, header.offsets = [1e-3] * 3, [EAST, NORTH, 0.0]
    las = laspy.LasData(header)
    x, y, z = survey(ground, count=5_000)
    las.x, las.y, las.z = x + EAST, y + NORTH, z
    epoch = datetime(1980, 1, 6, tzinfo=timezone.utc)
    las.gps_time = np.full(len(x), (when - epoch).total_seconds() - 1e9 if when else 0.0)
    las.write(str(path))
    return path


MAY, JUNE = (datetime(2024, month, 7, tzinfo=timezone.utc) for month in (5, 6))


def test_gps_times_tell_when_points_were_taken(tmp_path):
    assert abs(time_of_points(timed(tmp_path / "may.laz", MAY)) - MAY) < timedelta(seconds=1)
    assert time_of_points(timed(tmp_path / "week.laz", MAY, standard=False)) is None
    assert time_of_points(timed(tmp_path / "none.las", None)) is None
    assert time_of_points(tmp_path / "missing.las") is None


def test_surveys_the_wrong_way_round_in_time_are_refused(tmp_path, capsys):
    may, june = timed(tmp_path / "may.laz", MAY), timed(tmp_path / "june.laz", JUNE)
    with pytest.raises(InputError) as caught:
        quantify_client.change(june, may)
    assert str(caught.value) == (
        f"{june} was taken on 2024-06-07, after {may} (2024-05-07); expected the earlier survey "
        "first: exchange them"
    )
    assert main(["change", str(june), str(may)]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert quantify_client.change(may, june).kind == "change"


def project(folder, times):
    (folder / "odm_georeferencing").mkdir(parents=True)
    (folder / "odm_report").mkdir()
    write(folder / "odm_georeferencing" / "odm_georeferenced_model.laz", survey(ground, 5_000))
    features = [{"type": "Feature", "properties": {"capture_time": time}} for time in times]
    document = {"type": "FeatureCollection", "features": features}
    (folder / "odm_report" / "shots.geojson").write_text(json.dumps(document))
    return folder


@pytest.mark.parametrize("damaged", [False, True])
def test_photographs_tell_the_time_and_what_does_not_is_believed(tmp_path, damaged):
    later = project(tmp_path / "later", [0, JUNE.timestamp(), JUNE.timestamp() + 600])
    earlier = project(tmp_path / "earlier", ["?", MAY.timestamp(), 0])
    if damaged:
        (earlier / "odm_report" / "shots.geojson").write_text('{"features": [7]}')
        assert quantify_client.change(later, earlier).kind == "change"
        return
    with pytest.raises(InputError, match="was taken on 2024-06-07, after"):
        quantify_client.change(later, earlier)


def test_a_pair_that_fails_ends_the_command_with_status_1(epochs, tmp_path, capsys):
    far = survey(ground, count=20_000) + np.array([900.0, 0.0, 0.0])[:, None]
    away = str(write(tmp_path / "away.laz", far))
    area = tmp_path / "areas.geojson"
    area.write_text(json.dumps(areas(GAINED)))
    assert main(["change", epochs[0], away, epochs[2], "--area", str(area), "--json"]) == 1
    shown = capsys.readouterr()
    assert [one["results"] for one in json.loads(shown.out)["series"][:2]] == [[], []]
    lines = shown.err.splitlines()
    assert len(lines) == 2
    assert "epoch0.laz to away.laz: form 0:" in lines[0]


def test_a_survey_without_a_crs_among_others_is_named(epochs, tmp_path):
    bare = str(write(tmp_path / "bare.laz", survey(ground, count=20_000), crs=None))
    with pytest.raises(QuantifyError, match=r"bare.laz has no CRS"):
        quantify_client.change(epochs[0], bare, epochs[2])
