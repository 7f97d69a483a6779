"""Figures 2-2, 2-5 and 2-10: the drive, and the signals that excite the arm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from flexarm_core.channels import BOUND_V, DRIVE_A_PER_V, MAX_COMMAND_V
from flexarm_daq import SimulatedRig
from flexarm_daq.experiments.excitation import DIRECTION_HZ, VARYING_HZ
from reproduction.framework.findings import Call, Finding, Plot, SideBySide, Subject, prose, subject
from reproduction.framework.picture import DOTTED, SOLID, STYLE, figure_of, inline_svg
from reproduction.framework.rig import simulated_record
from reproduction.framework.study_rig import study_rig
from reproduction.framework.verdicts import exactly, judged

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from flexarm_daq import RigParameters
    from reproduction.framework.findings import Results


SEED = 1
SHOWN_S = 6.0
LINEAR = 0.01
"""The drive counts as linear when it departs from a line by less than this share of its range."""
_PUSH_S = 0.2
_COMMANDS_V = tuple(0.5 * k for k in range(-24, 25))
# Experiments that stand for the four waveforms, all with 2 V, and for the two bounded ones, 3 V.
_WAVEFORMS = {
    "a: square": "O_dat2",
    "b: periodic random": "O_dat6",
    "c: varying square": "O_dat10",
    "d: random": "O_dat13",
}
_BOUNDED = {"a: constant magnitude": "B_dat9", "b: random magnitude": "B_dat2"}


@dataclass(frozen=True)
class Signal:
    """Beginning of a record: one value per sample."""

    time_s: NDArray[np.float64]
    command_v: NDArray[np.float64]
    position_v: NDArray[np.float64]

    @property
    def turns(self) -> NDArray[np.intp]:
        """Samples whose command has another direction than the one before."""
        sign = np.sign(self.command_v)
        return np.flatnonzero(sign[1:] * sign[:-1] < 0.0) + 1

    @property
    def turning_hz(self) -> NDArray[np.float64]:
        """Frequency that belongs to each whole half-period."""
        return np.asarray(0.5 / np.diff(self.time_s[self.turns]))

    @property
    def is_constant(self) -> bool:
        """Return whether the magnitude is constant."""
        magnitude = np.abs(self.command_v)
        return bool(np.ptp(magnitude) < 1e-9 * magnitude.max())


def drive_characteristic() -> tuple[float, ...]:
    """Return the current of each command, A, from how far it moves an arm without friction."""
    rig = replace(
        study_rig(),
        coulomb_friction_nm=0.0,
        viscous_friction_nm_s_per_rad=0.0,
        backlash_deg=0.0,
        loop_delay_s=0.0,
        noise_v=(0.0, 0.0, 0.0, 0.0),
        adc_bits=32,
    )
    moved = np.array([_moved_v(rig, command_v) for command_v in _COMMANDS_V])
    at_one_volt = moved[_COMMANDS_V.index(1.0)]
    return tuple((DRIVE_A_PER_V * moved / at_one_volt).tolist())


def _moved_v(parameters: RigParameters, command_v: float) -> float:
    rig = SimulatedRig(parameters, rate_hz=1.0 / _PUSH_S)
    rig.open()
    rig.read()
    rig.write([command_v])
    return float(rig.read().outputs[0])


def signal(name: str, seed: int) -> Signal:
    """Return the beginning of an experiment's record."""
    record = simulated_record(name, seed, calm=True)
    samples = round(SHOWN_S / record.dt_s)
    time_s = np.arange(samples, dtype=np.float64) * record.dt_s
    return Signal(time_s, record.u[:samples, 0], record.y[:samples, 0])


def compare_drive(current_a: Sequence[float]) -> Finding:
    """Figure 2-2: a straight line of 0.5 A/V."""
    command, current = np.array(_COMMANDS_V), np.array(current_a)
    inside = np.abs(command) <= MAX_COMMAND_V
    slope = float(np.polyfit(command[inside], current[inside], 1)[0])
    largest = DRIVE_A_PER_V * MAX_COMMAND_V
    departure = float(np.abs(current - DRIVE_A_PER_V * command)[inside].max()) / largest
    beyond = float(np.abs(current).max())
    with mpl.rc_context(STYLE):
        figure = figure_of(2.4)
        axes = figure.subplots()
        axes.plot(command, DRIVE_A_PER_V * command, label="0.5 A/V", **DOTTED)
        axes.plot(command, current, label="simulated drive", **SOLID)
        axes.set(xlabel="command, V", ylabel="current, A")
        axes.legend()
        svg = inline_svg(figure, "motor current over command")
    rows = (
        ("slope, A/V", "about 0.5", f"{slope:.3f}"),
        ("departure from a line, % of range", "linear", f"{100.0 * departure:.2f}"),
        ("largest current, A", "5 at 10 V", f"{beyond:.2f}"),
    )
    return Finding(
        judged(
            statements=(
                exactly("the current is proportional to the command", holds=departure <= LINEAR),
            ),
            evidence=f"{slope:.3f} A/V, straight within {100.0 * departure:.2f} % of its range up "
            f"to {MAX_COMMAND_V:g} V, and {beyond:.2f} A beyond.",
            reason="The simulated drive is not linear.",
            by_construction=True,
        ),
        tables=(SideBySide("The drive", ("", "thesis", "ours"), rows),),
        plots=(Plot("Current over command; the direction is the sign", svg),),
        text=(prose("figure-2-2.text", push_s=_PUSH_S),),
    )


