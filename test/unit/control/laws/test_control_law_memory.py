"""Memory of every law: what is taken out and put into a fresh law goes on as the first would."""

from __future__ import annotations

import math

import pytest

from flexarm_control import LAWS, build_law
from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_control.laws.switching import Handover

RATE_HZ = 300.0
SAMPLES = 1200
TAKEN = 700
GAINS = {"ilqr": {"compensation_v": 0.7}, "lqg": {"strain_limit_v": 0.5}}
DRIVES = {2: DriveCommand(0.5, 0.1), 3: DriveCommand(0.0, 0.0)}
"""Commands in force that are not the answers: a limit, or nobody drives."""
HAVE_NONE = {"pd", "pdp", "pdpc", "pdpc_unconditional"}


def sample(k: int) -> tuple[float, float, float, float]:
    """Return outputs of an arm that turns to and fro, and for a while stands near 1 V, bent."""
    if 500 <= k < 900:
        # At the set-point first, then within the hysteresis of a rest.
        return (0.999 if k < 650 else 0.985, 0.03, 0.01, 0.0)
    phase = 2.0 * math.pi * 0.8 * k / RATE_HZ
    bend = math.sin(2.0 * math.pi * 2.7 * k / RATE_HZ)
    return (math.sin(phase), -0.9 * math.sin(phase) + 0.2 * bend, 0.1 * bend, math.cos(phase))


def reference_v(k: int) -> float:
    """Return the set-point of a sample."""
    return 1.0 if k >= 300 else -1.0


def answers(law: Handover, begin: int, end: int) -> list[tuple[float, float]]:
    """Return the answers to some samples."""
    return [law.step(sample(k), reference_v(k), DRIVES.get(k % 7)) for k in range(begin, end)]


def fresh(name: str) -> Handover:
    """Return a law before its first sample."""
    return Handover(build_law(name, GAINS.get(name)))


@pytest.mark.parametrize(("taken", "begun"), [(TAKEN, 0), (TAKEN, 3), (0, 3), (5, 0)])
@pytest.mark.parametrize("name", LAWS)
def test_law___with_the_memory_of_another___goes_on_as_that_one(
    name: str, taken: int, begun: int
) -> None:
    first = fresh(name)
    answers(first, 0, taken)
    memory = {group: list(numbers) for group, numbers in first.memory().items()}
    second = fresh(name)
    answers(second, 0, begun)

    second.remember(memory)

    assert {group: list(numbers) for group, numbers in second.memory().items()} == memory
    # One program on one machine: the same bits, which is what a replay rests on.
    assert answers(second, taken, SAMPLES) == answers(first, taken, SAMPLES)


@pytest.mark.parametrize("name", sorted(LAWS.keys() - HAVE_NONE))
def test_law___that_forgets_a_group_of_its_memory___answers_otherwise(name: str) -> None:
    first = fresh(name)
    answers(first, 0, TAKEN)
    memory = first.memory()
    forgetful = fresh(name)
    expected = answers(first, TAKEN, SAMPLES)

    assert len(memory) > 1
    assert answers(forgetful, TAKEN, SAMPLES) != expected


def test_handover___with_the_memory_of_another___fades_on() -> None:
    first = fresh("pd")
    answers(first, 0, 50)
    first.replace(build_law("pdp"))
    answers(first, 50, 53)
    second = fresh("pdp")

    second.remember(first.memory())

    assert first.memory()["handover"][1] != 0.0
    assert answers(second, 53, 120) == answers(first, 53, 120)


def test_handover___recorded_between_two_laws___fades_from_the_command_in_force() -> None:
    first = fresh("pd")
    answers(first, 0, 50)
    first.replace(build_law("pdp"))
    second = fresh("pdp")

    second.remember(first.memory())

    assert answers(second, 50, 120) == answers(first, 50, 120)
