"""Policy of SROS2 for the nodes of an arm, made of what they use in a running graph.

`PYTHONPATH=test ./flexarm exec python -m support.security_policy` writes the file that is shipped.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree import ElementTree as ET

from rclpy.action import (
    get_action_client_names_and_types_by_node,
    get_action_server_names_and_types_by_node,
)

from flexarm_bringup.graph.operator import OPERATOR, REMOTE
from flexarm_daq.nodes.recorded_topics import TOPICS
from flexarm_node.parameter_files import NODE_NAMES
from support.bag_samples import START_NS, reference, write_bag
from support.project import PROJECT
from support.system_graph import Graph

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rclpy.node import Node

    from support.system_graph import Process

POLICY = PROJECT / "src/flexarm_bringup/config/sros2/flexarm.policy.xml"
_HEAD = """\
<?xml version="1.0" encoding="UTF-8"?>
<!-- What each node of an arm may do, in an enclave of its own; docs/security.md says how to use it.
     Made of a running graph by test/support/security_policy.py. -->
"""
_VERSION = "0.2.0"
_DOUBLES = PROJECT / "test/support/doubles"
_CLOCK = "/clock"
_LAST_SERVED = list(TOPICS)[-1]
_HIDDEN = "/_action/"
LOOP = "loop"
"""Enclave of the process that two nodes share."""
_ENCLAVES = {
    OPERATOR: (OPERATOR,),
    REMOTE: (OPERATOR,),
    "controller": ("controller", LOOP),
    "daq": ("daq", LOOP),
}
"""Enclaves of a node that has others than its own."""


OTHER_RIGS = {"state": "io", "command": "io_command", "reference": "io_reference"}
"""Topics of the thesis's arm, and those in their places on another rig."""


class Rule(NamedTuple):
    """Kind of name, and what is allowed with it."""

    kind: str
    verb: str


PUBLISH, SUBSCRIBE = Rule("topic", "publish"), Rule("topic", "subscribe")
REPLY, REQUEST = Rule("service", "reply"), Rule("service", "request")
EXECUTE, CALL = Rule("action", "execute"), Rule("action", "call")
Uses = dict[Rule, set[str]]
"""Full names by what a node does with them."""


def uses_of(node: Node, full_name: str) -> Uses:
    """Return what another node uses, as this one has discovered it."""
    namespace, _, name = full_name.rpartition("/")
    found = {
        PUBLISH: node.get_publisher_names_and_types_by_node(name, namespace),
        SUBSCRIBE: node.get_subscriber_names_and_types_by_node(name, namespace),
        REPLY: node.get_service_names_and_types_by_node(name, namespace),
        REQUEST: node.get_client_names_and_types_by_node(name, namespace),
        EXECUTE: get_action_server_names_and_types_by_node(node, name, namespace),
        CALL: get_action_client_names_and_types_by_node(node, name, namespace),
    }
    return {
        rule: {each for each, _ in names if _HIDDEN not in each} for rule, names in found.items()
    }


def start_every_node(graph: Graph, folder: Path) -> dict[str, Process]:
    """Start every node with all the topics that its parameters can give it; return them by name."""
    bag = write_bag(folder / "bag", [reference(START_NS, 1.0)])
    parameters: dict[str, dict[str, Any]] = {
        "recorder": {"topics": list(TOPICS), "snapshot_mode": True},
        "player": {"bag": str(bag), "stopped": True, "clock": True},
        # Its clock is there while it is active.
        "daq": {"autostart": True},
    }
    # The policy is the same without the optional package.
    graph.environment["PYTHONPATH"] = f"{_DOUBLES}:{graph.environment['PYTHONPATH']}"
    nodes = {
        name: graph.start(name, parameters.get(name), "--enclave", graph.operator.full_name(name))
        for name in NODE_NAMES
    }
    for name in ("controller", "experiment"):
        assert graph.transition(name, "configure")
    assert graph.operator.is_active("daq")
    graph.wait(lambda: has_all(graph), "the topics of all nodes")
    return nodes


