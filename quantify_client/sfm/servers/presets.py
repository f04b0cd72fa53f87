"""Options of a task for measuring volumes, checked against those that a node has."""

from __future__ import annotations

import difflib
import json
import math
import re
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

from ...errors import UsageError
from ..odm.layout import CAMERAS, CONTROL_POSITIONS, GEOREFERENCING, MODELS, SHOTS, SIDECARS
from ..redaction import plain

__all__ = ["MINIMAL_OUTPUTS", "PRESETS", "choose_options"]

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

MINIMAL_OUTPUTS: Tuple[str, ...] = (
    f"{GEOREFERENCING}/{MODELS[0]}",
    *(f"{GEOREFERENCING}/{name}" for name in SIDECARS[:2]),
    CONTROL_POSITIONS,
    SHOTS,
    CAMERAS,
    "odm_report/stats.json",
    "images.json",
    "log.json",
)
"""What measuring, scaling and an honest error need; a node leaves out what is missing."""


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
            raise UsageError(_unknown(name, list(known)))
        chosen[name] = _fitting(known[name], value)
    return chosen, tuple(notes)


def _unknown(name: str, known: List[str]) -> str:
    near = difflib.get_close_matches(name.lower().replace("_", "-").lstrip("-"), known, 3, 0.6)
    meant = f"did you mean {' or '.join(near)}?" if near else "see the node's /options"
    return f"The node has no option {plain(name, 60)!r}, and would ignore it; {meant}"


def _fitting(option: Any, value: Value) -> Value:
    """Turn a value into what the node's option is; refuse what the node would refuse."""
    converted: Optional[Value]
    if option.type == "bool":
        words = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}
        converted = words.get(str(value).strip().lower())
    elif option.type in ("int", "float"):
        converted = _number(value, option.type)
    else:
        converted = str(value)
    if converted is None or not _in_domain(option.domain, converted):
        raise UsageError(
            f"The option {option.name} cannot be {plain(value, 60)!r}; expected "
            f"{_expected(option)}"
        )
    return converted


def _number(value: Value, kind: str) -> Optional[Union[int, float]]:
    try:
        number = float(value)
    except ValueError:
        return None
    if not math.isfinite(number) or isinstance(value, bool):
        return None
    if kind == "int":
        return int(number) if number == int(number) else None
    return number


_RANGE = re.compile(r"^(?:float|integer): ([-+.\d]+) <= x <= ([-+.\d]+)$")
_BOUND = re.compile(r"^(?:float|integer) (>=|>|<=|<) ([-+.\d]+)$")


def _in_domain(domain: Any, value: Value) -> bool:
    """Whether a value is in a domain as nodes write them; one that we cannot read passes."""
    if isinstance(domain, (list, tuple)):
        return value in domain
    text = str(domain or "")
    if text == "json":
        return _is_json(str(value))
    if isinstance(value, (str, bool)):
        return True
    within, bound = _RANGE.match(text), _BOUND.match(text)
    if within:
        return float(within.group(1)) <= value <= float(within.group(2))
    if bound:
        limit = float(bound.group(2))
        return {
            ">=": value >= limit,
            ">": value > limit,
            "<=": value <= limit,
            "<": value < limit,
        }[bound.group(1)]
    if text == "percent":
        return 0 <= value <= 100
    return not text.startswith("positive ") or value >= 0


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def _expected(option: Any) -> str:
    if isinstance(option.domain, (list, tuple)):
        return "one of " + ", ".join(plain(choice, 40) for choice in option.domain)
    domain = plain(option.domain, 80)
    return f"{option.type} ({domain})" if domain and domain != option.type else str(option.type)
