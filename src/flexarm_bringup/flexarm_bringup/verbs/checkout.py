"""Verbs of a checkout: tests, pages, benchmarks."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from flexarm_bringup.verbs.verb import RUN_ON, examples


@click.command(context_settings=RUN_ON)
@click.option("--quick", is_flag=True, help="Lint, types and quick unit tests: three minutes.")
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
@examples("test", "test --quick", "test test/unit -k margins")
def test(arguments: tuple[str, ...], *, quick: bool) -> None:
    """Lint, check types and run the tests; with arguments, run pytest with them only."""
    from flexarm_bringup.checkout.check import check_everything  # noqa: PLC0415

    if quick and arguments:
        raise click.UsageError(
            f"--quick chooses the tests: leave out {' '.join(arguments)}, or leave out --quick and "
            'say -m "not slow"'
        )
    sys.exit(check_everything(arguments, quick=quick))


@click.command()
@click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/docs"),
    show_default=True,
    help="Folder of the site.",
)
@examples("docs")
def docs(out: Path) -> None:
    """Build the pages as a site that works offline, and run their examples."""
    from flexarm_bringup.checkout.docs import build_docs  # noqa: PLC0415

    sys.exit(build_docs(out))


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
        "holes",
        "Models of records with lost samples beside the undamaged ones",
        ("--seeds 20", "--only bursts --seeds 5"),
    ),
    ("reduction", "Modal reduction on simulated C_dat3 and C_dat11", ("--seeds 20",)),
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
        name, context_settings=RUN_ON, add_help_option=False, short_help=words, help=words
    )
    @click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
    def measure(arguments: tuple[str, ...]) -> None:
        from flexarm_bringup.checkout.check import run_bench  # noqa: PLC0415

        sys.exit(run_bench(name, arguments))

    lines = "\n".join(f"  flexarm bench {name} {example}" for example in ("", *examples))
    measure.help = f"{words}; --help lists the options.\n\n\b\nExamples:\n{lines}"


for _bench in _BENCHES:
    _add_bench(*_bench)
