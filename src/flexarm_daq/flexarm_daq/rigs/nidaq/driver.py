"""Driver package `nidaqmx`, imported on demand; its errors become rig errors."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, Protocol, cast

from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

# The shell's `python` hardly ever belongs to this environment.
INSTALL_PACKAGE: Final = f'{sys.executable} -m pip install "nidaqmx>=1.0,<2"'
"""Command that installs the Python package."""

INSTALL_DRIVER: Final = f"{sys.executable} -m nidaqmx installdriver"
"""Command that installs the driver below the package."""

_MODULES: Final = ("constants", "errors", "stream_readers", "stream_writers", "system")
_LOOK: Final = "flexarm doctor --hardware"

_ADVICE: Final = {
    -200279: "samples were overwritten before they were read; free the machine or lower rate_hz",
    -200284: "no sample came in time; check the board's connection and its sample clock",
    -200278: "the sampling has ended by itself; activate again",
    -201003: f"the board does not answer; check its cable and power, then run {_LOOK}",
    -200324: f"the board is absent; check its cable and power, then run {_LOOK}",
    -88705: f"the board is absent; check its cable and power, then run {_LOOK}",
    -50405: f"the transfer was aborted; check the board's cable and power, then run {_LOOK}",
    -88709: "the board was reset while in use; end the other program and activate again",
    -88710: "the board was reset while in use; end the other program and activate again",
    -50103: "another program holds the board; end it (a second DAQ node, a test panel)",
    -201105: "another program holds the board; end it (a second DAQ node, a test panel)",
    -200220: f"no board has this name; {_LOOK} lists the names, nidaq.device chooses one",
    -200170: f"the board has no such channel; {_LOOK} lists them",
    -200077: f"the board cannot do this; {_LOOK} shows its ranges and terminals",
    -200081: "too fast for four channels of this board; lower rate_hz",
    -200332: "too fast for this board; lower rate_hz",
}
_OTHER_ADVICE: Final = f"run {_LOOK}"


class Nidaqmx(Protocol):
    """Used part of the package `nidaqmx`; tests replace it by a double."""

    Task: Any
    constants: Any
    errors: Any
    stream_readers: Any
    stream_writers: Any
    system: Any


def load_nidaqmx() -> Nidaqmx:
    """Import the package.

    Raises
    ------
    RigError
        If it is not installed.
    """
    try:
        package = import_module("nidaqmx")
        for name in _MODULES:
            import_module(f"nidaqmx.{name}")
    except ImportError as error:
        raise RigError(
            f"the package nidaqmx cannot be imported ({error}): install it with {INSTALL_PACKAGE}"
        ) from None
    return cast("Nidaqmx", package)


@contextmanager
def named_errors(nidaqmx: Nidaqmx, what: str) -> Iterator[None]:
    """Turn every error of the package into a `RigError`.

    Parameters
    ----------
    nidaqmx : Nidaqmx
        Package.
    what : str
        Channel or board in use, for the message.

    Raises
    ------
    RigError
        In place of any error of the package, with a remedy in one line.
    """
    errors = nidaqmx.errors
    try:
        yield
    except errors.DaqNotFoundError as error:
        raise RigError(f"the NI-DAQmx driver is not installed: {INSTALL_DRIVER}") from error
    except errors.DaqNotSupportedError as error:
        raise RigError(
            "there is no NI-DAQmx driver for this platform: use Linux or Windows on x86-64"
        ) from error
    except errors.DaqError as error:
        advice = _ADVICE.get(error.error_code, _OTHER_ADVICE)
        raise RigError(
            f"{what}: {_first_line(error)} (NI-DAQmx error {error.error_code}): {advice}"
        ) from error
    except errors.Error as error:
        raise RigError(f"{what}: {_first_line(error)}: {_OTHER_ADVICE}") from error


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".") if lines else type(error).__name__


def succeeds(nidaqmx: Nidaqmx, action: Callable[[], object]) -> bool:
    """Return whether an action of the package ends without an error of the package."""
    try:
        action()
    except nidaqmx.errors.Error:
        return False
    return True
