"""What all readers share: their interface, the filter for unusable points, and error messages.

A reader knows what the header of its file says, and delivers the points in chunks. Nothing here
depends on a file format.
"""

from __future__ import annotations

from collections import Counter
from contextlib import contextmanager
from pathlib import Path
from typing import (
    Any,
    Dict,
    Iterable,
    Iterator,
    List,
    Optional,
    Protocol,
    Sequence,
    Tuple,
    runtime_checkable,
)

import numpy as np
import numpy.typing as npt

from ..errors import CloudError, QuantifyError
from ..types import MAX_COORDINATE, Bounds, Chunk, CloudInfo, Faces, FloatArray, Notice, Window

DEFAULT_CHUNK = 1_000_000
"""Points in a chunk: enough to hide the cost of Python, few enough to stay far below 100 MB."""

NOISE = "noise class"
WITHHELD = "withheld"
OFF_THE_MAP = "coordinate beyond any map"
NODATA, VOID = "nodata", "nodata beyond any map"
NO_PLACE = "NaN in all coordinates"
NOT_FINITE = "NaN or infinite coordinate"
_GROUND = 2  # ASPRS
_IS_NOISE = np.isin(np.arange(256), (7, 18))  # ASPRS: low point (noise) and high noise
_VOID_FROM, _VOID_TO = 1e20, 3.5e38  # what rasters have for no height: 1e20 (CF), 9.97e36 (netCDF),
# 1.70141e38 (Surfer), 3.4028e38 of either sign (the largest float32: ESRI, GDAL)
_DEGREES = 360.0  # no longitude or latitude is larger
_MOST_DAMAGED = 0.01  # of a file: more than that is not an odd row, but a badly written file


