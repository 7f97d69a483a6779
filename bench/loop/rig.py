"""Benchmark of the simulated rig: seconds of motion for each second of computing.

`one` simulates a whole record in one call, `sampled` reads and writes a rig sample by sample as
the DAQ node does in virtual time. Both drive the arm with a 2.5 V square of 0.6 s at 300 Hz.
`many` moves a batch of rigs by a sample in each call, with the same square on all.
`learning` steps the environment of many arms, with actions at random, on one core.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import click
import numpy as np

from bench.tools import json_option, make_table, write_json
from flexarm_bringup.console import terminal
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.rigs.plant import Plant, simulate
from flexarm_extras.batch import RigBatch
from flexarm_extras.gym import ArmVectorEnv

if TYPE_CHECKING:
    from pathlib import Path

RATE_HZ = 300.0
_REPEATS = 5
_PERIOD_S, _COMMAND_V = 0.6, 2.5
_RIGS = 256
_ARMS, _STEPS = 1024, 200


@click.command()
@click.option("--seconds", type=click.FloatRange(1.0), default=100.0, show_default=True)
@json_option
def main(seconds: float, json_file: Path | None) -> None:
    """Measure, print a table, and write the figures to a file on request."""
    samples = round(seconds * RATE_HZ)
    phase = np.arange(samples) / RATE_HZ / _PERIOD_S + 0.25
    command_v = np.where(phase % 1.0 < 1.0 / 2.0, _COMMAND_V, -_COMMAND_V)
    steps_per_s = learning()
    figures = {
        "times_real_time": one(command_v),
        "many_times_real_time": many(command_v[: round(_PERIOD_S * RATE_HZ)]),
        "sampled_times_real_time": sampled(command_v),
        "learning_times_real_time": steps_per_s / RATE_HZ,
        "learning_steps_per_s": steps_per_s,
        "seconds": seconds,
    }
    title = f"{seconds:g} s of motion at {RATE_HZ:g} Hz, 10 kHz sub-steps, best of {_REPEATS}"
    table = make_table("way", "times real time", title=title)
    table.add_row("one", f"{figures['times_real_time']:.0f}")
    table.add_row(f"many, {_RIGS} rigs", f"{figures['many_times_real_time']:.0f}")
    table.add_row("sampled", f"{figures['sampled_times_real_time']:.0f}")
    table.add_row(f"learning, {_ARMS} arms", f"{figures['learning_times_real_time']:.0f}")
    terminal.show_table(table)
    terminal.CONSOLE.print(f"learning: {steps_per_s:,.0f} steps/s on one core")
    write_json(json_file, figures)


def one(command_v: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """Return seconds of motion per second in one call; the first compiles and is not counted."""
    took_s = []
    for _ in range(1 + _REPEATS):
        plant = Plant(RigParameters())
        start_s = time.perf_counter()
        simulate(plant, command_v, RATE_HZ)
        took_s.append(time.perf_counter() - start_s)
    return len(command_v) / RATE_HZ / min(took_s[1:])


def many(command_v: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """Return seconds of motion of all rigs per second, on one core."""
    rigs, moving = RigBatch(_RIGS, rate_hz=RATE_HZ), np.ones(_RIGS, np.bool_)
    for rig in range(_RIGS):
        rigs.rest(rig, RigParameters(), seed=rig)
    took_s = []
    for _ in range(1 + _REPEATS):
        start_s = time.perf_counter()
        for volts in command_v.tolist():
            rigs.write(np.full(_RIGS, volts), moving)
        took_s.append(time.perf_counter() - start_s)
    return _RIGS * len(command_v) / RATE_HZ / min(took_s[1:])


def sampled(command_v: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """Return seconds of motion per second of reading and writing."""
    took_s = []
    for _ in range(_REPEATS):
        rig = SimulatedRig(rate_hz=RATE_HZ)
        rig.open()
        start_s = time.perf_counter()
        for volts in command_v.tolist():
            rig.read()
            rig.write([volts])
        took_s.append(time.perf_counter() - start_s)
    return len(command_v) / RATE_HZ / min(took_s)


def learning() -> float:
    """Return steps per second of all arms of the environment together."""
    arms = ArmVectorEnv(_ARMS)
    arms.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (_STEPS, _ARMS, 1)).astype(np.float32)
    took_s = []
    for _ in range(_REPEATS):
        start_s = time.perf_counter()
        for action in actions:
            arms.step(action)
        took_s.append(time.perf_counter() - start_s)
    return _ARMS * _STEPS / min(took_s)


if __name__ == "__main__":
    main()
