"""Terrain: cut, fill and net of an open surface above a base."""
