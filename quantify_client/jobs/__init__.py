"""Jobs on a node: photographs out, all.zip in, across bad lines, restarts and reboots.

A job lives in a folder. `plan_job` checks everything before anything is sent, `create_job` writes
the journal, and `run_job` goes on from wherever the journal stands until all.zip is there.
"""

from .create import Plan, create_job, plan_job
from .events import JobEvent
from .own import Confirmed
from .run import Pace, cancel_job, run_job

__all__ = [
    "Confirmed",
    "JobEvent",
    "Pace",
    "Plan",
    "cancel_job",
    "create_job",
    "plan_job",
    "run_job",
]
