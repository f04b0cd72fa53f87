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
        from app.plugins.functions import get_plugin_by_name

        name = package.split(".")[-1]
        plugin = get_plugin_by_name(name, only_active=False, refresh_cache_if_none=True)
        if plugin is None:
            raise ImportError("not there", name="the plugin itself")
        with plugin.python_imports():
            work = importlib.import_module(package + ".work")
            work.run(root, job)
    except BaseException as error:
        if os.path.exists(os.path.join(folder, "cancel")):
            return {"output": {"job": job}}
        logging.getLogger("app.logger").exception("volcalc: job %s failed", job)
        # The plugin's own modules may be what failed, so the state is written without them.
        # Its text may hold paths of the server, which are for the log alone.
        words = "the measurement stopped with {}: the log of WebODM's worker says more"
        words = words.format(type(error).__name__)
        if isinstance(error, ImportError):
            words = f"the worker lacks {error.name}: restart WebODM, or add the plugin again"
        try:
            partial = os.path.join(folder, ".state.json.failed")
            state = {"state": "failed", "beat": time.time(), "error": words}
            with open(partial, "w", encoding="utf-8") as stream:
                json.dump(state, stream)
            os.replace(partial, os.path.join(folder, "state.json"))
        except OSError:
            pass
    return {"output": {"job": job}}
