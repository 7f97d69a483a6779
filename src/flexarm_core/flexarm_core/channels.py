"""Channels of the rig: one current command in, four sensor voltages out (section 2.3).

As in the thesis, every signal of the rig is a voltage; this module holds the one set of factors
between those voltages and SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

BOUND_V: Final = 3.0
"""Bound of the position in open-loop experiments (section 2.4.2)."""

BOUND_DEG: Final = 35.0
"""The same bound as an angle."""

POSITION_V_PER_RAD: Final = BOUND_V / math.radians(BOUND_DEG)
"""Potentiometer gain (section 2.4.2), 4.911 V/rad."""

BASE_STRAIN_V_PER_NM: Final = 1.6
"""Base gauge gain per N m of bending moment, from the frequency responses of Appendix B."""

MIDDLE_STRAIN_V_PER_NM: Final = 1.1
"""Middle gauge gain per N m of bending moment, from the frequency responses of Appendix B."""

SPEED_V_S_PER_RAD: Final = 0.2014
"""Tachometer gain, from the ratio y4 / (j omega y1) of the models in Appendix B."""

DRIVE_A_PER_V: Final = 0.5
"""Gain of the current drive (Figure 2-2)."""

MAX_COMMAND_V: Final = 10.0
"""Largest magnitude of the command (Figure 2-2): 5 A."""

INPUT_RANGE_V: Final = 10.0
"""The analogue inputs read from minus to plus this voltage and clip beyond it."""

TRAVEL_DEG: Final = 80.0
"""The arm turns this far to either side (section 2.4.1)."""


@dataclass(frozen=True)
class Channel:
    """A voltage and the physical quantity it stands for.

    Attributes
    ----------
    name : str
        Name of the voltage, ending in ``_v``.
    si_name : str
        Name of the quantity, with its unit as suffix.
    volts_per_si : float
        Volts per SI unit.
    """

    name: str
    si_name: str
    volts_per_si: float

    def to_si(self, volts: float) -> float:
        """Convert a voltage to the physical quantity, in SI units."""
        return volts / self.volts_per_si


CHANNELS: Final = (
    Channel("position_v", "position_rad", POSITION_V_PER_RAD),
    Channel("base_strain_v", "base_moment_nm", BASE_STRAIN_V_PER_NM),
    Channel("middle_strain_v", "middle_moment_nm", MIDDLE_STRAIN_V_PER_NM),
    Channel("speed_v", "speed_rad_per_s", SPEED_V_S_PER_RAD),
)
"""The four sensors y1 to y4, in the order of the analogue inputs ACH0 to ACH3."""

CHANNEL_NAMES: Final = ("position_v", "base_strain_v", "middle_strain_v", "speed_v")
"""Names of the four sensors, in the order of `CHANNELS`."""

COMMAND: Final = Channel("command_v", "current_a", 1.0 / DRIVE_A_PER_V)
"""The rig's only input: the drive's current command."""

TRAVEL_V: Final = POSITION_V_PER_RAD * math.radians(TRAVEL_DEG)
"""Position reading at the end of the travel, 6.857 V."""
