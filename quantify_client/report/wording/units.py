"""Numbers as people read them: rounded to what their error supports, in the units asked for.

JSON and files for programs never pass through here: they stay metric.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional

from ...errors import InputError
from ...types import INTERVAL95, Measurement

__all__ = [
    "MINUS",
    "NOTHING",
    "THIN_SPACE",
    "Units",
    "count",
    "display_units",
    "fixed",
    "ground_units",
    "named_units",
    "number",
    "plus_minus",
]

THIN_SPACE = "\u202f"  # the narrow space that does not break: a number stays on one line
MINUS = "\u2212"
NOTHING = "\u2013"
MAX_DECIMALS = 9

FOOT_M = 0.3048
YARD3_M3 = (3 * FOOT_M) ** 3
ACRE_FT2 = 43560.0
SHORT_TON_T = 0.90718474


def number(value: Optional[float], *, std: Optional[float] = None, digits: int = 4) -> str:
    """Return a number with the digits that its error supports.

    Two significant digits of the standard deviation `std` are kept; without one (or with 0)
    `digits` of the value, and never fewer than its integer part. None and what is not finite
    give a dash.

    Examples
    --------
    >>> number(1234.567, std=2.34).replace(THIN_SPACE, " ")
    '1 234.6'
    >>> number(1234.567, std=234.0).replace(THIN_SPACE, " ")
    '1 230'
    >>> number(0.0123456), number(None) == NOTHING
    ('0.01235', True)
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    if std is not None and math.isfinite(std) and std > 0.0:
        decimals = 1 - _power_of_ten(std, 2)
    else:
        decimals = max(digits - 1 - _power_of_ten(value, digits), 0) if value else 0
    return fixed(value, min(decimals, MAX_DECIMALS))


def fixed(value: float, decimals: int) -> str:
    """Return a number with that many decimals; negative ones round to tens, hundreds, ...

    Examples
    --------
    >>> fixed(-0.001, 2), fixed(-12.5, 1).replace(MINUS, "-")
    ('0.00', '-12.5')
    """
    text = f"{round(value, decimals):,.{max(decimals, 0)}f}".replace(",", THIN_SPACE)
    if text.startswith("-"):
        # "-0.00" would claim a sign that the digits shown do not have.
        bare = text[1:]
        return MINUS + bare if any(c in "123456789" for c in bare) else bare
    return text


def count(value: int) -> str:
    """Return a whole number with spaces between thousands.

    Examples
    --------
    >>> count(184321).replace(THIN_SPACE, " ")
    '184 321'
    """
    return fixed(value, 0)


def _power_of_ten(value: float, digits: int) -> int:
    """Return the exponent of the value once it is rounded: 0.99999 counts as 1."""
    return int(f"{abs(value):.{digits - 1}e}".partition("e")[2])


def plus_minus(spread: str) -> str:
    """Return what follows a value: `` \u00b1 spread``, or nothing where the spread is unknown."""
    return "" if spread == NOTHING else f" \u00b1 {spread}"


