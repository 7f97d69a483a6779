"""Benchmark of the simulated rig beside MuJoCo: one arm in two engines.

The packaged arm `mujoco-thesis` stands beside the simulated rig, whose parts that the model of
MuJoCo lacks are left out: backlash, break-away above the friction of motion, damping of the hub's
frame, filter, converters, delay of the loop and noise. A pulse of 5 V for 0.2 s shows the free
response: where friction stops the hub, and the arm that rings then. A slow ramp shows the command
that moves the hub. The thesis's law `pdpc` steps both, and the simulated rig as it comes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from scipy.linalg import eigvals

from bench.tools import json_option, make_table, write_json, write_table
from flexarm_bringup.console import terminal
from flexarm_control import build_law, step_figures
from flexarm_control.simulation import simulate
from flexarm_core.channels import POSITION_V_PER_RAD
from flexarm_core.rig_description import load_rig
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.drivers.mujoco.rig import MujocoArm, MujocoRig, MujocoSettings
from flexarm_daq.drivers.scaled_rig import ScaledRig
from flexarm_daq.drivers.settings import settings_of
from flexarm_daq.rigs.beam import natural_frequencies_hz

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_daq.rigs.rig_protocol import Rig

_PAGE = Path(__file__).parents[2] / "docs" / "howto" / "mujoco.md"
_RIG = load_rig("mujoco-thesis")
_RATE_HZ = _RIG.rate_hz
_PAYLOADS_KG = (0.0, 0.2, 0.4)
_STEPS = ((0.0, 1.0), (0.2, 3.0), (0.4, 5.0))
_STEP_S = 10.0
_PULSE_V, _PULSE_S, _PULSED_S, _RINGS_FROM_S = 5.0, 0.2, 6.0, 2.0
_RAMP_V, _RAMP_S, _MOVED_V = 1.5, 6.0, 0.02
_PLAIN: dict[str, Any] = {
    "backlash_deg": 0.0,
    "breakaway_ratio": 1.0,
    "mass_damping_per_s": 0.0,
    "tacho_cutoff_hz": 1000.0,
    "noise_v": (0.0,) * 4,
    "adc_bits": 32,
    "dac_bits": 32,
    "loop_delay_s": 0.0,
}
"""Simulated rig with the parts alone that MuJoCo's model has."""
_HEADS = (
    "arm",
    "payload",
    "modes Hz",
    "hub stops at",
    "rings at, damping",
    "moves at",
    "times real time",
)
_STEP_HEADS = ("payload, step", "`mujoco-thesis`", "simulated, the same parts", "simulated")


@dataclass(frozen=True)
class FreeResponse:
    """Figures of an arm without control.

    Attributes
    ----------
    arm : str
        Engine.
    payload_kg : float
        Its payload.
    modes_hz : tuple of float
        First three natural frequencies with a free hub.
    stops_deg : float
        Where the hub comes to rest after the pulse.
    rings_hz, damping_ratio : float
        Vibration of the base gauge that is left then.
    moves_at_v : float
        Command of the ramp at which the hub moves.
    times_real_time : float
        Seconds of motion for each second of a processor, read and written sample by sample.
    """

    arm: str
    payload_kg: float
    modes_hz: tuple[float, ...]
    stops_deg: float
    rings_hz: float
    damping_ratio: float
    moves_at_v: float
    times_real_time: float


@dataclass(frozen=True)
class Step:
    """Step of the law on one arm: parts of the step, and s."""

    arm: str
    payload_kg: float
    setpoint_v: float
    settling_s: float
    overshoot: float


@click.command()
@json_option
@click.option("--docs", is_flag=True, help="Write the tables of docs/howto/mujoco.md.")
def main(*, json_file: Path | None, docs: bool) -> None:
    """Compare both arms, print the tables, and write the figures to a file on request."""
    free = [free_response(arm, each) for each in _PAYLOADS_KG for arm in ("mujoco", "plain")]
    rows = [_free_row(each) for each in free]
    _show(_HEADS, rows)
    steps = {
        case: [stepped(arm, *case) for arm in ("mujoco", "plain", "simulated")] for case in _STEPS
    }
    step_rows = [_step_row(case, found) for case, found in steps.items()]
    _show(_STEP_HEADS, step_rows)
    write_json(json_file, {"free": free, "steps": [each for row in steps.values() for each in row]})
    if docs:
        write_table(_PAGE, "mujoco", _HEADS, rows)
        write_table(_PAGE, "mujoco steps", _STEP_HEADS, step_rows)


