"""Parameters that real nodes describe, and the tables that they come from."""

from __future__ import annotations

import os
from dataclasses import fields
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.signals import SignalHandlerOptions

from flexarm_control.controller_node import ControllerNode
from flexarm_control.laws.registry import LAWS
from flexarm_control.references import REFERENCES
from flexarm_control.shaping.shapers import SHAPERS
from flexarm_control.tuner_node import TunerNode
from flexarm_daq.experiments.excitation import EXCITATIONS
from flexarm_daq.nodes import player_node
from flexarm_daq.nodes.daq_node import DaqNode
from flexarm_daq.nodes.experiment_node import ExperimentNode
from flexarm_daq.nodes.player_node import PlayerNode
from flexarm_daq.nodes.recorded_topics import TOPICS
from flexarm_daq.nodes.recorder_node import RecorderNode
from flexarm_daq.rigs.faulty import Fault
from flexarm_ident.ident_node import IdentNode
from support.bag_samples import played_bag
from support.system_graph import claim_domain

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rcl_interfaces.msg import ParameterDescriptor

pytestmark = pytest.mark.system

LOOP = ("flexarm_node", "loop_node")
NODES: dict[Any, list[tuple[str, str]]] = {
    DaqNode: [("flexarm_daq.nodes", "daq"), LOOP],
    ExperimentNode: [("flexarm_daq.nodes", "experiment"), LOOP],
    RecorderNode: [("flexarm_daq.nodes", "recorder")],
    PlayerNode: [("flexarm_daq.nodes", "player")],
    ControllerNode: [("flexarm_control", "controller"), LOOP],
    IdentNode: [("flexarm_ident", "ident")],
    TunerNode: [],
}
# What the tables take from the code: figures of the thesis's drive and board, and registries.
KNOWN = {
    "$NidaqSettings.device": "Dev1",
    "$NidaqSettings.sensors": ["ai0", "ai1", "ai2", "ai3"],
    "$NidaqSettings.magnitude": "ao0",
    "$NidaqSettings.direction": "ao1",
    "$NidaqSettings.terminals": "rse",
    "$NidaqSettings.high_is_positive": True,
    "$LimiterSettings.max_command_v": 10.0,
    "$LimiterSettings.max_slew_v_per_s": 6000.0,
    "$LimiterSettings.position_bound_v": 6.5,
    "$SensorLimits.stuck_samples": 30,
    "$max_command_v": 10.0,
    "$input_range_v": 10.0,
    "$topic": "topic",
    "$laws": [*LAWS, "servo"],
    "$references": ["topic", *REFERENCES],
    "$no_shaper": "none",
    "$shapers": ["none", *SHAPERS],
    "$topics": list(TOPICS),
    "$Band.low_hz": 0.2,
    "$Band.high_hz": 50.0,
    "$Band.period_s": 10.0,
    "$Band.odd": False,
    "$Band.octaves": False,
    "$excitations": list(EXCITATIONS),
    "$faults": ["none", *(fault.value for fault in Fault)],
    "$first_channel": "position_v",
    "$channels": ["position_v", "base_strain_v", "middle_strain_v", "speed_v"],
    "$noises": ["low", "thesis", "none"],
    "$terminals": ["rse", "nrse", "diff", "default"],
}
TYPES = {
    "bool": ParameterType.PARAMETER_BOOL,
    "int": ParameterType.PARAMETER_INTEGER,
    "double": ParameterType.PARAMETER_DOUBLE,
    "string": ParameterType.PARAMETER_STRING,
    "double_array": ParameterType.PARAMETER_DOUBLE_ARRAY,
    "string_array": ParameterType.PARAMETER_STRING_ARRAY,
}
RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")


