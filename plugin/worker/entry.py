"""What WebODM's worker runs.

WebODM sends the text of this one function and runs it in an empty namespace: everything it needs is
imported inside. It returns a reference only, because WebODM hands a job's result to anyone who
knows its id; and it never raises, because WebODM answers that with an error of its own for ever.
WebODM's own progress is not used: it breaks when it is called from another thread than the job's.
"""


def run_job(package, root, job):
    """Measure what a job's folder asks for, and leave the result there."""
    import importlib
    import json
    import logging
    import os
    import time

    folder = os.path.join(root, job)
    try:
        # Whoever makes this file decides: a job that its user was told is lost does not run, and
        # none runs twice.
        taken = os.path.join(folder, "taken")
        os.close(os.open(taken, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
    except (FileExistsError, FileNotFoundError, NotADirectoryError):
        return {"output": {"job": job}}
    except OSError:
        pass  # a full disk: the measurement will say so
    try:
        from app.plugins.functions import get_plugin_by_name

        name = package.split(".")[-1]
        plugin = get_plugin_by_name(name, only_active=False, refresh_cache_if_none=True)
        if plugin is None:
            raise ImportError("not there", name="the plugin itself")
        with plugin.python_imports():
            work = importlib.import_module(package + ".worker.measuring")
            work.run(root, job)
    except BaseException as error:
        if os.path.exists(os.path.join(folder, "cancel")) or not os.path.exists(folder):
            return {"output": {"job": job}}
        logging.getLogger("app.logger").exception("volcalc: job %s failed", job)
        # The plugin's own modules may be what failed, so the state is written without them.
        # Its text may hold paths of the server, which are for the log alone.
        words = "the measurement stopped with {}: the log of WebODM's worker says more"
        words = words.format(type(error).__name__)
        if isinstance(error, ImportError):
            words = f"the worker lacks {error.name}: restart WebODM, or add the plugin again"
        if isinstance(error, OSError) and error.strerror:
            words = f"the worker cannot read or write its files ({error.strerror}): free some "
            words += "space on the server's disk, or ask WebODM's administrator"
        try:
            # In its place: on a full disk only the file that is there has room left.
            with open(os.path.join(folder, "state.json"), "r+", encoding="utf-8") as stream:
                json.dump({"state": "failed", "beat": time.time(), "error": words}, stream)
                stream.truncate()
        except OSError:
            pass
    return {"output": {"job": job}}