class Cloud(Protocol):
    """A point cloud that can be read as often as needed."""

    @property
    def info(self) -> CloudInfo:
        """What is known before the points are read."""

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the points, at most `size` at a time.

        `window` (the cloud's own coordinates) is a hint: what does not touch it may be skipped,
        points outside may still come. Raises :class:`CloudError` when fewer points can be read
        than the header promises.
        """


@runtime_checkable
class Mesh(Cloud, Protocol):
    """A cloud whose points may be the corners of faces."""

    def faces(self) -> Optional[Faces]:
        """Return the faces, whose corners are numbers of points in the order of `chunks`; or None.

        Raises :class:`CloudError` where they are damaged.
        """


class CloudWrapper:
    """A cloud that changes what another one delivers; it has the same faces."""

    def __init__(self, cloud: Cloud, info: CloudInfo) -> None:
        self._cloud, self.info = cloud, info

    def faces(self) -> Optional[Faces]:
        """Return the faces of the wrapped cloud, or None."""
        return self._cloud.faces() if isinstance(self._cloud, Mesh) else None


class GroundOnly(CloudWrapper):
    """A cloud without the points that are not of the class of ground."""

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the points of that class: none where the cloud has no classes."""
        for chunk in self._cloud.chunks(window, size):
            ground = np.zeros(len(chunk), dtype=bool)
            if chunk.classes is not None:
                ground = chunk.classes == _GROUND
            yield Chunk(chunk.x[ground], chunk.y[ground], chunk.z[ground])


def measurable(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    classes: Optional[npt.NDArray[Any]] = None,
    withheld: Optional[npt.NDArray[np.bool_]] = None,
) -> Chunk:
    """Return the points to be measured, and count those left out.

    Points with a coordinate that is NaN, infinite or larger than any on the Earth are left out:
    the bounding box would be useless with them.

    Parameters
    ----------
    x : (N,) float64
        The cloud's own units, like y and z.
    y : (N,) float64
        As x.
    z : (N,) float64
        As x.
    classes : (N,) uint8, optional
        ASPRS classes; 7 and 18 are left out.
    withheld : (N,) bool, optional
        Points that their producer marked as not to be used. A withheld noise point counts as
        noise.
    """
    unwanted = {}
    if classes is not None:
        unwanted[NOISE] = _IS_NOISE[classes]
    if withheld is not None:
        unwanted[WITHHELD] = withheld
    on_map = _all_on_map(x, y, z)
    if on_map and not any(marked.any() for marked in unwanted.values()):
        return Chunk(x, y, z, classes=classes)
    if not on_map:
        unwanted.update(_off_the_map(x, y, z))
    keep = np.ones(len(x), dtype=bool)
    left_out = {}
    for reason, marked in unwanted.items():  # the first reason counts
        count = int((marked & keep).sum())
        if count:
            left_out[reason] = count
        keep &= ~marked
    own = None if classes is None else classes[keep]
    return Chunk(x[keep], y[keep], z[keep], left_out, keep, own)


def _off_the_map(x: FloatArray, y: FloatArray, z: FloatArray) -> Dict[str, npt.NDArray[np.bool_]]:
    """Return which points are left out, by reason."""
    axes = np.array([x, y, z])
    reach = np.abs(axes)
    void = (reach[2] >= _VOID_FROM) & (reach[2] <= _VOID_TO)
    return {
        NO_PLACE: np.isnan(axes).all(axis=0),
        NOT_FINITE: ~np.isfinite(axes).all(axis=0),
        VOID: void & (reach[:2] <= MAX_COORDINATE).all(axis=0),
        OFF_THE_MAP: ~(reach <= MAX_COORDINATE).all(axis=0),
    }


def _all_on_map(*axes: FloatArray) -> bool:
    with np.errstate(invalid="ignore"):  # NaN: no comparison holds
        return all(
            not len(axis) or (axis.min() >= -MAX_COORDINATE and axis.max() <= MAX_COORDINATE)
            for axis in axes
        )


def require_few_damaged(path: Path, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
    """Deliver the chunks of a file, and refuse it when too many points are damaged.

    Raises
    ------
    CloudError
        At the end, when too many points had some of their coordinates only.
    """
    read, damaged = 0, 0
    for chunk in chunks:
        read += len(chunk) + sum(chunk.left_out.values())
        damaged += chunk.left_out.get(NOT_FINITE, 0)
        yield chunk
    if damaged > _MOST_DAMAGED * read:
        raise CloudError(
            f"{path}: {damaged} of {read} points have a coordinate that is NaN or infinite, and "
            f"others that are valid; expected at most {_MOST_DAMAGED:.0%}, which are left "
            "out: check which columns are x, y and z, or remove such points and export it again"
        )


def require_on_map(path: Path, x: FloatArray, y: FloatArray, z: FloatArray, first: int) -> None:
    """Raise CloudError when a coordinate is beyond any map; `first` is the points before these."""
    if not _all_on_map(x, y, z):
        at = int(np.argmax(np.abs([x, y, z]).max(axis=0)))
        raise CloudError(
            f"{path}: point {first + at + 1} of the file is at {x[at]:.3g}, {y[at]:.3g}, "
            f"{z[at]:.3g}; expected coordinates of at most {MAX_COORDINATE:.0e}: remove such "
            "points and write the file again"
        )


def rechunk(chunks: Iterable[Chunk], size: int) -> Iterator[Chunk]:
    """Join small chunks into chunks of at most `size` points, which cost less per point."""
    waiting: List[Chunk] = []
    points = 0
    for chunk in chunks:
        if waiting and points + len(chunk) > size:
            yield _join(waiting)
            waiting, points = [], 0
        waiting.append(chunk)
        points += len(chunk)
    if waiting:
        yield _join(waiting)


def _join(chunks: List[Chunk]) -> Chunk:
    if len(chunks) == 1:
        return chunks[0]
    left_out: Counter[str] = Counter()
    for chunk in chunks:
        left_out.update(chunk.left_out)
    x, y, z = (np.concatenate([getattr(chunk, axis) for chunk in chunks]) for axis in "xyz")
    each = [chunk.classes for chunk in chunks if chunk.classes is not None]
    classes = np.concatenate(each) if len(each) == len(chunks) else None
    return Chunk(x, y, z, dict(left_out), classes=classes)


def count_and_bounds(chunks: Iterable[Chunk]) -> Tuple[int, Optional[Bounds]]:
    """Count the points and find their box by reading them all once.

    Returns
    -------
    count : points read, those left out included.
    bounds : box of the points delivered, or None when there are none.
    """
    count, bounds = 0, None
    for chunk in chunks:
        count += len(chunk) + sum(chunk.left_out.values())
        bounds = union([bounds, box_of(chunk)])
    return count, bounds


def union(boxes: Iterable[Optional[Bounds]]) -> Optional[Bounds]:
    """Return the box of all boxes; None among them do not matter, and None is that of none."""
    known = [box for box in boxes if box is not None]
    if not known:
        return None
    return Bounds(
        *(min(getattr(box, f"min_{axis}") for box in known) for axis in "xyz"),
        *(max(getattr(box, f"max_{axis}") for box in known) for axis in "xyz"),
    )


def touches(bounds: Optional[Bounds], window: Optional[Window]) -> bool:
    """Whether a box and a window overlap; True when either is unknown."""
    if bounds is None or window is None:
        return True
    return (
        bounds.min_x <= window.max_x
        and bounds.max_x >= window.min_x
        and bounds.min_y <= window.max_y
        and bounds.max_y >= window.min_y
    )


def widened(window: Window, some: float) -> Window:
    """Return a window that is larger by `some` on all sides."""
    return Window(
        window.min_x - some, window.min_y - some, window.max_x + some, window.max_y + some
    )


def box_of(chunk: Chunk) -> Optional[Bounds]:
    """Return the box of a chunk's points, None where it has none."""
    if not len(chunk):
        return None
    axes = (chunk.x, chunk.y, chunk.z)
    return Bounds(*(float(axis.min()) for axis in axes), *(float(axis.max()) for axis in axes))


def within(inner: Bounds, outer: Bounds, some: float = 0.0) -> bool:
    """Whether a box lies within another, with a tolerance of `some`."""
    return all(
        getattr(inner, f"min_{axis}") >= getattr(outer, f"min_{axis}") - some
        and getattr(inner, f"max_{axis}") <= getattr(outer, f"max_{axis}") + some
        for axis in "xyz"
    )


def overlap(one: Bounds, other: Bounds) -> bool:
    """Whether two boxes overlap."""
    return all(
        getattr(one, f"min_{axis}") <= getattr(other, f"max_{axis}")
        and getattr(other, f"min_{axis}") <= getattr(one, f"max_{axis}")
        for axis in "xyz"
    )


def scale_warnings(
    path: Path, steps: Sequence[float], bounds: Optional[Bounds], count: Optional[int]
) -> Tuple[Notice, ...]:
    """Warn where the steps of x, y and z are larger than the points' mean spacing.

    Where x and y may be degrees, the spacing says nothing of z.
    """
    if bounds is None or not count:
        return ()
    x, y, z = steps
    # Of a grid whose step is its spacing, every point has a place of its own.
    ground = (bounds.max_x - bounds.min_x + x) * (bounds.max_y - bounds.min_y + y)
    spacing = (ground / count) ** 0.5
    sides = (bounds.min_x, bounds.min_y, bounds.max_x, bounds.max_y)
    alike = max(abs(side) for side in sides) > _DEGREES
    steps_of = zip("xyz", (x, y, z) if alike else (x, y))
    large = {axis: step for axis, step in steps_of if step > 1.01 * spacing > 0}
    if not large:
        return ()
    axes = ", ".join(f"{axis} in steps of {step:g}" for axis, step in large.items())
    text = (
        f"{path}: its header has {axes}, and the points' mean spacing is {spacing:.2g}: "
        "coordinates are rounded to these steps, and points coincide; export it again with a finer "
        "scale"
    )
    return (Notice("scale-coarse", text, file=str(path), spacing=spacing, steps=large),)


@contextmanager
def naming(path: Path, advice: str) -> Iterator[None]:
    """Turn any error of a library into a CloudError of one line that names the file.

    `advice` completes the sentence: what was expected and what to do.
    """
    try:
        yield
    except (QuantifyError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except PermissionError:
        raise CloudError(
            f"{path}: no permission to read it; make it readable for the user who runs this"
        ) from None
    except BaseException as fault:
        # A panic of the LAZ library arrives as a BaseException that is not an Exception.
        kind = type(fault).__name__.replace("PanicException", "decoder")
        if not isinstance(fault, Exception) and kind != "decoder":
            raise
        lines = str(fault).strip().splitlines() or [kind]
        reason = f"{kind}: {lines[0].rstrip('.')[:200]}"
        raise CloudError(f"{path}: cannot be read ({reason}); {advice}") from fault
