"""The options of a measurement: what each is called, what it may be and what it means.

One field of `Options` is one option. From its `Option` come the arguments of the command line, the
checks and their messages, what a job's folder may hold and what a request to the WebODM plugin may
ask for; the keywords of :func:`quantify_client.measure` are compared with it by a test. Nothing but
the errors is imported here, so that the command line and the plugin start at once.
"""

from __future__ import annotations

# ruff: noqa: RUF009 - what looks like a default of a field here makes the field
import math
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from numbers import Integral, Real
from typing import Any, Dict, Iterable, List, Mapping, Optional, Tuple, Union

from .errors import UsageError

__all__ = [
    "AUTO",
    "BASES",
    "DEFAULT_BASE",
    "DEFAULT_LAYER",
    "LAYERS",
    "METHOD_REVISION",
    "METHOD_REVISIONS",
    "OPTIONS",
    "UNITS",
    "Option",
    "Options",
    "choose_shape",
    "for_objects",
    "proposes",
    "read_options",
]

#: The revisions of the method, each with the base that volumes are measured from unless another
#: is asked for. One is added when the same cloud gives other numbers than before: volumes of
#: different revisions are not subtracted from each other (docs/method.md lists what changed).
METHOD_REVISIONS = {1: "triangulate", 2: "kriged"}
METHOD_REVISION = max(METHOD_REVISIONS)
DEFAULT_BASE = METHOD_REVISIONS[METHOD_REVISION]

_BASES = ("kriged", "triangulate", "plane", "average", "lowest", "highest")
#: The names of the base surfaces, the default first, as a comparison lists them; the surfaces are
#: in `volcalc.terrain.base`.
BASES = (DEFAULT_BASE, *(name for name in _BASES if name != DEFAULT_BASE))

#: What may be measured where two surfaces lie over each other, the default first.
LAYERS = ("upper", "lower", "mean")
DEFAULT_LAYER = LAYERS[0]

#: In place of a file with areas: outlines are proposed for what stands out from the ground.
AUTO = "auto"

#: The units of lengths that a source may be in.
UNITS = ("m", "cm", "mm", "ft", "us-ft")

#: The groups of options, as headings of the command line's help.
MEASURED = "what is measured"
TERRAIN = "terrain: an open surface against a base"
OBJECT = "object: a closed body"
CONTROL = "true size by control"
COORDINATES = "coordinates and units"
AMOUNTS = "mass and speed"

#: Levels of a stage curve, at most.
_MOST_LEVELS = 1000

_DENSEST = 22.6  # t/m3: osmium

_FILE = {"kind": "given", "metavar": "FILE", "request": None}
_HEIGHTS = (-20_000, 20_000)
_ELEVATION: Dict[str, Any] = {
    "kind": "number",
    "amount": "an elevation",
    "request": _HEIGHTS,
}
_LENGTH = {
    "kind": "number",
    "metavar": "LENGTH",
    "amount": "a length above 0",
    "above": 0.0,
    "request": (0, 10_000),
}


