"""Choice of the rig and its time: parameters of the DAQ node, and the rig made from them."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import SettingError
from flexarm_core.specs import ParameterSpec
from flexarm_daq.loop.self_test import check_possible
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.nidaq.terminals import TERMINALS, NidaqSettings
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, THESIS_NOISE_V, RigParameters
from flexarm_daq.rigs.simulated import SimulatedRig

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_daq.rigs.rig_protocol import Rig

NOISE_V = {"low": LOW_NOISE_V, "thesis": THESIS_NOISE_V, "none": (0.0, 0.0, 0.0, 0.0)}

_WIRED = NidaqSettings()

RIG_PARAMETERS = (
    ParameterSpec("rig", "simulated", "which rig is sampled", choices=("simulated", "nidaq")),
    ParameterSpec(
        "time",
        "auto",
        "real: by the clock; virtual: lock-step; auto: virtual for the simulated rig, else real",
        choices=("auto", "real", "virtual"),
    ),
    ParameterSpec(
        "self_test",
        "auto",
        "pulse the rig before it is armed and check the signs; auto: not the simulated rig",
        choices=("auto", "on", "off"),
    ),
    ParameterSpec("payload_kg", 0.0, "simulated rig: mass at the tip", 0.0, 1.0, "kg"),
    ParameterSpec("seed", 0, "simulated rig: seed of the sensor noise", 0, 2**31 - 1),
    ParameterSpec("noise", "low", "simulated rig: sensor noise", choices=tuple(NOISE_V)),
    ParameterSpec(
        "reply_delay_s", 5e-4, "virtual time: from a sample to its command", 0.0, 0.1, "s"
    ),
    ParameterSpec("nidaq.device", _WIRED.device, "NI-DAQ rig: name of the board"),
    ParameterSpec(
        "nidaq.sensors",
        list(_WIRED.sensors),
        "NI-DAQ rig: inputs of position, base gauge, middle gauge, speed",
    ),
    ParameterSpec("nidaq.magnitude", _WIRED.magnitude, "NI-DAQ rig: output, current's magnitude"),
    ParameterSpec("nidaq.direction", _WIRED.direction, "NI-DAQ rig: output, current's direction"),
    ParameterSpec(
        "nidaq.terminals", _WIRED.terminals, "NI-DAQ rig: wiring of the inputs", choices=TERMINALS
    ),
    ParameterSpec(
        "nidaq.high_is_positive",
        _WIRED.high_is_positive,
        "NI-DAQ rig: 5 V on the direction turns towards positive position",
    ),
)
"""Parameters of the DAQ node that choose and describe the rig."""


def rig_name(values: Mapping[str, Any]) -> str:
    """Return the name of the chosen rig, with that of its board."""
    name: str = values["rig"]
    return f"{name} {values['nidaq.device']}" if name == "nidaq" else name


def is_virtual(values: Mapping[str, Any]) -> bool:
    """Return whether the parameters `time` and `rig` mean sampling in virtual time."""
    return bool(
        values["time"] == "virtual" or (values["time"] == "auto" and values["rig"] == "simulated")
    )


def make_rig(values: Mapping[str, Any]) -> Rig:
    """Make the rig of the parameters, without opening it.

    Raises
    ------
    SettingError
        When the parameters do not fit together.
    """
    if wants_self_test(values):
        check_possible(values["rate_hz"], values["max_command_v"])
    if values["rig"] == "simulated":
        return _simulated(values)
    if values["time"] == "virtual":
        raise SettingError("time = 'virtual' needs rig = 'simulated': a real rig has real time")
    start = "nidaq."
    wired = {name.removeprefix(start): values[name] for name in values if name.startswith(start)}
    wired |= {"sensors": tuple(wired["sensors"]), "rate_hz": values["rate_hz"]}
    return NidaqRig(NidaqSettings(**wired))


def _simulated(values: Mapping[str, Any]) -> SimulatedRig:
    virtual = is_virtual(values)
    # In real time a command acts when it arrives.
    delay_s = values["reply_delay_s"] if virtual else 0.0
    if not delay_s < 1.0 / values["rate_hz"]:
        raise SettingError(
            f"reply_delay_s must be from 0 to less than the period {1.0 / values['rate_hz']:g} s, "
            f"got {delay_s:g}"
        )
    return SimulatedRig(
        RigParameters(
            payload_kg=values["payload_kg"],
            noise_v=NOISE_V[values["noise"]],
            loop_delay_s=delay_s,
        ),
        rate_hz=values["rate_hz"],
        seed=values["seed"],
        clock=None if virtual else time.monotonic,
    )


def wants_self_test(values: Mapping[str, Any]) -> bool:
    """Return whether the rig is to be pulsed before it is armed."""
    return bool(
        values["self_test"] == "on"
        or (values["self_test"] == "auto" and values["rig"] != "simulated")
    )