def free_response(arm: str, payload_kg: float) -> FreeResponse:
    """Pulse an arm, and ramp its command."""
    pulse_v = np.zeros(round(_PULSED_S * _RATE_HZ))
    pulse_v[: round(_PULSE_S * _RATE_HZ)] = _PULSE_V
    driven(_rig(arm, payload_kg), pulse_v[:100])  # compiles
    begun_s = time.process_time()
    outputs_v = driven(_rig(arm, payload_kg), pulse_v)
    took_s = time.process_time() - begun_s
    rings = outputs_v[round(_RINGS_FROM_S * _RATE_HZ) :, 1]
    ramp_v = np.linspace(0.0, _RAMP_V, round(_RAMP_S * _RATE_HZ))
    ramped_v = driven(_rig(arm, payload_kg), ramp_v)[:, 0]
    modes_hz = _engine_modes_hz if arm == "mujoco" else _beam_modes_hz
    return FreeResponse(
        arm,
        payload_kg,
        tuple(modes_hz(payload_kg).tolist()),
        float(np.degrees(outputs_v[-1, 0] / POSITION_V_PER_RAD)),
        *vibration(rings, _RATE_HZ),
        float(ramp_v[np.argmax(np.abs(ramped_v) > _MOVED_V)]),
        _PULSED_S / took_s,
    )


def driven(rig: Rig, commands_v: FloatArray) -> FloatArray:
    """Give commands in turn, each after a sample; return the samples, V, (samples, outputs)."""
    rig.open()
    outputs_v = np.empty((len(commands_v), len(_RIG.outputs)))
    for k, command_v in enumerate(commands_v):
        outputs_v[k] = rig.read().outputs
        rig.write([command_v])
    rig.close()
    return outputs_v


def vibration(signal: FloatArray, rate_hz: float) -> tuple[float, float]:
    """Return frequency, Hz, and damping ratio of a signal with one vibration about zero."""
    before, after = signal[:-1], signal[1:]
    (crossed,) = np.nonzero(before * after < 0.0)
    instants = crossed + before[crossed] / (before[crossed] - after[crossed])
    angular = np.pi * rate_hz * (len(instants) - 1) / (instants[-1] - instants[0])
    halves = [np.abs(signal[begin:end]).max() for begin, end in pairwise(crossed)]
    decay = -np.polyfit(np.pi * np.arange(len(halves)), np.log(halves), 1)[0]
    return float(angular / (2.0 * np.pi)), float(decay)


def stepped(arm: str, payload_kg: float, setpoint_v: float) -> Step:
    """Step an arm by the thesis's law from rest."""
    rig = _rig(arm, payload_kg)
    reference_v = np.full(round(_STEP_S * _RATE_HZ), setpoint_v)
    run = simulate(rig, build_law("pdpc"), reference_v)
    found = step_figures(run.time_s, run.y[:, 0], setpoint_v)
    return Step(arm, payload_kg, setpoint_v, found.settling_s, found.overshoot)


def _settings(payload_kg: float) -> MujocoSettings:
    settings = settings_of(MujocoSettings, _RIG, rate_hz=_RATE_HZ)
    return replace(settings, payload_kg=payload_kg, noise=())


def _rig(arm: str, payload_kg: float) -> Rig:
    if arm == "mujoco":
        return ScaledRig(MujocoRig(_settings(payload_kg), Path()), _RIG)
    parts = _PLAIN if arm == "plain" else {}
    return SimulatedRig(RigParameters(payload_kg=payload_kg, **parts), rate_hz=_RATE_HZ)


def _beam_modes_hz(payload_kg: float) -> FloatArray:
    return natural_frequencies_hz(RigParameters(payload_kg=payload_kg), 3)


def _engine_modes_hz(payload_kg: float) -> FloatArray:
    """Return the natural frequencies of the engine's own linearisation, without dry friction."""
    arm = MujocoArm(_settings(payload_kg), Path())
    arm.model.dof_frictionloss[:] = 0.0
    states = 2 * arm.model.nv
    state = np.zeros((states, states))
    engine = arm._mujoco  # noqa: SLF001 - a second look
    engine.mjd_transitionFD(arm.model, arm.data, 1e-6, True, state, None, None, None)  # noqa: FBT003
    poles = np.log(eigvals(state).astype(complex)) / arm.step_s
    found: FloatArray = np.sort(np.abs(poles[poles.imag > 1.0]))[:3] / (2.0 * np.pi)
    return found


def _free_row(found: FreeResponse) -> tuple[str, ...]:
    return (
        "`mujoco-thesis`" if found.arm == "mujoco" else "simulated",
        f"{1e3 * found.payload_kg:.0f} g",
        ", ".join(f"{each:.2f}" for each in found.modes_hz),
        f"{found.stops_deg:.2f} deg",
        f"{found.rings_hz:.3f} Hz, {found.damping_ratio:.4f}",
        f"{found.moves_at_v:.3f} V",
        f"{found.times_real_time:.2g}",
    )


def _step_row(case: tuple[float, float], found: list[Step]) -> tuple[str, ...]:
    payload_kg, setpoint_v = case
    cells = (f"{each.settling_s:.2f} s, {each.overshoot:.1%}" for each in found)
    return (f"{1e3 * payload_kg:.0f} g, {setpoint_v:g} V", *cells)


def _show(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    table = make_table(*heads, words=2)
    for row in rows:
        table.add_row(*row)
    terminal.show_table(table)


if __name__ == "__main__":
    main()
