"""Entwine Point Tiles: an index, and a file for each tile."""
