"""Change beside xdem's, on the same rasters: `pip install xdem scikit-gstat` into an environment.

xdem (GlaciHack) finds shifts after Nuth and Kaab (2011), and errors after Hugonnet et al. (2022).
It needs Python 3.10 and is too large to be installed for every run of the tests.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from shapely.geometry import box, mapping

import quantify_client

EAST, NORTH, CELL, SIDE = 412_000.0, 5_204_000.0, 0.5, 480
SHIFT = (0.4, -0.3, 0.1)
AREA = box(EAST + 80, NORTH + 80, EAST + 160, NORTH + 160)

pytestmark = pytest.mark.one_python


@pytest.fixture(scope="module")
def xdem():
    pytest.importorskip("skgstat", reason="scikit-gstat is not installed beside xdem")
    return pytest.importorskip("xdem", reason="xdem is not installed")


def ground(x, y):
    narrow = 1.2 * np.sin(x / 6 + 1) * np.sin(y / 8)
    return 900 + 0.1 * x + 6 * np.sin(x / 19) * np.cos(y / 27) + narrow


def places():
    side = (np.arange(SIDE) + 0.5) * CELL
    return np.meshgrid(side, side[::-1])


def write(path, z):
    rasterio = pytest.importorskip("rasterio")
    about = {"driver": "GTiff", "width": SIDE, "height": SIDE, "count": 1, "dtype": "float32"}
    about["transform"] = rasterio.transform.from_origin(EAST, NORTH + SIDE * CELL, CELL, CELL)
    with rasterio.open(path, "w", crs="EPSG:32632", **about) as raster:
        raster.write(z.astype(np.float32), 1)
    return str(path)


def pair(folder, noise):
    """Two surveys of the same ground, the later one shifted; `noise` makes that of each."""
    x, y = places()
    moved = ground(x - SHIFT[0], y - SHIFT[1]) + SHIFT[2]
    before = write(folder / "before.tif", ground(x, y) + noise(x, y))
    return before, write(folder / "after.tif", moved + noise(x, y))


def white(rng):
    return lambda x, y: 0.02 * rng.standard_normal(x.shape)


def shared(rng, std=0.03, length=3.0):
    """Return noise that neighbours over a few metres share, besides white noise."""

    def noise(x, y):
        field = gaussian_filter(
            rng.standard_normal(x.shape), length / CELL / np.sqrt(2), mode="wrap"
        )
        return std * field / field.std() + 0.02 * rng.standard_normal(x.shape)

    return noise


def steeper_is_worse(rng):
    def noise(x, y):
        down, right = np.gradient(ground(x, y), CELL)
        return (0.01 + 0.08 * np.hypot(down, right)) * rng.standard_normal(x.shape)

    return noise


def ours(paths):
    shape = {"type": "Feature", "properties": {}, "geometry": mapping(AREA)}
    area = {"type": "FeatureCollection", "features": [shape]}
    area["crs"] = {"type": "name", "properties": {"name": "EPSG:32632"}}
    return quantify_client.change(*paths, area=area, grid=True)


def theirs(xdem, paths):
    """Return xdem's shift of the later one, the difference after it, and the stable ground."""
    import geopandas
    import geoutils

    before, after = (xdem.DEM(path) for path in paths)
    outline = geoutils.Vector(geopandas.GeoDataFrame(geometry=[AREA], crs="EPSG:32632"))
    stable = ~outline.create_mask(before)
    nuth_kaab = xdem.coreg.NuthKaab()
    nuth_kaab.fit(before, after, inlier_mask=stable, random_state=1)
    found = nuth_kaab.meta["outputs"]["affine"]
    shift = [found["shift_x"], found["shift_y"], found["shift_z"]]
    return shift, nuth_kaab.apply(after) - before, stable, outline


@pytest.mark.filterwarnings("ignore")
def test_shifts_are_those_of_nuth_and_kaab(xdem, tmp_path):
    paths = pair(tmp_path, white(np.random.default_rng(1)))
    shift, *_ = theirs(xdem, paths)
    found = ours(paths).alignment.shift_m
    assert found[:2] == pytest.approx(shift[:2], abs=0.005)
    assert found[2] == pytest.approx(shift[2], abs=0.001)
    assert found[:2] == pytest.approx((-SHIFT[0], -SHIFT[1]), abs=0.005)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_error_of_a_mean_is_that_of_spatial_error_propagation(xdem, tmp_path, seed):
    paths = pair(tmp_path, shared(np.random.default_rng(seed)))
    (result,) = ours(paths).results
    _, difference, stable, outline = theirs(xdem, paths)
    _, model, _ = xdem.spatialstats.infer_spatial_correlation_from_stable(
        difference,
        list_models=["Gaussian", "Spherical"],
        stable_mask=stable,
        subsample=2000,
        random_state=1,
    )
    known = difference.data.filled(np.nan)[stable.data.filled(False)]
    spread = 1.4826 * np.nanmedian(np.abs(known - np.nanmedian(known)))
    errors = difference.copy(new_array=np.full(difference.shape, float(spread)))
    (std,) = xdem.spatialstats.spatial_error_propagation([outline.ds], errors, model)
    assert result.std_m3 / result.area_m2 == pytest.approx(std, rel=0.15)


def test_noise_that_grows_with_slope_is_measured(tmp_path):
    """Which xdem has from Hugonnet et al. as well; here beside what the noise was made with."""
    relief = ours(pair(tmp_path, steeper_is_worse(np.random.default_rng(3)))).results[0].relief
    row, column = np.nonzero(relief.fraction == 1.0)
    x = relief.min_x + (column + 0.5) * relief.cell_m - EAST
    y = relief.min_y + (row + 0.5) * relief.cell_m - NORTH
    up = [ground(x + a, y + b) - ground(x - a, y - b) for a, b in ((0.01, 0.0), (0.0, 0.01))]
    slope = np.hypot(*up) / 0.02
    # A cell of K pixels has the noise of both surveys, over sqrt(K).
    made = np.sqrt(2.0) * (0.01 + 0.08 * slope) / (relief.cell_m / CELL)
    found = relief.sigma_m[row, column]
    for low, high in ((0.0, 0.2), (0.4, 0.6), (0.8, 1.0)):
        some = (slope >= np.quantile(slope, low)) & (slope <= np.quantile(slope, high))
        assert np.median(found[some]) == pytest.approx(np.median(made[some]), rel=0.2)
