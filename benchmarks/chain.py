"""From points and an outline to results, by the stages of the library; in several processes."""

from __future__ import annotations

from multiprocessing import Pool
from typing import Callable, Dict, Iterator, Sequence, Tuple, TypeVar, Union

from sites import Outline

from quantify_client.types import AreaResult, FloatArray, Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.measure import TerrainRecipe

T = TypeVar("T")
R = TypeVar("R")


def measure(points: FloatArray, outline: Outline, base: Union[str, float]) -> AreaResult:
    """Return the result of an area, as the stages of `quantify_client.pipeline.terrain` do."""
    accumulator = TerrainAccumulator([Window(*outline.bounds)])
    accumulator.absorb(accumulator.reduce(*points))
    kept = accumulator.points_of(0)
    return measure_area("area", kept.to_local(outline), kept, TerrainRecipe(base=base))


def on_bases(
    points: FloatArray, outline: Outline, bases: Sequence[str]
) -> Tuple[Dict[str, AreaResult], str]:
    """Return the results on the bases, and why there are none.

    Whatever a measurement raises counts as refused, and is told.
    """
    try:
        result = measure(points, outline, bases[0] if len(bases) == 1 else "compare")
    except Exception as refusal:
        return {}, f"{type(refusal).__name__}: {refusal}"
    rows = result.bases or (result,)
    return {str(row.base): row for row in rows if row.base in bases}, ""


def run(work: Callable[[T], R], tasks: Sequence[T], jobs: int) -> Iterator[R]:
    """Yield what `work` returns for each task, in their order."""
    if jobs <= 1:
        yield from map(work, tasks)
        return
    with Pool(jobs) as pool:
        yield from pool.imap(work, tasks, 4)
