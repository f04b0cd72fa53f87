"""Mean heights of triangles over cells, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import Delaunay

import quantify_client.volcalc.terrain.tin_surface as module
from quantify_client.errors import DesignError
from quantify_client.types import Window
from quantify_client.volcalc.terrain.grid import CellWindow
from quantify_client.volcalc.terrain.tin_surface import tin_means

EAST, NORTH = 576_700.3, 5_188_140.7


def window(cell=0.4, side=30.0, margin=2):
    return CellWindow.around(Window(EAST, NORTH, EAST + side, NORTH + side), cell, margin)


def scattered(count, seed=1, side=30.0):
    """Return places with the corners of a square among them, and their triangles."""
    places = np.random.default_rng(seed).uniform(0, side, (count, 2))
    places = np.concatenate([places, [(0, 0), (side, 0), (side, side), (0, side)]])
    return places + np.array([EAST, NORTH]), Delaunay(places).simplices


def test_a_plane_is_exact_however_it_is_cut_into_triangles():
    places, triangles = scattered(3000)
    height = 100.0 + 0.7 * (places[:, 0] - EAST) - 0.3 * (places[:, 1] - NORTH)
    cells = window()
    z, share = tin_means(np.column_stack([places, height]), triangles[:, [1, 0, 2]], cells)
    x, y = cells.middles(np.ones(cells.shape, dtype=bool))
    inside = (np.abs(x - EAST - 15) < 14.8) & (np.abs(y - NORTH - 15) < 14.8)
    inside = inside.reshape(cells.shape)
    assert (share[inside] == 1.0).all()
    plane = (100.0 + 0.7 * (x - EAST) - 0.3 * (y - NORTH)).reshape(cells.shape)
    assert np.abs(z - plane)[inside].max() < 1e-8
    outside = (np.abs(x - EAST - 15) > 15.3) | (np.abs(y - NORTH - 15) > 15.3)
    assert (share.ravel()[outside] == 0).all()
    assert np.isnan(z.ravel()[outside]).all()
    assert share.sum() * cells.cell**2 == pytest.approx(900.0, rel=0.01)


@pytest.mark.parametrize("cell", [0.1, 0.4])
@pytest.mark.parametrize("turn", [0.0, 0.37])
def test_cut_and_fill_of_a_pyramid_against_a_level(cell, turn):
    """Of a pyramid of 800 m3 three quarters of the height are cut, net 200 m3."""
    side, top, level = 20.0, 6.0, 1.5
    base = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (0, 0)]) * side / 2
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    places = base @ rotation.T + (EAST + 15, NORTH + 15)
    points = np.column_stack([places, [0, 0, 0, 0, top]])
    triangles = np.array([(i, (i + 1) % 4, 4) for i in range(4)])
    cells = window(cell)
    z, share = tin_means(points, triangles, cells)
    above = np.nan_to_num(z - level) * share * cells.cell**2
    cut = 800.0 * 0.75**3
    assert above.sum() == pytest.approx(200.0, rel=1e-3)
    if cell == 0.1:  # cells that the level crosses count for one of both sides
        assert above[above > 0].sum() == pytest.approx(cut, rel=1e-3)
        assert -above[above < 0].sum() == pytest.approx(cut - 200.0, rel=1e-3)


def test_creases_are_off_by_what_is_told():
    """A valley across places at random: too low by s c / 384 on average, s c / 128 at most."""
    cell, slope, off = 0.8, 1.0, []
    for offset in np.linspace(0, 0.8, 41)[:-1]:
        x = np.array([0.0, 15.0 + offset, 30.0])
        points = [(EAST + u, NORTH + v, abs(u - x[1]) * slope / 2) for v in (0, 30) for u in x]
        triangles = np.array([(0, 1, 3), (1, 4, 3), (1, 2, 4), (2, 5, 4)])
        cells = window(cell)
        z, _ = tin_means(np.array(points), triangles, cells)
        west = cells.min_x + np.arange(cells.nx) * cell - EAST - x[1]
        exact = slope / 2 * (np.sign(west + cell) * (west + cell) ** 2 - np.sign(west) * west**2)
        exact /= 2 * cell
        off.append((z[20] - exact)[5:-5])
    off = np.array(off)
    assert off.min() == pytest.approx(-slope * cell / 128, rel=0.05)
    assert off.min(axis=1).mean() == pytest.approx(-slope * cell / 384, rel=0.1)
    assert off.max() < 1e-8


def test_slices_of_any_size_give_the_same(monkeypatch):
    places, triangles = scattered(400)
    points = np.column_stack([places, np.sin(places).sum(axis=1)])
    z, share = tin_means(points, triangles, window())
    monkeypatch.setattr(module, "_AT_ONCE", 1500)
    again, same = tin_means(points, triangles, window())
    assert np.array_equal(share, same)
    assert np.allclose(z, again, rtol=0, atol=1e-12, equal_nan=True)


def test_a_hole_and_a_notch_are_not_covered():
    places, triangles = scattered(2000)
    middle = places[triangles].mean(axis=1) - (EAST + 15, NORTH + 15)
    hole = np.hypot(*middle.T) < 5
    points = np.column_stack([places, np.full(len(places), 7.0)])
    cells = window()
    z, share = tin_means(points, triangles[~hole], cells)
    corner = places[triangles[~hole]]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    assert share.sum() * cells.cell**2 == pytest.approx(area, rel=1e-3)
    assert np.nanmin(z) == np.nanmax(z) == 7.0


def test_faces_over_each_other_are_refused():
    places, triangles = scattered(100)
    points = np.column_stack([places, np.zeros(len(places))])
    over = np.array([(EAST + 10, NORTH + 10, 1.0), (EAST + 14, NORTH + 10, 1.0)])
    over = np.concatenate([points, over, [(EAST + 12, NORTH + 13, 1.0)]])
    last = len(over) - 1
    with pytest.raises(DesignError, match="up to 1 m apart"):
        tin_means(over, np.concatenate([triangles, [(last - 2, last - 1, last)]]), window())
    with pytest.raises(DesignError, match="more than once"):
        tin_means(over, np.concatenate([triangles, triangles]), window())
    # The same height, as rounded coordinates make it, is one surface.
    over[-3:, 2] = 1e-3
    _, share = tin_means(over, np.concatenate([triangles, [(last - 2, last - 1, last)]]), window())
    assert share.max() == 1.0


def test_no_triangle_covers_nothing():
    z, share = tin_means(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), window())
    assert np.isnan(z).all()
    assert not share.any()