def compare_waveforms(signals: Sequence[Signal]) -> Finding:
    """Figure 2-5: what each waveform holds and how often it turns."""
    square, periodic, varying, random = signals
    low_hz, high_hz = VARYING_HZ
    once = [np.allclose(each.turning_hz, DIRECTION_HZ, rtol=0.01) for each in (square, periodic)]
    within = bool(np.all((varying.turning_hz > 0.99 * low_hz) & (varying.turning_hz < high_hz)))
    rows = (
        ("square", "constant", "0.5", *_held(square)),
        ("periodic random", "random", "0.5", *_held(periodic)),
        ("varying square", "constant", "0.6 to 3", *_held(varying)),
        ("random", "random", "random", *_held(random)),
    )
    right = [
        bool(once[0]) and square.is_constant,
        bool(once[1]) and not periodic.is_constant,
        within and varying.is_constant,
        not random.is_constant,
    ]
    wrong = [name for name, ok in zip(_WAVEFORMS, right, strict=True) if not ok]
    return Finding(
        judged(
            statements=[
                exactly(f"{name.partition(': ')[2]} is held and turns so", holds=ok)
                for name, ok in zip(_WAVEFORMS, right, strict=True)
            ],
            evidence=f"{sum(right)} of 4 waveforms hold the magnitude and turn as section 2.4.1 "
            f"says; the varying one at {varying.turning_hz.min():.2f} to "
            f"{varying.turning_hz.max():.2f} Hz.",
            reason=f"Not so: {', '.join(wrong)}.",
            by_construction=True,
        ),
        tables=(
            SideBySide(
                "The waveforms",
                ("waveform", "magnitude", "turns, Hz", "our magnitude, V", "our turns, Hz"),
                rows,
            ),
        ),
        plots=tuple(
            Plot(f"{name} ({code})", _plotted(each, name, positions=False))
            for (name, code), each in zip(_WAVEFORMS.items(), signals, strict=True)
        ),
        text=(prose("figure-2-5.text"),),
    )


def compare_bounded(signals: Sequence[Signal]) -> Finding:
    """Figure 2-10: the direction turns where the position reaches a bound."""
    right, rows = [], []
    for name, each in zip(_BOUNDED, signals, strict=True):
        outward = np.sign(each.command_v[each.turns - 1])
        at_turn = outward * each.position_v[each.turns]
        # A sample before the turn the arm was still within the bound.
        before = outward * each.position_v[each.turns - 1]
        turns_there = bool(np.all((at_turn >= BOUND_V) & (before < BOUND_V)))
        held = each.is_constant == ("constant" in name)
        right.append(turns_there and held and each.command_v[0] >= 0.0)
        past = float(np.abs(each.position_v).max())
        rows.append(
            (name, *_held(each), f"{at_turn.min():.2f} to {at_turn.max():.2f}", f"{past:.2f}")
        )
    wrong = [name for name, ok in zip(_BOUNDED, right, strict=True) if not ok]
    return Finding(
        judged(
            statements=[
                exactly(f"{name.partition(': ')[2]} turns at the bounds", holds=ok)
                for name, ok in zip(_BOUNDED, right, strict=True)
            ],
            evidence=f"{sum(right)} of 2 signals begin towards the positive bound and turn in the "
            f"sample in which the position reaches {BOUND_V:g} V.",
            reason=f"Not so: {', '.join(wrong)}.",
            by_construction=True,
        ),
        tables=(
            SideBySide(
                "The signals; the bounds are 3 V, 35 degrees",
                ("signal", "magnitude, V", "turns, Hz", "position at the turns, V", "farthest, V"),
                tuple(rows),
            ),
        ),
        plots=tuple(
            Plot(f"{name} ({code})", _plotted(each, name, positions=True))
            for (name, code), each in zip(_BOUNDED.items(), signals, strict=True)
        ),
        text=("3 V of command are the 1.5 A of the figure.",),
    )


def _held(signal_: Signal) -> tuple[str, str]:
    magnitude, turning = np.abs(signal_.command_v), signal_.turning_hz
    held = f"{magnitude.max():.2f}"
    if not signal_.is_constant:
        held = f"{magnitude.min():.2f} to {magnitude.max():.2f}"
    low, high = (f"{value:.2f}" for value in (turning.min(), turning.max()))
    return held, low if low == high else f"{low} to {high}"


def _plotted(signal_: Signal, name: str, *, positions: bool) -> str:
    with mpl.rc_context(STYLE):
        figure = figure_of(2.4 if positions else 1.5)
        panels = figure.subplots(2 if positions else 1, sharex=True, squeeze=False)[:, 0]
        look = {**SOLID, "linewidth": 0.8}
        panels[0].plot(signal_.time_s, signal_.command_v, drawstyle="steps-post", **look)
        panels[0].set_ylabel("command, V")
        if positions:
            panels[1].plot(signal_.time_s, signal_.position_v, **look)
            for bound in (-BOUND_V, BOUND_V):
                panels[1].axhline(bound, linewidth=0.8, **DOTTED)
            panels[1].set_ylabel("position, V")
        panels[-1].set(xlabel="time, s", xlim=(0.0, SHOWN_S))
        return inline_svg(figure, f"{name}: command over time")


def _of_records(
    key: str, names: Iterable[str], compare: Callable[[list[Signal]], Finding]
) -> Subject:
    calls = tuple(Call(signal, (name, SEED)) for name in names)
    return subject(key, calls, lambda results: compare([results[call] for call in calls]))


_DRIVE = Call(drive_characteristic)


def _build_drive(results: Results) -> Finding:
    return compare_drive(results[_DRIVE])


SUBJECTS = (
    subject("figure-2-2", (_DRIVE,), _build_drive),
    _of_records("figure-2-5", _WAVEFORMS.values(), compare_waveforms),
    _of_records("figure-2-10", _BOUNDED.values(), compare_bounded),
)
