"""What a plugin imports."""

from .base import MountPoint, PluginBase

__all__ = ["MountPoint", "PluginBase"]
