"""Scale bars clicked on a map: heights from the cloud, and an honest accuracy of the places."""

import json

import numpy as np
import pytest
import shapely
from clouds import write_las
from visitors import lon_lat

from quantify_client import measure
from quantify_client.errors import ControlError
from quantify_client.webmap.clicked import bars_control

EAST, NORTH = 576_700.0, 5_188_150.0


@pytest.fixture(scope="module")
def slope(tmp_path_factory):
    """A plane that rises 0.5 m per metre to the east, a point each 0.1 m."""
    x, y = (values.ravel() for values in np.meshgrid(np.arange(0, 20, 0.1), np.arange(0, 10, 0.1)))
    xyz = np.column_stack([EAST + x, NORTH + y, 100.0 + 0.5 * x])
    path = tmp_path_factory.mktemp("slope") / "slope.laz"
    write_las(path, xyz, crs="EPSG:32615")
    return path


def bar(x1, x2, length, accuracy=0.001):
    line = shapely.LineString([[EAST + x1, NORTH + 5.0], [EAST + x2, NORTH + 5.0]])
    ends = lon_lat(line)["coordinates"]
    return {"from": ends[0], "to": ends[-1], "length_m": length, "accuracy_m": accuracy}


def test_ends_get_the_heights_of_the_points_around_them(slope):
    control = bars_control(slope, [bar(4.0, 14.0, 11.18)])
    low, high = control["cloud"].values()
    assert low["xyz"] == pytest.approx([EAST + 4.0, NORTH + 5.0, 102.0], abs=0.03)
    assert high["xyz"] == pytest.approx([EAST + 14.0, NORTH + 5.0, 107.0], abs=0.03)
    assert low["accuracy"] == pytest.approx(0.2, rel=0.2)  # two point spacings
    (length,) = control["scale_bars"]
    assert length["length"] == 11.18
    # 5 m of rise over 11.18 m, each end known in height to some 0.08 m by the slope around it
    assert 0.02 < length["accuracy"] < 0.1


def test_level_bar_keeps_its_own_accuracy(site, tmp_path):
    xyz = np.load(site / "points.npy")
    x, y = xyz[:, 0].min() + 2.0, xyz[:, 1].min() + 2.0
    flat = shapely.LineString([[x, y], [x + 3.0, y]])
    ends = lon_lat(flat)["coordinates"]
    clicked = {"from": ends[0], "to": ends[-1], "length_m": 3.0, "accuracy_m": 0.05}
    (length,) = bars_control(site / "pile.laz", [clicked])["scale_bars"]
    assert length["accuracy"] == pytest.approx(0.05, rel=0.02)


def test_control_that_was_clicked_scales_the_cloud(slope, tmp_path):
    true = 1.05 * 11.1803 * frame_factor(slope)
    path = tmp_path / "control.json"
    path.write_text(json.dumps(bars_control(slope, [bar(4.0, 14.0, true)])))
    found = measure(slope, gcp=path, base="plane")
    assert found.scale.factor == pytest.approx(1.05 * frame_factor(slope), rel=5e-3)


def frame_factor(path):
    """Return grid length / ground length: factors are of ground lengths."""
    return measure(path, base="plane").grid_scale_factor


def test_click_beside_the_cloud_and_cloud_without_crs_are_told(slope, site):
    with pytest.raises(ControlError, match="bar 1, second end was clicked where the cloud has no"):
        bars_control(slope, [bar(4.0, 25.0, 11.0)])
    with pytest.raises(ControlError, match="no CRS"):
        bars_control(site / "plain.csv", [bar(4.0, 14.0, 11.0)])
