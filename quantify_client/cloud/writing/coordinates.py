"""The scale and the offsets with which coordinates are written.

LAS holds each coordinate as a 32-bit integer: X = round((x - offset) / scale).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Iterable, List, Optional, Tuple

import numpy as np
import numpy.typing as npt

from ...errors import OutputError
from ...types import Bounds, FloatArray, Notice

Move = Callable[[FloatArray, FloatArray, FloatArray], Tuple[FloatArray, FloatArray, FloatArray]]

COARSEST = 0.001  # in the unit of the output, as long as its integers reach that far
_SHARE = 1e-5  # of the power of ten below a box's longest side, for files without steps
_ALIKE = 3.0  # a move that changes lengths by less than this leaves the steps as they are
_ROUNDING = 1e-6  # in powers of ten: a thousandth of a metre is a millimetre
_LARGEST = 2**31 - 1
_PROBE = 0.01  # share of the box over which a move is tried


@dataclass(frozen=True)
class Quantization:
    """The scale of x, y and z, and their offsets."""

    scale: float
    offsets: Tuple[float, ...]

    def integers(self, out: Path, axis: int, values: FloatArray) -> npt.NDArray[np.int32]:
        """Return coordinates as a file holds them.

        Parameters
        ----------
        out : the file, for messages.
        values : (N,) float64; coordinates of one axis (0, 1 or 2).

        Raises
        ------
        OutputError
            A coordinate that is NaN, or farther from the offset than 2**31 steps.
        """
        counted = np.rint((values - self.offsets[axis]) / self.scale)
        with np.errstate(invalid="ignore"):
            bad = ~(np.abs(counted) <= _LARGEST)
        if bad.any():
            reach = _LARGEST * self.scale
            raise OutputError(
                f"{out}: a moved point has {'xyz'[axis]} = {values[np.argmax(bad)]:.10g}; expected "
                f"{self.offsets[axis] - reach:.10g} to {self.offsets[axis] + reach:.10g}, around "
                "the box that the cloud's header gives: check the header's bounds, and remove "
                "points far from all others"
            )
        whole: npt.NDArray[np.int32] = counted.astype(np.int32)
        return whole


def fitted(step: float, bounds: Bounds) -> Tuple[Quantization, Tuple[Notice, ...]]:
    """Return offsets in the middle of a box, in whole numbers, and a scale that reaches its ends.

    Returns
    -------
    quantization : with a scale of `step` times a power of ten.
    warnings : what is to be said when it is coarser than `step`.
    """
    low, high = _ends(bounds)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise OutputError(
            f"the box of the moved points is {tuple(low.tolist())} to {tuple(high.tolist())}; "
            "expected finite numbers: check the control and the cloud's bounds"
        )
    middle = np.round((low + high) / 2) + 0.0  # no negative zero
    reach = float(max((high - middle).max(), (middle - low).max()))
    used = step
    while reach * 1.01 > _LARGEST * used:
        used *= 10
    quantization = Quantization(used, tuple(middle.tolist()))
    if used == step:
        return quantization, ()
    text = (
        f"coordinates are written in steps of {used:g} instead of {step:g}: with finer steps a "
        f"LAS file cannot span {2 * reach:.6g}"
    )
    return quantization, (Notice("coarser-coordinates", text, step=used, wanted=step),)


def wanted_step(
    sources: Iterable[Tuple[Optional[Tuple[float, ...]], Optional[Bounds]]],
    move: Move,
    after: Bounds,
) -> float:
    """Return a scale that keeps the resolution of the files.

    That is the finest step of the files, at most 0.001, or what it has become where the move
    changes the unit (degrees to metres, say). Files without steps of their own (PLY, text) are
    given a hundred-thousandth of the box.

    Parameters
    ----------
    sources : steps and bounds of each file.
    move : the way from the coordinates in the files to those written.
    after : the box of the moved points.
    """
    low, high = _ends(after)
    side = float((high - low).max())
    found: List[float] = [COARSEST]
    tried = set()
    for steps, bounds in sources:
        if steps is None:
            found.append(_SHARE * _power_below(side) if 0 < side < math.inf else COARSEST)
        elif steps not in tried:
            tried.add(steps)
            found.append(_moved_step(steps, bounds, move))
    return min(found)


def _ends(box: Bounds) -> Tuple[FloatArray, FloatArray]:
    low = np.array([box.min_x, box.min_y, box.min_z])
    return low, np.array([box.max_x, box.max_y, box.max_z])


def _power_below(value: float) -> float:
    return 10.0 ** math.floor(math.log10(value) + _ROUNDING)


def _moved_step(steps: Tuple[float, ...], bounds: Optional[Bounds], move: Move) -> float:
    """Return the finest of three steps, after the move."""
    if bounds is None:
        return min(steps)
    low, high = _ends(bounds)
    apart = np.maximum((high - low) * _PROBE, np.array(steps) * 1000)
    at = np.vstack([np.zeros(3), np.diag(apart)]) + (low + high) / 2
    moved = np.column_stack(move(*(np.ascontiguousarray(at[:, axis]) for axis in range(3))))
    with np.errstate(over="ignore", invalid="ignore"):  # damaged bounds: the steps stay
        stretch = np.linalg.norm(moved[1:] - moved[0], axis=1) / apart
    after = []
    for step, factor in zip(steps, stretch.tolist()):
        alike = not math.isfinite(factor) or 1 / _ALIKE < factor < _ALIKE or factor == 0
        after.append(step if alike else _power_below(step * factor))
    return min(after)