@pytest.fixture(scope="module")
def domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Start the middleware of this process; the player is given a bag."""
    folder = tmp_path_factory.mktemp("bags")
    played_bag(folder / "played", 10)
    given = folder / "player.yaml"
    given.write_text(f"/**/player: {{ros__parameters: {{bag: {folder}/played}}}}\n", "utf-8")
    number, claim = claim_domain()
    rclpy.init(
        args=["--ros-args", "--params-file", str(given)],
        domain_id=number,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    yield
    rclpy.shutdown()
    os.close(claim)


def written(content: dict[str, Any], group: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and row of each parameter of a table, read without our reader."""
    for key, row in content.items():
        if key == "__map_designed_laws":
            for law in ("ilqr", "lqg", "planned"):
                yield from written(row, f"{law}.")
        elif "type" in row:
            yield group + key, row
        else:
            yield from written(row, f"{group}{key}.")


def of_laws_and_references() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and row of the fields of the dataclasses."""
    kinds: list[tuple[str, Any]] = [
        (name, kind) for name, law in LAWS.items() for kind in law.settings
    ]
    for name, kind in [*kinds, *((name, row.kind) for name, row in REFERENCES.items())]:
        for field in fields(kind):
            if field.init:
                meta = field.metadata
                row = {
                    "type": "int" if isinstance(field.default, int) else "double",
                    "default_value": field.default,
                    "description": meta["description"],
                    "unit": meta["unit"],
                    "live": True,
                    "validation": {"bounds<>": [meta["minimum"], meta["maximum"]]},
                }
                if isinstance(field.default, tuple):
                    row |= {"type": "double_array", "default_value": list(field.default)}
                yield f"{name}.{field.name}", row


def range_of(described: ParameterDescriptor) -> list[float]:
    """Return the bounds that a node describes; empty for none."""
    ranges = [*described.integer_range, *described.floating_point_range]
    return [end for each in ranges for end in (each.from_value, each.to_value)]


def known(value: Any) -> Any:  # noqa: ANN401 - of a YAML text
    """Return a value of a table, that of the code for a name of it."""
    return KNOWN.get(value, value) if isinstance(value, str) else value


def constraints(row: dict[str, Any]) -> str:
    """Return the text of a row's unit, choices and effect."""
    validation = row.get("validation", {})
    ((choices,),) = [validation[key] for key in validation if key.endswith("_of<>")] or [([],)]
    listed = ", ".join(known(choices))
    effect = "at once" if row.get("live") else "in the next run"
    parts = [
        f"unit: {row['unit']}" if row.get("unit") else "",
        f"one of: {listed}" if listed else "",
        "" if row.get("read_only") else f"a change acts {effect}",
    ]
    return "; ".join(filter(None, parts))


@pytest.mark.usefixtures("domain")
@pytest.mark.parametrize("kind", NODES, ids=lambda kind: str(kind.__name__))
def test_node___describes___the_rows_of_its_table(
    kind: Any,  # noqa: ANN401 - a class of nodes
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The player ends its process, which is this one.
    monkeypatch.setattr(player_node, "request_stop", lambda: None)
    expected: dict[str, dict[str, Any]] = {}
    for package, name in NODES[kind]:
        text = files(package).joinpath(f"{name}.yaml").read_text("utf-8")
        expected |= written(yaml.safe_load(text)[name])
    if kind is ControllerNode:
        expected |= of_laws_and_references()
    node = kind()
    try:
        names = [name for name in node._parameters if not name.startswith(RCLPY)]
        described = dict(zip(names, node.describe_parameters(names), strict=True))
        values = {name: node.get_parameter(name).value for name in names}
    finally:
        node.stop()
        node.destroy_node()

    assert sorted(names) == sorted(expected)
    for name, row in expected.items():
        found = described[name]
        assert (found.name, found.type) == (name, TYPES[row["type"]])
        assert found.description == row["description"]
        assert found.read_only == row.get("read_only", False)
        bounds = row.get("validation", {}).get("bounds<>", [])
        assert range_of(found) == [known(end) for end in bounds]
        assert found.additional_constraints == constraints(row)
        if (kind, name) != (PlayerNode, "bag"):
            assert values[name] == known(row["default_value"])
