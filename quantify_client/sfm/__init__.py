"""Photographs, OpenDroneMap's outputs, and the servers that make these of those."""
