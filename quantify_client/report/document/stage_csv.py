"""How much each area holds below each level as CSV, for programs."""

from __future__ import annotations

from typing import TextIO

from ...types import AreaResult, Measurement, StageLevel
from ...types.json_records import record_of
from .slices_csv import harmless, writer_of

__all__ = ["STAGE_COLUMNS", "write_stage"]

STAGE_COLUMNS = ("name", *record_of(StageLevel).fields)


def write_stage(measurement: Measurement, file: TextIO) -> None:
    """Write one line for each area and level, always metric."""
    write = writer_of(file, STAGE_COLUMNS)
    for result in measurement.results:
        if isinstance(result, AreaResult) and result.stage is not None:
            for level in result.stage.levels:
                write([harmless(result.name), *record_of(StageLevel).write(level).values()])
