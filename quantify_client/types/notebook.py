"""A measurement at hand, in a notebook or a program: short to see, easy to look into."""

from __future__ import annotations

import math
from html import escape
from importlib import import_module
from typing import Any, Dict, Iterator, Sequence, Union

from ..errors import MissingExtraError

__all__ = ["Notebook"]

_SHOWN = 3  # results that a repr names

# What volume, cut, fill and base are called.
_VOLUME = ("Volume", "Cut", "Fill", "Base")
_CHANGE = ("Net change", "Gain", "Loss", "Before")


class Notebook:
    """What a :class:`Measurement` can do besides holding its fields.

    Iterating gives the results, ``measurement["white car"]`` the one of that name,
    ``measurement[0]`` the first. Two measurements are equal when all their numbers and words are,
    whenever and in whatever time they were made.
    """

    source: str
    length_unit: str
    shape: str
    method: str
    kind: str
    results: Sequence[Any]
    warnings: Sequence[str]

    def __iter__(self) -> Iterator[Any]:
        return iter(self.results)

    def __len__(self) -> int:
        return len(self.results)

    def __contains__(self, name: object) -> bool:
        return any(name in (result, result.name) for result in self.results)

    def __getitem__(self, name: Union[str, int]) -> Any:
        if isinstance(name, int):
            return self.results[name]
        for result in self.results:
            if result.name == name:
                return result
        names = ", ".join(repr(result.name) for result in self.results)
        raise KeyError(f"there is no result {name!r}; there are {names}")

    def __repr__(self) -> str:
        told = [f"{r.name} {self._volume(r)}" for r in self.results[:_SHOWN]]
        told += ["..."] if len(self.results) > _SHOWN else []
        count = "1 result" if len(self.results) == 1 else f"{len(self.results)} results"
        return f"<Measurement of {self.source}: {self.shape}, {count}: {'; '.join(told)}>"

    def _volume(self, result: Any) -> str:
        """Return a volume with its 95 % interval, or why there is none."""
        if hasattr(result, "error"):
            return f"not measured ({result.error})"
        unit = "m³" if self.length_unit == "m" else "cubic units"
        interval = result.interval95_m3
        if interval is None:
            return f"{result.volume_m3:.4g} {unit}"
        half = (interval[1] - interval[0]) / 2
        decimals = max(0, 1 - math.floor(math.log10(half))) if half > 0 else 3
        return f"{result.volume_m3:,.{decimals}f} ± {half:,.{decimals}f} {unit}"

    def _repr_html_(self) -> str:
        """Return a table for a notebook."""
        words = _CHANGE if self.kind == "change" else _VOLUME
        head = ("", f"{words[0]} ± 95 %", *words[1:3], "Area", "Coverage", words[3])
        rows = [_row(head, "th"), *(_row(self._cells(result), "td") for result in self.results)]
        how = self.shape if self.method == self.shape else f"{self.shape}, {self.method}"
        notes = [*self.warnings, *(w for r in self.results for w in getattr(r, "warnings", ()))]
        return (
            f"<table><caption>{escape(self.source)} ({escape(how)})</caption>{''.join(rows)}"
            f"</table>{''.join(f'<p>{escape(note)}</p>' for note in notes)}"
        )

    def _cells(self, result: Any) -> Sequence[str]:
        volume = [result.name, self._volume(result)]
        if hasattr(result, "error"):
            return [*volume, *[""] * 5]
        numbers = (result.cut_m3, result.fill_m3, result.area_m2)
        covered = "" if result.coverage is None else f"{result.coverage:.1%}"
        base = "" if result.base is None else str(result.base)
        return [*volume, *("" if n is None else f"{n:.4g}" for n in numbers), covered, base]

    # Upwards, and only when asked: the document is the report's, and this is the result's own way
    # of writing it.

    def to_dict(self) -> Dict[str, Any]:
        """Return the JSON document, as ``--json`` prints it."""
        from ..report.document.measurement import to_json

        return to_json(self)  # type: ignore[arg-type]

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each result, with the columns of areas.geojson.

        Raises
        ------
        MissingExtraError
            Pandas is not installed.
        """
        return _package("pandas").DataFrame([f["properties"] for f in self._features()["features"]])

    def to_geodataframe(self) -> Any:
        """Return the same as a geopandas GeoDataFrame, with the areas' outlines.

        They are in longitude and latitude (WGS 84), or in the cloud's own coordinates where it has
        no CRS. A body has no outline.

        Raises
        ------
        MissingExtraError
            Geopandas is not installed.
        """
        found = self._features()
        crs = None if "coordinate_reference" in found else "OGC:CRS84"
        return _package("geopandas").GeoDataFrame.from_features(found["features"], crs=crs)

    def _features(self) -> Dict[str, Any]:
        from ..report.document.geojson import to_geojson

        return to_geojson(self)  # type: ignore[arg-type]


def _row(cells: Sequence[str], tag: str) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"


def _package(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingExtraError(
            f"this needs {name}, which is not installed; install it (pip install {name}), or use "
            "to_dict()"
        ) from error
