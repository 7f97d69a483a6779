"""Choice of the rig and its time by the parameters of the DAQ node."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_core.channels import is_thesis_arm
from flexarm_core.errors import SettingError, nearest
from flexarm_core.rig_description import SIMULATIONS, load_rig
from flexarm_daq.drivers.registry import driven, require_methods
from flexarm_daq.drivers.scaled_rig import ScaledRig
from flexarm_daq.loop.self_test import check_possible
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.nidaq.terminals import NidaqSettings
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, THESIS_NOISE_V, RigParameters
from flexarm_daq.rigs.rig_protocol import absent_channels, has_virtual_time
from flexarm_daq.rigs.simulated import SimulatedRig

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_core.rig_description import RigDescription
    from flexarm_daq.rigs.rig_protocol import Rig

NOISE_V = {"low": LOW_NOISE_V, "thesis": THESIS_NOISE_V, "none": (0.0, 0.0, 0.0, 0.0)}


def rig_name(values: Mapping[str, Any]) -> str:
    """Return the name of the chosen rig, with that of its board."""
    name: str = values["rig"]
    return f"{name} {values['nidaq.device']}" if name == "nidaq" else name


def driver_name(values: Mapping[str, Any]) -> str:
    """Return the name of the rig's driver.

    Raises
    ------
    SettingError
        If there is no such description, or it is wrong.
    """
    return load_rig(values["rig"]).driver


def is_virtual(values: Mapping[str, Any]) -> bool:
    """Return whether the parameters `time` and `rig` mean sampling in virtual time."""
    return bool(
        values["time"] == "virtual"
        or (values["time"] == "auto" and driver_name(values) in SIMULATIONS)
    )


def make_rig(values: Mapping[str, Any]) -> Rig:
    """Make the rig of the parameters, without opening it.

    Raises
    ------
    SettingError
        When the parameters do not fit together, or the rig is none.
    """
    if wants_self_test(values):
        check_possible(load_rig(values["rig"]), values["rate_hz"], values["max_command_v"])
    if driver_name(values) not in SIMULATIONS and values["time"] == "virtual":
        raise SettingError(
            f"time = 'virtual', as --fast has it, needs a simulated rig, and rig = "
            f"'{values['rig']}' has real time: leave it out"
        )
    rig = chosen_rig(values)
    require_methods(rig)
    require_channels(rig, load_rig(values["rig"]))
    return rig


def chosen_rig(values: Mapping[str, Any]) -> Rig:
    """Make the rig that the parameter `rig` names: a driver, or a description with its own."""
    description = load_rig(values["rig"])
    if values["viewer"] and description.driver != "mujoco":
        raise SettingError(
            f"viewer: {values['rig']} has the driver {description.driver}, and only mujoco has a "
            "viewer: leave it out"
        )
    if description.driver == "simulated" and is_thesis_arm(description):
        return _simulated(values)
    if values["rig"] == "nidaq":
        start = "nidaq."
        wired = {
            name.removeprefix(start): values[name] for name in values if name.startswith(start)
        }
        wired |= {"sensors": tuple(wired["sensors"]), "rate_hz": values["rate_hz"]}
        return NidaqRig(NidaqSettings(**wired))
    if description.rate_hz != values["rate_hz"]:
        raise SettingError(
            f"rate_hz = {values['rate_hz']:g} of the node and {description.rate_hz:g} of "
            f"{values['rig']}: give the node rate_hz:={description.rate_hz}"
        )
    if description.driver in SIMULATIONS:
        said = {name: values[name] for name in ("seed", "viewer") if values[name]}
        description = replace(description, settings={**description.settings, **said})
    driver = driven(description, Path(values["rig"]).parent)
    if has_virtual_time(driver) and not is_virtual(values):
        driver.clock = time.monotonic  # type: ignore[attr-defined]
    return ScaledRig(driver, description)


def require_channels(rig: Rig, description: RigDescription) -> None:
    """Refuse a rig whose absent channels are none of its outputs.

    Raises
    ------
    SettingError
        When one of them is not.
    """
    for name in absent_channels(rig):
        names = description.output_names
        if name not in names:
            raise SettingError(
                f"the rig's class {type(rig).__name__} has absent_channels with {name!r}"
                f"{nearest(name, names)}: name some of {', '.join(names)}"
            )


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
            disturbance_v=values["disturbance_v"],
            noise_v=NOISE_V[values["noise"]],
            loop_delay_s=delay_s,
        ),
        rate_hz=values["rate_hz"],
        seed=values["seed"],
        clock=None if virtual else time.monotonic,
    )


def wants_self_test(values: Mapping[str, Any]) -> bool:
    """Return whether the rig is to be pulsed before it is armed."""
    if values["self_test"] != "auto":
        return bool(values["self_test"] == "on")
    return is_thesis_arm(load_rig(values["rig"])) and driver_name(values) not in SIMULATIONS