@dataclass(frozen=True)
class Units:
    """Factors from metric values to displayed ones, and the names of the displayed units.

    Attributes
    ----------
    length, area, volume, mass : names of the units.
    length_per_m, area_per_m2, volume_per_m3, mass_per_t : factors.
    large_area : name of the unit for areas of at least `large_area_from` (in `area`), or "".
    """

    length: str
    area: str
    volume: str
    mass: str = "t"
    length_per_m: float = 1.0
    area_per_m2: float = 1.0
    volume_per_m3: float = 1.0
    mass_per_t: float = 1.0
    large_area: str = ""
    large_area_from: float = math.inf

    def volume_number(self, value_m3: Optional[float], std_m3: Optional[float] = None) -> str:
        """Return a volume without its unit."""
        return number(
            _times(value_m3, self.volume_per_m3), std=_times(std_m3, self.volume_per_m3), digits=5
        )

    def volume_text(self, value_m3: Optional[float], std_m3: Optional[float] = None) -> str:
        """Return a volume with its unit."""
        return _with_unit(self.volume_number(value_m3, std_m3), self.volume)

    def half_width(self, std_m3: Optional[float]) -> str:
        """Return the half width of the 95 % interval of a volume, without unit or sign."""
        return self.volume_number(_times(std_m3, INTERVAL95), std_m3)

    def mass_text(self, value_t: Optional[float], std_t: Optional[float] = None) -> str:
        """Return a mass with its unit."""
        factor = self.mass_per_t
        return _with_unit(number(_times(value_t, factor), std=_times(std_t, factor)), self.mass)

    def mass_half_width(self, std_t: Optional[float]) -> str:
        """Return the half width of the 95 % interval of a mass, without unit or sign."""
        std = _times(std_t, self.mass_per_t)
        return number(_times(std, INTERVAL95), std=std)

    def area_text(self, value_m2: Optional[float]) -> str:
        """Return an area with its unit; acres when it is large and they are asked for."""
        value = _times(value_m2, self.area_per_m2)
        if value is not None and self.large_area and value >= self.large_area_from:
            return _with_unit(number(value / self.large_area_from), self.large_area)
        return _with_unit(number(value), self.area)

    def length_number(self, value_m: Optional[float]) -> str:
        """Return a length or height without its unit: a hundredth at least."""
        value = _times(value_m, self.length_per_m)
        if value is None or not math.isfinite(value):
            return NOTHING
        return fixed(value, 2) if abs(value) >= 1.0 or value == 0.0 else number(value, digits=3)

    def length_by_error(self, value_m: Optional[float], std_m: Optional[float]) -> str:
        """Return a length without its unit, with the digits that its error supports."""
        return number(_times(value_m, self.length_per_m), std=_times(std_m, self.length_per_m))

    def length_text(self, value_m: Optional[float]) -> str:
        """Return a length or height with its unit."""
        return _with_unit(self.length_number(value_m), self.length)

    def elevation_number(self, value_m: Optional[float], height_m: float) -> str:
        """Return an elevation without its unit, to a hundredth, or finer for what is less high."""
        value, height = _times(value_m, self.length_per_m), height_m * self.length_per_m
        if value is None or not math.isfinite(value):
            return NOTHING
        finer = 2 - _power_of_ten(height, 3) if 0.0 < height < 1.0 else 2
        return fixed(value, min(finer, MAX_DECIMALS))

    def elevation_text(self, value_m: Optional[float], height_m: float) -> str:
        """Return an elevation of what is so high, with its unit."""
        return _with_unit(self.elevation_number(value_m, height_m), self.length)


METRIC = Units("m", "m²", "m³")
UNKNOWN = Units("units", "units²", "units³")
US = Units(
    "ft",
    "ft²",
    "yd³",
    "short tons",
    length_per_m=1 / FOOT_M,
    area_per_m2=1 / FOOT_M**2,
    volume_per_m3=1 / YARD3_M3,
    mass_per_t=1 / SHORT_TON_T,
    large_area="acre",
    large_area_from=ACRE_FT2,
)


def display_units(measurement: Measurement, units: str) -> Units:
    """Return the units of what people read.

    A cloud of unknown unit is never converted: nobody knows from what.
    """
    known = named_units(units)
    return known if measurement.length_unit == "m" else UNKNOWN


def named_units(units: str) -> Units:
    """Return the units of that name, for what is in metres."""
    if units not in ("metric", "us"):
        raise InputError(f"The units {units!r} are not known; use metric or us.")
    return US if units == "us" else METRIC


def ground_units(units: Units) -> Units:
    """Return the units of control, which is in metres even where the cloud's unit is unknown."""
    return METRIC if units == UNKNOWN else units


def _times(value: Optional[float], factor: float) -> Optional[float]:
    return None if value is None else value * factor


def _with_unit(text: str, unit: str) -> str:
    # The space does not break: a number never stands apart from its unit.
    return text if text == NOTHING else f"{text}\u00a0{unit}"
