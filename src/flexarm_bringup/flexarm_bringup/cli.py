"""The `flexarm` command: one verb per job, one-line errors, exit code 0 only on success."""

from __future__ import annotations

import os

import click

from flexarm_bringup.console.verb_group import LazyVerbGroup

# The matrices here are small: more threads of BLAS would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

VERBS = {
    "demo": "laboratory.demo:demo",
    "design": "laboratory.design:design",
    "up": "laboratory.up:up",
    "status": "laboratory.remote:status",
    "reference": "laboratory.remote:reference",
    "set": "laboratory.remote:set_",
    "stop": "laboratory.remote:stop",
    "deactivate": "laboratory.remote:deactivate",
    "activate": "laboratory.remote:activate",
    "run": "laboratory.programs:run",
    "exec": "checkout.execute:execute",
    "ros2": "checkout.ros2:ros2",
    "import": "offline.bags:import_",
    "experiment": "laboratory.experiment:experiment",
    "catalogue": "laboratory.experiment:catalogue",
    "identify": "offline.identify:identify",
    "report": "offline.identify:report",
    "tune": "offline.tune:tune",
    "replay": "offline.replay:replay",
    "reproduce": "checkout.reproduce:reproduce",
    "play": "laboratory.programs:play",
    "record": "laboratory.programs:record",
    "bag": "offline.bags:bag",
    "test": "checkout.checks:test",
    "docs": "checkout.docs:docs",
    "bench": "checkout.bench:bench",
    "doctor": "health.doctor:doctor",
}
"""Verbs in the order of the help, and the function that each is."""


_NAMES = {"help_option_names": ["-h", "--help"]}


@click.group(cls=LazyVerbGroup, places=VERBS, context_settings=_NAMES)
@click.version_option("0.1.0", prog_name="flexarm")
def main() -> None:
    """Measure, model and control a flexible arm.

    FLEXARM_DEBUG=1 shows where an error comes from.
    """
