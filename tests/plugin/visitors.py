"""Visitors of the stand-in: requests as a browser sends them, and what the tests measure."""

from __future__ import annotations

import http.cookiejar
import json
import time
import urllib.error
import urllib.request
from typing import Any, NamedTuple, Optional

import shapely
from beach import frame_of

from quantify_client.crs import geometry_to_wgs84

API = "/api/plugins/volcalc/task"
SECONDS = 90.0  # of a machine that does other things besides


class Answer(NamedTuple):
    status: int
    body: bytes
    headers: Any

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def error(self) -> str:
        return str(self.json["error"])


class Visitor:
    """One browser: logged in as a user, or nobody."""

    def __init__(self, base: str, user: Optional[str] = None) -> None:
        self.base, self._jar = base, http.cookiejar.CookieJar()
        self._open = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(self._jar)).open
        self.get("/test/login" + (f"?user={user}" if user else ""))

    def get(self, path: str) -> Answer:
        return self.ask("GET", path)

    def post(self, path: str, body: Any = None) -> Answer:
        return self.ask("POST", path, {} if body is None else body)

    def ask(self, method: str, path: str, body: Any = None, kind: str = "json") -> Answer:
        tokens = [cookie.value for cookie in self._jar if cookie.name == "csrftoken"]
        headers = {"X-CSRFToken": str(tokens[0])} if tokens else {}
        data = None
        if body is not None:
            headers["Content-Type"] = f"application/{kind}"
            data = body if isinstance(body, bytes) else json.dumps(body).encode()
        where = self.base + path
        request = urllib.request.Request(where, data, headers, method=method)  # noqa: S310
        try:
            with self._open(request, timeout=SECONDS) as found:
                return Answer(found.status, found.read(), found.headers)
        except urllib.error.HTTPError as error:
            with error:
                return Answer(error.code, error.read(), error.headers)

    def wait(self, task: str, job: str, *states: str) -> Any:
        """Wait until a job is in one of these states; by default until it has ended."""
        wanted = states or ("done", "failed", "cancelled", "lost")
        ends = time.monotonic() + SECONDS
        while time.monotonic() < ends:
            state = self.get(f"{API}/{task}/jobs/{job}").json
            if state["state"] in wanted:
                return state
            time.sleep(0.02)
        raise AssertionError(f"still {state}")

    def measured(self, task: str, **asked: Any) -> Any:
        """Start a measurement, wait for it, and return its document."""
        started = self.post(f"{API}/{task}/jobs", {"area": ROUND, **asked})
        assert started.status == 202, started.body
        state = self.wait(task, started.json["job"])
        assert state["state"] == "done", state
        answer = self.get(f"{API}/{task}/jobs/{started.json['job']}/result")
        assert answer.status == 200, answer.body
        return answer.json

    def saved(self, task: str, name: str = "round", **asked: Any) -> Any:
        """Measure, save, and return what is kept."""
        document = self.measured(task, **asked)
        answer = self.post(f"{API}/{task}/measurements", {"job": document["id"], "name": name})
        assert answer.status == 201, answer.body
        return answer.json


def lon_lat(polygon: Any) -> Any:
    """Return a polygon of the beach's grid as GeoJSON geometry."""
    moved = geometry_to_wgs84(polygon, frame_of("EPSG:32615"))
    return json.loads(json.dumps(shapely.geometry.mapping(moved)))


#: Round the roofed structure beside the road, roughly.
PLACE = shapely.Point(576_711.5, 5_188_138.9).buffer(5.0, 8)
ROUND = {"type": "Feature", "properties": {"name": "round"}, "geometry": lon_lat(PLACE)}
