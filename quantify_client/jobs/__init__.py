"""Jobs on a node: photographs out, all.zip in, across bad lines, restarts and reboots.

A job lives in a folder. `plan_job` checks everything before anything is sent, `create_job` writes
the journal, and `run_job` goes on from wherever the journal stands until all.zip is there.
"""

from .create import JobPlan, create_job, plan_job
from .job import JobEvent
from .run import Pace, cancel_job, run_job
from .trust import Confirmed

__all__ = [
    "Confirmed",
    "JobEvent",
    "JobPlan",
    "Pace",
    "cancel_job",
    "create_job",
    "plan_job",
    "run_job",
]
