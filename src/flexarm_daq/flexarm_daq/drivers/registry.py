"""Drivers of rigs: a row here, an entry point of ``flexarm.rigs``, or a file of one's own.

A driver is a class with the methods of `rig_protocol.Rig`, made from the settings of the rig's
description.
"""

from __future__ import annotations

import inspect
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from flexarm_core.channels import COMMAND, is_thesis_arm
from flexarm_core.errors import FlexarmError, SettingError, nearest
from flexarm_core.own_files import error_text, failed_line, own_module
from flexarm_core.yaml_sections import sections_of
from flexarm_daq.drivers.mujoco.rig import MujocoRig, MujocoSettings
from flexarm_daq.drivers.serial.rig import SerialRig, SerialSettings
from flexarm_daq.drivers.settings import require_count, settings_of
from flexarm_daq.drivers.tip_rig import TipRig, TipSettings
from flexarm_daq.drivers.topics.inbox import TopicsSettings
from flexarm_daq.drivers.topics.rig import TopicsRig
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.nidaq.terminals import NidaqSettings
from flexarm_daq.rigs.rig_protocol import METHODS
from flexarm_daq.rigs.simulated import SimulatedRig

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_core.rig_description import RigDescription
    from flexarm_daq.rigs.rig_protocol import Rig

GROUP: Final = "flexarm.rigs"
"""Entry points of packages that bring a driver."""


def _simulated(rig: RigDescription, _: Path) -> Rig:
    if not is_thesis_arm(rig):
        return _with_other_sensors(rig)
    if rig.settings:
        raise SettingError("the simulated rig has no settings here, but parameters of the node daq")
    return SimulatedRig(rate_hz=rig.rate_hz)


def _with_other_sensors(rig: RigDescription) -> Rig:
    if rig.input_names != (COMMAND.name,):
        raise SettingError(
            f"rig {rig.name}: the driver simulated is the thesis's arm, whose input is "
            f"{COMMAND.name}: simulate another arm by the driver twin or mujoco"
        )
    settings = settings_of(TipSettings, rig, rate_hz=rig.rate_hz)
    require_count("sensors", settings.sensors, rig.output_names)
    return TipRig(settings)


def _nidaq(rig: RigDescription, _: Path) -> Rig:
    return NidaqRig(settings_of(NidaqSettings, rig, rate_hz=rig.rate_hz))


def _mujoco(rig: RigDescription, folder: Path) -> Rig:
    settings = settings_of(MujocoSettings, rig, rate_hz=rig.rate_hz)
    require_count("actuators", settings.actuators, rig.input_names)
    require_count("sensors", settings.sensors, rig.output_names)
    return MujocoRig(settings, folder)


def _serial(rig: RigDescription, _: Path) -> Rig:
    settings = settings_of(SerialSettings, rig, rate_hz=rig.rate_hz)
    require_count("inputs", settings.inputs, rig.input_names)
    require_count("outputs", settings.outputs, rig.output_names)
    return SerialRig(settings)


def _topics(rig: RigDescription, _: Path) -> Rig:
    settings = settings_of(TopicsSettings, rig)
    require_count("outputs", settings.outputs, rig.output_names)
    return TopicsRig(settings, len(rig.inputs))


DRIVERS: Final[dict[str, Callable[[RigDescription, Path], Rig]]] = {
    "simulated": _simulated,
    "nidaq": _nidaq,
    "mujoco": _mujoco,
    "serial": _serial,
    "topics": _topics,
}
"""Drivers that come with flexarm."""


def driven(rig: RigDescription, folder: Path) -> Rig:
    """Make the driver of a rig, without opening it.

    Parameters
    ----------
    rig : RigDescription
        The rig.
    folder : Path
        Where a driver's relative file begins, and those of its settings: the folder of the
        description.

    Raises
    ------
    SettingError
        If there is no such driver, it does not take the settings, or it lacks a method; with file
        and line of the description.
    """
    try:
        return _driven(rig, folder)
    except SettingError as error:
        raise SettingError(f"{rig.file}:{_line_of(str(error), rig)}: {error}") from error


def _line_of(said: str, rig: RigDescription) -> int:
    """Return the line of the setting that an error begins with, else that of the driver."""
    top, (first, _, _) = sections_of(rig.text, rig.file), said.partition(" ")
    name = first.removeprefix("settings.")
    if name != first and name in rig.settings:
        return top.section("settings").line(name)
    return top.line("driver")


def _driven(rig: RigDescription, folder: Path) -> Rig:
    if rig.driver in DRIVERS:
        return DRIVERS[rig.driver](rig, folder)
    driver = _own(rig.driver, folder) if ":" in rig.driver else _installed(rig.driver)
    path = Path(inspect.getsourcefile(driver) or "")
    # A class that asks for them has the description and its folder beside its settings.
    wanted = inspect.signature(driver).parameters
    beside = {"rig": rig, "folder": folder}
    settings = {**rig.settings, **{name: beside[name] for name in beside if name in wanted}}
    try:
        made: Rig = driver(**settings)
    except FlexarmError:
        raise
    except Exception as error:
        raise SettingError(
            f"driver {rig.driver}{failed_line(error, path)}: settings "
            f"{', '.join(rig.settings) or '(none)'} do not make it: {error_text(error)}"
        ) from error
    require_methods(made)
    return made


def require_methods(rig: Rig) -> None:
    """Refuse a rig that lacks a method, which would show when the method is needed.

    Raises
    ------
    SettingError
        When it does.
    """
    lacking = [name for name in METHODS if not callable(getattr(rig, name, None))]
    if lacking:
        raise SettingError(
            f"the rig's class {type(rig).__name__} has no method {', '.join(lacking)}: a rig has "
            f"{', '.join(METHODS)} (docs/howto/own_rig.md)"
        )


def _own(driver: str, folder: Path) -> Any:  # noqa: ANN401 - a class of the user's
    file, _, name = driver.rpartition(":")
    path = folder / file
    module = own_module(path, f"driver {driver}")
    found = getattr(module, name, None)
    if not inspect.isclass(found):
        classes = [
            each
            for each, value in vars(module).items()
            if inspect.isclass(value) and value.__module__ == module.__name__
        ]
        raise SettingError(f"driver {driver}: {path} has no class {name!r}{nearest(name, classes)}")
    return found


def _installed(driver: str) -> Any:  # noqa: ANN401 - a class of another package
    found = {each.name: each for each in entry_points(group=GROUP)}
    if driver not in found:
        known = [*DRIVERS, *found]
        raise SettingError(
            f"driver {driver!r} is not known{nearest(driver, known)}: name one of "
            f"{', '.join(known)}, or FILE.py:CLASS"
        )
    try:
        return found[driver].load()
    except Exception as error:
        raise SettingError(
            f"driver {driver} of {found[driver].value}: {error_text(error)}"
        ) from error
