"""A point cloud through a transform into a new LAS or LAZ file, written by laspy.

:mod:`.rewrite` says what is done in which order, :mod:`.sources` reads any format with all its
attributes, :mod:`.columns` sorts named columns into fields, :mod:`.record_layout` lays out records,
:mod:`.coordinates` chooses the scale and the offsets, :mod:`.las_file` hands everything to laspy.
"""

from .rewrite import RewriteReport, require_rewritable, rewrite_cloud

__all__ = ["RewriteReport", "require_rewritable", "rewrite_cloud"]
