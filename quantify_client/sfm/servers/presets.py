"""Options of a task for measuring volumes, checked against those that a node has."""

from __future__ import annotations

import difflib
import json
import math
import operator
import re
from typing import Any, Dict, Mapping, Optional, Sequence, Tuple, Union

from ...errors import UsageError
from ..redaction import plain

__all__ = ["PRESETS", "choose_options"]

Value = Union[str, int, float, bool]

_VOLUME: Mapping[str, Value] = {"dsm": True, "auto-boundary": True, "pc-ept": True}
PRESETS: Mapping[str, Mapping[str, Value]] = {
    "fast": {
        **_VOLUME,
        "feature-quality": "medium",
        "pc-quality": "low",
        "skip-3dmodel": True,
        "skip-orthophoto": True,
        "optimize-disk-space": True,
    },
    "default": {**_VOLUME, "feature-quality": "high", "pc-quality": "medium"},
    "best": {**_VOLUME, "feature-quality": "ultra", "pc-quality": "high"},
}
"""What is asked for unless the user says otherwise; what a node does not have is left out."""


_WORDS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}
_BOUNDS = re.compile(
    r"(?:float|integer)(?:: ([-+.\d]+) <= x <= ([-+.\d]+)| (>=|>|<=|<) ([-+.\d]+))"
)
_COMPARE = {">=": operator.ge, ">": operator.gt, "<=": operator.le, "<": operator.lt}


def choose_options(
    available: Sequence[Any],
    preset: str = "default",
    given: Optional[Mapping[str, Value]] = None,
    *,
    ground: bool = False,
    split: Optional[int] = None,
) -> Tuple[Dict[str, Value], Tuple[str, ...]]:
    """Choose a task's options: the preset's, then what the user gives.

    Parameters
    ----------
    available : the node's own options (pyodm's NodeOption).
    given : from the user; texts are turned into what the node's option is.
    ground : the base is to be the ground, for which the cloud has to be classified.
    split : photographs in each part of a job that many nodes share (split-merge), about.

    Returns
    -------
    The options, and notes on the preset's that the node does not have.

    Raises
    ------
    UsageError
        The preset or an option does not exist, or a value does not fit; near names are suggested.
    """
    if preset not in PRESETS:
        raise UsageError(f"There is no preset {preset!r}; expected one of {', '.join(PRESETS)}")
    known = {option.name: option for option in available}
    wanted = dict(PRESETS[preset])
    if ground:
        wanted["pc-classify"] = True
    asked: Dict[str, Value] = dict(given or {})
    if split is not None:
        asked.setdefault("split", split)
    unknown = [name for name in wanted if name not in known and name not in asked]
    notes = [f"The node has no option {', '.join(unknown)}: left out."] if unknown else []
    chosen = {name: value for name, value in wanted.items() if name in known}
    for name, value in asked.items():
        if name not in known:
            bare = name.lower().replace("_", "-").lstrip("-")
            near = difflib.get_close_matches(bare, known, 3, 0.6)
            meant = f"did you mean {' or '.join(near)}?" if near else "see the node's /options"
            raise UsageError(
                f"The node has no option {plain(name, 60)!r}, and would ignore it; {meant}"
            )
        chosen[name] = _fitting(known[name], value)
    return chosen, tuple(notes)


def _fitting(option: Any, value: Value) -> Value:
    """Turn a value into what the node's option is; refuse what the node would refuse."""
    converted: Optional[Value] = str(value)
    if option.type == "bool":
        converted = _WORDS.get(str(value).strip().lower())
    elif option.type in ("int", "float"):
        converted = _number(value, option.type)
    if converted is None or not _in_domain(option.domain, converted):
        expected = str(option.type)
        if isinstance(option.domain, (list, tuple)):
            expected = "one of " + ", ".join(plain(choice, 40) for choice in option.domain)
        elif plain(option.domain, 80) not in ("", expected):
            expected = f"{expected} ({plain(option.domain, 80)})"
        raise UsageError(
            f"The option {option.name} cannot be {plain(value, 60)!r}; expected {expected}"
        )
    return converted


def _number(value: Value, kind: str) -> Optional[Union[int, float]]:
    try:
        number = float(value)
    except ValueError:
        return None
    if not math.isfinite(number) or isinstance(value, bool):
        return None
    if kind == "float":
        return number
    return int(number) if number.is_integer() else None


def _in_domain(domain: Any, value: Value) -> bool:
    """Whether a value is in a domain as nodes write them; one that we cannot read passes."""
    if isinstance(domain, (list, tuple)):
        return value in domain
    text = str(domain or "")
    if text == "json":
        try:
            json.loads(str(value))
        except ValueError:
            return False
    if isinstance(value, (str, bool)):
        return True
    bounds = _BOUNDS.fullmatch(text)
    if bounds:
        low, high, sign, limit = bounds.groups()
        if sign is None:
            return float(low) <= value <= float(high)
        return bool(_COMPARE[sign](value, float(limit)))
    if text == "percent":
        return 0 <= value <= 100
    return not text.startswith("positive ") or value >= 0
