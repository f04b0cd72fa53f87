"""Covariance of the ground's heights: which are likely, and what they say of places between.

The ground is a plane and, around it, a random field g with the Matern covariance

    C(r) = s^2 M(r / l; v),  M(t; 1/2) = exp(-t),  M(t; 3/2) = (1 + a) exp(-a), a = sqrt(3) t,
    M(t; 5/2) = (1 + b + b^2 / 3) exp(-b), b = sqrt(5) t                (Stein 1999, section 2.10)

seen as means over blocks, each with a white error of variance q s^2 / n for its n cells. Smoothness
v, range l, the ratio q and the scale s are not known: all that a grid of them allows is averaged,
each with its restricted likelihood (REML; Patterson and Thompson 1971, Harville 1974), under priors
flat in log l, log q and log s (Handcock and Stein 1993). The plane's coefficients have flat priors,
so that each prediction is that of universal kriging (Cressie 1993, section 3.4; Rasmussen and
Williams 2006, section 2.7).

Change of support. The mean of C over two blocks d apart is about C at sqrt(d^2 + a + b), with a and
b the mean square distances of the blocks' points from their middles (within 0.02 of the variance
for squares side by side). C is a mixture of Gaussians in r (Schoenberg 1938), so that these values
form a covariance matrix whatever the blocks; what a block's own variance lacks at short ranges is
added to the diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Iterator, NamedTuple

import numpy as np
from scipy import special

from ...types import FloatArray

__all__ = ["Blocks", "Prediction", "block_covariance", "matern", "predict_blocks"]

#: Smoothness v of the fields that are tried: rough as a random walk, to twice differentiable.
SMOOTHNESS = (0.5, 1.5, 2.5)

#: Ranges that are tried, evenly in their logarithm: from half of the finest block to twice the
#: distance over which there are data. A range beyond it looks like the plane.
_RANGES = 5
_SHORTEST, _LONGEST = 0.5, 2.0

#: Ratios of the white error's variance that are tried, over so many decades around the field's own.
_RATIOS = 24
_DECADES = 4.0

#: Models that have less than this share of the whole likelihood add nothing that shows.
_LEAST_SHARE = 1e-3

#: Least variance of a contrast, as a share of the largest: rounding.
_LEAST_VARIANCE = 1e-10


class Blocks(NamedTuple):
    """Places whose mean heights are known or wanted, all (N,), metres.

    Attributes
    ----------
    x, y : middles. spread : mean square distance of the block's points from its middle: h^2 / 6 for
        a square of side h.
    """

    x: FloatArray
    y: FloatArray
    spread: FloatArray

    def squares_to(self, other: Blocks) -> FloatArray:
        """Return the mean square distances between blocks of both, (N, M)."""
        square = (self.x[:, None] - other.x) ** 2 + (self.y[:, None] - other.y) ** 2
        return np.asarray(square + self.spread[:, None] + other.spread)


@dataclass(frozen=True)
class Prediction:
    """Mean heights of blocks.

    Attributes
    ----------
    mean : (T,) metres.
    covariance : (K, K) of the errors of the first K, m2.
    unshared, unshared_std : variance of what is white, in each cell: noise, and all that is finer
        than the blocks; and the standard deviation of that variance, m2.
    """

    mean: FloatArray
    covariance: FloatArray
    unshared: float
    unshared_std: float


class _Model(NamedTuple):
    """One covariance function, seen through the M = N - 3 contrasts of N blocks that no plane has.

    The contrasts are turned so that they are independent: `values` (M,) with the variances s^2
    (`variances` + q). `weight` (Q,) is the share of each ratio q in the likelihood of all, `total`
    (M, Q) variances + ratio, and `scale` (Q,) the expected s^2.
    """

    smoothness: float
    length: float
    white: FloatArray
    turn: FloatArray
    values: FloatArray
    ratio: FloatArray
    total: FloatArray
    scale: FloatArray
    weight: FloatArray


def matern(r: FloatArray, smoothness: float, length: float) -> FloatArray:
    """Return the Matern correlation at distances `r`, for a smoothness of 1/2, 3/2 or 5/2.

    >>> matern(np.array([0.0, 2.0]), 0.5, 2.0).round(4)
    array([1.    , 0.3679])
    """
    t = r * (np.sqrt(2.0 * smoothness) / length)
    decay = np.exp(-t)
    if smoothness == 0.5:
        return np.asarray(decay)
    return np.asarray((1.0 + t if smoothness == 1.5 else 1.0 + t + t * t / 3.0) * decay)


def _difference_nodes(order: int) -> tuple[FloatArray, FloatArray]:
    """Return distances and weights that average a function of the distance in a unit square.

    Coordinate differences u of two random places in it have the density 2 (1 - u) on 0 .. 1.
    """
    node, weight = special.roots_legendre(order)
    u, density = (node + 1) / 2, weight * (1 - (node + 1) / 2)
    return np.hypot(u[:, None], u).ravel(), np.outer(density, density).ravel()


_DISTANCES, _WEIGHTS = _difference_nodes(8)


def block_covariance(blocks: Blocks, smoothness: float, length: float) -> FloatArray:
    """Return the correlations (N, N) of the means over blocks of a field of variance 1."""
    matrix = matern(np.sqrt(blocks.squares_to(blocks)), smoothness, length)
    side, which = np.unique(np.sqrt(6.0 * blocks.spread), return_inverse=True)
    own = matern(side[:, None] * _DISTANCES, smoothness, length) @ _WEIGHTS
    diagonal = np.diag_indices(len(matrix))
    matrix[diagonal] = np.maximum(matrix[diagonal], own[which])
    return matrix


def predict_blocks(
    known: Blocks,
    z: FloatArray,
    n: FloatArray,
    wanted: Blocks,
    finest: float,
    extent: float,
    joint: int | None = None,
) -> Prediction:
    """Return the mean heights of blocks from those of others, averaged over all likely covariances.

    Parameters
    ----------
    known : N >= 6 blocks, not on a line.
    z : (N,) their mean heights, metres.
    n : (N,) number of cells in each.
    wanted : T blocks.
    finest : side of the finest blocks, metres.
    extent : distance over which there are data, metres.
    joint : covariances are wanted of so many, the first: of all by default.
    """
    root, level = np.sqrt(n), float(z.mean())
    centre = known.x.mean(), known.y.mean()
    q, r = np.linalg.qr(_plane_terms(known, centre, extent) * root[:, None], mode="complete")
    on_plane, contrasts = q[:, :3], q[:, 3:]
    weighted = (z - level) * root
    # The plane through the blocks, and what it gives at the wanted ones: coefficients (T, 3).
    through = np.linalg.solve(r[:3].T, _plane_terms(wanted, centre, extent).T).T
    trend = through @ (on_plane.T @ weighted)
    means, weights, unshared, square = [], [], 0.0, 0.0
    first = Blocks(*(values[:joint] for values in wanted))
    covariance = np.zeros((len(first.x), len(first.x)))
    squares = np.sqrt(wanted.squares_to(known))
    lengths = np.geomspace(_SHORTEST * finest, max(_LONGEST * extent, finest), _RANGES)
    for model in _likely_models(known, root, contrasts, contrasts.T @ weighted, lengths):
        cross = matern(squares, model.smoothness, model.length) * root
        # What the wanted heights, less the plane through the data, have in common with the
        # contrasts.
        share = (cross - through @ (on_plane.T @ model.white)) @ contrasts @ model.turn
        means.append(trend[:, None] + share @ (model.values[:, None] / model.total))
        weights.append(model.weight)
        cross, share, plane = cross[:joint], share[:joint], through[:joint]
        error = block_covariance(first, model.smoothness, model.length)
        along = cross @ on_plane @ plane.T
        error += plane @ (on_plane.T @ model.white @ on_plane) @ plane.T - along - along.T
        scaled = model.weight * model.scale
        covariance += scaled.sum() * error + (scaled @ model.ratio) * (plane @ plane.T)
        unshared += float(scaled @ model.ratio)
        # The scale is inverse gamma, with two moments for more than four contrasts.
        free = max(len(model.values) - 2.0, 3.0)
        square += float(scaled @ (model.scale * model.ratio**2)) * free / (free - 2.0)
        covariance -= (share * (scaled / model.total).sum(axis=1)) @ share.T
    mean, weight = np.concatenate(means, axis=1), np.concatenate(weights)
    best = mean @ weight / weight.sum()
    apart = ((mean - best[:, None]) * np.sqrt(weight))[:joint]
    total = float(weight.sum())
    unshared /= total
    spread = float(np.sqrt(max(square / total - unshared**2, 0.0)))
    return Prediction(best + level, (covariance + apart @ apart.T) / total, unshared, spread)


def _plane_terms(blocks: Blocks, centre: tuple[float, float], extent: float) -> FloatArray:
    """Return 1, x and y of blocks, (N, 3), about a centre and in units of the extent."""
    x, y = (blocks.x - centre[0]) / extent, (blocks.y - centre[1]) / extent
    return np.column_stack([np.ones_like(x), x, y])


def _likely_models(
    known: Blocks, root: FloatArray, contrasts: FloatArray, values: FloatArray, lengths: FloatArray
) -> Iterator[_Model]:
    """Yield the models that have a share in the likelihood, those of weights that sum to about 1.

    Parameters
    ----------
    root : (N,) square roots of the blocks' cells: times these, all blocks have the same white
        error.
    contrasts : (N, M), columns orthonormal and orthogonal to every plane.
    values : (M,) the contrasts of the heights.
    lengths : ranges to be tried, metres.
    """
    kinds = [(v, float(length)) for v in SMOOTHNESS for length in lengths]
    white = np.stack([block_covariance(known, *kind) for kind in kinds]) * np.outer(root, root)
    variances, turns = np.linalg.eigh(contrasts.T @ white @ contrasts)
    variances = np.maximum(variances, _LEAST_VARIANCE * variances[:, -1:])
    turned = values @ turns
    steps = np.geomspace(10.0**-_DECADES, 10.0**_DECADES, _RATIOS)
    ratios = variances.mean(axis=1)[:, None] * steps
    totals = variances[:, :, None] + ratios[:, None, :]
    square = (turned[:, :, None] ** 2 / totals).sum(axis=1)
    count = len(values)
    tiny = np.finfo(np.float64).tiny
    likelihood = -0.5 * (np.log(totals).sum(axis=1) + count * np.log(square + tiny))
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    for i in np.flatnonzero(weight.sum(axis=1) >= _LEAST_SHARE):
        scale = square[i] / (count - 2)
        smoothness, length = kinds[i]
        seen = turns[i], turned[i], ratios[i], totals[i]
        yield _Model(smoothness, length, white[i], *seen, scale, weight[i])
