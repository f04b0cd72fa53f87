"""Simulated surveys by class: random sites on random ground, and points of them.

None of this is from the library, and no threshold of the library was chosen on it. Everything is
drawn from the number of the survey and the name of its class, so that a survey can be had again.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field
from typing import Callable, Dict, Mapping, Sequence, Tuple, Union

import numpy as np
from grounds import RELIEFS, WAVELENGTH, Height, Sum, gaussian_field, matern, plane
from shapely import affinity
from shapely.geometry import MultiPolygon, Point, Polygon, box
from sites import Gully, Joined, Outline, Pile, Profile, Rectangle, Site, Star, integral, star

from quantify_client.types import FloatArray

EAST, NORTH, LEVEL = 576_000.0, 5_188_000.0, 160.0

Range = Tuple[float, float]
Rng = np.random.Generator
Facts = Dict[str, Union[float, str]]

#: Of the ground's relief, metres.
WAVELENGTHS = (3.0, 100.0)


def log_uniform(rng: Rng, limits: Range) -> float:
    """Return a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(*np.log(limits))))


# --- sites: (rng, width in metres) -> Site


def _profile(rng: Rng) -> Profile:
    """Return a cone, a truncated one, or something rounder."""
    return Profile(float(rng.choice([0.0, 0.0, rng.uniform(0.1, 0.6)])), rng.uniform(0, 1))


def _pile(rng: Rng, shape: Union[Star, Rectangle], fill: float, sign: float = 1.0) -> Pile:
    """Return a pile (or, by its sign, a pit) whose sides rise by 5 to 35 degrees."""
    radius = fill * math.sqrt(shape.polygon.area / math.pi)
    height = sign * radius * math.tan(math.radians(rng.uniform(5, 35)))
    return Pile(shape, fill, height, _profile(rng))


def _rectangle(rng: Rng, width: float, x: float = 0.0, y: float = 0.0) -> Rectangle:
    halves = (width / 2, width / 2 * rng.uniform(0.4, 1.0))
    return Rectangle(x, y, halves, rng.uniform(0, math.pi))


def _of_one_part(rng: Rng, width: float, sign: float) -> Site:
    """Return a star or a turned rectangle that its pile nearly fills."""
    shape = star(rng, width / 2) if rng.random() < 0.6 else _rectangle(rng, width)
    pile = _pile(rng, shape, rng.uniform(0.7, 0.97), sign)
    return Site(shape.polygon, Joined((pile,)), pile.volume)


def _of_two_parts(rng: Rng, width: float, sign: float) -> Site:
    """Return two outlines at some distance as one area, a pile in each."""
    apart = rng.uniform(1.05, 2.0) * width / 4
    angle = rng.uniform(0, math.pi)
    dx, dy = apart * math.cos(angle), apart * math.sin(angle)
    # No radius of these is longer than a quarter of the width.
    shapes = [_bounded_star(rng, width / 4, x, y) for x, y in ((dx, dy), (-dx, -dy))]
    piles = tuple(_pile(rng, shape, rng.uniform(0.7, 0.97), sign) for shape in shapes)
    outline = MultiPolygon([shape.polygon for shape in shapes])
    return Site(outline, Joined(piles), sum(pile.volume for pile in piles))


def _of_an_l(rng: Rng, width: float, sign: float) -> Site:
    """Return an L with a round pile in its corner, or two joined ridges along its arms."""
    arm, end = rng.uniform(0.3, 0.5) * width, width / 2
    near = arm / 2 - end
    arms = (Rectangle(near, 0, (arm / 2, end)), Rectangle(0, near, (end, arm / 2)))
    inner = arm - end
    outline = Polygon(
        [(-end, -end), (end, -end), (end, inner), (inner, inner), (inner, end), (-end, end)]
    )
    if rng.random() < 0.5:
        pile = _pile(rng, _bounded_star(rng, arm / 2, near, near), 0.95, sign)
        return Site(outline, Joined((pile,)), pile.volume)
    form = Joined(tuple(_pile(rng, shape, rng.uniform(0.7, 0.95), sign) for shape in arms))
    return Site(outline, form, integral(form, outline))


def _bounded_star(rng: Rng, radius: float, x: float, y: float) -> Star:
    """Return a star none of whose radii is longer than `radius`."""
    shape = star(rng, radius, x, y)
    return Star(x, y, shape.radii * (radius / shape.radii.max()))


def any_site(rng: Rng, width: float, sign: float = 1.0) -> Site:
    """Return a pile (or, by its sign, a pit) in an outline of any kind."""
    kind = rng.random()
    if kind < 0.65:
        return _of_one_part(rng, width, sign)
    return (_of_two_parts if kind < 0.8 else _of_an_l)(rng, width, sign)


