"""A mesh that encloses a volume by its faces, or the words why only its vertices count."""

from __future__ import annotations

from dataclasses import replace
from typing import Mapping, NamedTuple, Optional, Tuple, Union

import numpy as np

from ..cloud import Cloud, Mesh
from ..crs import Frame
from ..source import Source
from ..types import AreaResult, Faces, Options
from ..volcalc.mesh.measure import MeshRecipe, measure_mesh
from .common import bounds_in_frame, ground_factor, only_vertices, window_of
from .streaming import Progress, gather

__all__ = ["ByFaces", "measure_faces"]


class ByFaces(NamedTuple):
    """A result, the counts of points left out, grid length / ground length, and warnings."""

    result: AreaResult
    left_out: Mapping[str, int]
    factor: Optional[float]
    warnings: Tuple[str, ...]


def measure_faces(
    source: Source, frame: Frame, options: Options, report: Progress
) -> Union[ByFaces, Tuple[str, ...]]:
    """Return the volume within the faces of a mesh, or warnings that say why it has none.

    Raises
    ------
    CloudError
        The faces are damaged.
    """
    if not source.cloud.info.faces:
        if options.accuracy is None:
            return ()
        return (
            "--accuracy is that of a mesh's faces, and the cloud has none: it has no effect; leave "
            "it out",
        )
    if options.method == "polar" or options.center_caps:
        return only_vertices(source, "--method polar takes points")
    lost = "" if options.accuracy is None else "; --accuracy has no effect"
    report("reading faces", 0.0)
    faces = source.cloud.faces() if isinstance(source.cloud, Mesh) else None
    if faces is None:
        return only_vertices(
            source, f"they are those of several files; join the meshes, or measure each{lost}"
        )
    x, y, z, left_out = gather(source.cloud, frame, report)
    renumbered = _renumbered(source.cloud, faces) if any(left_out.values()) else faces
    if renumbered is None:
        count = sum(left_out.values())
        said = "1 vertex is" if count == 1 else f"{count} vertices are"
        return only_vertices(source, f"{said} left out{lost}")
    bounds = bounds_in_frame(source, frame)
    height = 0.5 * (bounds.min_z + bounds.max_z)
    factor = ground_factor(source, frame, window_of(bounds), height, options)
    recipe = MeshRecipe(options.slices, options.slice_height, options.accuracy, factor or 1.0)
    report("judging the mesh", 0.0)
    found = measure_mesh(source.stem, np.column_stack([x, y, z]), renumbered, recipe)
    report("judging the mesh", 1.0)
    if isinstance(found, str):
        return only_vertices(source, found + lost)
    return ByFaces(found, left_out, factor, _without_effect(options))


def _renumbered(cloud: Cloud, faces: Faces) -> Optional[Faces]:
    """Return faces with the numbers of the points that are kept; None where they have others."""
    kept = np.concatenate(
        [
            np.ones(len(chunk), dtype=bool) if chunk.kept is None else chunk.kept
            for chunk in cloud.chunks()
        ]
    )
    if not kept[faces.corners].all():
        return None
    return replace(faces, corners=(np.cumsum(kept) - 1)[faces.corners])


def _without_effect(options: Options) -> Tuple[str, ...]:
    given = (
        ("--hollow", options.hollow),
        ("--max-gap", options.max_gap is not None),
        ("--floor", options.floor != "auto"),
    )
    names = [name for name, is_given in given if is_given]
    if not names:
        return ()
    return (f"without effect: {', '.join(names)}; a closed mesh is measured as its faces are",)
