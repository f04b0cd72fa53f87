"""Options: which contradict each other, and what they leave to be chosen."""

from __future__ import annotations

import math

from .crs import UNITS_M
from .errors import UsageError
from .scaler.adjustment.fit import MODES
from .types import Options
from .volcalc.terrain.base import BASES
from .volcalc.terrain.integrate import MAX_SLICES

__all__ = ["MOST_THREADS", "check_options", "choose_shape"]

MOST_THREADS = 256

_OBJECT_METHODS = ("section", "polar")
_DENSEST = 22.6  # t/m3: osmium
_FLOORS = ("auto", "none", "plane")


def check_options(options: Options) -> Options:
    """Return the options, or say which are out of range or contradict each other.

    Raises
    ------
    UsageError
        In one line, with the command line's names of the options.
    """
    _check_slices(options)
    _check_base(options)
    _check_object(options)
    _check_control(options)
    density, sigma = options.density, options.density_sigma
    if density is not None and not 0 < density < math.inf:
        raise UsageError(f"--density is {density}; give tonnes per cubic metre above 0")
    if density is not None and density > _DENSEST:
        raise UsageError(
            f"--density is {density:g} t/m3, more than that of any material ({_DENSEST:g}); for "
            f"{density:g} kg/m3 give {density / 1000:g}"
        )
    if not 0 <= sigma < math.inf:
        raise UsageError(f"the sigma of --density is {sigma}; give tonnes per cubic metre from 0")
    if options.vertical_unit is not None and options.vertical_unit not in UNITS_M:
        raise UsageError(f"--vertical-unit is {options.vertical_unit}; give {', '.join(UNITS_M)}")
    if options.method is not None and options.method not in _OBJECT_METHODS:
        raise UsageError(f"--method is {options.method}; give {' or '.join(_OBJECT_METHODS)}")
    if not 0 <= options.threads <= MOST_THREADS:
        raise UsageError(f"--threads is {options.threads}; give a number from 1 to {MOST_THREADS}")
    return options


def _check_slices(options: Options) -> None:
    slices, height = options.slices, options.slice_height
    if slices != "auto" and height is not None:
        raise UsageError("--slices and --slice-height exclude each other: give one of them")
    if slices != "auto" and not (isinstance(slices, int) and 1 <= slices <= MAX_SLICES):
        raise UsageError(f"--slices is {slices}; give auto or 1 to {MAX_SLICES}")
    if height is not None and not 0 < height < math.inf:
        raise UsageError(f"--slice-height is {height}; give a length above 0")


def _check_base(options: Options) -> None:
    base = options.base
    if isinstance(base, str) and base not in (*BASES, "compare"):
        names = ", ".join((*BASES, "compare"))
        raise UsageError(f"--base is {base}; give {names} or an elevation")
    if isinstance(base, (int, float)) and not math.isfinite(base):
        raise UsageError(f"--base is {base}; give a finite elevation")


def _check_object(options: Options) -> None:
    gap, floor = options.max_gap, options.floor
    if gap is not None and not 0 < gap < math.inf:
        raise UsageError(f"--max-gap is {gap}; give a length above 0")
    if floor not in _FLOORS if isinstance(floor, str) else not math.isfinite(floor):
        raise UsageError(f"--floor is {floor}; give {', '.join(_FLOORS)} or an elevation")
    accuracy = options.accuracy
    if accuracy is not None and not 0 < accuracy < math.inf:
        raise UsageError(f"--accuracy is {accuracy}; give a length above 0")
    if options.center_caps and options.method == "section":
        raise UsageError("--center-caps goes with --method polar: leave one of them out")
    of_sections = options.hollow or gap is not None or floor != "auto" or accuracy is not None
    if options.method == "polar" and of_sections:
        raise UsageError(
            "--hollow, --max-gap, --floor and --accuracy go with --method section, not polar"
        )


def _check_control(options: Options) -> None:
    frames = ("cloud", "control")
    if options.scale_mode not in MODES:
        raise UsageError(f"--scale-mode is {options.scale_mode}; give {', '.join(MODES)}")
    if options.area_frame not in frames:
        raise UsageError(f"--area-frame is {options.area_frame}; give {' or '.join(frames)}")
    if options.gcp is None and (options.scale_mode != "auto" or options.area_frame != "cloud"):
        raise UsageError("--scale-mode and --area-frame go with --gcp: give a control file")
    if options.gcp is not None and options.grid:
        raise UsageError(
            "--grid goes without --gcp: with control everything is measured on the ground, as the "
            "tapes are"
        )


def choose_shape(options: Options, *, has_crs: bool, is_odm: bool) -> str:
    """Return ``"terrain"`` or ``"object"``: what was asked for, or what the source is.

    An option that only one shape knows decides, unless it is that of a mesh's faces, --accuracy;
    else an area, a CRS or an ODM output means terrain; else it is an object.

    >>> choose_shape(Options(center_caps=True), has_crs=True, is_odm=True)
    'object'
    >>> choose_shape(Options(), has_crs=True, is_odm=False)
    'terrain'
    """
    for_object = (
        options.method is not None
        or options.center_caps
        or options.hollow
        or options.max_gap is not None
        or options.floor != "auto"
    )
    for_terrain = options.base is not None
    if options.shape not in ("auto", "terrain", "object"):
        raise UsageError(f"--shape is {options.shape}; give auto, terrain or object")
    of_object = for_object or options.accuracy is not None
    if of_object and (for_terrain or options.shape == "terrain"):
        raise UsageError(
            "--method, --center-caps, --accuracy, --hollow, --max-gap and --floor go with "
            "--shape object, --base with --shape terrain"
        )
    if options.shape == "object" and for_terrain:
        raise UsageError("--base goes with --shape terrain: leave one of them out")
    shape = options.shape
    if shape == "auto":
        likely_terrain = for_terrain or options.area is not None or has_crs or is_odm
        shape = "terrain" if likely_terrain and not for_object else "object"
    if shape == "object" and options.area is not None:
        raise UsageError("--area goes with --shape terrain: an object is measured whole")
    return shape
