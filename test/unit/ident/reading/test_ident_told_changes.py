"""Changes of the payload and of the law that a bag of our own rig tells."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_ident import read_bag
from flexarm_ident.diagnostics.quality import assess
from flexarm_ident.records.span import Span
from flexarm_ident.subspace.gram import block_gram
from support.bag_samples import (
    START_NS,
    STEP_NS,
    Sent,
    arm_state,
    header,
    serialised,
    typestore,
    write_bag,
)

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_ident import IoData
    from flexarm_ident.records.iodata import DataWarning

SAMPLES = 400
PERIOD_S = 1e-9 * STEP_NS


def payload_set(row: int, payload_kg: float, node: str = "/flexarm/daq") -> Sent:
    """Event of a parameter that was set just before a sample was taken."""
    types, time_ns = typestore().types, START_NS + row * STEP_NS - STEP_NS // 4
    number: dict[str, Any] = {
        "bool_value": False,
        "integer_value": 0,
        "string_value": "",
        "byte_array_value": np.empty(0, np.uint8),
        "bool_array_value": np.empty(0, np.bool_),
        "integer_array_value": np.empty(0, np.int64),
        "double_array_value": np.empty(0),
        "string_array_value": [],
    }
    value = types["rcl_interfaces/msg/ParameterValue"](type=3, double_value=payload_kg, **number)
    changed = types["rcl_interfaces/msg/Parameter"](name="payload_kg", value=value)
    type_name = "rcl_interfaces/msg/ParameterEvent"
    stamp = types["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    raw = serialised(
        type_name,
        stamp=stamp,
        node=node,
        new_parameters=[],
        changed_parameters=[changed],
        deleted_parameters=[],
    )
    return Sent("/parameter_events", type_name, time_ns, raw)


def law(row: int, parameters: object) -> Sent:
    type_name = "flexarm_msgs/msg/LawInForce"
    stamp_ns = START_NS + row * STEP_NS
    text = parameters if isinstance(parameters, str) else json.dumps(parameters)
    raw = serialised(
        type_name,
        header=header(stamp_ns),
        command_sequence=row,
        run_time_ns=row * STEP_NS,
        reference_v=0.0,
        parameters=text,
        memory_names=[],
        memory_sizes=np.empty(0, np.uint32),
        memory=np.empty(0),
    )
    return Sent("/flexarm/law", type_name, stamp_ns + 1000, raw)


def record(path: Path, *told: Sent) -> IoData:
    rng = np.random.default_rng(1)
    states = [
        arm_state(
            k + 1, START_NS + k * STEP_NS, rng.normal(size=4).tolist(), command_v=rng.normal()
        )
        for k in range(SAMPLES + 1)
    ]
    return read_bag(write_bag(path, sorted([*states, *told], key=lambda sent: sent.time_ns)))


def warnings(data: IoData) -> dict[str, DataWarning]:
    found = assess([data], block_gram([data], 4))
    return {each.name: each for each in found if each.name.endswith("_changed")}


def test_payload___set_in_mid_record___is_told_with_the_parts(tmp_path: Path) -> None:
    data = record(tmp_path / "run", payload_set(150, 0.3), payload_set(300, 0.0))

    found = warnings(data)["plant_changed"]

    assert found.figures["at_s"] == pytest.approx(150 * PERIOD_S)
    assert str(found.grade) == "caution"
    assert found.text == (
        "the payload was changed in mid-record, to 0.3 kg at 0.3 s (row 150), to 0 kg at 0.6 s "
        "(row 300): a model of the whole mixes several arms; identify the parts separately "
        "(--to 0.3s, --from 0.3s --to 0.6s, --from 0.6s)"
    )


@pytest.mark.parametrize("span", [Span(to_s=0.3), Span(from_s=0.3)])
def test_payload___set_outside_the_part___is_no_matter(tmp_path: Path, span: Span) -> None:
    data = record(tmp_path / "run", payload_set(150, 0.3))

    assert "plant_changed" in warnings(data)
    assert "plant_changed" not in warnings(span.of(data))


def test_payload___of_another_arm_or_before_the_record___is_no_matter(tmp_path: Path) -> None:
    data = record(tmp_path / "run", payload_set(150, 0.3, node="/arm2/daq"), payload_set(-20, 0.1))

    assert not warnings(data)


def test_law___replaced_or_with_another_gain___is_told(tmp_path: Path) -> None:
    pd = {"law": "pd", "pd.kp": 1.0, "reference": "topic"}
    told = [
        law(0, pd),
        law(80, {**pd, "reference": "square", "square.period_s": 4.0}),
        law(100, {**pd, "pd.kp": 2.0}),
        law(250, {"law": "pi", "pi.kp": 1.0}),
    ]

    found = warnings(record(tmp_path / "run", *told))["law_changed"]

    assert str(found.grade) == "information"
    assert found.text == (
        "the law was changed in mid-record, in pd.kp at 0.2 s (row 100), to pi at 0.5 s (row 250)"
    )


@pytest.mark.parametrize("text", ["no JSON", "[1, 2]"])
def test_law___of_another_program___is_no_matter(tmp_path: Path, text: str) -> None:
    assert not warnings(record(tmp_path / "run", law(0, {"law": "pd"}), law(100, text)))
