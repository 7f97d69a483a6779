"""Mock of the live laboratory's server: the other side of the page, without ROS.

`PYTHONPATH=test ./flexarm exec python -m support.live_mock` prints an address.
"""

from __future__ import annotations

import json
import threading
import time
from contextlib import suppress
from http import HTTPStatus
from itertools import count
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from flexarm_live.page_files import INDEX, page_files
from flexarm_live.serving.encoding import as_json
from support.live_mock_lab import (
    MockArm,
    MockLinks,
    compared,
    frame,
    greeting,
    greeting_of,
    identified,
    tuned,
    tuned_line,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import Self

    from flexarm_core.rig_description import RigDescription

TOKEN = "mock"  # noqa: S105 - of no secret
FRAMES_PER_S = 60
STATES_PER_S = 2
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
JOB_STEPS = ("reading", "computing", "writing")


class Refusal(Exception):  # noqa: N818 - it is the reply
    """Reason why a request is not done."""


class LiveMock:
    """Server of the page with an arm of its own, the thesis's or that of a description.

    `requests` holds what pages asked for.
    """

    def __init__(
        self,
        rate_hz: float = 300.0,
        job_step_s: float = 0.03,
        rig: RigDescription | None = None,
    ) -> None:
        self.rate_hz = rate_hz if rig is None else rig.rate_hz
        self.rig = rig
        self.job_step_s = job_step_s
        self.writing_s = 0.0
        self.arm: Any = MockArm(rate_hz) if rig is None else MockLinks(rig)
        self.requests: list[dict[str, Any]] = []
        self.solids: list[dict[str, Any]] = []
        self.poses: list[list[float]] = []
        self.files = page_files()
        self.badge = "DRIVING"
        self.payload_kg = 0.0
        self.recording: str | None = None
        self.bags = ["run1"]
        self.dropped: dict[str, bytes] = {}
        self.waveform: dict[str, Any] = {"kind": "none"}
        self._holder: ServerConnection | None = None
        self._pages: list[ServerConnection] = []
        self.jobs: list[int] = []
        self._job_numbers = count(100)
        self._due: list[threading.Thread] = []
        self._cancelled: set[int] = set()
        self._ended = threading.Event()
        self.greets = threading.Event()
        self.greets.set()
        self.opens = True
        self.acknowledges = True
        self._server = serve(
            self._serve_page,
            "127.0.0.1",
            0,
            process_request=self._serve_file,
            # A busy machine may keep a page from its answer for longer than the usual time.
            ping_interval=None,
        )
        self._threads = [
            threading.Thread(target=self._server.serve_forever, daemon=True),
            threading.Thread(target=self._sample, daemon=True),
        ]

    @property
    def address(self) -> str:
        """Address that a person opens, with the token."""
        return f"http://127.0.0.1:{self._server.socket.getsockname()[1]}/#token={TOKEN}"

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._server.shutdown()

    def send_state(self) -> None:
        """Tell every page the state."""
        for page in list(self._pages):
            _send(page, as_json(self._state(page)))

    def _serve_file(self, _: ServerConnection, request: Request) -> Response | None:
        path = request.path.partition("?")[0]
        if path in {"/live", "/stop", "/drop"}:
            return None if self.opens else Response(HTTPStatus.SERVICE_UNAVAILABLE, "", Headers())
        file = self.files.get(path.removeprefix("/") or INDEX)
        if file is None:
            return Response(HTTPStatus.NOT_FOUND, "Not Found", Headers())
        headers = Headers()
        headers["Content-Type"] = file.media_type
        headers["Content-Length"] = str(len(file.content))
        headers["Content-Security-Policy"] = POLICY
        headers["X-Content-Type-Options"] = "nosniff"
        return Response(HTTPStatus.OK, "OK", headers, file.content)

    def _serve_page(self, page: ServerConnection) -> None:
        hand = page.request is not None and page.request.path.endswith(f"token={TOKEN}")
        if page.request is not None and page.request.path.startswith("/stop"):
            with suppress(ConnectionClosed):
                for text in page:
                    self._take(page, json.loads(text))
            return
        if page.request is not None and page.request.path.startswith("/drop"):
            self._take_file(page, parse_qs(urlsplit(page.request.path).query)["name"][0])
            return
        self.greets.wait()
        _send(page, as_json(self._greeting(hand=hand)))
        _send(page, as_json(self._state(page)))
        self._pages.append(page)
        try:
            for text in page:
                self._take(page, json.loads(text))
        except ConnectionClosed:
            pass
        finally:
            self._pages.remove(page)
            self._holder = None if self._holder is page else self._holder

    def _take_file(self, page: ServerConnection, name: str) -> None:
        content = b"".join(iter(page.recv, "end"))  # type: ignore[arg-type]
        self.dropped[name] = content
        self.bags.insert(0, name.partition("/")[0])
        _send(page, json.dumps({"ok": True, "message": "", "data": {"bag": self.bags[0]}}))

    def _do_signals(self, request: dict[str, Any]) -> dict[str, Any]:
        content = self.dropped.get(request["bag"], b"").partition(b"\n")[0].decode()
        signals = [{"name": name, "unit": "", "role": ""} for name in content.split(",") if name]
        return {"signals": signals, "endings": {"V": "_v", "rad": "_rad"}, "has_clock": False}

    def _greeting(self, *, hand: bool) -> dict[str, Any]:
        hello = (
            greeting(self.rate_hz, hand=hand)
            if self.rig is None
            else greeting_of(self.rig, hand=hand)
        )
        return hello | {"solids": self.solids}

    def _take(self, page: ServerConnection, request: dict[str, Any]) -> None:
        self.requests.append(request | {"at_s": time.monotonic()})
        reply: dict[str, Any] = {"type": "reply", "id": request["id"]}
        try:
            reply |= {"ok": True, "message": "", "data": self._do(page, request) or {}}
        except Refusal as reason:
            reply |= {"ok": False, "message": str(reason), "data": {}}
        if self.acknowledges:
            _send(page, json.dumps(reply))
        # The first news of a job comes behind its number.
        while self._due:
            self._due.pop().start()
        self.send_state()

    def drop_pages(self) -> None:
        """Break the connection of every page."""
        for page in list(self._pages):
            page.close()

    def _do(self, page: ServerConnection, request: dict[str, Any]) -> dict[str, Any] | None:
        verb = request["do"]
        jobs: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
            "identify": self._identified,
            "compare": compared,
            "tune": tuned,
            "experiment": self._recorded,
        }
        if verb in jobs:
            self.jobs.append(next(self._job_numbers))
            arguments = self.jobs[-1], request, jobs[verb]
            self._due.append(threading.Thread(target=self._work, args=arguments, daemon=True))
            return {"job": self.jobs[-1]}
        handler = getattr(self, f"_do_{verb}", None)
        if handler is None:
            raise Refusal(f"unknown verb {verb}")
        if verb in {"hold", "let_go"}:
            self._holder = page if verb == "hold" else None
        answer: dict[str, Any] | None = handler(request)
        return answer

    def _do_hold(self, _: dict[str, Any]) -> None:
        pass

    _do_let_go = _do_hold
    _do_fault = _do_hold

    def _do_stop(self, _: dict[str, Any]) -> None:
        self.badge, self.arm.driven = "HELD", False

    def _do_release(self, _: dict[str, Any]) -> None:
        self.badge = "OFF"

    _do_deactivate = _do_release

    def _do_activate(self, _: dict[str, Any]) -> None:
        self.badge, self.arm.driven = "DRIVING", True

    def _do_reference(self, request: dict[str, Any]) -> None:
        self.arm.move(request.get("joint", ""), request["value"])

    def _do_waveform(self, request: dict[str, Any]) -> None:
        self.waveform = request

    def _do_law(self, request: dict[str, Any]) -> None:
        self.arm.law = request["name"]

    def _do_set(self, request: dict[str, Any]) -> None:
        name, value = request["name"], request["value"]
        if name.endswith(".kp") and not 0.0 <= value <= 5.0:
            raise Refusal(f"{name} = {value} is outside 0 to 5 V/V")
        self._change(request["node"], {name: value})

    def _do_apply(self, request: dict[str, Any]) -> None:
        self.arm.law = request["law"]
        self._change("controller", request["gains"])

    def _change(self, node: str, values: dict[str, Any]) -> None:
        self.arm.gains |= values
        for page in list(self._pages):
            _send(page, json.dumps({"type": "parameters", "node": node, "values": values}))

    def _do_payload(self, request: dict[str, Any]) -> None:
        self.payload_kg = request["kg"]

    def _do_record(self, request: dict[str, Any]) -> dict[str, Any]:
        bag = self.recording or f"run{len(self.bags) + 1}"
        if not request["on"]:
            self.bags.append(bag)
        self.recording = bag if request["on"] else None
        return {"bag": bag, "command": f"./flexarm record out/live/{bag}"}

    def _do_bags(self, _: dict[str, Any]) -> dict[str, Any]:
        return {"bags": self.bags, "models": []}

    def _do_identify_line(self, request: dict[str, Any]) -> dict[str, Any]:
        return {"command": identified(request)["command"]}

    def _do_tune_line(self, request: dict[str, Any]) -> dict[str, Any]:
        return {"command": tuned_line(request)}

    def _do_cancel(self, request: dict[str, Any]) -> None:
        self._cancelled.add(request["job"])

    def _identified(self, request: dict[str, Any]) -> dict[str, Any]:
        found = identified(request)
        if self.rig is not None:
            found["outputs"] = self.rig.output_names[: len(found["outputs"])]
        return found

    def _recorded(self, request: dict[str, Any]) -> dict[str, Any]:
        self.bags.append(request["name"])
        return {"bag": self.bags[-1]}

    def _work(
        self,
        number: int,
        request: dict[str, Any],
        work: Callable[[dict[str, Any]], dict[str, Any]],
    ) -> None:
        news = {"type": "job", "job": request["do"], "id": number, "done": False, "ok": True}
        for k, stage in enumerate(JOB_STEPS):
            if self._ended.wait(self.job_step_s):
                return
            if number in self._cancelled:
                self._end(number, news | {"done": True, "ok": False, "message": "cancelled"})
                return
            self._post(news | {"stage": stage, "fraction": k / len(JOB_STEPS)})
        found = work(request)
        if request["do"] == "identify":
            self._post(news | {"stage": "writing", "fraction": None, "data": found})
            if not self._is_written(number):
                self._end(number, news | {"done": True, "ok": False, "message": "cancelled"})
                return
        self._end(number, news | {"done": True, "fraction": 1.0, "data": found})

    def _is_written(self, number: int) -> bool:
        """Take the time that writing takes; return whether nobody cancelled it."""
        until_s = time.monotonic() + self.writing_s
        while time.monotonic() < until_s:
            if number in self._cancelled or self._ended.wait(self.job_step_s):
                return False
        return True

    def _end(self, number: int, news: dict[str, Any]) -> None:
        self._post(news)
        self.jobs.remove(number)

    def _post(self, message: dict[str, Any]) -> None:
        for page in list(self._pages):
            _send(page, json.dumps(message))

    def _sample(self) -> None:
        start_s, done, states = time.monotonic(), 0, 0
        while not self._ended.wait(1.0 / FRAMES_PER_S):
            elapsed_s = time.monotonic() - start_s
            due = int(elapsed_s * self.rate_hz)
            # A machine that was busy is not made to catch up for ever.
            rows = [self.arm.row() for _ in range(min(due - done, 1000))]
            done = due
            if rows:
                packed = frame(rows)
                for page in list(self._pages):
                    _send(page, packed)
            if self.poses:
                self._post({"type": "poses", "poses": self.poses})
            if elapsed_s * STATES_PER_S > states:
                states += 1
                self.send_state()

    def _state(self, page: ServerConnection) -> dict[str, Any]:
        active = "active" if self.badge == "DRIVING" else "inactive"
        counts = [max(0, 900 - 90 * k * k) for k in range(24)]
        times = {"p50": 0.21, "p99": 0.83, "max": 2.4}
        return {
            "type": "state",
            "badge": self.badge,
            "reason": "",
            "tone": "failure" if self.badge == "HELD" else "",
            "law": self.arm.law,
            "references": self.arm.references,
            "factor": 1.0,
            "missed": 0,
            "unanswered": 0,
            "late_ms": times,
            "reply_ms": times,
            "histogram": {
                "edges_ms": [0.25 * k for k in range(25)],
                "late": counts,
                "reply": [0, *counts[:-1]],
            },
            "payload_kg": self.payload_kg if self.rig is None else None,
            "recording": self.recording,
            "waveform": self.waveform,
            "jobs": list(self.jobs),
            "holder": self._holder is page,
            "holder_name": "another page" if self._holder not in {None, page} else "",
            "nodes": {"daq": active, "controller": active},
        }


def _send(page: ServerConnection, message: str | bytes) -> None:
    try:
        page.send(message)
    except ConnectionClosed:
        return


if __name__ == "__main__":
    with LiveMock() as mock:
        print(mock.address, flush=True)  # noqa: T201 - it is what the program is for
        threading.Event().wait()
