"""Numbers, constants and errors of the double of `nidaqmx`."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

OVERRUN = -200279
TIMEOUT = -200284
REMOVED = -201003
RESERVED = -50103
UNKNOWN_DEVICE = -200220
UNKNOWN_CHANNEL = -200170
NOT_SUPPORTED = -200077
OUT_OF_RANGE = -200561
TASK_GONE = -200088

CALL_SITES = (
    "Task",
    "ai.add_ai_voltage_chan",
    "ai.cfg_samp_clk_timing",
    "ai.samp_clk_rate",
    "ai.start",
    "ai.avail_samp_per_chan",
    "ai.read_one_sample",
    "ai.close",
    "ao.add_ao_voltage_chan",
    "ao.start",
    "ao.write_one_sample",
    "ao.close",
)
"""Where a session of the rig calls the driver."""


class Error(Exception):
    """Base of the package's errors."""


class DaqNotFoundError(Error):
    """Missing driver."""


class DaqNotSupportedError(Error):
    """Platform without a driver."""


class DaqError(Error):
    """Error of the driver, by its number."""

    def __init__(self, message: str, error_code: int, task_name: str = "") -> None:
        self.error_code = error_code
        name = f"\n\nTask Name: {task_name}" if task_name else ""
        super().__init__(f"{message}{name}\n\nStatus Code: {error_code}")


class TerminalConfiguration(Enum):
    """Wiring of an input."""

    RSE = 10083
    NRSE = 10078
    DIFF = 10106
    PSEUDO_DIFF = 12529
    DEFAULT = -1


class AcquisitionType(Enum):
    """Number of samples that a task takes."""

    FINITE = 10178
    CONTINUOUS = 10123


class Edge(Enum):
    """Edge of a clock."""

    RISING = 10280
    FALLING = 10171


class VoltageUnits(Enum):
    """Unit of a voltage channel."""

    VOLTS = 10348


class Fault(NamedTuple):
    """Call site that fails: from its n-th call on, a number of times."""

    site: str
    code: int
    at: int = 1
    times: float = 1
