"""The `flexarm` command: one verb per job, one-line errors, exit code 0 only on success."""

from __future__ import annotations

import os

import click

from flexarm_bringup.console.verb_group import LazyVerbGroup
from flexarm_core import __version__

# The matrices here are small: more threads of BLAS would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

GROUPS = {
    "Start": {
        "demo": "simulated.demo:demo",
        "doctor": "health.doctor:doctor",
        "rig": "health.rig:rig",
        "completion": "health.completion:completion",
    },
    "Measure": {
        "commission": "commissioning.commission:commission",
        "experiment": "laboratory.experiment:experiment",
        "catalogue": "laboratory.experiment:catalogue",
        "import": "offline.bags:import_",
        "bag": "offline.bags:bag",
    },
    "Model": {
        "identify": "offline.identify:identify",
        "report": "offline.identify:report",
    },
    "Control": {
        "tune": "offline.tune:tune",
        "design": "simulated.design:design",
        "learn": "simulated.learn:learn",
        "replay": "offline.replay:replay",
    },
    "Run the laboratory": {
        "up": "laboratory.up:up",
        "status": "laboratory.remote:status",
        "watch": "laboratory.remote:watch",
        "reference": "laboratory.remote:reference",
        "get": "laboratory.remote:get",
        "set": "laboratory.remote:set_",
        "stop": "laboratory.remote:stop",
        "deactivate": "laboratory.remote:deactivate",
        "activate": "laboratory.remote:activate",
        "record": "laboratory.programs:record",
        "play": "laboratory.programs:play",
        "run": "laboratory.programs:run",
        "exec": "checkout.handing_on:execute",
        "ros2": "checkout.handing_on:ros2",
    },
    "Work on the checkout": {
        "reproduce": "checkout.handing_on:reproduce",
        "bench": "checkout.bench:bench",
        "docs": "checkout.handing_on:docs",
        "test": "checkout.checks:test",
        "clean": "checkout.handing_on:clean",
    },
}
"""Verbs in the order of the help, by groups, and the function that each is."""

# Up to that many columns, help is as wide as the terminal.
_NAMES = {"help_option_names": ["-h", "--help"], "max_content_width": 120}


@click.group(cls=LazyVerbGroup, groups=GROUPS, context_settings=_NAMES)
@click.version_option(__version__, prog_name="flexarm")
def main() -> None:
    """Measure, model and control a flexible arm.

    FLEXARM_DEBUG=1 shows where an error comes from.
    """
