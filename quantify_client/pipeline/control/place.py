"""Control -> the transform of a cloud, and the frame in which it is then measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import List, Sequence, Tuple

import numpy as np

from ...crs import Frame, placed_frame
from ...errors import ControlError
from ...scaler.adjustment.build import build_network
from ...scaler.adjustment.direct import direct_heights
from ...scaler.adjustment.fit import ScaleFit, fit
from ...scaler.adjustment.similarity import Similarity
from ...scaler.adjustment.summary import (
    findings,
    observations,
    root_mean_square,
    scale_source,
    worst_conflict,
)
from ...scaler.control.model import Control
from ...scaler.control.read import read_control
from ...source import Source
from ...types import Bounds, ControlledPoint, FloatArray, Matrix4, Options, Scaling
from ...types.notice import Notice
from ..streaming import nothing_usable
from .positions import cloud_places
from .site import ControlSite, Target, free_site, grid_site, height_notes, require_near, target_of
from .to_odm import controlled_point

__all__ = ["Placement", "place_cloud"]

#: A difference in height that is worth a word: 0.003 % of lengths.
_FAR_UP_M = 200.0

_UNDETERMINED_M = 1000.0  # a coordinate known no better than this is not known


@dataclass(frozen=True)
class Placement:
    """A transform, and what it was made of.

    Attributes
    ----------
    frame : in which the moved cloud is measured.
    """

    scaling: Scaling
    frame: Frame
    fit: ScaleFit
    site: ControlSite
    target: Target
    bounds: Bounds

    @property
    def relative_std(self) -> float:
        """Standard deviation of the scale / the scale."""
        return self.fit.std / self.fit.factor

    def resized(self, share: float) -> Frame:
        """Return the frame with a scale larger by a share of itself, about the control's middle."""
        similarity = self.fit.similarity
        return self._with(replace(similarity, scale=similarity.scale * (1.0 + share)))

    def shifted(self, by: FloatArray) -> Frame:
        """Return the frame with the cloud lying further east, north and up, metres."""
        similarity = self.fit.similarity
        return self._with(replace(similarity, shift=similarity.shift + by))

    def _with(self, similarity: Similarity) -> Frame:
        return _frame(self.frame.delivered, self.site, self.target, similarity, self.bounds)


def place_cloud(source: Source, frame: Frame, options: Options) -> Placement:
    """Fit the transform that the control asks for.

    Raises
    ------
    ControlError
        A control file that cannot be read, or control that cannot fix what is asked of it.
    """
    bounds = source.cloud.info.bounds
    if bounds is None:
        raise nothing_usable()
    control = read_control(str(options.gcp))
    places, notes = cloud_places(source, frame, control)
    georeferenced = frame.grid is not None
    if georeferenced:
        site = grid_site(frame, control, places, odm=source.is_odm)
    else:
        site = free_site(control, places)
        notes += height_notes(control, site)
    network, assumed = build_network(control, site.local, site.level, site.moved(places))
    if georeferenced:
        require_near(control, site, network)
    try:
        found = fit(network, options.scale_mode, georeferenced)
    except ControlError as error:
        raise ControlError(f"{control.label}: {error}") from error
    target = target_of(frame, site, found.mode)
    placed = _frame(frame, site, target, found.similarity, bounds)
    points, undetermined = _points(found, site, placed)
    warnings = (
        *control.warnings,
        *notes,
        *assumed,
        *found.warnings,
        *_move_notes(found),
        *_elevation_notes(found, site, options, control, georeferenced),
        *findings(found.adjustment),
        *undetermined,
    )
    scaling = _scaling(found, site, placed, points, warnings)
    return Placement(scaling, placed, found, site, target, bounds)


def _frame(
    base: Frame, site: ControlSite, target: Target, similarity: Similarity, bounds: Bounds
) -> Frame:
    matrix = target.from_local @ similarity.matrix() @ site.to_local
    return placed_frame(base, matrix, target.crs, target.ground_factor, bounds)


def _move_notes(found: ScaleFit) -> List[Notice]:
    """Return how far a georeferenced cloud was moved, and how well that is known."""
    if found.mode != "shift" or found.shift_std_m is None:
        return []
    similarity = found.similarity
    east, north, up = (similarity.shift - similarity.pivot).tolist()
    moved = float(np.hypot(east, north))
    height = f", by {up:+.2f} m in height" if abs(up) >= 0.005 else ""
    turned = float(np.degrees(np.arctan2(similarity.rotation[1, 0], similarity.rotation[0, 0])))
    heading = "?" if found.heading_std_deg is None else f"{found.heading_std_deg:.2g}"
    text = (
        f"the cloud was moved by {moved:.2f} m across (known to {found.shift_std_m:.2g} m){height} "
        f"and turned by {abs(turned):.2f} degrees (known to {heading}); --scale-mode scale leaves "
        "it where it is"
    )
    values = {"east_m": east, "north_m": north, "up_m": up, "turned_deg": turned}
    return [Notice("cloud-moved", text, **values)]


