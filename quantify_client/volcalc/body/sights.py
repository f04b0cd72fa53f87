"""How much of what cameras see through is sure to be empty.

A reconstruction has points of a surface where two cameras or more see it, and none of them from
along it. A surface that one camera sees, or that others see at a slant, is missing from the cloud:
what is behind it then seems to be seen, through the body. Cameras agree that space is empty where,
whichever way a surface there might face, two of them would have shown it.

A cloud in which one camera was enough has many points that one alone sees, about as many as two do.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...types import FloatArray

__all__ = ["Agreement", "one_is_enough"]

#: Cameras that a point takes, and the least angle between line of sight and surface, degrees:
#: dense matching finds hardly anything below (method.md).
_LEAST = 2
_SLANT = 20.0

#: Ways a surface may face: (64, 3) unit vectors, even over half a sphere (Fibonacci lattice).
_UP = (np.arange(64) + 0.5) / 64
_AROUND = np.arange(64) * np.pi * (3.0 - np.sqrt(5.0))
_FLAT = np.sqrt(1.0 - _UP**2)
_WAYS = np.column_stack([_FLAT * np.cos(_AROUND), _FLAT * np.sin(_AROUND), _UP])

#: One camera is enough where one alone sees so many of the points, and so many times as many as two
#: do (measured: method.md).
_ALONE = 0.02
_TO_TWO = 0.35


def one_is_enough(seen: npt.NDArray[np.bool_]) -> bool:
    """Whether a point that one camera sees is in the cloud.

    Parameters
    ----------
    seen : (K, N) which cameras see which points from the front.
    """
    count = seen.sum(axis=0)
    one, two = np.mean(count == 1), np.mean(count == 2)
    return bool(one > max(_ALONE, _TO_TWO * two))


class Agreement:
    """What cameras that see through points (N, 3) agree on."""

    def __init__(self, points: FloatArray) -> None:
        self.points = points
        self.shown = np.zeros((len(points), len(_WAYS)), dtype=np.int16)

    def add(self, place: FloatArray, which: npt.NDArray[np.bool_]) -> None:
        """Count a camera that sees through some (N,) of the points."""
        sight = place - self.points[which]
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        self.shown[which] += np.abs(sight @ _WAYS.T) > np.sin(np.radians(_SLANT))

    def empty(self) -> npt.NDArray[np.bool_]:
        """(N,) True where enough cameras would have shown a surface, whichever way it faced."""
        return np.asarray(self.shown.min(axis=1) >= _LEAST)
