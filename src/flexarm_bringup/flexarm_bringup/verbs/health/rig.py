"""Verbs rig new and rig check: the description of an arm, written and tried without driving."""

from __future__ import annotations

import math
import re
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.table import Table

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import examples
from flexarm_core.channels import is_thesis_arm
from flexarm_core.errors import SettingError
from flexarm_core.rig_description import (
    INPUT_QUANTITIES,
    OUTPUT_QUANTITIES,
    load_rig,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.rig_description import Joint, Output, RigDescription
    from flexarm_daq.drivers.at_rest import RestReading

_READ_S = 2.0
_NEAR_END = 0.02
"""A reading so near to an end of its range, in parts of it, is said to clip."""


@click.group()
def rig() -> None:
    """Write and try the description of an arm."""


@rig.command()
@click.argument("name")
@examples("rig new my_arm", "rig new benches/two_link")
def new(name: str) -> None:
    """Write NAME.yaml, a description to fill in.

    Every entry is explained there, and those with a default are commented out.
    """
    from flexarm_daq.drivers.registry import DRIVERS  # noqa: PLC0415 - drivers load numba

    file = Path(f"{name.removesuffix('.yaml')}.yaml")
    if not re.fullmatch(r"[A-Za-z0-9_-]+", file.stem):
        raise SettingError(f"a rig's name has letters, digits, _ and -: {file.stem!r}")
    if file.exists():
        raise SettingError(f"{file} is there already: choose another name, or remove it")
    template = Template(files("flexarm_core").joinpath("rigs", "template.yaml").read_text("utf-8"))
    text = template.substitute(
        name=file.stem,
        input_quantities=", ".join(INPUT_QUANTITIES),
        output_quantities=", ".join(OUTPUT_QUANTITIES),
        drivers=", ".join(DRIVERS),
    )
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, "utf-8")
    except OSError as error:
        raise SettingError(f"{file}: cannot be written: {error.strerror}") from error
    click.echo(f"{file}: fill it in")
    terminal.next_step(f"flexarm rig check {terminal.quoted(file)}")


@rig.command()
@click.argument("rig_file", metavar="FILE|NAME")
@examples("rig check my_arm.yaml", "rig check thesis", "rig check thesis-nidaq")
def check(rig_file: str) -> None:
    """Try a description: sample for 2 s, and drive nothing.

    Each channel is printed with its raw reading, its value and its noise. FILE is a description,
    NAME a packaged one. The exit code is 1 where a reading or the rate is of no use.
    """
    description = load_rig(rig_file)
    click.echo(_summary(description))
    check_at_rest(description, Path(rig_file).parent)


def check_at_rest(description: RigDescription, folder: Path) -> None:
    """Sample a rig for 2 s with its drives at rest, and print each channel.

    Parameters
    ----------
    description : RigDescription
        The rig.
    folder : Path
        Folder of its description.

    Raises
    ------
    RigError
        When it cannot be read, a reading is not a number or at the end of its range, or the rate is
        another one.
    """
    from flexarm_daq.drivers.at_rest import read_at_rest  # noqa: PLC0415 - drivers load numba
    from flexarm_daq.drivers.registry import driven  # noqa: PLC0415
    from flexarm_daq.rigs.rig_protocol import RigError  # noqa: PLC0415

    reading = read_at_rest(driven(description, folder), description, _READ_S)
    if reading.about:
        click.echo(reading.about)
    terminal.show_table(readings_table(description, reading))
    click.echo(f"rate {reading.rate_hz:.5g} Hz, {len(reading.raw)} samples")
    for channel, output in enumerate(description.outputs):
        fault = reading_fault(output, reading.values(channel, output))
        if fault and not output.absent:
            raise RigError(f"{output.name}: {fault}")
    reading.require_rate(
        description.rate_hz,
        "set it to the driver's rate, or let time_s be the seconds at which each sample was taken",
    )
    checked = is_thesis_arm(description) or description.safety.stuck_samples
    if not checked and all(_has_noise(description, reading)):
        terminal.note(
            "every output has noise: stuck_samples: 30 under safety holds the drive when one "
            "stands still"
        )


def _summary(rig: RigDescription) -> str:
    """Return what a description says, in a line for each input and joint."""
    lines = [f"{rig.name}: {rig.rate_hz:g} Hz, driver {rig.driver}"]
    lines += [
        f"  input {each.name}: {each.low:g} to {each.high:g} {each.unit}"
        f"{_in_si(each.low, each.high, each)}"
        for each in rig.inputs
    ]
    lines += [
        f"  joint {each.name}: {each.input} turns {each.angle}, {each.low:g} to {each.high:g} "
        f"{rig.output(each.angle).unit}{_in_si(each.low, each.high, rig.output(each.angle))}"
        f"{_turns(each, rig)}"
        for each in rig.joints
    ]
    if not rig.joints:
        lines.append("  no joints: pd, pi, commission and C_dat need them, and the page's handles")
    return "\n".join([*lines, f"  tracked: {', '.join(rig.tracked) or 'nothing'}"])


def _turns(joint: Joint, rig: RigDescription) -> str:
    """Return a travel in turns, which show at a glance whether it was written in another unit."""
    angle = rig.output(joint.angle)
    if angle.quantity != "angle":
        return ""
    return f", {angle.to_si(joint.high - joint.low) / math.tau:.3g} turns in all"


def _in_si(low: float, high: float, channel: object) -> str:
    """Return a range in SI units, to be added where its own unit is another one."""
    unit, to_si = channel.si_unit, channel.to_si  # type: ignore[attr-defined]
    if not unit or unit == channel.unit:  # type: ignore[attr-defined]
        return ""
    return f" ({to_si(low):.4g} to {to_si(high):.4g} {unit})"


def readings_table(rig: RigDescription, reading: RestReading) -> Table:
    """Return the raw reading, the value and the noise of each output."""
    table = Table("output", "raw", "value", "noise", "", box=None, pad_edge=False)
    for channel, output in enumerate(rig.outputs):
        values = reading.values(channel, output)
        table.add_row(
            output.name,
            f"{reading.raw[:, channel].mean():.6g}",
            f"{values.mean():.6g} {output.unit}",
            f"{values.std():.2g} {output.unit}",
            _remark(output, values),
        )
    return table


def _has_noise(rig: RigDescription, reading: RestReading) -> Iterator[bool]:
    for channel, output in enumerate(rig.outputs):
        if not output.absent:
            yield bool(np.ptp(reading.raw[:, channel]) > 0.0)


def _remark(output: Output, values: np.ndarray) -> str:
    """Return what is odd about the readings of an output."""
    if output.absent:
        return "absent"
    if fault := reading_fault(output, values):
        return fault
    return "" if np.ptp(values) > 0.0 else "stands still: no noise, or not wired"


def reading_fault(output: Output, values: np.ndarray) -> str:
    """Return why readings of an output are of no use, or nothing."""
    if not np.isfinite(values).all():
        return "not a number: check the wiring"
    margin = _NEAR_END * output.span
    clips = values.min() < output.low + margin or values.max() > output.high - margin
    if output.span and clips:
        return "at the end of its range: check wiring and scale"
    return ""
