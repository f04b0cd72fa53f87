"""The error tree.

Every message is one line that holds what was found, what was expected, and the way out::

    QuantifyError
    +-- InputError (ValueError)      what the user gave cannot be used
    |   +-- CloudError               a point cloud or the archive around it
    |   +-- AreaError                a polygon or the file around it
    |   +-- CrsError                 a coordinate reference system or a unit
    |   +-- DesignError              a design surface, or the file around it
    |   +-- SupportError             too few points under an area
    |   +-- ControlError             a control file, or what it says of a cloud
    |   +-- UsageError               options that contradict each other
    +-- ServerError (OSError)        a server refuses, cannot be reached, or answers nonsense
    +-- JobError (RuntimeError)      a job on a server failed, was lost, or its folder is in use
    +-- OutputError (OSError)        what we were to write cannot be written
    +-- MissingExtraError (ImportError)   a package is needed that is not installed
"""

from __future__ import annotations

from importlib.util import find_spec

__all__ = [
    "AreaError",
    "CloudError",
    "ControlError",
    "CrsError",
    "DesignError",
    "InputError",
    "JobError",
    "MissingExtraError",
    "OutputError",
    "QuantifyError",
    "ServerError",
    "SupportError",
    "UsageError",
    "require_installed",
]


class QuantifyError(Exception):
    """Root of everything this package raises on purpose."""


class InputError(QuantifyError, ValueError):
    """What the user gave cannot be used."""


class CloudError(InputError):
    """A point cloud, or the folder or archive that should hold one, cannot be read."""


class AreaError(InputError):
    """A polygon, or the file that should hold it, cannot be used."""


class CrsError(InputError):
    """A coordinate reference system or a unit is missing, unknown or does not fit."""


class DesignError(InputError):
    """A design surface, or the file that should hold it, cannot be used."""


class SupportError(InputError):
    """Too few points lie under an area to measure it."""


class ControlError(InputError):
    """A control file cannot be read, or the control it holds cannot do what is asked of it."""


class UsageError(InputError):
    """Options contradict each other or are out of range."""


class ServerError(QuantifyError, OSError):
    """A server refuses what it is asked, cannot be reached, or answers with nonsense."""


class JobError(QuantifyError, RuntimeError):
    """A job failed or was lost on its server, or its folder holds none or is in use."""


class OutputError(QuantifyError, OSError):
    """A result cannot be written where it should go."""


class MissingExtraError(QuantifyError, ImportError):
    """A package is needed that is not installed."""


def require_installed(package: str, what: str) -> None:
    """Raise MissingExtraError where a package is not installed that `what` needs."""
    if find_spec(package) is None:
        raise MissingExtraError(
            f"{what} needs {package}, which is not installed; install it (pip install {package})"
        )
