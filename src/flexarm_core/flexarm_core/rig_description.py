"""Rig description: what an arm is, in one YAML file.

It names the inputs and outputs with their units and ranges, the joints, the driver with its
settings, and what keeps the drive safe. Nothing else knows channels and scales.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from flexarm_core.bounds import read_text_bytes
from flexarm_core.errors import SettingError, nearest, one_line
from flexarm_core.labels import PER_SI, RAW_UNITS, SI_UNITS
from flexarm_core.yaml_sections import Section, sections_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

INPUT_QUANTITIES: Final = ("current", "torque", "force", "rate", "other")
OUTPUT_QUANTITIES: Final = tuple(SI_UNITS)
TRAVEL_ACTIONS: Final = ("inward", "hold")
"""At the end of the travel: only commands that lead back pass, or the drive is held at zero."""
SIMULATIONS: Final = ("simulated", "twin", "mujoco")
"""Drivers without a board: their time may be virtual."""
SHORT_NAMES: Final[Mapping[str, str]] = {"simulated": "thesis", "nidaq": "thesis-nidaq"}
"""Packaged descriptions that go by the name of their driver too."""
_TAKEN = ("reference_", "compensation_")
_RATES_HZ = 1.0, 10_000.0
_MOST_PERIODS = 1000
_MOST_SAMPLES = 2**31 - 1


@dataclass(frozen=True)
class Channel:
    """Signal of a rig.

    Attributes
    ----------
    name : str
        Its name in records, models and messages.
    unit : str
        Unit of its values there.
    quantity : str
        One of `SI_UNITS`.
    per_si : float or None
        Its units in one SI unit, such as V/(N m); None for a quantity without an SI unit.
    low, high : float
        Ends of its range, in its unit: limits of a command, or where a reading clips.
    """

    name: str
    unit: str
    quantity: str
    per_si: float | None
    low: float
    high: float

    @property
    def si_unit(self) -> str:
        """SI unit of the quantity; empty for another one."""
        return SI_UNITS[self.quantity]

    def to_si(self, value: float) -> float:
        """Convert a value to the SI unit; a quantity without one stays as it is."""
        return value if self.per_si is None else value / self.per_si

    def text(self, value: float) -> str:
        """Return a value in its unit and, where that is another one, in SI: ``1.2 V, 0.6 A``."""
        own = f"{value:.4g} {self.unit}"
        if self.si_unit in ("", self.unit):
            return own
        return f"{own}, {self.to_si(value):.4g} {self.si_unit}"

    @property
    def units(self) -> dict[str, float]:
        """Units of the quantity, its own first, and what one of each is in its own."""
        known = PER_SI.get(self.quantity, {})
        others = {unit: (self.per_si or 1.0) / per_si for unit, per_si in known.items()}
        return {self.unit: 1.0} | {unit: one for unit, one in others.items() if unit != self.unit}


@dataclass(frozen=True)
class Input(Channel):
    """Command of a drive.

    Attributes
    ----------
    slew_per_s : float
        Fastest change, in its unit a second.
    rest : float
        Command at which the drive rests.
    raw_per_unit : float
        Volts or counts of the driver in one unit.
    """

    slew_per_s: float
    rest: float
    raw_per_unit: float

    @property
    def reach(self) -> float:
        """Largest change from rest that is possible both ways, in its unit."""
        return min(self.high - self.rest, self.rest - self.low)


@dataclass(frozen=True)
class Output(Channel):
    """Reading of a sensor.

    Attributes
    ----------
    scale, offset : float
        A raw reading of the driver has the value ``scale * (raw - offset)``.
    wrap : float or None
        An encoder begins anew after that many units.
    absent : bool
        True when the rig has no such sensor: the driver reads a constant in its place.
    """

    scale: float
    offset: float
    wrap: float | None
    absent: bool

    @property
    def span(self) -> float:
        """Width of its range, at whose ends it saturates; 0 without ends, as one that wraps."""
        span = self.high - self.low
        return span if self.wrap is None and math.isfinite(span) else 0.0

    def value(self, raw: float) -> float:
        """Return the value of a raw reading."""
        return self.scale * (raw - self.offset)


@dataclass(frozen=True)
class Joint:
    """Joint of an arm.

    Attributes
    ----------
    name : str
        Name of the joint.
    input : str
        Input that drives it.
    angle : str
        Output that is its angle.
    rate : str or None
        Output that is its rate, if that is measured.
    low, high : float
        Ends of its travel, in the unit of the angle.
    sign : int
        1 where a positive command turns it towards positive angles, else -1.
    coulomb : float or None
        Dry friction, in the unit of the input, if it is known.
    link_length_m : float
        Length of its link, for the drawing.
    """

    name: str
    input: str
    angle: str
    rate: str | None
    low: float
    high: float
    sign: int
    coulomb: float | None
    link_length_m: float

    @property
    def middle(self) -> float:
        """Middle of its travel, in the unit of the angle."""
        return 0.5 * (self.low + self.high)

    @property
    def half_travel(self) -> float:
        """Travel to either side of the middle, in the unit of the angle."""
        return 0.5 * (self.high - self.low)


@dataclass(frozen=True)
class Track:
    """Output that a set-point means: name of its joint, its own, unit, ends of the travel."""

    name: str
    output: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class Safety:
    """What keeps the drive safe, beside the limits of inputs and joints.

    Attributes
    ----------
    max_age_periods : int
        Age at which a command is stale, periods; 0 for 3, and at least 3 ms.
    stuck_samples : int
        Equal readings in a row that mean a stuck sensor; 0 for never.
    end_of_travel : str
        One of `TRAVEL_ACTIONS`.
    """

    max_age_periods: int
    stuck_samples: int
    end_of_travel: str


@dataclass(frozen=True)
class RigDescription:
    """Arm with its signals, joints, driver and safety.

    Attributes
    ----------
    name : str
        Name of the arm.
    rate_hz : float
        Sampling rate, Hz.
    inputs : tuple of Input
        Commands, in the order of the driver.
    outputs : tuple of Output
        Readings, in the order of the driver.
    joints : tuple of Joint
        Joints, from the base on.
    tracked : tuple of str
        Outputs that a set-point means, by default the angles of the joints; others need a servo.
    driver : str
        Name of a driver, or ``FILE.py:CLASS``; a relative file is one beside the description.
    settings : mapping
        Settings of the driver.
    safety : Safety
        What keeps the drive safe.
    text : str
        The file's own text.
    file : str
        Its name, for messages.
    """

    name: str
    rate_hz: float
    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]
    joints: tuple[Joint, ...]
    tracked: tuple[str, ...]
    driver: str
    settings: Mapping[str, Any]
    safety: Safety
    text: str
    file: str = field(default="rig.yaml", compare=False)

    @cached_property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(each.name for each in self.inputs)

    @cached_property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(each.name for each in self.outputs)

    @property
    def tracks(self) -> tuple[Track, ...]:
        """Outputs that the set-points mean, in their order."""
        joints = {each.angle: each for each in self.joints}
        found = []
        for name in self.tracked:
            output, joint = self.output(name), joints.get(name)
            ends = (joint.low, joint.high) if joint else (output.low, output.high)
            found.append(Track(joint.name if joint else name, name, output.unit, *ends))
        return tuple(found)

    def output(self, name: str) -> Output:
        """Return an output by its name; KeyError for another one."""
        return {each.name: each for each in self.outputs}[name]

    def input(self, name: str) -> Input:
        """Return an input by its name; KeyError for another one."""
        return {each.name: each for each in self.inputs}[name]


def packaged() -> tuple[str, ...]:
    """Return the names of the descriptions that come with flexarm."""
    folder = files(__package__).joinpath("rigs", "packaged")
    return tuple(sorted(each.name.removesuffix(".yaml") for each in folder.iterdir()))


def load_rig(rig: str | Path) -> RigDescription:
    """Read a rig description.

    Parameters
    ----------
    rig : str or Path
        Name of a packaged description, one of `SHORT_NAMES`, or a file.

    Raises
    ------
    SectionError
        With file and line, where the description is wrong.
    SettingError
        If there is no such description.
    """
    rig = SHORT_NAMES.get(str(rig), rig)
    if str(rig) in packaged():
        return _packaged_rig(str(rig))
    path = Path(rig)
    if not path.is_file():
        raise SettingError(
            f"rig {str(rig)!r}: no such file, and no packaged rig{nearest(str(rig), packaged())}: "
            f"`flexarm rig new NAME` writes a template"
        )
    try:
        text = read_text_bytes(path).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SettingError(f"{path}: {one_line(error)}") from error
    return described(text, str(path))


@cache
def _packaged_rig(name: str) -> RigDescription:
    text = files(__package__).joinpath("rigs", "packaged", f"{name}.yaml").read_text("utf-8")
    return described(text, f"{name}.yaml")


def described(text: str, file: str = "rig.yaml") -> RigDescription:
    """Return the rig that a YAML text describes; `file` stands in the errors.

    Raises
    ------
    SectionError
        With file and line, where the description is wrong.
    """
    top = sections_of(text, file)
    inputs = tuple(_input(each) for each in _some(top, "inputs"))
    outputs = tuple(_output(each) for each in _some(top, "outputs"))
    names = [each.name for each in (*inputs, *outputs)]
    for name in names:
        if names.count(name) > 1:
            top.refuse(f"{name} is the name of an input and of an output: rename one", "outputs")
        if name.startswith(_TAKEN):
            top.refuse(
                f"{name}: names with {' or '.join(_TAKEN)} are those of set-points and "
                "compensations in records: rename it",
                "inputs" if name in [each.name for each in inputs] else "outputs",
            )
    joints = tuple(_joints(top, inputs, outputs))
    present = [each.name for each in outputs if not each.absent]
    tracked = top.words("tracked", present, [each.angle for each in joints])
    if len(tracked) > len(inputs):
        top.refuse(
            f"tracked has {len(tracked)} outputs for {len(inputs)} inputs: a set-point for each "
            "input at most",
            "tracked",
        )
    free = set(tracked) - {each.angle for each in joints}
    for each in outputs:
        if each.name in free and not math.isfinite(each.high - each.low):
            top.refuse(
                f"tracked: {each.name} is not a joint's angle and needs a range for its set-points",
                "tracked",
            )
    rig = RigDescription(
        name=top.text("name"),
        rate_hz=top.number("rate_hz", within=_RATES_HZ),
        inputs=inputs,
        outputs=outputs,
        joints=joints,
        tracked=tracked,
        driver=top.text("driver"),
        settings=top.section("settings").values(),
        safety=_safety(top.section("safety")),
        text=text,
        file=file,
    )
    top.end()
    return rig


def _some(top: Section, name: str) -> Iterator[Section]:
    rows = list(top.sections(name))
    if not rows:
        top.refuse(f"{name} are missing: an arm has at least one", name)
    yield from rows


def _channel(
    row: Section, quantities: tuple[str, ...], limits: tuple[float, float]
) -> dict[str, Any]:
    """Return the fields that inputs and outputs share."""
    quantity = row.word("quantity", quantities, "other")
    known = PER_SI.get(quantity, {})
    # A quantity without an SI unit has any.
    units, role = (*known, *RAW_UNITS), f"a unit of {quantity}"
    unit = row.word("unit", units, role=role) if quantity != "other" else row.text("unit")
    per_si = known.get(unit)
    if "per_si" in row:
        if per_si is not None or quantity == "other":
            row.refuse(f"{row.name}: per_si has no meaning for {quantity} in {unit}", "per_si")
        per_si = row.number("per_si", zero=False)
    elif per_si is None and quantity != "other":
        row.refuse(
            f"{row.name}: {quantity} in {unit} needs per_si, the {unit} of one {SI_UNITS[quantity]}"
        )
    measure = {"quantity": quantity, "per_si": per_si, "low": limits[0], "high": limits[1]}
    return {"name": row.name, "unit": unit, **measure}


def _input(row: Section) -> Input:
    low, high = row.interval("limits")
    channel = Input(
        **_channel(row, INPUT_QUANTITIES, (low, high)),
        slew_per_s=row.number("slew_per_s", 1e6, within=(1e-9, 1e12)),
        rest=row.number("rest", 0.0, within=(low, high)),
        raw_per_unit=row.number("raw_per_unit", 1.0, zero=False),
    )
    row.end()
    return channel


def _output(row: Section) -> Output:
    low, high = row.interval("range") if "range" in row else (-math.inf, math.inf)
    wrap = row.number("wrap", within=(1e-12, 1e12)) if "wrap" in row else None
    if wrap is not None and not wrap <= high - low < math.inf:
        row.refuse(
            f"{row.name}: wrap = {wrap:g} needs a range of at least {wrap:g} units, from where to "
            "where the readings run before they begin anew",
            "wrap",
        )
    channel = Output(
        **_channel(row, OUTPUT_QUANTITIES, (low, high)),
        scale=row.number("scale", 1.0, zero=False),
        offset=row.number("offset", 0.0),
        wrap=wrap,
        absent=row.flag("absent"),
    )
    row.end()
    return channel


def _joints(
    top: Section, inputs: tuple[Input, ...], outputs: tuple[Output, ...]
) -> Iterator[Joint]:
    used: dict[str, str] = {}
    by_quantity = {
        quantity: [each.name for each in outputs if each.quantity in kinds and not each.absent]
        for quantity, kinds in (("angle", ("angle", "position")), ("rate", ("rate", "velocity")))
    }
    for row in top.sections("joints"):
        name = row.name
        driven = row.word("input", [each.name for each in inputs])
        measured = [row.word("angle", by_quantity["angle"], role="an angle or position")]
        if "rate" in row:
            measured.append(row.word("rate", by_quantity["rate"], role="a rate or velocity"))
        for entry, signal in zip(("input", "angle", "rate"), (driven, *measured), strict=False):
            if signal in used:
                row.refuse(
                    f"joints.{name}.{entry} = {signal} is that of joint {used[signal]}", entry
                )
            used[signal] = name
        sign = row.number("sign", 1.0, zero=False)
        if abs(sign) != 1.0:
            row.refuse(f"joints.{name}.sign = {sign:g} must be 1 or -1", "sign")
        low, high = row.interval("travel")
        angle = next(each for each in outputs if each.name == measured[0])
        if angle.wrap is None and not angle.low <= low < high <= angle.high:
            row.refuse(
                f"joints.{name}.travel = [{low:g}, {high:g}] passes the range of {angle.name}, "
                f"[{angle.low:g}, {angle.high:g}], beyond which it reads nothing",
                "travel",
            )
        yield Joint(
            name=name,
            input=driven,
            angle=measured[0],
            rate=measured[1] if len(measured) > 1 else None,
            low=low,
            high=high,
            sign=int(sign),
            coulomb=row.number("coulomb", within=(0.0, math.inf)) if "coulomb" in row else None,
            link_length_m=row.number("link_length_m", 1.0, within=(1e-3, 1e3)),
        )
        row.end()


def _safety(row: Section) -> Safety:
    safety = Safety(
        max_age_periods=row.whole("max_age_periods", 0, (0, _MOST_PERIODS)),
        stuck_samples=row.whole("stuck_samples", 0, (0, _MOST_SAMPLES)),
        end_of_travel=row.word("end_of_travel", TRAVEL_ACTIONS, "inward"),
    )
    row.end()
    return safety
