"""What lists tell of a measurement: computed from the document that it comes from."""

import math

__all__ = ["agree", "entry_from", "summary_of"]

_MOST_TEXT = 200
_TOLD = ("id", "name", "date", "area_key", "options")


def entry_from(document):
    """Return what lists tell of a checked document; a WKT among its options is cut."""
    options = {
        key: value[:_MOST_TEXT] if isinstance(value, str) else value
        for key, value in document["options"].items()
    }
    told = {**{key: document[key] for key in _TOLD}, "options": options}
    return {**told, "summary": summary_of(document)}


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
    }


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
