"""Stages with control: the transform of a cloud and what follows from it."""