@dataclass(frozen=True)
class Option:
    """One option: its name, what it may be, and how it is explained.

    Attributes
    ----------
    help : one line; empty for an option that is no argument of the command line by itself.
    group : the heading that it is listed under.
    kind : ``"flag"``, ``"choice"``, ``"number"`` or ``"whole"`` (number), ``"text"``,
        ``"levels"`` (elevations in one text), or ``"given"`` (a file, or what a Python program has
        in its place).
    choices : the texts that it may be, a number besides its numbers.
    above, least, most : limits of a number; `above` itself is outside.
    metavar : what stands for a value in help, beside the choices.
    amount : in words, what a number may be.
    goes_with : what it is for, where it is not for everything: ``"object"`` (of which ``"section"``
        and ``"polar"`` are methods), ``"terrain"``, ``"control"`` or ``"proposals"``.
    request : lowest and highest number in a request to the plugin; None where it cannot be asked.
    title : what messages call an option that is no argument by itself.
    """

    name: str = ""
    default: Any = None
    help: str = ""
    group: str = ""
    kind: str = "choice"
    choices: Tuple[str, ...] = ()
    metavar: Optional[str] = None
    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf
    amount: str = ""
    goes_with: str = ""
    request: Optional[Tuple[float, float]] = (0, 0)
    title: str = ""

    @property
    def flag(self) -> str:
        """The command line's name."""
        return self.title or "--" + self.name.replace("_", "-")

    @property
    def expected(self) -> str:
        """What it may be, in words."""
        words = [*self.choices, *([self.amount] if self.amount else [])] or ["True", "False"]
        return " or ".join([", ".join(words[:-1]), words[-1]] if words[1:] else words)

    def read(self, value: Any) -> Any:
        """Return a value that a user gave; a number may be a text, as on the command line.

        Raises
        ------
        UsageError
            It is not what the option may be.

        Examples
        --------
        >>> OPTIONS["slices"].read("7"), OPTIONS["slices"].read("auto")
        (7, 'auto')
        """
        if value is self.default or self.kind == "given":
            return value
        if self.kind == "flag" and type(value).__name__ in ("bool", "bool_"):  # numpy's
            value = bool(value)
        if self.kind == "levels":
            value = _levels(value)
        if self.kind in _NUMBERS:
            number, also = _NUMBERS[self.kind]
            if isinstance(value, (str, also)) and not isinstance(value, (int, float)):
                with suppress(ValueError):
                    value = number(value)
        if not self._accepts(value):
            shown = str(value)[:100] or "''"
            raise UsageError(f"{self.flag} is {shown}; give {self.expected}")
        return value

    def _accepts(self, value: Any) -> bool:
        if self.kind == "flag":
            return isinstance(value, bool)
        if self.kind == "levels":
            return isinstance(value, str)
        if isinstance(value, str) or self.kind == "text":
            return value in self.choices or (self.kind == "text" and isinstance(value, str))
        whole = isinstance(value, int) and not isinstance(value, bool)
        if not (whole or (self.kind == "number" and isinstance(value, float))):
            return False
        return math.isfinite(value) and self.above < value and self.least <= value <= self.most


def _levels(given: Any) -> Any:
    """Return ``"auto"``, or elevations as one text in ascending order: ``"10.5,11"``.

    What they cannot be is returned as something that is no text.
    """
    listed = isinstance(given, Iterable) and not isinstance(given, str)
    parts = [str(part) for part in given] if listed else [str(given)]
    words = [word for part in parts for word in part.replace(",", " ").split()]
    if words == [AUTO]:
        return AUTO
    try:
        levels = sorted({float(word) for word in words})
    except ValueError:
        return words or None
    low, high = _HEIGHTS
    right = levels and len(levels) <= _MOST_LEVELS and low <= levels[0] and levels[-1] <= high
    return ",".join(f"{level:.12g}" for level in levels) if right else words


# What a number is kept as, and what else is one: numpy's.
_NUMBERS: Mapping[str, Tuple[Any, Any]] = {"number": (float, Real), "whole": (int, Integral)}


def _option(default: Any, help: str = "", group: str = "", **about: Any) -> Any:
    return field(default=default, metadata={"option": Option("", default, help, group, **about)})


