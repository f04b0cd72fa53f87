"""A small network for GNU Gama's gama-local, and what that says of it."""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np

from quantify_client.scaler.adjustment.network import Network

POSITIONS = {
    "A": (999.976, 1999.960),
    "B": (1032.393, 2011.713),
    "C": (1050.934, 1980.203),
    "D": (1018.583, 1968.276),
    "E": (1029.522, 1990.449),
}
POSITION_SIGMA = 0.03

ELEVATIONS = {"A": 50.003, "C": 61.788}
ELEVATION_SIGMA = 0.01

TAPES = {
    "AB": 34.7113,
    "BC": 37.2992,
    "CD": 37.4306,
    "DA": 36.8612,
    "AE": 31.9398,
    "BE": 21.7437,
    "CE": 24.0732,
    "DE": 26.7837,
    "AC": 55.8728,
}
TAPE_SIGMA = 0.004

# What gama-local 2.03 makes of it, in metres: x, y, z of A to E, and their standard deviations.
RECORDED = np.array(
    [
        (999.99375507, 1999.97471402, 50.00354741),
        (1032.39279329, 2011.70524871, 54.19803419),
        (1050.91707440, 1980.23273655, 61.78745259),
        (1018.58742468, 1968.27050981, 47.20189436),
        (1029.51695257, 1990.41779091, 57.56624731),
    ]
)
RECORDED_STD = np.array(
    [
        (0.01823815, 0.02117192, 0.00997900),
        (0.02478226, 0.02278735, 0.16694385),
        (0.01703716, 0.02436980, 0.00997900),
        (0.02581032, 0.02397268, 0.07850726),
        (0.01506453, 0.01739430, 0.02525343),
    ]
)

HIGHER = {"AB": "B", "CD": "C", "DA": "A", "AE": "E", "BE": "E", "CE": "C", "DE": "E", "BC": "C"}


def network() -> Network:
    names = tuple(POSITIONS)
    return Network(
        names=names,
        horizontal=np.array(list(POSITIONS.values())),
        horizontal_sigma=np.full(5, POSITION_SIGMA),
        elevation=np.array([ELEVATIONS.get(name, np.nan) for name in names]),
        elevation_sigma=np.full(5, ELEVATION_SIGMA),
        cloud=np.full((5, 3), np.nan),
        cloud_covariance=np.tile(np.eye(3), (5, 1, 1)),
        ends=np.array([[names.index(a), names.index(b)] for a, b in TAPES]),
        length=np.array(list(TAPES.values())),
        length_sigma=np.full(len(TAPES), TAPE_SIGMA),
        bar=np.zeros(len(TAPES), dtype=bool),
        check=np.zeros(len(TAPES), dtype=bool),
        higher=np.array([{p[1]: 1, p[0]: -1}.get(HIGHER.get(p, ""), 0) for p in TAPES]),
    )


def as_xml(approximate: Dict[str, np.ndarray]) -> str:
    """The network in gama-local's input format; standard deviations in millimetres."""
    points = "".join(
        f'<point id="{n}" x="{e}" y="{u}" z="{h}" adj="xyz"/>\n'
        for n, (e, u, h) in approximate.items()
    )
    tapes = "".join(
        f'<s-distance from="{a}" to="{b}" val="{v}" stdev="{1000 * TAPE_SIGMA}"/>\n'
        for (a, b), v in TAPES.items()
    )
    plane = "".join(f'<point id="{n}" x="{e}" y="{u}"/>\n' for n, (e, u) in POSITIONS.items())
    heights = "".join(f'<point id="{n}" z="{h}"/>\n' for n, h in ELEVATIONS.items())
    return f"""<?xml version="1.0"?>
<gama-local xmlns="http://www.gnu.org/software/gama/gama-local">
<network axes-xy="en" angles="left-handed">
<parameters sigma-apr="1" conf-pr="0.95" tol-abs="1000" sigma-act="apriori"/>
<points-observations>
{points}
<obs>
{tapes}</obs>
<coordinates>
{plane}{_covariance(2 * len(POSITIONS), POSITION_SIGMA)}</coordinates>
<coordinates>
{heights}{_covariance(len(ELEVATIONS), ELEVATION_SIGMA)}</coordinates>
</points-observations>
</network>
</gama-local>
"""


def _covariance(size: int, sigma: float) -> str:
    rows = f"{(1000 * sigma) ** 2} " * size
    return f'<cov-mat dim="{size}" band="0">{rows}</cov-mat>\n'


def run(
    program: str, folder: Path, approximate: Dict[str, np.ndarray]
) -> Tuple[np.ndarray, np.ndarray]:
    """(n, 3) adjusted x, y, z of every point and their standard deviations, by gama-local."""
    source, result = folder / "network.gkf", folder / "network.xml"
    source.write_text(as_xml(approximate))
    subprocess.run(
        [program, str(source), "--xml", str(result)], check=True, capture_output=True, timeout=60
    )
    places: Dict[str, List[float]] = {}
    variances: List[float] = []
    for part in ET.parse(result).iter():  # noqa: S314 (written by the line above)
        if part.tag.endswith("}adjusted"):
            for entry in part:
                fields = {child.tag.split("}")[1].lower(): child.text for child in entry}
                places[str(fields["id"])] = [float(fields[axis] or "nan") for axis in "xyz"]
        elif part.tag.endswith("}cov-mat"):  # the upper triangle, row by row, in mm^2
            numbers = [float(e.text or "nan") for e in part if e.tag.endswith("}flt")]
            size = 3 * len(places)
            first = np.cumsum([0, *range(size, 1, -1)])
            variances = np.array(numbers)[first].tolist()
    found = np.array([places[name] for name in POSITIONS])
    return found, np.sqrt(variances).reshape(-1, 3) / 1000.0
