"""Benchmark of all laws: steps on the grid of payloads, and on rigs that differ from their design.

Every figure is noise-free, since the sensors' noise hides settling and vibration. `planned` is
given the payload, `planned_blind` detects it; `planned_observer` has the observer of friction, and
`planned_model` plans on a model that was identified from the simulated C_dat3 with the payload.
`lqg_limited` has a limit on the gauge. The second move goes back to zero: what a law has learned of
the payload, it knows by then.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click
import numpy as np

from bench.control.control import LENGTH_S, SETTLED_S, step_cost_us
from bench.tools import count_option, json_option, make_table, run_trials, write_json
from flexarm_bringup.console import terminal
from flexarm_control import LAWS, build_law, step_figures
from flexarm_core.labels import counted
from flexarm_daq import RigParameters
from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run as identify
from reproduction.framework.rig import RATE_HZ, run_experiment, run_law

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from flexarm_control.simulation import LoopRun

    Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]

PAYLOADS_KG, SETPOINTS_V = (0.0, 0.2, 0.4), (1.0, 3.0, 5.0)
NOMINAL, SECOND = "nominal", "second move"
SECOND_S = 5.0
_OBSERVER_HZ = 5.0
_EXPERIMENT = "C_dat3"
_OWN: dict[str, dict[str, float]] = {
    "planned": {},
    "planned_observer": {"observer_hz": _OBSERVER_HZ},
    "planned_blind": {},
    "planned_model": {},
}
_LIMITED, _LIMIT_V = "lqg_limited", 2.0
NAMES = (*(name for name in LAWS if name != "planned"), _LIMITED, *_OWN)
_MODEL = "planned_model"
_PAGE = Path(__file__).parents[2] / "docs" / "control.md"
_HEADING = "## Which law\n"
_SECTION = """
| to | take |
| --- | --- |
| move fast and come to rest | `planned`; with friction, gain or backlash that are not known well, \
also `planned.observer_hz` 5 |
| move on your own arm | `planned` with `planned.model`, from `identify` |
| keep the command and the gauge's peak small, or bear noise in the set-point | `pdpc_plus` |
| settle with a payload that changes, without a plan | `pdpc_scheduled` |
| bear a delay, or limit the gauge's peak in a fast move (`lqg.strain_limit_v`) | `lqg` |
| control from the position alone | `ilqr` |
| repeat the thesis | `pd`, `pi`, `pdp`, `pdpc` and `pdpc_unconditional` with its values |

The two tables come from `./flexarm bench laws --docs`: steps to 1, 3 and 5 V with 0, 200 and 400 g,
{seeds} a case, mean and worst settling. Overshoot, error, the gauge's peak and the command
are the worst; the gauge's RMS from 3 to 10 s is a mean. All figures are noise-free. `planned` and
`planned_observer` know the payload, `planned_blind` detects it, and `planned_model` plans on a
model identified from the simulated C_dat3. `lqg_limited` has a limit of 2 V. 10 s means that some
steps never settle.