@dataclass(frozen=True)
class Options:
    """Everything that decides a measurement; each field is a command-line option of the same name.

    Lengths and elevations are in metres, densities in t/m3. ``area`` is a file with polygons or
    what :func:`quantify_client.measure` takes in its place, or ``"auto"``; ``gcp`` is a control
    file. ``crs``
    (``EPSG:n``, WKT, a PROJ string or a file with one) and ``vertical_unit`` go before what the
    cloud says; ``source_unit`` is for one that does not say. ``threads`` is 0 for as many as the
    processor has, up to 4. :data:`OPTIONS` has the rest.
    """

    area: Optional[Any] = _option(
        None,
        "polygons: GeoJSON or KML; with the extra 'vector' also shapefile, GeoPackage, DXF and "
        "FlatGeobuf. One result for each; auto: outlines of stockpiles are proposed",
        MEASURED,
        **{**_FILE, "metavar": "FILE|auto"},
    )
    shape: str = _option(
        "auto",
        "terrain or a body; auto: what the other options, the areas and the source tell",
        MEASURED,
        choices=("auto", "object", "terrain"),
    )
    method: Optional[str] = _option(
        None,
        "sections of any body (default), or the paper's slices",
        OBJECT,
        choices=("section", "polar"),
        goes_with="object",
    )
    slices: Union[str, int] = _option(
        "auto",
        "number of slices",
        MEASURED,
        kind="whole",
        choices=("auto",),
        metavar="N",
        least=1,
        most=10_000,
        amount="1 to 10000",
        request=(1, 1000),
    )
    slice_height: Optional[float] = _option(None, "height of the slices", MEASURED, **_LENGTH)
    least_height: Optional[float] = _option(
        None,
        "with --area auto: lower piles are not proposed (default: ten standard deviations of the "
        "ground, or two cells)",
        MEASURED,
        goes_with="proposals",
        **{**_LENGTH, "request": None},
    )
    least_area: Optional[float] = _option(
        None,
        "with --area auto: smaller piles are not proposed (default: 64 cells)",
        MEASURED,
        kind="number",
        metavar="AREA",
        amount="an area above 0",
        above=0.0,
        goes_with="proposals",
        request=None,
    )
    base: Optional[Union[str, float]] = _option(
        None,
        f"the surface that volumes are measured from (default {DEFAULT_BASE}); vertices: between "
        "the elevations of the outline's corners; ground: points of class 2, or what a filter "
        "takes for ground; volume also takes a FILE: another survey, or a design surface "
        "(LandXML, DXF)",
        TERRAIN,
        choices=(*BASES, "compare", "vertices", "ground"),
        metavar="ELEVATION",
        goes_with="terrain",
        **_ELEVATION,
    )
    base_points: Optional[Any] = _option(
        None,
        "points of the floor (any cloud or text file of x, y, z): volumes are measured from the "
        "triangles between them",
        TERRAIN,
        goes_with="terrain",
        **_FILE,
    )
    stage: Optional[str] = _option(
        None,
        "level, water surface and volume below it, and where basins spill (auto: about twenty "
        "levels up to there)",
        TERRAIN,
        kind="levels",
        choices=("auto",),
        metavar="Z",
        goes_with="terrain",
        amount="elevations (one or more, at most 1000)",
        request=None,
    )
    toe: Optional[Union[str, float]] = _option(
        None,
        "moves outlines to the toe of their piles that the terrain shows, by this much at most "
        "(auto: a quarter of their longer side)",
        TERRAIN,
        choices=("auto",),
        goes_with="terrain",
        **_LENGTH,
    )
    layer: str = _option(
        DEFAULT_LAYER,
        "where two surfaces lie over each other (trees or a roof over ground): which is measured, "
        f"or the mean of their points (default {DEFAULT_LAYER})",
        TERRAIN,
        choices=LAYERS,
        goes_with="terrain",
    )
    center_caps: bool = _option(
        False,
        "with --method polar: end slabs centred on the end points",
        OBJECT,
        kind="flag",
        goes_with="polar",
    )
    hollow: bool = _option(
        False, "what would hold water is void, not solid", OBJECT, kind="flag", goes_with="section"
    )
    max_gap: Optional[float] = _option(
        None,
        "widest opening in the surface to be closed (default: found from the cloud)",
        OBJECT,
        goes_with="section",
        **_LENGTH,
    )
    cameras: Optional[Any] = _option(
        None,
        "where photographs were taken (shots.geojson, geo.txt, any text of x, y, z, or a folder of "
        "photographs with GPS): tells which space was seen to be empty (default: what the ODM "
        "project says)",
        OBJECT,
        goes_with="section",
        **_FILE,
    )
    floor: Union[str, float] = _option(
        "auto",
        "what it stands on; the ground is left out and the body closed there",
        OBJECT,
        choices=("auto", "none", "plane"),
        metavar="Z",
        goes_with="section",
        **_ELEVATION,
    )
    accuracy: Optional[float] = _option(
        None,
        "standard deviation of the surface of a closed mesh; gives it an interval",
        OBJECT,
        goes_with="section",
        **{**_LENGTH, "request": None},
    )
    grid: bool = _option(False, "no grid-to-ground correction", COORDINATES, kind="flag")
    gcp: Optional[Any] = _option(
        None,
        "taped distances, positions, scale bars: set the cloud's size right by them first",
        CONTROL,
        **_FILE,
    )
    area_frame: str = _option(
        "cloud",
        "with --gcp: areas and elevations are those of the delivered cloud and move with it "
        "(default), or were surveyed like the control",
        CONTROL,
        choices=("cloud", "control"),
        goes_with="control",
    )
    scale_mode: str = _option(
        "auto",
        "only the size (scale), also heading and place (shift), or everything (full); auto: what "
        "the cloud needs and the control can tell",
        CONTROL,
        choices=("auto", "scale", "shift", "full"),
        goes_with="control",
    )
    crs: Optional[str] = _option(
        None,
        "EPSG:n, WKT, a PROJ string or a file with one: in place of what the cloud says",
        COORDINATES,
        kind="text",
        metavar="CODE|FILE",
        amount="EPSG:n, WKT, a PROJ string or a file with one",
    )
    source_unit: Optional[str] = _option(
        None, "for a cloud that does not say", COORDINATES, choices=UNITS
    )
    vertical_unit: Optional[str] = _option(
        None, "of heights, in place of what the cloud says", COORDINATES, choices=UNITS
    )
    density: Optional[float] = _option(
        None,
        "adds tonnes",
        AMOUNTS,
        kind="number",
        metavar="T_PER_M3[:SIGMA]",
        above=0.0,
        amount="tonnes per cubic metre above 0 (T_PER_M3 or T_PER_M3:SIGMA)",
        request=(0, _DENSEST),
    )
    density_sigma: float = _option(
        0.0,
        kind="number",
        least=0.0,
        amount="tonnes per cubic metre from 0",
        title="the sigma of --density",
        request=(0, 100),
    )
    threads: int = _option(
        0,
        "default: the processor's, up to 4",
        AMOUNTS,
        kind="whole",
        metavar="N",
        least=1,
        most=256,
        amount="a number from 1 to 256",
        request=None,
    )

    def given(self) -> Dict[str, Any]:
        """Return the options that are not left at their defaults.

        Examples
        --------
        >>> Options(hollow=True, max_gap=0.5).given()
        {'hollow': True, 'max_gap': 0.5}
        """
        values = {name: getattr(self, name) for name in OPTIONS}
        return {
            name: value
            for name, value in values.items()
            if value is not None
            and (OPTIONS[name].kind == "given" or value != OPTIONS[name].default)
        }


