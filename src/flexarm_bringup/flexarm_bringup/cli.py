"""The `flexarm` command: one verb per job, one-line errors, exit code 0 only on success."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable

# The matrices here are small: more threads of BLAS would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A verb imports what it needs when it runs: `--help` and tab completion stay quick.

_RUN_ON = {"ignore_unknown_options": True, "allow_interspersed_args": False}


class _Verbs(click.Group):
    """Turns the errors that a user can mend into one line, and Ctrl-C into exit code 130."""

    def invoke(self, context: click.Context) -> Any:  # noqa: ANN401 - as click has it
        try:
            return super().invoke(context)
        except KeyboardInterrupt:
            click.echo("flexarm: interrupted", err=True)
            sys.exit(130)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except (ValueError, RuntimeError, OSError) as error:
            if os.environ.get("FLEXARM_DEBUG"):
                raise
            click.echo(f"flexarm: {' '.join(str(error).split())}", err=True)
            sys.exit(1)

    def list_commands(self, context: click.Context) -> list[str]:  # noqa: ARG002
        return list(self.commands)


def _examples(*lines: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        text = "\n".join(f"  flexarm {line}" for line in lines)
        function.__doc__ = f"{function.__doc__}\n\n\b\nExamples:\n{text}"
        return function

    return add


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option("0.1.0", prog_name="flexarm")
def main() -> None:
    """Measure, model and control a flexible arm.

    FLEXARM_DEBUG=1 shows where an error comes from.
    """


@main.command()
@click.option(
    "--payload", type=click.FloatRange(0.0, 1.0), default=0.0, help="Mass at the tip, kg."
)
@click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the noise."
)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/demo"), show_default=True)
@click.option("--fast", is_flag=True, help="Virtual time: as fast as the machine can.")
@click.option("--keep-bag", is_flag=True, help="Keep the recorded bags in OUT/bag.")
@_examples("demo", "demo --fast --payload 0.4 --seed 7", "demo --out /tmp/arm --keep-bag")
def demo(payload: float, seed: int, out: Path, *, fast: bool, keep_bag: bool) -> None:
    """Excite, record, identify, reduce and control the simulated arm, with real nodes."""
    from flexarm_bringup.demo import DemoSettings, run_demo  # noqa: PLC0415

    run_demo(DemoSettings(out, payload, seed, fast, keep_bag))


@main.command()
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
@_examples("up", "up --rate 500 --payload 0.2 --reference square", "up --bag out/run1")
def up(payload: float, rate: float, reference: str, bag: Path | None) -> None:
    """Start daq, controller, recorder and ident, and keep them until Ctrl-C."""
    from flexarm_bringup.up import run_graph  # noqa: PLC0415

    run_graph(payload_kg=payload, rate_hz=rate, reference=reference, bag=bag)


@main.command(context_settings=_RUN_ON)
@click.argument("package")
@click.argument("executable")
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
@_examples(
    "run flexarm_daq daq_node --ros-args -p autostart:=true -p rate_hz:=500.0",
    "run flexarm_daq recorder_node --ros-args -p bag:=out/run1",
)
def run(package: str, executable: str, arguments: tuple[str, ...]) -> None:
    """Run one node, as `ros2 run` does."""
    from flexarm_bringup.processes import find_executable  # noqa: PLC0415

    path = str(find_executable(package, executable))
    os.execv(path, [path, *arguments])  # noqa: S606 - this is what the verb is for


@main.command("exec", context_settings=_RUN_ON)
@click.argument("command", nargs=-1, required=True, type=click.UNPROCESSED)
@_examples("exec python -c 'import rclpy'", "exec bash")
def execute(command: tuple[str, ...]) -> None:
    """Run any command inside the environment."""
    try:
        os.execvp(command[0], command)  # noqa: S606 - this is what the verb is for
    except FileNotFoundError:
        raise click.ClickException(f"no command {command[0]}") from None


@main.command("import")
@click.argument("csv", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--map",
    "map_file",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="YAML file that says which column is what.",
)
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Bag to create."
)
@_examples("import run.csv --map columns.yaml -o bags/run")
def import_(csv: Path, map_file: Path, output: Path) -> None:
    """Turn a CSV file with named columns into a bag."""
    from flexarm_bringup.files import import_measurements  # noqa: PLC0415

    click.echo(import_measurements(csv, map_file, output))


_SEED = click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of what is random."
)
_OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace bags that are there.")


@main.command()
@click.argument("names", nargs=-1, required=True)
@click.option("--payload", type=click.FloatRange(0.0, 1.0), help="Instead of its own, kg.")
@click.option("--fast", is_flag=True, help="Virtual time: as fast as the machine can.")
@_SEED
@click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/experiments"),
    show_default=True,
    help="Folder that gets a bag for each.",
)
@_OVERWRITE
@_examples(
    "experiment C_dat3", "experiment B_dat9 --fast --seed 7", "experiment C_dat3 --payload 0.2"
)
def experiment(
    names: tuple[str, ...],
    payload: float | None,
    seed: int,
    out: Path,
    *,
    fast: bool,
    overwrite: bool,
) -> None:
    """Run experiments of the thesis by their names and record each to a bag."""
    from flexarm_bringup.experiment import ExperimentSettings, run_experiments  # noqa: PLC0415
    from flexarm_daq import catalogue as experiments  # noqa: PLC0415

    entries = [experiments.experiment(name) for name in names]
    run_experiments(entries, ExperimentSettings(out, payload, seed, fast, overwrite))


@main.command()
@click.option("--all", "everything", is_flag=True, help="Run all of them; else list them.")
@click.option("--fast", is_flag=True, help="Virtual time: as fast as the machine can.")
@_SEED
@click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/experiments"),
    show_default=True,
)
@_OVERWRITE
@_examples("catalogue", "catalogue --all --fast -o out/experiments")
def catalogue(*, everything: bool, seed: int, out: Path, fast: bool, overwrite: bool) -> None:
    """List the experiments of the thesis, or run all of them."""
    from flexarm_bringup.experiment import (  # noqa: PLC0415
        ExperimentSettings,
        run_experiments,
        show_catalogue,
    )
    from flexarm_daq import catalogue as experiments  # noqa: PLC0415

    if not everything:
        show_catalogue()
        return
    entries = list(experiments.catalogue().values())
    run_experiments(entries, ExperimentSettings(out, None, seed, fast, overwrite))


@main.command()
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), default=Path("out/identify"), show_default=True
)
@click.option(
    "--method",
    default="auto",
    show_default=True,
    help="auto, orse, orse_iv, pbsid or orse_thesis.",
)
@click.option(
    "--train-fraction",
    type=click.FloatRange(0.0, 1.0, min_open=True),
    default=0.5,
    show_default=True,
    help="Leading part of each record that is fitted.",
)
@click.option(
    "--block-rows", type=click.IntRange(2), default=40, show_default=True, help="q of (2-18)."
)
@click.option("--order", type=click.IntRange(1), help="Order of the full model; else chosen.")
@click.option(
    "--reduction",
    type=click.Choice(["none", "mrm", "msv", "mrmc"]),
    default="none",
    show_default=True,
    help="Ranking by which modes are kept.",
)
@click.option("--reduced-order", type=click.IntRange(1), help="States to keep; else chosen.")
@click.option(
    "--known-mode", "known_modes_hz", multiple=True, type=float, help="Hz, for mrmc; repeat."
)
@click.option(
    "--update",
    type=click.Choice(["none", "b", "c"]),
    default="none",
    show_default=True,
    help="Matrix that is fitted again after the reduction.",
)
@click.option(
    "--remove-compensation/--keep-compensation",
    default=True,
    show_default=True,
    help="Subtract the Coulomb compensation from the input.",
)
@click.option(
    "--stabilise/--keep-unstable",
    default=True,
    show_default=True,
    help="Move unstable eigenvalues inside the unit circle.",
)
@click.option(
    "--friction/--no-friction",
    default=True,
    show_default=True,
    help="Model dry friction where the data show it and carry no compensation.",
)
@click.option(
    "--refine/--no-refine",
    default=False,
    show_default=True,
    help="Refine the model by its simulation error; it never gets worse.",
)
@click.option(
    "--export", default="", metavar="LIST", help="Formats beside model.yaml: any of json,mat,h."
)
@_examples(
    "identify bags/c_dat3_0g",
    "identify bags/c_dat3_0g --reduction mrm --reduced-order 10 --update b -o out/c3",
    "identify bags/c_dat3_0g --export json,mat,h",
    "identify bags/quanser_2dsfl --refine",
)
def identify(bags: tuple[Path, ...], out: Path, **options: Any) -> None:  # noqa: ANN401
    """Identify a model from bags, without any node; write parameters, exports and report."""
    from flexarm_bringup.identify import identify_bags  # noqa: PLC0415

    identify_bags(bags, out, **options)


@main.command()
@click.argument("models", nargs=-1, required=True)
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/gains.yaml"),
    show_default=True,
)
@click.option("--law", type=click.Choice(["pdp", "pi"]), default="pdp", show_default=True)
@click.option("--error-weight", type=click.FloatRange(0.0), default=0.5, show_default=True)
@click.option("--strain-weight", type=click.FloatRange(0.0), default=0.5, show_default=True)
@click.option("--gain-margin", "gain_margin_db", default=10.0, show_default=True, help="dB.")
@click.option("--phase-margin", "phase_margin_deg", default=55.0, show_default=True, help="deg.")
@click.option("--delay", "delay_s", default=0.0, show_default=True, help="Loop delay, s.")
@_examples(
    "tune nominal:0 nominal:0.2 nominal:0.4",
    "tune nominal:0:flipped nominal:0.2:flipped nominal:0.4:flipped",
    "tune bags/c_dat3_0g bags/c_dat3_400g",
    "tune out/a/model.yaml out/b/model.yaml --delay 0.001 -o out/gains.yaml",
)
def tune(models: tuple[str, ...], out: Path, **options: Any) -> None:  # noqa: ANN401
    """Tune gains on models (files from identify, bags, or nominal:KG); write a --params-file.

    nominal:KG:flipped turns the sign of the middle gauge y3, which the thesis seems to have had.
    """
    from flexarm_bringup.tune import tune_models  # noqa: PLC0415

    tune_models(models, out, **options)


@main.command()
@click.argument("keys", nargs=-1)
@click.option("--list", "listing", is_flag=True, help="Say what there is.")
@click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/reproduction"),
    show_default=True,
    help="Folder of the pages.",
)
@click.option("--jobs", type=click.IntRange(1), help="Processes; by default one per core.")
@click.option("--dask", default="", metavar="ADDRESS", help="Scheduler of a Dask cluster.")
@_examples(
    "reproduce --list",
    "reproduce table-2-4",
    "reproduce 'figure-4-*' chapter-3",
    "reproduce all -o docs/reproduction",
    "reproduce all --dask tcp://10.0.0.7:8786",
)
def reproduce(keys: tuple[str, ...], out: Path, jobs: int | None, dask: str, *, listing: bool) -> None:
    """Set tables, figures and claims of the thesis beside our own, with a verdict each."""
    from flexarm_bringup.reproduce import reproduce_subjects, show_subjects  # noqa: PLC0415
    from flexarm_reproduction.run import Workers  # noqa: PLC0415

    if listing:
        show_subjects(keys)
        return
    if not keys:
        raise click.UsageError("say what, such as table-2-4 or all; --list says what there is")
    sys.exit(reproduce_subjects(keys, out, Workers(jobs or -1, dask)))


@main.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--rate", type=float, default=1.0, show_default=True, help="2 plays twice as fast.")
@click.option("--loop", is_flag=True, help="Start again at the end.")
@click.option(
    "--stand-in", is_flag=True, help="Publish the samples only, stamped now, as a DAQ node would."
)
@_examples("play bags/c_dat3_0g", "play bags/c_dat3_0g --rate 2", "play bags/run1 --stand-in")
def play(bag: Path, rate: float, *, loop: bool, stand_in: bool) -> None:
    """Publish the messages of a bag with their original timing; the service ~/play stops it."""
    parameters = {"bag": bag.absolute(), "rate": rate, "loop": loop, "stand_in": stand_in}
    _exec_node("player_node", parameters)


@main.command()
@click.argument("bag", type=click.Path(path_type=Path))
@_examples("record out/run1")
def record(bag: Path) -> None:
    """Record state, command and reference of the running graph until Ctrl-C."""
    _exec_node("recorder_node", {"bag": bag.absolute()})


@main.group()
def bag() -> None:
    """Look after bags."""


@bag.command("repair")
@click.argument("damaged", type=click.Path(exists=True, path_type=Path))
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Bag to create."
)
@_examples("bag repair out/run1 -o out/run1_repaired")
def repair(damaged: Path, output: Path) -> None:
    """Copy every whole message of a damaged bag into a new one."""
    from flexarm_bringup.files import repair_bag  # noqa: PLC0415

    click.echo(repair_bag(damaged, output))


@bag.command("check")
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@_examples("bag check out/run1", "bag check bags/*/")
def check(bags: tuple[Path, ...]) -> None:
    """Find wrong bits, missing samples, wrong types and clock problems; exit code 1 if any."""
    from flexarm_bringup.files import check_bags  # noqa: PLC0415

    sys.exit(0 if check_bags(bags) else 1)


@main.command(context_settings=_RUN_ON)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
@_examples("test", "test test/unit -k margins")
def test(arguments: tuple[str, ...]) -> None:
    """Lint, check types and run the tests; with arguments, run pytest with them only."""
    from flexarm_bringup.check import check_everything  # noqa: PLC0415

    sys.exit(check_everything(arguments))


@main.group()
def bench() -> None:
    """Measure flexarm beside its peers."""


# Name, what it measures, examples. Each is a file of the folder `bench`.
_BENCHES = (
    (
        "ident",
        "CPU time, memory and accuracy of the identification beside its peers",
        ("--quick", "--install-peers --seeds 5"),
    ),
    ("rig", "Speed of the simulated rig in times real time", ("--json out/rig.json",)),
    ("bags", "Speed of reading bags beside rosbags", ("--seconds 600",)),
    (
        "loop",
        "The control loop over DDS beside a bare Python loop",
        ("--rate 300 --rate 500", "--minutes 10 --load"),
    ),
    ("payload", "Payload detection, and gains that follow it", ("--seeds 20",)),
    (
        "control",
        "Trials of the laws, their cost, and the tuning time",
        ("--json out/control.json",),
    ),
    (
        "robustness",
        "Tuned gains over a grid of payloads and on rigs drawn at random",
        ("--rigs 500 --spread 0.2",),
    ),
    ("faults", "The fault campaign: broken rigs, killed processes", ("--docs",)),
    ("bag_faults", "Cut, flipped and mutated bags", ()),
    ("endurance", "Ten minutes of recording at 500 Hz with a busy core", ()),
)


def _add_bench(name: str, words: str, examples: tuple[str, ...]) -> None:
    @bench.command(
        name, context_settings=_RUN_ON, add_help_option=False, short_help=words, help=words
    )
    @click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
    def measure(arguments: tuple[str, ...]) -> None:
        from flexarm_bringup.check import run_bench  # noqa: PLC0415

        sys.exit(run_bench(name, arguments))

    lines = "\n".join(f"  flexarm bench {name} {example}" for example in ("", *examples))
    measure.help = f"{words}; --help lists the options.\n\n\b\nExamples:\n{lines}"


for _bench in _BENCHES:
    _add_bench(*_bench)


@main.command()
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
@_examples("doctor", "doctor --hardware", "doctor --hardware --device Dev2 --terminals diff")
def doctor(*, hardware: bool, sensors: str, rate: float, **names: Any) -> None:  # noqa: ANN401
    """Say what this environment consists of and whether nodes can talk."""
    if not hardware:
        from flexarm_bringup.doctor import examine  # noqa: PLC0415

        sys.exit(examine())
    from flexarm_bringup.hardware import examine_hardware  # noqa: PLC0415
    from flexarm_daq.nidaq_channels import NidaqSettings  # noqa: PLC0415

    sys.exit(examine_hardware(NidaqSettings(sensors=tuple(sensors.split()), rate_hz=rate, **names)))


def _exec_node(executable: str, parameters: dict[str, object]) -> None:
    from flexarm_bringup.processes import NodeProgram  # noqa: PLC0415

    command = NodeProgram("flexarm_daq", executable, parameters).command()
    os.execv(command[0], command)  # noqa: S606 - our own node
