"""Random heaps of known volume on floors, and points of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable, Tuple

import numpy as np

OFFSET = np.array([576_700.0, 5_188_140.0, 160.0])
KINDS = ("cone", "cap", "truncated", "windrow", "pair")
SMOOTH = ("bell", "wave", "skirt")
"""They taper off into the floor: a normal curve, a cosine, a cone with a foot that fades."""


@dataclass(frozen=True)
class Heap:
    """A heap on the plane z = 0.

    Attributes
    ----------
    kind : one of `KINDS` or `SMOOTH`.
    heights : from (N,) x and y to heights, metres.
    volume : m3.
    half : half the side of a square about the origin that it fits in, metres.
    top : its height, metres.
    """

    kind: str
    heights: Callable[[np.ndarray, np.ndarray], np.ndarray]
    volume: float
    half: float
    top: float


def random_heap(rng: np.random.Generator, kind: str) -> Heap:
    """Return a heap 2 to 60 m wide."""
    a = float(np.exp(rng.uniform(0.0, math.log(30.0))))
    b = a * rng.uniform(0.5, 1.0)
    top = b * math.tan(math.radians(rng.uniform(8.0, 38.0)))
    if kind == "cone":
        return Heap(
            kind, lambda x, y: top * over(1.0 - ring(x / a, y / b)), third(a, b, top), a, top
        )
    if kind == "cap":
        # A ball that is cut so that its cap is as high, made oblong.
        high = top / 2.0
        ball = (b**2 + high**2) / (2.0 * high)

        def cap(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            away = np.minimum(ring(x * b / a, y), b)
            return np.sqrt(ball**2 - away**2) - (ball - high)

        return Heap(kind, cap, math.pi * high**2 * (3.0 * ball - high) / 3.0 * a / b, a, high)
    if kind == "truncated":
        kept = rng.uniform(0.2, 0.7)
        high = top * (1.0 - kept)
        volume = third(a, b, high) * (1.0 + kept + kept**2)
        return Heap(
            kind,
            lambda x, y: np.minimum(high, top * over(1.0 - ring(x / a, y / b))),
            volume,
            a,
            high,
        )
    if kind in SMOOTH:
        return smooth(kind, a, b, top)
    if kind == "windrow":
        reach, long = a * rng.uniform(0.2, 0.5), 0.0
        long, high = a - reach, top * reach / b
        volume = 2.0 * long * reach * high + third(reach, reach, high)
        return Heap(
            kind,
            lambda x, y: high * over(1.0 - ring(over(np.abs(x) - long), y) / reach),
            volume,
            a,
            high,
        )
    left, right = a * rng.uniform(0.5, 0.7), a * rng.uniform(0.35, 0.7)
    slope = top / b

    def pair(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        one, other = left - ring(x + a - left, y), right - ring(x - a + right, y)
        return slope * over(np.maximum(one, other))

    step = a / 500.0
    x, y = np.meshgrid(*[np.arange(-a, a, step) + 0.5 * step] * 2)
    return Heap(kind, pair, float(pair(x, y).sum()) * step**2, a, slope * max(left, right))


def smooth(kind: str, a: float, b: float, top: float) -> Heap:
    """Return a heap whose profile goes on for ever, or nearly: less than 0.01 % is beyond `half`.

    Volumes are 2 pi times the integral of r h(r), times b / a.
    """
    width = {"bell": a / 4.5, "wave": a, "skirt": a / 6.0}[kind]

    def profile(r: np.ndarray) -> np.ndarray:
        if kind == "bell":
            return np.exp(-0.5 * r**2)
        if kind == "wave":
            return np.where(r < 1.0, 0.5 + 0.5 * np.cos(math.pi * r), 0.0)
        return np.where(r < 1.0, 1.0 - 0.85 * r, 0.15 * np.exp(-2.0 * (r - 1.0)))

    integral = {
        "bell": 1.0,
        "wave": 0.25 - 1.0 / math.pi**2,
        "skirt": 0.5 - 0.85 / 3.0 + 0.15 * (0.5 + 0.25),
    }[kind]
    return Heap(
        kind,
        lambda x, y: top * profile(ring(x, y * a / b) / width),
        2.0 * math.pi * integral * width**2 * b / a * top,
        a,
        top,
    )


def ring(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.hypot(x, y)


def over(values: np.ndarray) -> np.ndarray:
    return np.maximum(values, 0.0)


def third(a: float, b: float, height: float) -> float:
    return math.pi * a * b * height / 3.0


def sampled(heap: Heap, rng: np.random.Generator, most: int) -> Tuple[np.ndarray, float]:
    """Return the points of a heap on its floor, and their noise over its height."""
    count = int(np.exp(rng.uniform(math.log(5_000), math.log(most))))
    half = heap.half * rng.uniform(1.5, 3.0)
    if rng.random() < 0.5:
        x, y = rng.uniform(-half, half, (2, count))
    else:
        step = 2.0 * half / math.sqrt(count)
        x, y = np.meshgrid(*[np.arange(-half, half, step)] * 2)
        x, y = (axis.ravel() + rng.uniform(0.0, 0.8 * step, axis.size) for axis in (x, y))
    share = max(0.0, rng.uniform(-0.005, 0.01))
    dx, dy = heap.half * rng.uniform(-0.2, 0.2, 2)
    points = np.column_stack([x, y, heap.heights(x - dx, y - dy)])
    points += rng.normal(0.0, 1.0, points.shape) * share * heap.top
    turn, tilt = rng.uniform(0.0, 2.0 * math.pi), math.radians(rng.uniform(0.0, 10.0))
    about = np.array(
        [
            [math.cos(turn), -math.sin(turn), 0.0],
            [math.sin(turn), math.cos(turn), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    tilted = np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, math.cos(tilt), -math.sin(tilt)],
            [0.0, math.sin(tilt), math.cos(tilt)],
        ]
    )
    return points @ (tilted @ about).T + OFFSET, share
