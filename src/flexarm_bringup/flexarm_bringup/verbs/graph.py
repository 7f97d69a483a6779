"""Verbs that run nodes."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.verbs.verb import RUN_ON, examples

if TYPE_CHECKING:
    from flexarm_bringup.runs.pace import Pace

_PARAMETERS = click.option(
    "--params-file",
    "parameter_files",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Parameters of the nodes, such as gains or a board's wiring; repeat.",
)
_FAST = click.option("--fast", is_flag=True, help="As fast as the machine can; the same samples.")
_REAL_TIME = click.option(
    "--real-time",
    is_flag=True,
    help="Hard real time, as with a board: what a busy machine is late for is lost.",
)


def _pace(*, fast: bool = False, real_time: bool = False) -> Pace:
    from flexarm_bringup.runs.pace import Pace  # noqa: PLC0415

    if fast and real_time:
        raise click.UsageError("--fast and --real-time exclude each other: give one of them.")
    if fast:
        return Pace.FAST
    return Pace.REAL if real_time else Pace.WALL_CLOCK


@click.command()
@click.option(
    "--payload", type=click.FloatRange(0.0, 1.0), default=0.0, help="Mass at the tip, kg."
)
@click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the noise."
)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/demo"), show_default=True)
@_FAST
@_REAL_TIME
@click.option("--keep-bag", is_flag=True, help="Keep the recorded bags in OUT/bag.")
@examples(
    "demo",
    "demo --fast --payload 0.4 --seed 7",
    "demo --out /tmp/arm --keep-bag",
    "demo --real-time",
)
def demo(payload: float, seed: int, out: Path, *, keep_bag: bool, **pace: bool) -> None:
    """Excite, record, identify, reduce and control the simulated arm, with real nodes.

    The arm's time follows the wall clock and waits for a machine that is late: no sample is lost.
    """
    from flexarm_bringup.runs.demo import DemoSettings, run_demo  # noqa: PLC0415

    run_demo(DemoSettings(out, payload, seed, _pace(**pace), keep_bag))


@click.command()
@click.option(
    "--payload", type=click.FloatRange(0.0, 1.0), default=0.0, help="Mass at the tip, kg."
)
@click.option(
    "--rate", type=click.FloatRange(10.0, 2000.0), default=300.0, show_default=True, help="Hz."
)
@click.option(
    "--reference",
    type=click.Choice(["topic", "step", "square", "varying_square"]),
    default="topic",
    show_default=True,
    help="Set-points from /flexarm/reference, or a built-in profile.",
)
@click.option("--bag", type=click.Path(path_type=Path), help="Record into this new folder.")
@click.option("--law", default="pdpc", show_default=True, help="Law of the controller.")
@_REAL_TIME
@_PARAMETERS
@examples(
    "up",
    "up --rate 500 --payload 0.2 --reference square",
    "up --bag out/run1 --law pdpc_plus --params-file out/gains.yaml",
)
def up(payload: float, rate: float, *, real_time: bool, **settings: Any) -> None:  # noqa: ANN401
    """Start daq, controller, recorder and ident, and keep them until Ctrl-C.

    The simulated arm's time follows the wall clock and waits for a machine that is late. A board
    runs in real time.
    """
    from flexarm_bringup.runs.up import UpSettings, run_graph  # noqa: PLC0415

    pace = _pace(real_time=real_time)
    run_graph(UpSettings(payload_kg=payload, rate_hz=rate, pace=pace, **settings))


@click.command(context_settings=RUN_ON)
@click.argument("package")
@click.argument("executable")
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
@examples(
    "run flexarm_daq daq_node --ros-args -p autostart:=true -p rate_hz:=500.0",
    "run flexarm_daq recorder_node --ros-args -p bag:=out/run1",
)
def run(package: str, executable: str, arguments: tuple[str, ...]) -> None:
    """Run one node, as `ros2 run` does."""
    from flexarm_bringup.graph.processes import find_executable  # noqa: PLC0415

    path = str(find_executable(package, executable))
    os.execv(path, [path, *arguments])  # noqa: S606 - this is what the verb is for


@click.command("exec", context_settings=RUN_ON)
@click.argument("command", nargs=-1, required=True, type=click.UNPROCESSED)
@examples("exec python -c 'import rclpy'", "exec bash")
def execute(command: tuple[str, ...]) -> None:
    """Run any command inside the environment."""
    try:
        os.execvp(command[0], command)  # noqa: S606 - this is what the verb is for
    except FileNotFoundError:
        raise click.ClickException(f"no command {command[0]}") from None


_SEED = click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of what is random."
)
_OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace bags that are there.")
_BAGS = click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/experiments"),
    show_default=True,
    help="Folder that gets a bag for each.",
)


@click.command()
@click.argument("names", nargs=-1, required=True)
@click.option(
    "--payload", "payload_kg", type=click.FloatRange(0.0, 1.0), help="Instead of its own, kg."
)
@_FAST
@_REAL_TIME
@_SEED
@_BAGS
@_OVERWRITE
@_PARAMETERS
@examples(
    "experiment C_dat3",
    "experiment B_dat9 --fast --seed 7",
    "experiment C_dat3 --payload 0.2",
    "experiment O_dat2 --params-file rig.yaml",
)
def experiment(
    names: tuple[str, ...],
    out: Path,
    *,
    fast: bool,
    real_time: bool,
    **settings: Any,  # noqa: ANN401
) -> None:
    """Run experiments of the thesis by their names and record each to a bag.

    The simulated arm's time follows the wall clock and waits for a machine that is late: no sample
    is lost. A board runs in real time.
    """
    from flexarm_bringup.runs.experiment import ExperimentSettings, run_experiments  # noqa: PLC0415
    from flexarm_daq.experiments import catalogue as experiments  # noqa: PLC0415

    entries = [experiments.experiment(name) for name in names]
    pace = _pace(fast=fast, real_time=real_time)
    run_experiments(entries, ExperimentSettings(out, pace=pace, **settings))


@click.command()
@click.option("--all", "everything", is_flag=True, help="Run all of them; else list them.")
@_FAST
@_REAL_TIME
@_SEED
@_BAGS
@_OVERWRITE
@_PARAMETERS
@examples("catalogue", "catalogue --all --fast -o out/experiments")
def catalogue(
    *,
    everything: bool,
    out: Path,
    fast: bool,
    real_time: bool,
    **settings: Any,  # noqa: ANN401
) -> None:
    """List the experiments of the thesis, or run all of them."""
    from flexarm_bringup.runs.experiment import (  # noqa: PLC0415
        ExperimentSettings,
        run_experiments,
        show_catalogue,
    )
    from flexarm_daq.experiments import catalogue as experiments  # noqa: PLC0415

    if not everything:
        show_catalogue()
        return
    entries = list(experiments.catalogue().values())
    pace = _pace(fast=fast, real_time=real_time)
    run_experiments(entries, ExperimentSettings(out, pace=pace, **settings))


@click.command()
@click.option("--hardware", is_flag=True, help="Examine the board and the sensors; moves nothing.")
@click.option("--device", default="Dev1", show_default=True, help="Name of the board.")
@click.option(
    "--sensors",
    default="ai0 ai1 ai2 ai3",
    show_default=True,
    help="Inputs of position, base gauge, middle gauge, speed.",
)
@click.option("--magnitude", default="ao0", show_default=True, help="Output, current's magnitude.")
@click.option("--direction", default="ao1", show_default=True, help="Output, current's direction.")
@click.option("--terminals", default="rse", show_default=True, help="rse, nrse, diff or default.")
@click.option(
    "--rate", type=click.FloatRange(10.0, 2000.0), default=300.0, show_default=True, help="Hz."
)
@examples("doctor", "doctor --hardware", "doctor --hardware --device Dev2 --terminals diff")
def doctor(*, hardware: bool, sensors: str, rate: float, **names: Any) -> None:  # noqa: ANN401
    """Say what this environment consists of and whether nodes can talk."""
    if not hardware:
        from flexarm_bringup.health.doctor import examine  # noqa: PLC0415

        sys.exit(examine())
    from flexarm_bringup.health.hardware import examine_hardware  # noqa: PLC0415
    from flexarm_daq.rigs.nidaq.terminals import NidaqSettings  # noqa: PLC0415

    sys.exit(examine_hardware(NidaqSettings(sensors=tuple(sensors.split()), rate_hz=rate, **names)))
