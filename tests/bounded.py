"""A measurement in a process of its own, with what it took."""

import json
import subprocess
import sys
from dataclasses import dataclass
from typing import Any, Mapping, Sequence

MOST_MB = 600
MOST_SECONDS = 20  # of the processor: the machine may have other things to do

_CHILD = f"""
import json, resource, sys
resource.setrlimit(resource.RLIMIT_CPU, ({MOST_SECONDS}, {MOST_SECONDS} + 5))
from quantify_client import measure
from quantify_client.errors import QuantifyError
asked = json.load(sys.stdin)
told = {{"error": None, "results": [], "warnings": []}}
try:
    measurement = measure(asked["cloud"], threads=1, **asked["options"])
    told["warnings"] = list(measurement.warnings)
    for result in measurement.results:
        told["results"].append({{
            "name": result.name,
            "error": getattr(result, "error", None),
            "volume_m3": getattr(result, "volume_m3", None),
            "std_m3": getattr(result, "std_m3", None),
            "left_out": dict(getattr(result, "points_left_out", {{}})),
        }})
except QuantifyError as error:
    told["error"] = str(error)
with open("/proc/self/status") as lines:
    status = dict(line.split(":", 1) for line in lines if ":" in line)
told["peak_mb"] = int(status["VmHWM"].split()[0]) // 1024
print(json.dumps(told))
"""


@dataclass(frozen=True)
class Told:
    """What a measurement said."""

    error: Any
    results: Sequence[Mapping[str, Any]]
    warnings: Sequence[str]
    peak_mb: int

    @property
    def only(self) -> Mapping[str, Any]:
        (result,) = self.results
        return result

    @property
    def problem(self) -> str:
        """Why there is no result, in one line."""
        said = self.error or self.only["error"]
        assert said, self
        assert "\n" not in said
        return said


def measured(cloud: Any, **options: Any) -> Told:
    """Measure within the limits, every warning of a library being an error."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", _CHILD],
        input=json.dumps({"cloud": str(cloud), "options": options}),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert not done.stderr, done.stderr[-2000:]
    told = Told(**json.loads(done.stdout))
    assert told.peak_mb < MOST_MB, told
    return told
