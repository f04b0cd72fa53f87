"""What cameras that see through space agree on."""

from __future__ import annotations

import numpy as np
import pytest

from quantify_client.volcalc.body.sights import Agreement, one_is_enough
from quantify_client.volcalc.body.views import Views

POINT = np.array([[5.0, -3.0, 2.0]])


def around(count, up):
    """Cameras on a ring about the point, so many degrees above it."""
    angle = 2.0 * np.pi * np.arange(count) / count
    flat, rise = np.cos(np.radians(up)), np.sin(np.radians(up))
    way = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), np.full(count, rise)])
    return POINT + 40.0 * way


@pytest.mark.parametrize(
    ("cameras", "agreed"),
    [
        (around(1, 30.0), False),
        (around(12, 0.0), False),  # a level surface would be seen from along it by all of them
        (around(12, 10.0), False),  # at 10 degrees
        (around(12, 45.0), True),
        (around(3, 45.0), False),  # a steep surface that faces between two is seen by one
        (np.vstack([around(6, 20.0), around(6, 60.0)]), True),
    ],
)
def test_a_surface_would_have_been_shown_whichever_way_it_faced(cameras, agreed):
    found = Agreement(np.vstack([POINT, POINT + 1.0]))
    for place in cameras:
        found.add(place, np.array([True, False]))
    assert found.empty().tolist() == [agreed, False]


def test_clouds_in_which_one_camera_was_enough():
    rng = np.random.default_rng(0)
    seen = rng.random((12, 4_000)) < 0.2
    assert one_is_enough(seen)
    assert not one_is_enough(seen[:, seen.sum(axis=0) != 1])
    assert not one_is_enough(rng.random((40, 4_000)) < 0.5)  # hardly any point is seen by few


def test_cameras_that_have_to_agree_take_nothing_away_alone():
    """A wall of which only what two cameras see is in the cloud, and ground behind it."""
    rng = np.random.default_rng(1)
    wall = rng.uniform([-1.0, 0.0, 0.0], [1.0, 0.0, 1.0], (3_000, 3))
    behind = rng.uniform([-3.0, 1.0, 0.0], [3.0, 5.0, 0.0], (6_000, 3))
    hole = (np.abs(wall[:, 0]) < 0.3) & (np.abs(wall[:, 2] - 0.5) < 0.3)
    cameras = np.array([[x, -6.0, 3.0] for x in (-4.0, -2.0, 2.0, 4.0)] + [[0.0, -6.0, 3.5]])
    points = np.vstack([wall[~hole], behind])
    views = Views.of(points, 0.05, cameras, None, len(behind), len(cameras))
    assert views.in_need.all()
    place = np.array([[0.0, 0.2, 0.5]])  # behind the hole
    before, beyond = views.empty(place, np.ones(5, dtype=bool), 2)
    told = np.array([view.shows_empty(place) for view in views.views])[:, 0, 0]
    assert told.sum() >= 1
    assert before[0] == beyond[0] == 0
