"""Closed meshes: the volume within their faces, exactly."""
