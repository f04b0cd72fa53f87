"""The changes of a series of surveys as CSV, for programs."""

from __future__ import annotations

from typing import TextIO

from ...types import Measurement
from .slices_csv import harmless, writer_of

__all__ = ["SERIES_COLUMNS", "write_series"]

_NUMBERS = ("volume_m3", "cut_m3", "fill_m3", "std_m3")
SERIES_COLUMNS = ("before", "after", "name", *_NUMBERS)


def write_series(measurement: Measurement, file: TextIO) -> None:
    """Write one line for each pair of surveys and each area, always metric.

    Cut is gain, fill is loss. The last lines are those from the first survey to the last: no part
    of a sum over the others. An area that could not be measured has no numbers.
    """
    write = writer_of(file, SERIES_COLUMNS)
    for epochs in measurement.series:
        pair = (harmless(epochs.before), harmless(epochs.after))
        for result in epochs.results:
            numbers = [getattr(result, name) for name in _NUMBERS]
            write([*pair, harmless(result.name), *numbers])
        for failed in epochs.failures:
            write([*pair, harmless(failed.name), *[None] * len(_NUMBERS)])
