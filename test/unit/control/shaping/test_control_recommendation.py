"""Comparison of shapers against published figures and simulated motion."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control.shaping.shapers import (
    ACCELERATION_MM_S2,
    ALLOWED,
    PARTED,
    SeenMode,
    Vibration,
    compared_shapers,
    impulses,
    recommended,
    remaining_vibration,
    smoothing_mm,
)

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

HZ = np.arange(1.0, 200.0, 0.5)


def resonance(frequency_hz: float, damping_ratio: float) -> FloatArray:
    ratio = HZ / frequency_hz
    return np.asarray(1.0 / np.abs(1.0 - ratio**2 + 2j * damping_ratio * ratio) ** 2)


@pytest.mark.parametrize(
    ("name", "frequency_hz", "published_mm"),
    # As the guide of a firmware for printers prints them, at a damping ratio of 0.1.
    [
        ("zv", 34.4, 0.132),
        ("mzv", 34.6, 0.170),
        ("ei", 41.4, 0.188),
        ("2hump_ei", 51.8, 0.201),
        ("3hump_ei", 61.8, 0.215),
    ],
)
def test_smoothing___of_a_shaper___is_the_published_one(
    name: str, frequency_hz: float, published_mm: float
) -> None:
    found = impulses(name, Vibration(frequency_hz, 0.1))

    assert smoothing_mm(found, ACCELERATION_MM_S2) == pytest.approx(published_mm, abs=6e-4)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.05])
@pytest.mark.parametrize("name", PARTED)
def test_remaining_vibration___is_that_of_a_simulated_oscillator(
    name: str, damping_ratio: float
) -> None:
    found = impulses(name, Vibration(40.0, damping_ratio))
    hz = 44.0
    pole = 2.0 * np.pi * hz * complex(-damping_ratio, np.sqrt(1.0 - damping_ratio**2))
    dt_s = 1e-5
    state, ends = 0j, round(found.instants_s[-1] / dt_s)
    pushes = dict(zip(np.rint(found.instants_s / dt_s).astype(int), found.parts, strict=True))
    for sample in range(ends + 1):
        state = state * np.exp(pole * dt_s) + pushes.get(sample, 0.0)

    left = remaining_vibration(found, np.array([hz]), damping_ratio)
    assert left == pytest.approx(abs(state), abs=2e-3)


def test_shaper___of_one_sharp_mode___is_the_shortest() -> None:
    mode = SeenMode(Vibration(38.0, 0.05), 0.05, 1.0)
    best, _ = recommended(compared_shapers(HZ, resonance(38.0, 0.05), [mode]))

    assert best.name == "zv"
    assert best.vibration.frequency_hz == pytest.approx(38.0, rel=0.02)
    assert best.vibration_left <= ALLOWED


def test_shaper___of_two_modes_or_an_unsure_one___bears_more() -> None:
    sure = [SeenMode(Vibration(38.0, 0.05), 0.05, 1.0), SeenMode(Vibration(52.0, 0.05), 0.05, 0.8)]
    spectrum = resonance(38.0, 0.05) + resonance(52.0, 0.05)
    best, _ = recommended(compared_shapers(HZ, spectrum, sure))
    unsure = [SeenMode(Vibration(38.0, 0.05), 3.0, 1.0)]
    other, _ = recommended(compared_shapers(HZ, resonance(38.0, 0.05), unsure))

    assert best.name in {"ei", "2hump_ei", "3hump_ei"}
    assert other.name in {"mzv", "zvd", "ei"}
    assert max(best.vibration_left, other.vibration_left) <= ALLOWED


def test_acceleration___of_each_shaper___gives_the_allowed_smoothing() -> None:
    mode = SeenMode(Vibration(38.0, 0.05), 0.05, 1.0)
    for each in compared_shapers(HZ, resonance(38.0, 0.05), [mode]):
        found = impulses(each.name, each.vibration)
        assert smoothing_mm(found, each.largest_acceleration_mm_s2) == pytest.approx(0.12)


def test_shapers___that_all_leave_too_much___are_said_to() -> None:
    mode = SeenMode(Vibration(38.0, 0.05), 0.05, 1.0)
    compared = compared_shapers(HZ, resonance(38.0, 0.05), [mode])
    poor = [replace(each, remaining=0.3 - 0.01 * place) for place, each in enumerate(compared)]
    best, reason = recommended(poor)

    assert best == poor[-1]
    assert reason.startswith("it leaves least")
