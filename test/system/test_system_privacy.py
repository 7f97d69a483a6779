"""Privacy of the graph: sockets in the range LOCALHOST on loopback alone, policies of SROS2."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

from flexarm_bringup.graph.operator import OPERATOR
from flexarm_bringup.graph.processes import LaunchError
from flexarm_node.parameter_files import NODE_NAMES
from support.security_policy import LOOP, POLICY, policy, start_every_node, uses_by_node
from support.system_graph import PATIENCE_S, ROOT, Graph, executable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.system_graph import Process

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


def test_policies___are_as_sros2_has_them() -> None:
    root = ET.fromstring(POLICY.read_text("utf-8"))  # noqa: S314 - our own file
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    assert {each.attrib["path"] for each in root.findall("enclaves/enclave")} == {
        f"/flexarm/{name}" for name in (*NODE_NAMES, OPERATOR, LOOP)
    }
    rules = {
        (group.tag, rule, each.tag)
        for group in root.findall("enclaves/enclave/profiles/profile/*")
        for rule, qualifier in group.items()
        if qualifier == "ALLOW"
        for each in group
    }
    assert rules == {
        (f"{kind}s", rule, kind)
        for kind, *both in (
            ("topic", "publish", "subscribe"),
            ("service", "reply", "request"),
            ("action", "execute", "call"),
        )
        for rule in both
    }


@pytest.mark.parametrize(
    "verb",
    # The doctor's own node; the others ask for reports or look for an arm.
    [
        "doctor",
        *(
            pytest.param(verb, marks=pytest.mark.exhaustive)
            for verb in (
                "status",
                "reference 1",
                "stop",
                "set daq rate_hz=100.0",
                "activate daq",
                "deactivate daq",
            )
        ),
    ],
)
def test_verb___listens_on_loopback_alone(graph: Graph, verb: str) -> None:
    process = graph.run([str(ROOT / "flexarm"), *verb.split()])

    seen = addresses_until(graph, lambda: process.popen.poll() is not None)

    assert set.union(*seen.values()) == {_LOOPBACK}, process.printed


def test_up___listens_on_loopback_alone_and_so_do_its_nodes(graph: Graph) -> None:
    process = graph.run([str(ROOT / "flexarm"), "up", "--rate", "50"])

    # The page's address comes last.
    seen = addresses_until(graph, lambda: "/#token=" in process.printed)

    with_sockets = [addresses for addresses in seen.values() if addresses]
    assert with_sockets == [{_LOOPBACK}] * 6
    assert all(graph.survivors(executable(name).name) for name in ("recorder", "ident", "live"))


@pytest.mark.skipif("_ROS_WHEELS_BOOTSTRAP_COMPLETE" not in os.environ, reason="needs the wheels")
def test_security___without_its_libraries___is_refused_in_one_line(graph: Graph) -> None:
    graph.environment["ROS_SECURITY_ENABLE"] = "true"
    node = graph.run_node("recorder", {})
    verb = graph.run([str(ROOT / "flexarm"), "status"])
    assert (node.exit_code(), verb.exit_code()) == (2, 1)
    (line,) = node.printed.splitlines()
    assert line.startswith("ROS_SECURITY_ENABLE=true: the ROS 2 of these Python packages is built")
    assert verb.printed == f"flexarm: {line}\n"


# Last: so many nodes cost time as long as they live.
@pytest.fixture(scope="module")
def every_node(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[Graph, dict[str, Process]]]:
    """Return a graph of all nodes with all their topics, and the nodes by name."""
    folder = tmp_path_factory.mktemp("every_node")
    with Graph(folder) as graph:
        yield graph, start_every_node(graph, folder)


@pytest.mark.exhaustive
def test_every_node___listens_on_loopback_alone(
    every_node: tuple[Graph, dict[str, Process]],
) -> None:
    _, nodes = every_node
    listening = {name: local_addresses(node.popen.pid) for name, node in nodes.items()}
    assert listening == {name: {_LOOPBACK} for name in NODE_NAMES}


@pytest.mark.exhaustive
def test_policies___are_what_the_nodes_use(every_node: tuple[Graph, dict[str, Process]]) -> None:
    graph, nodes = every_node
    shipped = POLICY.read_text("utf-8")
    # A publisher may be discovered after the services that were made behind it.
    with suppress(LaunchError):
        graph.wait(lambda: policy(uses_by_node(graph)) == shipped, "the policies")
    assert policy(uses_by_node(graph)) == shipped
    enclaves = {
        name: enclave
        for name, _, enclave in graph.node.get_node_names_and_namespaces_with_enclaves()
    }
    assert {name: enclaves[name] for name in nodes} == {name: f"/flexarm/{name}" for name in nodes}
