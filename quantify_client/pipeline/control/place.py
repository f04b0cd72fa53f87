"""Control -> the transform of a cloud, and the frame in which it is then measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ...crs import Frame, placed_frame
from ...errors import ControlError
from ...scaler.adjustment.build import CloudPlace, build_network
from ...scaler.adjustment.direct import direct_heights
from ...scaler.adjustment.fit import Fit, fit
from ...scaler.adjustment.similarity import Similarity
from ...scaler.adjustment.summary import (
    carried_by,
    conflict,
    judgements,
    observations,
    point_std,
    root_mean_square,
)
from ...scaler.control.read import read_control
from ...source import Source
from ...types import Bounds, ControlledPoint, FloatArray, Matrix4, Options, Scaling
from ..streaming import nothing_usable
from .positions import cloud_places
from .site import Site, Target, free_site, grid_site, height_notes, require_near, scaled, target_of

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
    fit: Fit
    site: Site
    target: Target
    bounds: Bounds

    @property
    def ratio(self) -> float:
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
        matrix = similarity.matrix()
        return _frame(self.frame.delivered, self.site, self.target, matrix, self.bounds)


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
    local = {name: _moved(place, site.to_local) for name, place in places.items()}
    network, assumed = build_network(control, site.local, site.level, local)
    if georeferenced:
        require_near(control, site, network)
    try:
        found = fit(network, options.scale_mode, georeferenced)
    except ControlError as error:
        raise ControlError(f"{control.label}: {error}") from error
    target = target_of(frame, site, found.mode)
    placed = _frame(frame, site, target, found.similarity.matrix(), bounds)
    notes = [*control.warnings, *notes, *assumed, *found.warnings, *_moves(found)]
    notes += _heights(found, site, options, control.height_m, georeferenced)
    scaling = _scaling(found, site, placed, [*notes, *judgements(found.adjustment)])
    return Placement(scaling, placed, found, site, target, bounds)


def _moved(place: CloudPlace, matrix: FloatArray) -> CloudPlace:
    linear = matrix[:3, :3]
    covariance = linear @ place.covariance @ linear.T
    return CloudPlace(linear @ place.xyz + matrix[:3, 3], covariance)


def _frame(
    base: Frame, site: Site, target: Target, similarity: FloatArray, bounds: Bounds
) -> Frame:
    matrix = target.from_local @ similarity @ site.to_local
    return placed_frame(base, matrix, target.crs, target.ground_factor, bounds)


def _moves(found: Fit) -> List[str]:
    """Say how far a georeferenced cloud was moved, and how well that is known."""
    if found.mode != "shift" or found.shift_std_m is None:
        return []
    similarity = found.similarity
    east, north, up = (float(value) for value in similarity.shift - similarity.pivot)
    moved = float(np.hypot(east, north))
    height = f", by {up:+.2f} m in height" if abs(up) >= 0.005 else ""
    turned = np.degrees(np.arctan2(similarity.rotation[1, 0], similarity.rotation[0, 0]))
    heading = f"{found.heading_std_deg:.2g}" if found.heading_std_deg is not None else "?"
    return [
        f"the cloud was moved by {moved:.2f} m across (known to {found.shift_std_m:.2g} m){height} "
        f"and turned by {abs(turned):.2f} degrees (known to {heading}); --scale-mode scale leaves "
        "it where it is"
    ]


def _heights(
    found: Fit, site: Site, options: Options, height: Optional[float], georeferenced: bool
) -> List[str]:
    """Say what is not known of heights, where something depends on it."""
    out = []
    levelled = bool(found.adjustment.model.network.levelled.any())
    if not georeferenced and found.mode != "scale" and not levelled:
        out.append(
            f"no elevation is known: the middle of the control is put at {site.level:g} m, and "
            "heights are relative to that"
        )
    if options.area_frame == "control" and isinstance(options.base, (int, float)) and not levelled:
        out.append(
            "the base is a surveyed elevation, but no control point has one: the cloud's heights "
            "are as delivered, and what they are off by is not in the budget; give elevations"
        )
    if georeferenced and height is not None and abs(height - site.level) > _FAR_UP_M:
        out.append(
            f"the site's height ({height:g} m) is not that of the cloud's z ({site.level:.0f} m): "
            "a cloud written to a file is measured at its z, whose grid lengths differ by "
            f"{abs(height - site.level) / 6.38e4:.3f} %"
        )
    return out


def _scaling(found: Fit, site: Site, frame: Frame, warnings: Sequence[str]) -> Scaling:
    adjustment = found.adjustment
    network = adjustment.model.network
    records = observations(adjustment, site.level)
    upright = site.local is not None and (frame.delivered.grid is not None or found.mode != "scale")
    up = np.where(network.clouded, adjustment.state.points[:, 2], np.nan) if upright else None
    points, loose = _points(found, site, frame)
    return Scaling(
        factor=found.factor,
        std=found.std,
        transform=_own_units(frame),
        mode=found.mode,
        target_crs=frame.crs,
        observations=tuple(records),
        points=tuple(points),
        direct=tuple(direct_heights(network, up)),
        rms_m=root_mean_square(records, check=False),
        check_rms_m=root_mean_square(records, check=True),
        carried_by=carried_by(adjustment),
        conflict=conflict(adjustment),
        tilt_std_deg=found.tilt_std_deg,
        warnings=(*warnings, *loose),
    )


def _own_units(frame: Frame) -> Matrix4:
    """Return the transform between coordinates as files have them; the frame's is in metres.

    A cloud in degrees goes to its UTM zone first: for it this is the transform from there.
    """
    base, matrix = frame.delivered, frame.matrix
    if base.geographic_crs is None:
        matrix = matrix @ scaled((base.unit_m, base.unit_m, base.z_unit_m))
    unit = frame.unit_m
    matrix = scaled((1.0 / unit, 1.0 / unit, 1.0 / frame.z_unit_m)) @ matrix
    return tuple(tuple(float(value) for value in row) for row in matrix)


def _points(found: Fit, site: Site, frame: Frame) -> Tuple[List[ControlledPoint], List[str]]:
    """Return the adjusted points, and a note on those that nothing ties to the others."""
    adjustment = found.adjustment
    network, state = adjustment.model.network, adjustment.state
    std = point_std(adjustment)
    factor = float(np.exp(state.log_scale))
    moved = Similarity(factor, state.rotation, state.shift, network.pivot).apply(network.cloud)
    lon = lat = np.full(len(network.names), np.nan)
    if site.local is not None and network.placed.any():
        lon, lat = site.local.to_wgs84(state.points)
    levelled = bool(network.levelled.any()) or frame.delivered.grid is not None
    points, loose = [], []
    for i, name in enumerate(network.names):
        if std[i].max() > _UNDETERMINED_M and not network.clouded[i]:
            loose.append(name)
            continue
        east, north, up = (float(value) for value in state.points[i])
        miss = state.points[i, :2] - network.horizontal[i]
        off = state.points[i] - moved[i]
        points.append(
            ControlledPoint(
                name=name,
                east=east,
                north=north,
                up=up,
                std=(float(std[i, 0]), float(std[i, 1]), float(std[i, 2])),
                gps_residual=(float(miss[0]), float(miss[1])) if network.placed[i] else None,
                cloud_residual=(float(off[0]), float(off[1]), float(off[2]))
                if network.clouded[i]
                else None,
                lon=float(lon[i]) if np.isfinite(lon[i]) else None,
                lat=float(lat[i]) if np.isfinite(lat[i]) else None,
                elevation_m=up + site.level if levelled else None,
            )
        )
    if not loose:
        return points, []
    return points, [f"nothing tells where {', '.join(loose[:8])} lies in height or at all; unused"]
