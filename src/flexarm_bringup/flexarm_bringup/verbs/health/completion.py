"""Verb completion: what a shell has to run so that it completes lines of flexarm."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from flexarm_bringup.console.verb_group import examples


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@examples(
    "completion bash >> ~/.bashrc",
    "completion zsh >> ~/.zshrc",
    "completion fish > ~/.config/fish/completions/flexarm.fish",
)
def completion(shell: str) -> None:
    """Print what completes lines in a shell.

    Verbs, options, experiments, laws, nodes, parameters and bags are completed.
    """
    made = get_completion_class(shell)
    if made is not None:
        root = click.get_current_context().find_root().command
        click.echo(made(root, {}, "flexarm", "_FLEXARM_COMPLETE").source())