"""


def _scaled(name: str, factor: float) -> Callable[[RigParameters], RigParameters]:
    return lambda rig: replace(rig, **{name: factor * getattr(rig, name)})


#: Rigs that differ from those of the design; the frequency goes with the root of the stiffness.
VARIANTS: dict[str, Callable[[RigParameters], RigParameters]] = {
    NOMINAL: lambda rig: rig,
    SECOND: lambda rig: rig,
    "frequency -20 %": _scaled("youngs_modulus_pa", 0.8**2),
    "frequency +20 %": _scaled("youngs_modulus_pa", 1.2**2),
    "gain +10 %": _scaled("motor_gain_nm_per_v", 1.1),
    "friction -20 %": _scaled("coulomb_friction_nm", 0.8),
    "friction +50 %": _scaled("coulomb_friction_nm", 1.5),
    "backlash x 2": _scaled("backlash_deg", 2.0),
    "delay 1.67 ms": lambda rig: replace(rig, loop_delay_s=1.67e-3),
}


@dataclass(frozen=True)
class Step:
    """One step; the gauge is that at the base, from 3 s after the step on, noise-free."""

    law: str
    variant: str
    payload_kg: float
    setpoint_v: float
    seed: int
    mean_error_v: float
    overshoot: float
    settling_s: float
    residual_gauge_rms_v: float
    peak_gauge_v: float
    peak_command_v: float


class Case(NamedTuple):
    """Law, rig and set-point of a step."""

    law: str
    variant: str
    payload_kg: float
    setpoint_v: float
    seed: int


@click.command()
@count_option("--seeds", 20)
@click.option("--law", "names", type=click.Choice(NAMES), multiple=True, help="Default: all.")
@click.option("--variant", "variants", type=click.Choice(list(VARIANTS)), multiple=True)
@click.option("--docs", is_flag=True, help="Write the last section of docs/control.md.")
@json_option
def main(
    *,
    seeds: int,
    names: tuple[str, ...],
    variants: tuple[str, ...],
    docs: bool,
    json_file: Path | None,
) -> None:
    """Step every law on every rig, print the tables, and write the figures on request."""
    names, variants = names or NAMES, variants or tuple(VARIANTS)
    grid = product(names, variants, PAYLOADS_KG, SETPOINTS_V, range(seeds))
    cases = [Case(*each) for each in grid]
    steps = run_trials(step, cases, chunk=4)
    for title, head, rows in tables(steps):
        table = make_table(*head, title=title)
        for row in rows:
            table.add_row(*row)
        terminal.show_table(table)
    step_us = {name: step_cost_us(build_law(name)) for name in LAWS if name in names}
    write_json(json_file, {"step_us": step_us, "trials": [asdict(each) for each in steps]})
    if docs:
        write_section(steps, seeds)


@cache
def identified_model(payload_kg: float) -> control.StateSpace:
    """Return the model with a payload, identified and reduced as `flexarm design` does it."""
    record = run_experiment(experiment(_EXPERIMENT), RigParameters(payload_kg=payload_kg), 0)
    return identify(record, Request(reduction="mrm", update="b")).model


def step(case: Case) -> Step:
    """Step the arm once, or to and back again."""
    rig = VARIANTS[case.variant](RigParameters(payload_kg=case.payload_kg))
    values = dict(_OWN.get(case.law, {}))
    if case.law in ("planned", "planned_observer"):
        values["payload_kg"] = case.payload_kg
    name = "planned" if case.law in _OWN else case.law
    if case.law == _LIMITED:
        name, values = "lqg", {"strain_limit_v": _LIMIT_V}
    law = build_law(name, values, identified_model(case.payload_kg) if case.law == _MODEL else None)
    reference_v = np.full(round(LENGTH_S * RATE_HZ), case.setpoint_v)
    if case.variant == SECOND:
        reference_v = np.append(reference_v[: round(SECOND_S * RATE_HZ)], 0.0 * reference_v)
        made = run_law(law, reference_v, arm=rig, seed=case.seed)
        return _figures(case, made, made.time_s >= SECOND_S, (case.setpoint_v, 0.0))
    made = run_law(law, reference_v, arm=rig, seed=case.seed)
    return _figures(case, made, made.time_s >= 0.0, (0.0, case.setpoint_v))


def _figures(case: Case, made: LoopRun, during: np.ndarray, ends_v: tuple[float, float]) -> Step:
    time_s, true_v = made.time_s[during], made.true_y[during]
    figures = step_figures(time_s, true_v[:, 0], ends_v[1], ends_v[0])
    settled = time_s >= time_s[0] + SETTLED_S
    return Step(
        *case,
        figures.mean_error_v,
        figures.overshoot,
        min(figures.settling_s, LENGTH_S),
        float(np.sqrt(np.mean(true_v[settled, 1] ** 2))),
        float(np.abs(true_v[:, 1]).max()),
        float(np.abs(made.command_v[during]).max()),
    )


def tables(steps: Sequence[Step]) -> list[Table]:
    """Return titles, heads and rows: all figures on the rig of the design, settling on the rest."""
    names = tuple(dict.fromkeys(each.law for each in steps))
    variants = tuple(dict.fromkeys(each.variant for each in steps))
    head = ("law", "settling s", "overshoot", "error V", "gauge mV", "peak V", "command V")
    found: list[Table] = []
    if NOMINAL in variants:
        rows = [_row(name, _of(steps, name, NOMINAL)) for name in names]
        found.append(("rig of the design", head, rows))
    others = [variant for variant in variants if variant != NOMINAL]
    if others:
        settling = [
            (name, *(_settling(_of(steps, name, variant)) for variant in others)) for name in names
        ]
        found.append(("settling s on other rigs", ("law", *others), settling))
    return found


def _row(name: str, some: Sequence[Step]) -> tuple[str, ...]:
    gauge_mv = 1e3 * float(np.mean([each.residual_gauge_rms_v for each in some]))
    return (
        name,
        _settling(some),
        f"{max(each.overshoot for each in some):.1%}",
        f"{max(abs(each.mean_error_v) for each in some):.3f}",
        f"{gauge_mv:.1f}",
        f"{max(each.peak_gauge_v for each in some):.1f}",
        f"{max(each.peak_command_v for each in some):.1f}",
    )


def _settling(some: Sequence[Step]) -> str:
    settling_s = [each.settling_s for each in some]
    return f"{np.mean(settling_s):.2f} / {max(settling_s):.2f}"


def _of(steps: Sequence[Step], name: str, variant: str) -> list[Step]:
    return [each for each in steps if (each.law, each.variant) == (name, variant)]


def write_section(steps: Sequence[Step], seeds: int) -> None:
    """Write the last section of docs/control.md."""
    blocks = [
        "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))
        for _, head, rows in tables(steps)
    ]
    text = _SECTION.format(seeds=counted(seeds, "seed")) + "\n\n".join(blocks) + "\n"
    before, *_ = _PAGE.read_text("utf-8").partition(_HEADING)
    _PAGE.write_text(before + _HEADING + text, "utf-8")


if __name__ == "__main__":
    main()