def _pit(rng: Rng, width: float) -> Site:
    return any_site(rng, width, -1.0)


def _touching(rng: Rng, width: float) -> Site:
    """Return two to five piles that run into each other in one outline."""
    shape = _bounded_star(rng, width / 2, 0, 0) if rng.random() < 0.5 else _rectangle(rng, width)
    outline = shape.polygon
    depth = outline.boundary.distance(Point(0, 0))
    piles = []
    for angle in rng.uniform(0, 2 * math.pi) + np.arange(rng.integers(2, 6)) * 2.4:
        away = rng.uniform(0.2, 0.5) * depth
        foot = _bounded_star(
            rng, 0.95 * depth - away, away * math.cos(angle), away * math.sin(angle)
        )
        piles.append(_pile(rng, foot, 1.0))
    form = Joined(tuple(piles))
    return Site(outline, form, integral(form, outline))


def _neighboured(rng: Rng, width: float) -> Site:
    """Return a site with one to three piles beside its outline, 0.2 to 2 m from it."""
    site = any_site(rng, width)
    others = []
    for _ in range(rng.integers(1, 4)):
        radius = width * rng.uniform(0.1, 0.4)
        ring = site.outline.buffer(radius + rng.uniform(0.2, 2.0)).boundary
        at = ring.interpolate(rng.random(), normalized=True)
        others.append(_pile(rng, _bounded_star(rng, radius, at.x, at.y), 1.0))
    return site.beside(others)


def _thin_fill(rng: Rng, width: float) -> Site:
    """Return 2 cm of fill over 1 ha, that ends within 3 % of its width."""
    shape = star(rng, 56.0) if rng.random() < 0.5 else _rectangle(rng, 113.0)
    grown = math.sqrt(1e4 / shape.polygon.area)
    shape = (
        Star(0, 0, shape.radii * grown)
        if isinstance(shape, Star)
        else Rectangle(0, 0, (shape.halves[0] * grown, shape.halves[1] * grown), shape.angle)
    )
    pile = Pile(shape, rng.uniform(0.95, 1.0), 0.02, Profile(flat=0.97))
    return Site(shape.polygon, Joined((pile,)), pile.volume)


def _bare(rng: Rng, width: float) -> Site:
    site = any_site(rng, width)
    return Site(site.outline, Joined(), 0.0)


def _gully(rng: Rng, width: float) -> Site:
    """Return a winding channel that crosses the outline at both ends, or ends within it."""
    across = width * rng.uniform(0.1, 0.25)
    length = math.inf if rng.random() < 0.5 else width * rng.uniform(0.8, 0.95)
    gully = Gully(
        width=across,
        depth=across * rng.uniform(0.15, 0.5),
        meander=across * rng.uniform(0, 0.7),
        period=across * rng.uniform(4, 10),
        phase=rng.uniform(0, 2 * math.pi),
        angle=rng.uniform(0, math.pi),
        length=length,
        profile=Profile(float(rng.choice([0.0, 0.3])), rng.uniform(0, 1)),
    )
    room = across * rng.uniform(0.15, 0.6)
    outline = gully.corridor(room, width / 2)
    if rng.random() < 0.5:
        half = across / 2 + gully.meander + room
        outline = affinity.rotate(
            box(-half, -width / 2, half, width / 2), gully.angle, origin=(0, 0), use_radians=True
        )
    form = Joined((gully,))
    return Site(outline, form, integral(form, outline))


# --- classes


@dataclass(frozen=True)
class Kind:
    """What the surveys of a class are drawn from.

    Attributes
    ----------
    site : from random numbers and a width, metres.
    relief : RMS of the ground about its plane, metres: one of these.
    slope : of that plane, degrees.
    white : standard deviation of the points' own noise, metres.
    correlated, length : standard deviation of the noise that neighbours share, metres, in a share
        `shared` of the surveys, and the length of its covariance.
    outliers : share of points, in a share `spoiled` of the surveys.
    width, count : of the area, metres, and number of points.
    uneven : whether the points' own noise grows with the slope of what is measured, and to one side
        as where few photographs look.
    gaps : whether there are holes and a blind strip.
    true_warnings : codes of warnings about the outline that are right in this class.
    """

    site: Callable[[Rng, float], Site] = any_site
    relief: Sequence[float] = (0.0,)
    slope: Range = (0.0, 10.0)
    white: Range = (0.005, 0.04)
    correlated: Range = (0.005, 0.02)
    length: Range = (0.3, 3.0)
    shared: float = 0.33
    outliers: Range = (0.001, 0.01)
    spoiled: float = 0.4
    width: Range = (5.0, 60.0)
    count: Range = (20_000, 40_000)
    uneven: bool = False
    gaps: bool = False
    true_warnings: Sequence[str] = ()


