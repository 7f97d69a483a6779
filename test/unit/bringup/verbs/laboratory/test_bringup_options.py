from __future__ import annotations

import click
import pytest
from click.testing import CliRunner
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.verbs.laboratory.options import ARM
from flexarm_bringup.verbs.laboratory.options import chosen_pace as chosen

NAMESPACES = ("arm2", "lab/arm2", "_a", "a__b", "2arm", "a/2", "a//b", "a-b", "a b", "ä", "~a", "")


def test_options___choose_a_pace_and_exclude_each_other() -> None:
    assert chosen() is Pace.WALL_CLOCK
    assert chosen(fast=True) is Pace.FAST
    assert chosen(real_time=True) is Pace.REAL
    with pytest.raises(click.UsageError, match="exclude each other"):
        chosen(fast=True, real_time=True)


def is_valid(namespace: str) -> bool:
    """Return whether rclpy takes a namespace."""
    try:
        validate_namespace(namespace)
    except InvalidNamespaceException:
        return False
    return True


@pytest.mark.parametrize("text", [*NAMESPACES, 244 * "a", 245 * "a"])
def test_namespace___is_taken___where_ros_takes_it(text: str) -> None:
    @click.command()
    @ARM
    def verb(namespace: str) -> None:
        click.echo(namespace)

    done = CliRunner().invoke(verb, ["--namespace", text])
    assert (done.exit_code == 0) == (bool(text) and is_valid(f"/{text}"))