def _elevation_notes(
    found: ScaleFit, site: ControlSite, options: Options, control: Control, georeferenced: bool
) -> List[Notice]:
    """Return what is not known of heights, where something depends on it."""
    out, height = [], control.height_m
    levelled = found.adjustment.model.network.levelled.any()
    if not georeferenced and found.mode != "scale" and not levelled:
        text = (
            f"no elevation is known: the middle of the control is put at {site.level:g} m, and "
            "heights are relative to that"
        )
        out.append(Notice("heights-relative", text, level_m=site.level))
    if options.area_frame == "control" and isinstance(options.base, (int, float)) and not levelled:
        text = (
            "the base is a surveyed elevation, but no control point has one: the cloud's heights "
            "are as delivered, and what they are off by is not in the budget; give elevations"
        )
        out.append(Notice("base-not-tied", text))
    if georeferenced and height is not None and abs(height - site.level) > _FAR_UP_M:
        text = (
            f"the site's height ({height:g} m) is not that of the cloud's z ({site.level:.0f} m): "
            "a cloud written to a file is measured at its z, whose grid lengths differ by "
            f"{abs(height - site.level) / 6.38e4:.3f} %"
        )
        out.append(Notice("height-unlike-cloud", text, height_m=height, cloud_z_m=site.level))
    return out


def _scaling(
    found: ScaleFit,
    site: ControlSite,
    frame: Frame,
    points: Sequence[ControlledPoint],
    warnings: Sequence[str],
) -> Scaling:
    adjustment = found.adjustment
    network = adjustment.model.network
    records = observations(adjustment, site.level)
    upright = site.local is not None and (frame.delivered.grid is not None or found.mode != "scale")
    up = np.where(network.in_cloud, adjustment.state.points[:, 2], np.nan) if upright else None
    return Scaling(
        factor=found.factor,
        std=found.std,
        transform=_in_own_units(frame),
        mode=found.mode,
        target_crs=frame.crs,
        observations=tuple(records),
        points=tuple(points),
        direct=tuple(direct_heights(network, up)),
        rms_m=root_mean_square(records, check=False),
        check_rms_m=root_mean_square(records, check=True),
        carried_by=scale_source(adjustment),
        conflict=worst_conflict(adjustment),
        tilt_std_deg=found.tilt_std_deg,
        warnings=warnings,
    )


def _in_own_units(frame: Frame) -> Matrix4:
    """Return the transform between coordinates as files have them; the frame's is in metres.

    A cloud in degrees goes to its UTM zone first: for it this is the transform from there.
    """
    base, matrix = frame.delivered, frame.matrix
    if base.geographic_crs is None:
        matrix = matrix @ np.diag([base.unit_m, base.unit_m, base.z_unit_m, 1.0])
    unit = frame.unit_m
    matrix = np.diag([1.0 / unit, 1.0 / unit, 1.0 / frame.z_unit_m, 1.0]) @ matrix
    return tuple(tuple(row) for row in matrix.tolist())


def _points(
    found: ScaleFit, site: ControlSite, frame: Frame
) -> Tuple[List[ControlledPoint], List[Notice]]:
    """Return the adjusted points, and a warning of those that nothing ties to the others."""
    adjustment = found.adjustment
    network, state, std = adjustment.model.network, adjustment.state, adjustment.point_std
    factor = float(np.exp(state.log_scale))
    moved = Similarity(factor, state.rotation, state.shift, network.pivot).apply(network.cloud)
    lonlat = np.full((len(network.names), 2), np.nan)
    if site.local is not None and network.placed.any():
        lonlat = np.column_stack(site.local.to_wgs84(state.points))
    levelled = network.levelled.any() or frame.delivered.grid is not None
    loose = (std.max(axis=1) > _UNDETERMINED_M) & ~network.in_cloud
    points = []
    for i in np.flatnonzero(~loose).tolist():
        height = float(state.points[i, 2]) + site.level if levelled else None
        off = state.points[i] - moved[i] if network.in_cloud[i] else None
        points.append(controlled_point(network, i, state.points[i], std[i], lonlat[i], height, off))
    if not loose.any():
        return points, []
    names = [network.names[i] for i in np.flatnonzero(loose)]
    text = (
        f"the position of {', '.join(names[:8])} is undetermined and not used: add a distance, a "
        "position or an elevation"
    )
    return points, [Notice("point-undetermined", text, points=names)]