#: Relief of the classes that are about something else: none in half of the surveys.
_MILD = (0.0, 0.0, 0.03, 0.1)

CLASSES: Mapping[str, Kind] = {
    "relief-0": Kind(),
    "relief-0.03": Kind(relief=(0.03,)),
    "relief-0.1": Kind(relief=(0.1,)),
    "relief-0.3": Kind(relief=(0.3,)),
    "slopes": Kind(slope=(10.0, 35.0)),
    "white-noise": Kind(white=(0.01, 0.1), shared=0.0),
    "correlated-noise": Kind(correlated=(0.005, 0.05), shared=1.0),
    "uneven-noise": Kind(white=(0.005, 0.02), uneven=True),
    "gaps": Kind(relief=_MILD, gaps=True, true_warnings=("outline-without-points",)),
    "outliers": Kind(relief=_MILD, outliers=(0.01, 0.03), spoiled=1.0),
    "touching-piles": Kind(_touching, relief=_MILD),
    "neighbours": Kind(_neighboured, relief=_MILD),
    "thin-fill": Kind(_thin_fill, slope=(0.0, 3.0), white=(0.005, 0.02), spoiled=0.0,
                      correlated=(0.002, 0.01), width=(113.0, 113.1), count=(60_000, 100_000)),
    "flat-ground": Kind(_bare),
    "gullies": Kind(_gully, relief=_MILD, true_warnings=("outline-crosses-channel",)),
    "pits": Kind(_pit, relief=_MILD),
    "densities": Kind(relief=_MILD, width=(12.0, 20.0), count=(20_000, 200_000)),
}  # fmt: skip


# --- surveys


@dataclass(frozen=True)
class Survey:
    """A survey, the area to measure, and what is there.

    Attributes
    ----------
    points : (3, N) float64, easting, northing and height, metres.
    outline : in the same coordinates.
    truth : volume over the true ground, m3.
    facts : what was drawn.
    """

    points: FloatArray
    outline: Outline
    truth: float
    facts: Mapping[str, Union[float, str]] = field(default_factory=dict)


def generator(name: str, number: int, seed: int = 0) -> Rng:
    """Return the random numbers of one survey of a class."""
    return np.random.default_rng([seed, zlib.crc32(name.encode()), number])


def make_survey(name: str, number: int, seed: int = 0) -> Survey:
    """Return one survey of a class."""
    rng, kind = generator(name, number, seed), CLASSES[name]
    width = log_uniform(rng, kind.width)
    site = kind.site(rng, width)
    facts: Facts = {"width": width}
    x, y = places(rng, site.outline, round(log_uniform(rng, kind.count)), facts)
    if kind.gaps:
        x, y = _with_gaps(rng, x, y, site.outline)
    wide = 2 * float(np.abs([x, y]).max())
    ground = make_ground(rng, kind, wide, facts)
    noise = _noise(rng, kind, wide, site.form, facts)
    z = LEVEL + ground(x, y) + site.form(x, y) + noise(x, y)
    if rng.random() < kind.spoiled:
        facts["outliers"] = share = log_uniform(rng, kind.outliers)
        z += _outliers(rng, len(z), share)
    points = np.stack([x + EAST, y + NORTH, z])
    return Survey(points, affinity.translate(site.outline, EAST, NORTH), site.truth, facts)


def places(rng: Rng, outline: Outline, count: int, facts: Facts) -> Tuple[FloatArray, FloatArray]:
    """Return where the points of a cloud around an outline lie, (N,) each.

    It is a turned rectangle that goes on around the outline by half of its width or more, or in one
    survey of seven by 1 to 2 m. Places are random, or a raster each point of which is off its place
    by up to a third of the spacing; in a third of the surveys they thin out to one side, to 30 %.
    """
    angle = rng.uniform(0, math.pi / 2)
    corner, sides = turned_box(outline, angle)
    narrow = rng.random() < 1 / 7
    margin = rng.uniform(1, 2) if narrow else rng.uniform(0.5, 1.2) * sides.min()
    facts["margin"] = float(margin)
    return scattered(rng, angle, corner - margin, sides + 2 * margin, count)


def turned_box(outline: Outline, angle: float) -> Tuple[FloatArray, FloatArray]:
    """Return the lower corner and the sides, (2,) each, of the box that holds an outline.

    Its first side is turned by an angle from x, as is the frame of the corner.
    """
    box_ = affinity.rotate(outline, -angle, origin=(0, 0), use_radians=True).bounds
    return np.array(box_[:2]), np.array([box_[2] - box_[0], box_[3] - box_[1]])


