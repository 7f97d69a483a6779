"""Data warnings: what a kind of them means, and one that was found."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


class Grade(str, Enum):
    """Weight of a note, the heaviest first."""

    DO_NOT_USE = "do not use"
    CAUTION = "caution"
    INFORMATION = "information"

    # `StrEnum` came with Python 3.11.
    __str__ = str.__str__


@dataclass(frozen=True)
class DataWarning:
    """Fact that matters before a model is trusted.

    Attributes
    ----------
    code : str
        Kind of the warning, the same for all data and versions: ``saturation``.
    text : str
        One sentence with extent and remedy.
    figures : mapping of str to float
        The figures in the text.
    grade : Grade
        Its weight.
    record : str
        Short name of the record; empty for what concerns all records together.
    channel : str
        Name of the channel; empty for what concerns the whole record.
    """

    code: str
    text: str
    figures: Mapping[str, float]
    _: KW_ONLY
    grade: Grade = Grade.CAUTION
    record: str = ""
    channel: str = ""

    def __str__(self) -> str:
        return f"{self.record}: {self.text}" if self.record else self.text


@dataclass(frozen=True)
class Kind:
    """Kind of a data warning; a call of it makes one.

    Attributes
    ----------
    code : str
        Its stable name, `DataWarning.code`.
    title : str
        The same in words, for the report.
    when : str
        Condition under which it is given.
    remedy : str
        What to do.
    grade : Grade
        Its usual weight.
    """

    code: str
    title: str
    when: str
    remedy: str
    grade: Grade = Grade.CAUTION

    def __call__(
        self,
        text: str,
        figures: Mapping[str, float] | None = None,
        *,
        grade: Grade | None = None,
        channel: str = "",
    ) -> DataWarning:
        """Return a warning of this kind; without a grade it has that of its kind."""
        return DataWarning(
            self.code, text, figures or {}, grade=grade or self.grade, channel=channel
        )


LOST_SAMPLES = Kind(
    "lost_samples",
    "Lost samples",
    "instants of the period without a sample; an output that is NaN, as for an empty cell; "
    "messages or values of an input that are missing; a hole of more than 3 samples whose input "
    "was not recorded parts the record",
    "free the machine of other work; see Records with holes",
)
SAMPLING = Kind(
    "sampling",
    "Sampling",
    "a sample more than 0.3 periods off its instant, or 10 % RMS; instants of receiving, where "
    "messages have no stamps; stamps and declared rate that differ by 1 %; an output slower than"
    " the densest one, which has no information above half its own rate",
    "use messages with headers, one rate for all, and a machine with time to spare",
)
PARTIAL_RECORD = Kind(
    "partial_record",
    "Part that is used",
    "the numbering or the clock starts again: the longest run is used; or 5 % of the record lack a "
    "channel, or an output is NaN from its start on: that part is left out",
    "start all nodes before the recorder; identify each run as a bag of its own",
)
CONVERTED = Kind(
    "converted",
    "Converted channel",
    "an output jumps by a turn of an encoder (360, 2 pi, 2^8 to 2^32 counts): its turns are "
    "counted; a mean of a thousand deviations is subtracted; values beyond 1e-50 to 1e50 are "
    "multiplied by a power of ten",
    "`--wrap 0` leaves an angle, `--wrap 4000` sets another period; `--bias none` leaves a mean",
    Grade.INFORMATION,
)
DROPOUTS = Kind(
    "dropouts",
    "Drop-outs",
    "an output that is smooth else jumps to a level, or keeps its value for up to 20 samples, and "
    "jumps back, at two places or more: these samples count as missing",
    "check the wire, the sensor's supply and the bus",
)
PLANT_CHANGED = Kind(
    "plant_changed",
    "Change of plant or controller",
    "the bag says that the payload was set; models of two sides of a row predict the other side "
    "10 % worse than their own (p < 1e-6, 960 samples or more for each channel), or those of one"
    " of several records and of the others 30 % worse; of a controller in a closed loop it is "
    "information",
    "identify the parts alone (`--to`, `--from`), or each record (`--each`)",
)
TABLE = Kind(
    "table",
    "Table of text",
    "lines of a CSV file that are not rows, units and times that are doubtful, rows that were "
    "resampled",
    "see Forms of a file",
    Grade.INFORMATION,
)
RECORDING = (LOST_SAMPLES, SAMPLING, PARTIAL_RECORD, CONVERTED, DROPOUTS, PLANT_CHANGED, TABLE)
"""What the reading of a record reports."""
