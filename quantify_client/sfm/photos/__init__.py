"""Photographs, cameras, and points picked in photographs."""
