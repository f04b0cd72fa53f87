"""What lists tell of a measurement: computed from the document that it comes from."""

import math

from ..quantify_client.options import OPTIONS

__all__ = ["agree", "comparable_of", "entry_from", "summary_of"]

_MOST_TEXT = 200
_TOLD = ("id", "name", "date", "area_key", "options")
# The options that make another quantity of a volume, besides its base.
_SETTINGS = [
    name
    for name, option in OPTIONS.items()
    if option.goes_with in ("section", "polar") or name in ("grid", "area_frame", "layer")
]


def entry_from(document):
    """Return what lists tell of a checked document; a WKT among its options is cut."""
    told = {**{key: document[key] for key in _TOLD}, "options": _shortened(document["options"])}
    return {**told, "summary": summary_of(document)}


def comparable_of(document):
    """Return what two volumes have to share, all of it, to be subtracted from each other.

    Where areas have different bases (`kriged` may fall back to another), or one was not measured
    (None), the base is a list of each area's.
    """
    measured, options = document["measurement"], _shortened(document["options"])
    unscaled = "cloud" if measured["length_unit"] == "m" else "unknown"
    bases = [_base(result) for result in measured["results"]]
    return {
        "shape": measured["shape"],
        "method": measured["method"],
        "base": bases[0] if bases.count(bases[0]) == len(bases) else bases,
        "method_revision": measured["method_revision"],
        "scale": unscaled if measured["scale"] is None else "control",
        "settings": {
            name: options[name]
            for name in _SETTINGS
            if options.get(name) not in (None, OPTIONS[name].default)
        },
    }


def agree(told, held):
    """Whether two entries say the same, numbers to the last digits that machines agree on."""
    if isinstance(held, dict):
        return (
            isinstance(told, dict)
            and told.keys() == held.keys()
            and all(agree(told[key], value) for key, value in held.items())
        )
    if isinstance(told, float) and isinstance(held, float):
        return math.isclose(told, held, rel_tol=1e-9)
    return told == held


def summary_of(document):
    """Return what a list tells of a measurement: the sum of its results."""
    measured = document["measurement"]
    results = [result for result in measured["results"] if "error" not in result]
    return {
        "results": len(measured["results"]),
        "volume_m3": _sum(results, "volume_m3"),
        "cut_m3": _sum(results, "cut_m3"),
        "fill_m3": _sum(results, "fill_m3"),
        "std_m3": _joint_std(results),
        "shape": measured["shape"],
        "base": results[0]["base"] if results else None,
        "comparable": comparable_of(document),
    }


def _shortened(options):
    return {
        key: value[:_MOST_TEXT] if isinstance(value, str) else value
        for key, value in options.items()
    }


def _base(result):
    """Return the base; an elevation, which control or feet may have computed, to the millimetre."""
    base = None if "error" in result else result["base"]
    return base if base is None or isinstance(base, str) else round(base, 3)


def _sum(results, key):
    values = [result[key] for result in results]
    if not values or any(value is None for value in values):
        return None
    return math.fsum(values)


def _joint_std(results):
    """Return the error of a sum: that of the scale is shared by all, the others are each's own."""
    if not results or any(result["std_m3"] is None for result in results):
        return None
    shared = math.fsum(_scale_std(result) for result in results)
    own = math.fsum(max(r["std_m3"] ** 2 - _scale_std(r) ** 2, 0.0) for r in results)
    return math.sqrt(shared**2 + own)


def _scale_std(result):
    return math.fsum(item["std_m3"] for item in result["budget"] if item["source"] == "scale")
