"""Figures of terrain."""