def scattered(
    rng: Rng, angle: float, corner: FloatArray, sides: FloatArray, count: int
) -> Tuple[FloatArray, FloatArray]:
    """Return about `count` places in a box as `turned_box` returns it, spread as in `places`."""
    if rng.random() < 0.5:
        u, v = rng.uniform(0, 1, (2, count)) * sides[:, None]
    else:
        step = math.sqrt(sides.prod() / count)
        grid = np.meshgrid(*(np.arange(step / 2, side, step) for side in sides))
        u, v = (line.ravel() + rng.uniform(-step / 3, step / 3, line.size) for line in grid)
    if rng.random() < 1 / 3:
        kept = rng.random(len(u)) < 1 - 0.7 * np.clip(u / sides[0], 0, 1)
        u, v = u[kept], v[kept]
    u, v, c, s = u + corner[0], v + corner[1], math.cos(angle), math.sin(angle)
    return c * u - s * v, s * u + c * v


def _with_gaps(
    rng: Rng, x: FloatArray, y: FloatArray, outline: Outline
) -> Tuple[FloatArray, FloatArray]:
    """Return the places without those in three to eight holes and, in half of them, a strip.

    Holes are up to a tenth of the outline's width in radius, the strip up to 6 % of it wide.
    """
    left, bottom, right, top = outline.bounds
    width = max(right - left, top - bottom)
    kept = np.ones(len(x), dtype=bool)
    for _ in range(rng.integers(3, 9)):
        east, north = rng.uniform(left, right), rng.uniform(bottom, top)
        kept &= np.hypot(x - east, y - north) > rng.uniform(0.02, 0.1) * width
    if rng.random() < 0.5:
        angle, off = rng.uniform(0, math.pi), rng.uniform(-0.3, 0.3) * width
        across = x * math.cos(angle) + y * math.sin(angle) - off
        kept &= np.abs(across) > rng.uniform(0.01, 0.03) * width
    return x[kept], y[kept]


def make_ground(rng: Rng, kind: Kind, wide: float, facts: Facts) -> Height:
    """Return a plane with relief, for a square site of the given width around the origin."""
    facts["slope"] = slope = rng.uniform(*kind.slope)
    facts["relief"] = relief = float(rng.choice(kind.relief))
    flat = plane(math.tan(math.radians(slope)), rng.uniform(0, 2 * math.pi))
    if not relief:
        return flat
    facts["ground"] = name = str(rng.choice(list(RELIEFS)))
    facts["wavelength"] = wavelength = log_uniform(rng, WAVELENGTHS)
    return Sum(((1.0, flat), (relief, RELIEFS[name](rng, wide, wavelength))))


def _noise(rng: Rng, kind: Kind, wide: float, form: Height, facts: Facts) -> Height:
    """Return white noise and, in some surveys, noise that neighbours share."""
    facts["white"] = white = log_uniform(rng, kind.white)
    terms: Tuple[Tuple[float, Height], ...] = ((white, lambda x, y: rng.standard_normal(x.shape)),)
    if kind.uneven:
        terms = ((white, _uneven_noise(rng, form, wide)),)
    if rng.random() < kind.shared:
        facts["correlated"] = std = log_uniform(rng, kind.correlated)
        facts["length"] = length = log_uniform(rng, kind.length)
        spectrum = matern(float(rng.choice([0.5, 1.5, math.inf])))
        terms += ((std, gaussian_field(rng, spectrum, wide, WAVELENGTH * length)),)
    return Sum(terms)


def _uneven_noise(rng: Rng, form: Height, wide: float) -> Height:
    """Return noise of std (1 + 3 slope of the form) r, with r from 1 to 3 across the site."""
    angle = rng.uniform(0, 2 * math.pi)

    def noise(x: FloatArray, y: FloatArray) -> FloatArray:
        step = 0.05
        east, north = form(x + step, y) - form(x - step, y), form(x, y + step) - form(x, y - step)
        slope = np.hypot(east, north) / (2 * step)
        across = (x * math.cos(angle) + y * math.sin(angle)) / wide
        std = (1 + 3 * slope) * (2 + np.clip(across, -1, 1))
        return np.asarray(std * rng.standard_normal(x.shape))

    return noise


def _outliers(rng: Rng, count: int, share: float) -> FloatArray:
    """Return what outliers add to the heights (N,): high, low or both, all alike or exponential."""
    off = rng.random(count) < share
    size = np.full(count, rng.uniform(0.3, 6.0))
    if rng.random() < 0.5:
        size = rng.exponential(size)
    high = rng.choice([0.0, 0.5, 1.0])
    return np.where(off, np.where(rng.random(count) < high, size, -size), 0.0)
