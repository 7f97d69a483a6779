"""Verb clean: the script at the root does it, since an environment cannot remove itself."""

from __future__ import annotations

import click

from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.verbs.checkout.folder import checkout


@click.command()
@examples("clean")
def clean() -> None:
    """Remove the environment and the build.

    Bags, models and results stay.
    """
    root = checkout("set-up")
    raise click.ClickException(
        f"this shell is inside the environment, which cannot remove itself: leave it, then call "
        f"{root / 'flexarm'} clean"
    )
