"""The `flexarm` command: one verb per job, one-line errors, exit code 0 only on success."""

from __future__ import annotations

import os

import click

from flexarm_bringup.verbs import bags, checkout, graph, models, remote
from flexarm_bringup.verbs.verb import Verbs

# The matrices here are small: more threads of BLAS would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@click.group(cls=Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option("0.1.0", prog_name="flexarm")
def main() -> None:
    """Measure, model and control a flexible arm.

    FLEXARM_DEBUG=1 shows where an error comes from.
    """


for _verb in (
    graph.demo,
    graph.up,
    remote.status,
    remote.reference,
    remote.set_,
    remote.stop,
    remote.deactivate,
    remote.activate,
    graph.run,
    graph.execute,
    bags.import_,
    graph.experiment,
    graph.catalogue,
    models.identify,
    models.report,
    models.tune,
    models.reproduce,
    bags.play,
    bags.record,
    bags.bag,
    checkout.test,
    checkout.docs,
    checkout.bench,
    graph.doctor,
):
    main.add_command(_verb)