#: Each option by its name.
OPTIONS: Mapping[str, Option] = {
    item.name: replace(item.metadata["option"], name=item.name) for item in fields(Options)
}


def read_options(given: Mapping[str, Any]) -> Options:
    """Return the options that a user gave, each checked and all together.

    Parameters
    ----------
    given : values by name, of options and of other things. ``density`` may have its sigma with it.

    Raises
    ------
    UsageError
        In one line, with the command line's names of the options.

    Examples
    --------
    >>> options = read_options({"density": "1.6:0.1", "slices": "7"})
    >>> options.density, options.density_sigma, options.slices
    (1.6, 0.1, 7)
    """
    values = {name: given[name] for name in OPTIONS if name in given}
    density = values.get("density")
    if isinstance(density, str) and ":" in density:
        values["density"], _, values["density_sigma"] = density.partition(":")
    read = {name: OPTIONS[name].read(value) for name, value in values.items()}
    return _consistent(Options(**read))


def _consistent(options: Options) -> Options:
    """Return the options, or raise UsageError for those that contradict each other."""
    given = options.given()
    density = options.density
    if density is not None and density > _DENSEST:
        raise UsageError(
            f"--density is {density:g} t/m3, more than that of any material ({_DENSEST:g}); for "
            f"{density:g} kg/m3 give {density / 1000:g}"
        )
    if "slices" in given and "slice_height" in given:
        raise UsageError("--slices and --slice-height exclude each other: give one of them")
    if options.base is not None and options.base_points is not None:
        raise UsageError("--base and --base-points exclude each other: give one of them")
    if options.base == "vertices" and (options.area is None or proposes(options.area)):
        raise UsageError("--base vertices goes with outlines that have elevations: give --area")
    if options.base == "vertices" and options.toe is not None:
        raise UsageError("--toe moves outlines, and --base vertices holds them: leave one out")
    if options.method == "section" and options.center_caps:
        raise UsageError("--center-caps goes with --method polar: leave one of them out")
    if options.method == "polar" and _for(given, "section"):
        raise UsageError(f"{_go('section')} with --method section, not polar")
    if options.gcp is None and _for(given, "control"):
        raise UsageError(f"{_go('control')} with --gcp: give a control file")
    if not proposes(options.area) and _for(given, "proposals"):
        raise UsageError(f"{_go('proposals')} with --area auto: leave them out")
    if proposes(options.area) and options.area_frame == "control":
        raise UsageError("--area-frame control goes with areas that were surveyed: not --area auto")
    if options.gcp is not None and options.base_points is not None:
        raise UsageError(
            "--base-points does not go with --gcp yet: write the cloud true to size first "
            "(quantify-client scale), and measure that"
        )
    if options.gcp is not None and options.grid:
        raise UsageError(
            "--grid goes without --gcp: with control everything is measured on the ground, as the "
            "tapes are"
        )
    return options


