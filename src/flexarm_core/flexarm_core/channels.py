"""Channels of the thesis's arm: one current command in, four sensor voltages out (section 2.3).

As in the thesis, every signal of the rig is a voltage. The factors between those voltages and SI
units, ranges and travel are those of the packaged rig description ``thesis``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flexarm_core.rig_description import load_rig

if TYPE_CHECKING:
    from flexarm_core.rig_description import RigDescription

_RIG: Final = load_rig("thesis")
(_DRIVE,), (_HUB,) = _RIG.inputs, _RIG.joints

BOUND_V: Final = 3.0
"""Bound of the position in open-loop experiments (section 2.4.2), 35 degrees."""

MAX_COMMAND_V: Final = _DRIVE.high
"""Largest magnitude of the command (Figure 2-2): 5 A."""

INPUT_RANGE_V: Final = _RIG.outputs[0].high
"""The analogue inputs read from minus to plus this voltage and clip beyond it."""


CHANNELS: Final = _RIG.outputs
"""The four sensors y1 to y4, in the order of the analogue inputs ACH0 to ACH3."""

CHANNEL_NAMES: Final = _RIG.output_names
"""Names of the four sensors, in the order of `CHANNELS`."""

COMMAND: Final = _DRIVE
"""The rig's only input: the drive's current command."""

(
    POSITION_V_PER_RAD,
    BASE_STRAIN_V_PER_NM,
    MIDDLE_STRAIN_V_PER_NM,
    SPEED_V_S_PER_RAD,
) = (channel.per_si or 1.0 for channel in CHANNELS)

DRIVE_A_PER_V: Final = COMMAND.to_si(1.0)
"""Gain of the current drive (Figure 2-2)."""

TRAVEL_V: Final = _HUB.high
"""Position reading at the end of the travel, 6.857 V."""

TRAVEL_DEG: Final = round(math.degrees(TRAVEL_V / POSITION_V_PER_RAD), 9)
"""The arm turns this far to either side (section 2.4.1), 80 degrees."""


def is_thesis_arm(rig: RigDescription) -> bool:
    """Return whether a rig has the signals of the thesis's arm, in their order."""
    return rig.input_names == (COMMAND.name,) and rig.output_names == CHANNEL_NAMES
