"""First message about an arm: channels, shape, laws, experiments and faults."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_control.laws.registry import LAWS
from flexarm_core.channels import CHANNELS, COMMAND, TRAVEL_DEG, TRAVEL_V
from flexarm_daq.experiments.catalogue import catalogue
from flexarm_daq.rigs.beam import ELEMENTS, arm_modes
from flexarm_daq.rigs.faulty import Fault
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_live.graph.samples import COLUMNS

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_daq.experiments.catalogue import Experiment

_PER_V = {channel.name: 1.0 / channel.volts_per_si for channel in (*CHANNELS, COMMAND)}
_DEG_PER_V = math.degrees(_PER_V["position_v"])
_SI = {
    "position_v": ("deg", _DEG_PER_V, "position"),
    "base_strain_v": ("N m", _PER_V["base_strain_v"], "strain"),
    "middle_strain_v": ("N m", _PER_V["middle_strain_v"], "strain"),
    "speed_v": ("deg/s", math.degrees(_PER_V["speed_v"]), "speed"),
    "command_v": ("A", _PER_V["command_v"], "command"),
    "compensation_v": ("A", _PER_V["command_v"], "command"),
    "reference_v": ("deg", _DEG_PER_V, "position"),
    "sequence_low": ("", 1.0, "sequence"),
}
_MODES = 2
MOST_PAYLOAD_KG = 1.0


def about_arm(*, simulated: bool) -> dict[str, Any]:
    """Return the part of the first message that needs no node."""
    return {
        "channels": [_channel(name) for name in COLUMNS],
        "arm": _arm(),
        "laws": list(LAWS),
        "tunable_laws": [name for name, law in LAWS.items() if law.tuning],
        "laws_with_margins": [name for name, law in LAWS.items() if law.is_tuned_to_margins],
        "law_titles": {name: law.title for name, law in LAWS.items()},
        "experiments": [
            {"name": each.name, "description": _experiment(each)} for each in catalogue().values()
        ],
        "faults": [_fault("none", "no fault"), *map(_described, Fault)] if simulated else [],
        "reference": {"low_v": -TRAVEL_V, "high_v": TRAVEL_V},
    }


def _channel(name: str) -> dict[str, Any]:
    unit, per_v, group = _SI[name]
    volts = "" if name == "sequence_low" else "V"
    return {"name": name, "unit": volts, "si_unit": unit, "si_per_v": per_v, "group": group}


def _described(fault: Fault) -> dict[str, str]:
    return _fault(fault.value, fault.value.replace("_", " "))


def _experiment(entry: Experiment) -> str:
    loop = "closed" if entry.closed_loop else "open"
    return (
        f"{loop} loop: {entry.input_text}, {entry.length_s:g} s at {entry.rate_hz:g} Hz, "
        f"{1e3 * entry.payload_kg:.0f} g"
    )


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
