"""Sockets in the range LOCALHOST: of every node and verb, on loopback alone."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from support.bag_samples import START_NS, reference, write_bag
from support.system_graph import PACKAGES, PATIENCE_S, ROOT, Graph, executable

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.system

_LOOPBACK = "0100007F"
_TABLES = ("udp", "udp6", "tcp", "tcp6")


def local_addresses(pid: int) -> set[str]:
    """Return the local addresses of a process's sockets, as the kernel writes them."""
    files = []
    # A file may be closed, and the process may end, while we look.
    with suppress(OSError):
        for file in Path(f"/proc/{pid}/fd").iterdir():
            with suppress(OSError):
                files.append(str(file.readlink()))
    sockets = {file[len("socket:[") : -1] for file in files if file.startswith("socket:[")}
    tables = [Path(f"/proc/net/{name}").read_text().splitlines()[1:] for name in _TABLES]
    rows = [row.split() for table in tables for row in table]
    return {row[1].split(":")[0] for row in rows if row[9] in sockets}


def addresses_until(graph: Graph, ended: Callable[[], bool]) -> dict[int, set[str]]:
    """Return the addresses of every process of the graph, seen until something has ended."""
    seen: dict[int, set[str]] = {}
    deadline_s = time.monotonic() + PATIENCE_S
    while not ended():
        assert time.monotonic() < deadline_s, seen
        for pid in graph.survivors():
            seen[pid] = seen.get(pid, set()) | local_addresses(pid)
        time.sleep(0.05)
    return seen


def test_every_node___listens_on_loopback_alone(graph: Graph, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [reference(START_NS, 1.0)])
    parameters = {"player": {"bag": str(bag), "stopped": True}}
    nodes = {name: graph.start(name, parameters.get(name)) for name in PACKAGES}
    names = {f"/flexarm/{name}" for name in PACKAGES}
    graph.wait(lambda: names <= graph.operator.nodes(), "all nodes")
    graph.configure_loop()

    listening = {name: local_addresses(node.popen.pid) for name, node in nodes.items()}

    assert listening == {name: {_LOOPBACK} for name in PACKAGES}


@pytest.mark.parametrize(
    "verb",
    [
        "status",
        "stop",
        "reference 1",
        "set daq rate_hz=100.0",
        "activate daq",
        "deactivate daq",
        "doctor",
    ],
)
def test_verb___listens_on_loopback_alone(graph: Graph, verb: str) -> None:
    process = graph.run([str(ROOT / "flexarm"), *verb.split()])

    seen = addresses_until(graph, lambda: process.popen.poll() is not None)

    assert set.union(*seen.values()) == {_LOOPBACK}, process.printed


def test_up___listens_on_loopback_alone_and_so_do_its_nodes(graph: Graph) -> None:
    process = graph.run([str(ROOT / "flexarm"), "up"])

    seen = addresses_until(graph, lambda: "/flexarm is up" in process.printed)

    with_sockets = [addresses for addresses in seen.values() if addresses]
    assert with_sockets == [{_LOOPBACK}] * 5
    assert all(graph.survivors(executable(name).name) for name in ("recorder", "ident"))


@pytest.mark.skipif("_ROS_WHEELS_BOOTSTRAP_COMPLETE" not in os.environ, reason="needs the wheels")
def test_security___without_its_libraries___is_refused_in_one_line(graph: Graph) -> None:
    graph.environment["ROS_SECURITY_ENABLE"] = "true"
    node = graph.run_node("recorder", {})
    verb = graph.run([str(ROOT / "flexarm"), "status"])
    assert (node.exit_code(), verb.exit_code()) == (2, 1)
    (line,) = node.printed.splitlines()
    assert line.startswith("ROS_SECURITY_ENABLE=true: the ROS 2 of these Python packages is built")
    assert verb.printed == f"flexarm: {line}\n"