def proposes(area: Any) -> bool:
    """Return whether outlines are to be proposed, and not read.

    >>> proposes("auto"), proposes("./auto")
    (True, False)
    """
    return isinstance(area, str) and area == AUTO


def for_objects(options: Options) -> List[str]:
    """Return which of the options that were given say that an object is measured."""
    named = _for(options.given(), "object", "section", "polar")
    return [name for name in named if name != "accuracy"]


def _for(names: Iterable[str], *purposes: str) -> List[str]:
    """Return which of some options go with something."""
    return [name for name in names if OPTIONS[name].goes_with in purposes]


def _go(*purposes: str) -> str:
    """Return the names of all options that go with something, and the verb: ``--base goes``."""
    names = [OPTIONS[name].flag for name in _for(OPTIONS, *purposes)]
    return f"{', '.join(names[:-1])} and {names[-1]} go" if names[1:] else f"{names[0]} goes"


def choose_shape(options: Options, *, has_crs: bool, is_odm: bool) -> str:
    """Return ``"terrain"`` or ``"object"``: what was asked for, or what the source is.

    An option that only one shape knows decides, unless it is that of a mesh's faces, --accuracy;
    else an area, a CRS or an ODM output means terrain; else it is an object.

    >>> choose_shape(Options(center_caps=True), has_crs=True, is_odm=True)
    'object'
    >>> choose_shape(Options(), has_crs=True, is_odm=False)
    'terrain'
    """
    given, shape = options.given(), options.shape
    for_object = _for(given, "object", "section", "polar")
    for_terrain = _for(given, "terrain")
    if for_object and (for_terrain or shape == "terrain"):
        raise UsageError(
            f"{_go('object', 'section', 'polar')} with --shape object, {_go('terrain')} with "
            "--shape terrain"
        )
    if shape == "object" and for_terrain:
        raise UsageError(f"{_go('terrain')} with --shape terrain: leave one of them out")
    if shape == "auto":
        likely_terrain = for_terrain or options.area is not None or has_crs or is_odm
        shape = "terrain" if likely_terrain and not for_objects(options) else "object"
    if shape == "object" and options.area is not None:
        raise UsageError("--area goes with --shape terrain: an object is measured whole")
    return shape
