"""How fast jobs of tests ask and try again."""

from quantify_client.jobs import Pace

PACE = Pace(poll_s=0.02, pause_s=0.01, silence_s=0.5)
