"""Closed bodies: the space that a surface encloses."""
