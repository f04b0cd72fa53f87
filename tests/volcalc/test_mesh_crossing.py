"""Triangles that meet, against an independent judge: linear programming."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from quantify_client.volcalc.mesh.intersections import BITS, BoxTree, meeting, normals, overlaps

pytestmark = pytest.mark.one_python


def meet(points, one, two):
    """Whether two triangles have more in common than corners and edges that both have as theirs.

    The largest weight that a common point can have at corners which are not shared is above 0.
    """
    shared = set(one) & set(two)
    if len(shared) == 3:
        return True
    weights = [0.0 if corner in shared else -1.0 for corner in one]
    corners = np.vstack([points[list(one)], -points[list(two)]]).T
    sums = [[1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]]
    found = linprog([*weights, 0, 0, 0], A_eq=[*corners, *sums], b_eq=[0, 0, 0, 1, 1])
    return bool(found.status == 0 and -found.fun > 1e-7)


@pytest.mark.parametrize("shared", [0, 1, 2])
@pytest.mark.parametrize("flat", [False, True], ids=["in space", "in a plane"])
def test_triangles_meet_where_linear_programming_says_so(shared, flat):
    """Corners on a grid of 4 x 4 x 4 steps touch, overlap and lie in one plane very often."""
    rng = np.random.default_rng(shared)
    both = np.array([[0, 1, 2], [*range(shared), *range(3, 6 - shared)]])
    said, truth = [], []
    while len(said) < 40:
        points = rng.integers(0, 4, size=(6, 3))
        if flat:
            points[:, 2] = points[:, 0] - points[:, 1] + 4
        faces = np.array([np.roll(face, rng.integers(3)) for face in both])
        normal = normals(points, faces)
        distinct = len(np.unique(points[np.unique(faces)], axis=0)) == 6 - shared
        if not (distinct and normal.any(axis=1).all()):
            continue
        found = meeting(points, faces, normal)
        said.append(found is not None)
        truth.append(meet(points.astype(float), *faces.tolist()))
    assert said == truth
    assert 3 < sum(truth) < 37 or (shared == 2 and not flat)


def test_a_step_of_the_grid_is_told_at_the_largest_coordinates():
    """A corner on a face, one step above it and one step below, where products have 90 bits."""
    scale = 3 * 2 ** (BITS - 4)
    face = np.array([[0, 0, 3], [4, 1, 0], [1, 4, 0]]) * scale
    tip = face.sum(axis=0) // 3
    for step, meets in ((0, True), (1, False), (-1, True)):
        points = np.vstack(
            [face, tip + np.array([0, 0, step]), np.array([[4, 4, 4], [4, 3, 4]]) * scale]
        )
        faces = np.array([[0, 1, 2], [3, 4, 5]])
        found = meeting(points, faces, normals(points, faces))
        assert (found is not None) == meets, step


def test_boxes_that_overlap_are_found_once_each():
    rng = np.random.default_rng(3)
    low = rng.random((300, 3)) * rng.choice([1.0, 10.0], 300)[:, None]
    high = low + rng.random((300, 3)) ** 4
    wanted = {
        (a, b)
        for a in range(300)
        for b in range(a + 1, 300)
        if (low[a] <= high[b]).all() and (low[b] <= high[a]).all()
    }
    tree = BoxTree(low, high)
    found = [
        tuple(sorted(pair))
        for one, two in overlaps(tree, tree)
        for pair in zip(one.tolist(), two.tolist())
    ]
    assert len(found) == len(wanted) > 100
    assert set(found) == wanted
    other = BoxTree(low[:7], high[:7], tree.depth)
    between = {p for one, two in overlaps(tree, other) for p in zip(one.tolist(), two.tolist())}
    assert {tuple(sorted(p)) for p in between if p[0] != p[1]} == {p for p in wanted if p[0] < 7}


def test_one_box_and_boxes_all_alike_are_trees():
    for count in (1, 2, 5):
        tree = BoxTree(np.zeros((count, 3)), np.zeros((count, 3)))
        assert sum(len(one) for one, _ in overlaps(tree, tree)) == count * (count - 1) // 2
