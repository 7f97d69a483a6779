"""Changes of the payload and of the law that a bag of our own rig tells."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_ident import read_bag
from flexarm_ident.diagnostics.quality import assess
from flexarm_ident.records.span import Span
from flexarm_ident.records.unknown_inputs import known_parts
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

SAMPLES = 400
PERIOD_S = 1e-9 * STEP_NS


def payload_set(
    row: int, payload_kg: float, node: str = "/flexarm/daq", *, new: bool = False
) -> Sent:
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
        new_parameters=[changed] if new else [],
        changed_parameters=[] if new else [changed],
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


def record(path: Path, *reported: Sent, samples: int = SAMPLES) -> IoData:
    rng = np.random.default_rng(1)
    states = [
        arm_state(
            k + 1, START_NS + k * STEP_NS, rng.normal(size=4).tolist(), command_v=rng.normal()
        )
        for k in range(samples + 1)
    ]
    return read_bag(write_bag(path, sorted([*states, *reported], key=lambda sent: sent.time_ns)))


def warnings(*records: IoData) -> list[tuple[str, str]]:
    found = assess(records, block_gram(records, 4))
    return [(each.code, each.text) for each in found if each.code == "plant_changed"]


def payload(words: str, row: int, *, after: int = 0, before: int = 0) -> tuple[str, str]:
    """Return the warning of a change that comes after another one, or before one."""
    at, since, until = (f"{each * PERIOD_S:g}s" for each in (row, after, before))
    first = f"--from {since} --to {at}" if after else f"--to {at}"
    second = f"--from {at} --to {until}" if before else f"--from {at}"
    return "plant_changed", (
        f"the payload was changed to {words} at {row * PERIOD_S:g} s (row {row}): a model of both "
        f"sides mixes two arms; identify the parts separately ({first}, {second})"
    )


def test_payload___set_in_mid_record___is_reported_with_the_parts(tmp_path: Path) -> None:
    reported = [payload_set(150, 0.3), payload_set(200, 0.3), payload_set(300, 0.0)]
    data = record(tmp_path / "run", *reported)

    assert warnings(data) == [payload("0.3 kg", 150, before=300), payload("0 kg", 300, after=150)]
    (notice, _) = data.notices
    assert notice.figures["at_s"] == pytest.approx(0.3)
    assert str(notice.grade) == "caution"


@pytest.mark.parametrize(
    ("span", "row"), [(Span(to_s=0.5), 150), (Span(from_s=0.4), 300), (Span(0.3, 0.6), 0)]
)
def test_payload___set_outside_the_part___is_no_matter(
    tmp_path: Path, span: Span, row: int
) -> None:
    data = span.of(record(tmp_path / "run", payload_set(150, 0.3), payload_set(300, 0.0)))

    first, second = payload("0.3 kg", 150, before=300), payload("0 kg", 300, after=150)
    assert warnings(data) == {150: [first], 300: [second], 0: []}[row]


def test_payload___of_both_parts_of_a_split_record___is_reported_for_each(tmp_path: Path) -> None:
    data = record(tmp_path / "run", payload_set(150, 0.3), payload_set(300, 0.0))

    first, second = payload("0.3 kg", 150, before=300), payload("0 kg", 300, after=150)
    assert warnings(*data.split(0.5)) == [first, second]


def test_payload___of_a_node_that_starts_anew___is_known(tmp_path: Path) -> None:
    reported = [payload_set(-30, 0.3), payload_set(-20, 0.0, new=True), payload_set(150, 0.3)]

    assert warnings(record(tmp_path / "run", *reported)) == [payload("0.3 kg", 150)]


@pytest.mark.parametrize("row", [700, 950, 1010, 1100, 1500])
def test_payload___set_about_a_hole_with_an_unknown_input___is_reported(
    tmp_path: Path, row: int
) -> None:
    data = record(tmp_path / "run", payload_set(row, 0.3), samples=2000)
    held = np.zeros(len(data), dtype=np.bool_)
    held[900:1010] = True
    parts = known_parts(replace(data, input_held=held))

    assert len(parts) == 2
    assert warnings(*parts) == [payload("0.3 kg", row)]


def test_payload___of_another_arm_or_before_the_record___is_no_matter(tmp_path: Path) -> None:
    data = record(tmp_path / "run", payload_set(150, 0.3, node="/arm2/daq"), payload_set(-20, 0.1))

    assert not warnings(data)


def test_law___replaced_or_with_another_gain___is_reported(tmp_path: Path) -> None:
    pd = {"law": "pd", "pd.kp": 1.0, "reference": "topic"}
    reported = [
        law(0, pd),
        law(80, {**pd, "reference": "square", "square.period_s": 4.0}),
        law(100, {**pd, "pd.kp": 2.0, "shaper": "zv", "models.own.A": 1.0}),
        law(120, "no JSON"),
        law(250, {"law": "pi", "pi.kp": 1.0}),
    ]

    assert warnings(record(tmp_path / "run", *reported)) == [
        ("plant_changed", "the controller was changed in pd.kp at 0.2 s (row 100)"),
        ("plant_changed", "the controller was changed to pi at 0.5 s (row 250)"),
    ]


@pytest.mark.parametrize("text", ["no JSON", "[1, 2]"])
def test_law___of_another_program___is_no_matter(tmp_path: Path, text: str) -> None:
    assert not warnings(record(tmp_path / "run", law(0, {"law": "pd"}), law(100, text)))
