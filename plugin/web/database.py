"""What WebODM's database keeps for the plugin: who saved what, and what a task once had.

A restarted task loses its assets, and with them its measurements: only here can be known that
there were some. User names are here too, and not in the files, which WebODM serves to everyone
who may see the task, anonymous visitors of public ones included.
"""

from ..files.store import saved_paths

__all__ = ["forget", "names", "remember", "were_lost"]

_MOST = 500


def _key(task):
    return f"measurements::{task.id}"


def _read(plugin, task):
    known = plugin.get_global_data_store().get_json(_key(task), {})
    return dict(known) if isinstance(known, dict) else {}


def names(plugin, task):
    """Return who saved which measurement, by its id."""
    return {saved: who for saved, who in _read(plugin, task).items() if isinstance(who, str)}


def remember(plugin, task, saved, user):
    """Remember that a user saved a measurement; what is no longer there is forgotten."""
    present = {key for key, *_ in saved_paths(task)}
    known = {key: who for key, who in _read(plugin, task).items() if key in present}
    known[saved] = user
    if len(known) <= _MOST:
        plugin.get_global_data_store().set_json(_key(task), known)


def forget(plugin, task, saved):
    """Forget a measurement that was deleted on purpose."""
    known = _read(plugin, task)
    if known.pop(saved, None) is not None:
        plugin.get_global_data_store().set_json(_key(task), known)


def were_lost(plugin, task, present):
    """Whether the task had measurements, and none of them is there any more."""
    known = _read(plugin, task)
    return bool(known) and not any(saved in known for saved in present)
