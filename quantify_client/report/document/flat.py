"""A result of the JSON document without lists and objects, for attribute tables."""

from __future__ import annotations

from typing import Any, Dict, Mapping

__all__ = ["flat_properties"]

FLAT_KEYS = (
    "volume_m3",
    "cut_m3",
    "fill_m3",
    "std_m3",
    "cut_std_m3",
    "fill_std_m3",
    "area_m2",
    "surface_area_m2",
    "perimeter_m",
    "min_z_m",
    "max_z_m",
    "max_height_m",
    "coverage",
    "points_used",
    "mass_t",
    "mass_std_t",
    "base",
    "cell_m",
)


def flat_properties(row: Mapping[str, Any]) -> Dict[str, Any]:
    """Return flat properties: attribute tables have no lists."""
    if "error" in row:
        return {"name": row["name"], "error": row["error"]}
    flat: Dict[str, Any] = {"name": row["name"], **{key: row[key] for key in FLAT_KEYS}}
    for part in ("", "cut_", "fill_"):
        low, high = row[f"{part}interval95_m3"] or (None, None)
        flat[f"{part}interval95_low_m3"], flat[f"{part}interval95_high_m3"] = low, high
    flat["warnings"] = "; ".join(row["warnings"])
    return flat
