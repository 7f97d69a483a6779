"""First message about an arm: channels, joints, laws; of the thesis's arm its shape and more."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flexarm_control.laws.registry import LAWS
from flexarm_core.channels import CHANNELS, TRAVEL_DEG, is_thesis_arm
from flexarm_daq.experiments.catalogue import catalogue
from flexarm_daq.rigs.beam import ELEMENTS, arm_modes
from flexarm_daq.rigs.faulty import Fault
from flexarm_daq.rigs.rig_parameters import RigParameters

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import Channel, Input, RigDescription
    from flexarm_daq.experiments.catalogue import Experiment

SEQUENCE: Final = "sequence_low"
"""Column of the numbers of the samples."""
SEQUENCE_SPAN: Final = 2**20
"""The number of a sample is sent less whole spans of this: float32 has 24 bits."""
_THESIS_GROUPS = {"angle": "position", "moment": "strain", "rate": "speed"}
"""Words of the thesis for the quantities of its sensors."""
_DEGREES = {"rad": "deg", "rad/s": "deg/s"}
_MODES = 2
MOST_PAYLOAD_KG = 1.0


def columns_of(rig: RigDescription) -> tuple[str, ...]:
    """Return the columns of a frame behind the times.

    They are the outputs, the commands of the inputs, the part of each that compensates friction,
    the set-points of the tracked outputs, and the number of the sample.
    """
    return (
        *rig.output_names,
        *rig.input_names,
        *_compensations(rig),
        *_references(rig),
        SEQUENCE,
    )


def about_arm(rig: RigDescription, *, simulated: bool) -> dict[str, Any]:
    """Return the part of the first message that needs no node."""
    about: dict[str, Any] = {
        "channels": _channels(rig),
        "rig": _rig(rig, list(_tracked(rig))),
        "laws": list(LAWS),
        "law_titles": {name: law.title for name, law in LAWS.items()},
    }
    if not is_thesis_arm(rig):
        return about | {"experiments": [_scaled(rig, each) for each in _open_loop()]}
    return about | {
        "arm": _arm(),
        "tunable_laws": [name for name, law in LAWS.items() if law.tuning],
        "laws_with_margins": [name for name, law in LAWS.items() if law.is_tuned_to_margins],
        "experiments": [
            {"name": each.name, "description": _experiment(each)} for each in catalogue().values()
        ],
        "faults": [_fault("none", "no fault"), *map(_described, Fault)] if simulated else [],
    }


def _compensations(rig: RigDescription) -> tuple[str, ...]:
    if is_thesis_arm(rig):
        return ("compensation_v",)
    return tuple(f"compensation_{name}" for name in rig.input_names)


def _references(rig: RigDescription) -> tuple[str, ...]:
    if is_thesis_arm(rig):
        return ("reference_v",)
    return tuple(f"reference_{name}" for name in rig.tracked)


def _channels(rig: RigDescription) -> list[dict[str, Any]]:
    """Return name, units and plot of each column."""
    outputs = {each.name: each for each in rig.outputs}
    groups = dict(zip(outputs, _split_by_unit(rig.outputs, _quantities(rig)), strict=True))
    commands = list(zip(rig.inputs, _split_by_unit(rig.inputs, _drives(rig.inputs)), strict=True))
    rows = [_channel(name, each, groups[name]) for name, each in outputs.items()]
    for names in (rig.input_names, _compensations(rig)):
        rows += [_channel(name, *each) for name, each in zip(names, commands, strict=True)]
    rows += [
        _channel(name, outputs[output], groups[output])
        for name, output in zip(_references(rig), rig.tracked, strict=True)
    ]
    sequence = {
        "name": SEQUENCE,
        "unit": "",
        "si_unit": "",
        "si_per_unit": 1.0,
        "group": "sequence",
    }
    if is_thesis_arm(rig):
        return [*rows, sequence]
    ends = _ends(rig)
    return [
        *({**row, **_between(*ends[name])} for row, name in zip(rows, ends, strict=True)),
        sequence,
    ]


def _ends(rig: RigDescription) -> dict[str, tuple[float, float]]:
    """Return the ends of the values of each column but the last one, infinite where unknown."""
    travel = {joint.angle: (joint.low, joint.high) for joint in rig.joints}
    outputs = {each.name: travel.get(each.name, (each.low, each.high)) for each in rig.outputs}
    inputs = [(each.low, each.high) for each in rig.inputs]
    return {
        **outputs,
        **dict(zip(rig.input_names, inputs, strict=True)),
        **dict(zip(_compensations(rig), inputs, strict=True)),
        **{name: outputs[of] for name, of in zip(_references(rig), rig.tracked, strict=True)},
    }


def _between(low: float, high: float) -> dict[str, float]:
    return {"low": low, "high": high}


def _channel(name: str, channel: Channel, group: str) -> dict[str, Any]:
    unit, per_unit = channel.si_unit or channel.unit, channel.to_si(1.0)
    if unit in _DEGREES:
        unit, per_unit = _DEGREES[unit], math.degrees(per_unit)
    return {
        "name": name,
        "unit": channel.unit,
        "si_unit": unit,
        "si_per_unit": per_unit,
        "group": group,
    }


def _quantities(rig: RigDescription) -> list[str]:
    words = _THESIS_GROUPS if is_thesis_arm(rig) else {}
    return [words.get(each.quantity, each.quantity) for each in rig.outputs]


def _drives(inputs: Sequence[Input]) -> list[str]:
    are_alike = len({each.quantity for each in inputs}) == 1
    return ["command" if are_alike else f"{each.quantity} command" for each in inputs]


def _split_by_unit(channels: Sequence[Channel], groups: Sequence[str]) -> list[str]:
    """Return the plot of each channel: those of one group that have several units have several."""
    units: dict[str, set[str]] = {}
    for channel, group in zip(channels, groups, strict=True):
        units.setdefault(group, set()).add(channel.unit)
    return [
        group if len(units[group]) == 1 else f"{group}, {channel.unit}"
        for channel, group in zip(channels, groups, strict=True)
    ]


def _rig(rig: RigDescription, tracked: list[dict[str, Any]]) -> dict[str, Any]:
    set_points = {each["output"]: each["name"] for each in tracked}
    return {
        "name": rig.name,
        "rate_hz": rig.rate_hz,
        "inputs": [
            {"name": each.name, "unit": each.unit, "low": each.low, "high": each.high}
            for each in rig.inputs
        ],
        "outputs": [{"name": each.name, "unit": each.unit} for each in rig.outputs],
        "joints": [
            {
                "name": joint.name,
                "input": joint.input,
                "angle": joint.angle,
                "rate": joint.rate,
                "low": joint.low,
                "high": joint.high,
                "unit": rig.output(joint.angle).unit,
                "slides": rig.output(joint.angle).si_unit == "m",
                "link_length_m": joint.link_length_m,
                "reference": set_points.get(joint.angle),
            }
            for joint in rig.joints
        ],
        "tracked": tracked,
    }


def _tracked(rig: RigDescription) -> Iterator[dict[str, Any]]:
    """Yield the set-points: their columns, what each is of, and how far it may go."""
    for column, track in zip(_references(rig), rig.tracks, strict=True):
        yield {**asdict(track), "name": column, "joint": track.name}


def _described(fault: Fault) -> dict[str, str]:
    return _fault(fault.value, fault.value.replace("_", " "))


def _experiment(entry: Experiment) -> str:
    loop = "closed" if entry.closed_loop else "open"
    return (
        f"{loop} loop: {entry.input_text}, {entry.length_s:g} s at {entry.rate_hz:g} Hz, "
        f"{1e3 * entry.payload_kg:.0f} g"
    )


def _open_loop() -> Iterator[Experiment]:
    return (each for each in catalogue().values() if not each.closed_loop)


def _scaled(rig: RigDescription, entry: Experiment) -> dict[str, str]:
    """Return an experiment whose waveform the limits of the inputs scale."""
    words = f"open loop: {entry.input_text_on(rig)}, {entry.length_s:g} s at {rig.rate_hz:g} Hz"
    return {"name": entry.name, "description": words}


def _fault(name: str, description: str) -> dict[str, str]:
    return {"name": name, "description": description}


def _arm() -> dict[str, Any]:
    rig = RigParameters()
    modes = arm_modes(rig)
    stations = np.linspace(0.0, 1.0, ELEMENTS + 1)
    bending = slice(1, 1 + _MODES)
    # The mesh leaves out the deflection of the root, which is zero.
    deflections = np.vstack([np.zeros(_MODES), modes.shapes[1::2, bending]])
    # Beside the line that turns with the hub.
    bent = deflections - np.outer(stations * rig.length_m, modes.hub_angle[bending])
    return {
        "link_length_m": rig.length_m,
        "stops_deg": [-TRAVEL_DEG, TRAVEL_DEG],
        "mode_shapes": {"station": stations, "first": bent[:, 0], "second": bent[:, 1]},
        "gauges": [gauge.name for gauge in CHANNELS[1:3]],
        "gauge_stations": [
            rig.base_gauge_at_m / rig.length_m,
            rig.middle_gauge_at_m / rig.length_m,
        ],
        "strain_to_amplitude": _amplitudes_per_v(rig),
        "max_payload_kg": MOST_PAYLOAD_KG,
    }


def _amplitudes_per_v(rig: RigParameters) -> FloatArray:
    """Return the amplitudes of the first two bending modes per volt of base and middle gauge."""
    modes = arm_modes(rig)
    bending = slice(1, 1 + _MODES)
    # The gauges' signs are those of the wiring: see `plant`.
    volts_per_amplitude = rig.bending_stiffness_nm2 * np.array(
        [
            -rig.base_gauge_v_per_nm * modes.base_curvature[bending],
            rig.middle_gauge_v_per_nm * modes.middle_curvature[bending],
        ]
    )
    return np.asarray(np.linalg.inv(volts_per_amplitude), dtype=np.float64)