def uses_by_node(graph: Graph) -> dict[str, Uses]:
    """Return what every node of an arm may use, by its full name, those of the verbs too."""
    full_name = graph.operator.full_name
    uses = {full_name(name): uses_of(graph.node, full_name(name)) for name in NODE_NAMES}
    # Any node may be told to go by this clock, any rig be driven, and any recording be played.
    for each in uses.values():
        each[SUBSCRIBE].add(_CLOCK)
        for rule in (PUBLISH, SUBSCRIBE):
            each[rule] |= {
                full_name(other)
                for own, other in OTHER_RIGS.items()
                if full_name(own) in each[rule]
            }
    uses[full_name("player")][PUBLISH] |= uses[full_name("recorder")][SUBSCRIBE]
    return uses | {full_name(name): _of_verbs(graph, uses, name) for name in (OPERATOR, REMOTE)}


def _of_verbs(graph: Graph, uses: Mapping[str, Uses], name: str) -> Uses:
    """Return what a node of the verbs may use: it reads every topic and calls what is offered."""
    every: defaultdict[Rule, set[str]] = defaultdict(set)
    for each in uses.values():
        for rule, names in each.items():
            every[rule] |= names
    own = uses_of(graph.node, graph.node.get_fully_qualified_name())
    full_name = graph.operator.full_name
    return {
        PUBLISH: {*own[PUBLISH], *map(full_name, ("reference", OTHER_RIGS["reference"]))},
        SUBSCRIBE: every[PUBLISH],
        REPLY: {
            each.replace(full_name(graph.node.get_name()), full_name(name)) for each in own[REPLY]
        },
        REQUEST: every[REPLY],
        CALL: every[EXECUTE],
    }


def policy(uses: Mapping[str, Uses]) -> str:
    """Return the policy as SROS2 reads it."""
    root = ET.Element("policy", version=_VERSION)
    enclaves = ET.SubElement(root, "enclaves")
    places: dict[str, ET.Element] = {}
    pairs = [(path, full_name) for full_name in uses for path in _enclaves(full_name)]
    for path, full_name in sorted(pairs):
        namespace, _, node = full_name.rpartition("/")
        if path not in places:
            enclave = ET.SubElement(enclaves, "enclave", path=path)
            places[path] = ET.SubElement(enclave, "profiles")
        profile = ET.SubElement(places[path], "profile", ns=namespace, node=node)
        for rule, names in uses[full_name].items():
            if names:
                group = ET.SubElement(profile, f"{rule.kind}s", {rule.verb: "ALLOW"})
                for name in sorted(_shortened(names, full_name, namespace)):
                    ET.SubElement(group, rule.kind).text = name
    ET.indent(root)
    return _HEAD + ET.tostring(root, encoding="unicode") + "\n"


def _enclaves(full_name: str) -> list[str]:
    namespace, _, node = full_name.rpartition("/")
    return [f"{namespace}/{enclave}" for enclave in _ENCLAVES.get(node, (node,))]


def _shortened(names: set[str], full_name: str, namespace: str) -> Iterator[str]:
    """Yield names without what the profile says: its node, `~`, and its namespace."""
    for name in names:
        if name.startswith(f"{full_name}/"):
            yield f"~{name.removeprefix(full_name)}"
        else:
            yield name.removeprefix(f"{namespace}/")


def main() -> None:
    """Write the file that is shipped."""
    with TemporaryDirectory() as folder, Graph(Path(folder)) as graph:
        start_every_node(graph, Path(folder))
        POLICY.parent.mkdir(exist_ok=True)
        POLICY.write_text(policy(uses_by_node(graph)), "utf-8")


def has_all(graph: Graph) -> bool:
    """Return whether the nodes are discovered to the last thing that each makes."""
    full_name = graph.operator.full_name
    last = {
        "daq": (PUBLISH, _CLOCK),
        "controller": (PUBLISH, full_name("law")),
        "experiment": (PUBLISH, full_name("commander")),
        "recorder": (REPLY, full_name("recorder/record")),
        "player": (REPLY, full_name("player/play")),
        "ident": (EXECUTE, full_name("identify_bags")),
        "tuner": (REPLY, full_name("tune")),
        "live": (SUBSCRIBE, full_name("reference")),
        "foxglove": (SUBSCRIBE, _LAST_SERVED),
    }
    return {full_name(name) for name in last} <= graph.operator.nodes() and all(
        what in uses_of(graph.node, full_name(name))[rule] for name, (rule, what) in last.items()
    )


if __name__ == "__main__":
    main()
