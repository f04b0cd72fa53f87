"""The frame of a second cloud: from its own coordinates into the frame of the first."""

from __future__ import annotations

from dataclasses import replace

from ..errors import CrsError
from .frame import Frame

__all__ = ["frame_onto"]


def frame_onto(own: Frame, target: Frame, name: str) -> Frame:
    """Return the frame that brings a cloud into the metres of another cloud's frame.

    Heights are brought to metres and not sent through a datum, as everywhere.

    Parameters
    ----------
    own : the measuring frame of the cloud by itself.
    target : that of the other cloud.
    name : of the cloud, for messages.

    Raises
    ------
    CrsError
        Only one of the two has a CRS, or only one a unit.
    """
    if target.placement is not None:
        raise CrsError("a survey that control has placed is not compared with another one yet")
    if (own.crs is None) != (target.crs is None):
        without, other = (name, "the other one") if own.crs is None else ("the other one", name)
        raise CrsError(
            f"{without} has no CRS, and {other} has {own.crs or target.crs}; expected both in the "
            "same coordinates, or each with its CRS: write it into the file"
        )
    if own.crs is None or own.cloud_crs == target.cloud_crs:
        if own.length_unit != target.length_unit:
            raise CrsError(
                f"the unit of {name} is {own.length_unit}, that of the other one "
                f"{target.length_unit}; expected both to be known: write it into the file"
            )
        return own
    return replace(
        target,
        warnings=own.warnings,
        geographic_crs=own.cloud_crs,
        z_unit_m=own.z_unit_m,
        center_lon=own.center_lon,
    )
