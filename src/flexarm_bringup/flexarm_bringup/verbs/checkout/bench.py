"""Verb bench: flexarm measured beside its peers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE, RUN_ON, examples
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.checkout.folder import checkout, environment


@click.group()
def bench() -> None:
    """Measure flexarm beside its peers."""


# Name, what it measures, examples. Each is a file of the folder `bench`.
_BENCHES = (
    (
        "ident",
        "CPU time, memory and accuracy of the identification beside its peers",
        ("--quick", "--install-peers --seeds 5"),
    ),
    (
        "ident_bound",
        "Coloured noise: the methods beside the best that is possible",
        ("--seeds 20",),
    ),
    (
        "real",
        "Measured records of a folder: the default beside ARX, SLICOT and SIPPY",
        ("records --install-peers", "records --grid"),
    ),
    (
        "holes",
        "Models of records with lost samples beside the undamaged ones",
        ("--seeds 20", "--only bursts --seeds 5"),
    ),
    ("reduction", "Modal reduction on simulated C_dat3 and C_dat11", ("--seeds 20",)),
    ("rig", "Speed of the simulated rig in times real time", ("--json out/rig.json",)),
    ("bags", "Speed of reading bags beside rosbags", ("--seconds 600",)),
    ("verbs", "What a user waits for on the command line", ("--runs 11",)),
    (
        "loop",
        "The control loop over DDS beside C and a bare Python loop",
        ("--rate 300 --rate 500", "--minutes 10 --load"),
    ),
    (
        "live",
        "The live page: its cost to the loop, its drawing, STOP, verbs of another terminal",
        ("--quick", "--part stop --part verbs"),
    ),
    (
        "foxglove",
        "Samples of a running arm that reach a viewer of the Foxglove protocol",
        ("--seconds 300 --rate 500",),
    ),
    ("payload", "Payload detection, and gains that follow it", ("--seeds 20",)),
    (
        "control",
        "Trials of the laws, their cost, and the tuning time",
        ("--json out/control.json", "--peers"),
    ),
    (
        "shapers",
        "Reference shapers: residual vibration and settling time of each",
        ("--docs", "--law pdpc_scheduled --seeds 1"),
    ),
    (
        "laws",
        "All laws on payloads, set-points and rigs that differ from their design",
        ("--docs", "--law planned --law pdpc_plus --seeds 2 --variant nominal"),
    ),
    (
        "learning",
        "Learning of a command by repetition: what is left of the first run's differences",
        ("--docs", "--law pdpc --seeds 1"),
    ),
    (
        "robustness",
        "Tuned gains over a grid of payloads and on rigs drawn at random",
        ("--rigs 500 --spread 0.2",),
    ),
    (
        "servo",
        "design --track on arms in MuJoCo, drawn at random: steps beside those of the true model",
        ("--arms 12", "--arms 3 --first-seed 100"),
    ),
    (
        "mujoco",
        "The simulated rig beside the same arm in MuJoCo",
        ("--json out/mujoco.json",),
    ),
    (
        "tip",
        "Control of the tip of an arm in MuJoCo beside control of its hub",
        ("--json out/tip.json",),
    ),
    (
        "calibration",
        "Parameters of the study's rig beside the thesis's figures of all chapters",
        ("--docs", "--only noise_v --seeds 2"),
    ),
    ("faults", "The fault campaign: broken rigs, killed processes", ("--docs",)),
    (
        "schedules",
        "Seeded schedules of faults: the whole graph in virtual time, its invariants checked",
        ("--seeds 10000", "--seed 42", "--seeds 100000 --dask tcp://10.0.0.7:8786"),
    ),
    ("mutants", "Small defects planted in the code: which the tests notice", ("--docs",)),
    ("bag_faults", "Cut, flipped and mutated bags", ()),
    (
        "page_film",
        "Moving picture of the live page, from a real run",
        ("-o docs/images/page.webp --force",),
    ),
    (
        "report_picture",
        "Picture of the top of a report",
        ("out/identify/report.html -o docs/images/report.png --force",),
    ),
    (
        "endurance",
        "Ten minutes of recording with a busy core, or hours of memory",
        ("--hours 3 --page",),
    ),
)


_SPEED = {
    "verbs": (),
    "bags": ("--seconds", "600"),
    "rig": (),
    "ident": ("--seeds", "1"),
    "loop": ("--rate", "300", "--rate", "1000"),
}
"""What `bench all` runs, and its options."""


@bench.command("all")
@click.option(
    "--json",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the figures, one file for each.",
)
@FORCE
@examples("bench all", "bench all --json out/bench")
def every(folder: Path | None, *, force: bool) -> None:
    """Measure the speed of this machine, in some ten minutes.

    The benches of speed run one after the other: leave the machine alone for that while.
    """
    root, failed = checkout("benchmarks"), []
    for name, settings in _SPEED.items():
        kept = () if folder is None else ("--json", str(folder / f"{name}.json"))
        again = ("--force",) if force else ()
        terminal.step(f"bench {' '.join((name, *settings))}")
        if _measure(root, name, (*settings, *kept, *again)):
            failed.append(name)
    if failed:
        raise LaunchError(f"these benches failed, as they say above: {', '.join(failed)}")


def _measure(root: Path, name: str, arguments: tuple[str, ...]) -> int:
    """Run a bench, and return its exit code."""
    (file,) = root.glob(f"bench/*/{name}.py")
    command = [sys.executable, "-m", f"bench.{file.parent.name}.{name}", *arguments]
    done = subprocess.run(command, check=False, env=environment(root))  # noqa: S603 - our own
    return done.returncode


def _add_bench(name: str, words: str, calls: tuple[str, ...]) -> None:
    def measure(arguments: tuple[str, ...]) -> None:
        sys.exit(_measure(checkout("benchmarks"), name, arguments))

    measure.__doc__ = f"{words}; --help lists the options."
    verb = examples(*(f"bench {name} {call}".rstrip() for call in ("", *calls)))(measure)
    verb = click.argument("arguments", nargs=-1, type=click.UNPROCESSED)(verb)
    bench.command(name, context_settings=RUN_ON, add_help_option=False, short_help=words)(verb)


for _bench in _BENCHES:
    _add_bench(*_bench)
