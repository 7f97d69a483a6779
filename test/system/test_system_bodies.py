"""Bodies of a rig that knows them, from its driver to the pages."""

from __future__ import annotations

import math
import socket
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from websockets.sync.client import connect

from support.live_server import received

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from websockets.sync.client import ClientConnection

    from support.system_graph import Graph

pytestmark = pytest.mark.system

SOLID = {
    "body": 0,
    "kind": "box",
    "size_m": [0.5, 0.01, 0.02],
    "place_m": [0.5, 0.0, 0.0],
    "turn": [1.0, 0.0, 0.0, 0.0],
    "rgba": [0.1, 0.2, 0.3, 1.0],
}
# A body that turns by 1 rad/s, and an output that says how far.
DRIVER = f"""
import math
import time

import numpy as np

from flexarm_daq.rigs.rig_protocol import RigSample

class Turning:
    def __init__(self):
        self.bodies = self

    def open(self):
        self.began_s = time.monotonic()

    def read(self):
        self.angle_rad = time.monotonic() - self.began_s
        return RigSample(self.angle_rad, np.array([self.angle_rad]))

    def write(self, commands):
        pass

    def safe_stop(self):
        pass

    close = safe_stop

    def solids(self):
        return [{SOLID}]

    def poses(self):
        half_rad = 0.5 * self.angle_rad
        return np.array([[0.1, 0.2, 0.3, math.cos(half_rad), 0.0, 0.0, math.sin(half_rad)]])
"""
RIG = """\
name: turning
rate_hz: 100
inputs: {motor_nm: {quantity: torque, unit: N m, limits: 1}}
outputs: {hub_rad: {quantity: angle, unit: rad}}
joints: {hub: {input: motor_nm, angle: hub_rad, travel: 1000, link_length_m: 1}}
driver: turning.py:Turning
"""


def messages(page: ClientConnection, kind: str) -> Iterator[dict[str, Any]]:
    """Yield the messages of a kind as they come."""
    while True:
        message = received(page)
        if message["type"] == kind:
            yield message


def test_bodies___of_a_driver___come_to_each_page_and_move(graph: Graph, tmp_path: Path) -> None:
    (tmp_path / "turning.py").write_text(DRIVER)
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    about = {"rig": str(rig), "port": port, "view_only": True, "folder": str(tmp_path / "live")}
    graph.start("live", about)
    graph.start("controller", {"rig": str(rig), "law": "pd"})
    graph.start("daq", {"rig": str(rig), "autostart": True})

    def opened() -> ClientConnection:
        return connect(f"ws://127.0.0.1:{port}/live", compression=None, ping_interval=None)

    def solids() -> list[dict[str, Any]]:
        """Return what a page that opens now is greeted with."""
        with suppress(OSError), opened() as page:
            found: list[dict[str, Any]] = next(messages(page, "hello"))["solids"]
            return found
        return []

    graph.wait(lambda: solids() == [SOLID], "the solids")
    with opened() as page:
        turned_rad: list[float] = []
        for message in messages(page, "poses"):
            ((*place_m, w, x, y, z),) = message["poses"]
            assert (place_m, x, y) == (pytest.approx([0.1, 0.2, 0.3], abs=1e-4), 0.0, 0.0)
            turned_rad.append(2.0 * math.atan2(z, w))
            if len(turned_rad) == 20:
                break
        passed_rad = np.unwrap(turned_rad, period=4.0 * math.pi)
        # Twenty a second of the arm's time, fewer where one got lost.
        assert passed_rad[-1] - passed_rad[0] > 0.75
        # What a run begins with comes to the pages that are open.
        for transition in ("deactivate", "activate"):
            assert graph.transition("daq", transition)
        assert next(messages(page, "bodies"))["solids"] == [SOLID]
