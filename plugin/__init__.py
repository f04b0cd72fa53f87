from .plugin import *  # noqa: D104, F403 - WebODM looks for Plugin here
