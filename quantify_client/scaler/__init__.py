"""Relative control points -> true size: control files, adjustment, similarity transform."""
