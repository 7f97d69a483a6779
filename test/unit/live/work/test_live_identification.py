"""What a page is told of the modes of a model."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident.models.modes import Mode
from flexarm_live.work.identification import compared, identified, kind_of
from support.html_page import Page
from support.recurring_modes import NEIGHBOURS

if TYPE_CHECKING:
    from pathlib import Path


def pair(frequency_hz: float, damping_ratio: float) -> Mode:
    """Return a pair of any model: its place counts."""
    return Mode(0.9 + 0.1j, frequency_hz, damping_ratio, (0, 1), 1.0, 1.0, 1, 1)


@pytest.mark.parametrize(
    ("frequency_hz", "damping_ratio", "kind"),
    [
        (9.1, 0.02, "physical"),
        (43.3, 0.02, "split"),
        (45.3, 0.02, "split"),
        (50.0, 0.01, "noise"),
        (70.0, 0.01, "rare"),
        (70.0, 0.9, "damped"),
    ],
)
def test_kind_of_a_mode___is_that_of_the_report(
    frequency_hz: float, damping_ratio: float, kind: str
) -> None:
    assert kind_of(pair(frequency_hz, damping_ratio), NEIGHBOURS) == kind


DT_S, HZ, DAMPING = 0.01, 5.0, 0.02
SIGNALS = {"inputs": ["drive_v=drive"], "outputs": ["tip_rad=tip"], "times": []}


def log_of_an_oscillator(file: Path) -> None:
    """Write a log of an oscillator that random steps drive."""
    dt_s, hz, damping = DT_S, HZ, DAMPING
    pole = np.exp(2.0 * math.pi * hz * dt_s * (-damping + 1j * math.sqrt(1.0 - damping**2)))
    random = np.random.default_rng(5)
    u = random.choice([-1.0, 1.0], 1500)
    y = np.zeros(1500)
    for k in range(2, 1500):
        y[k] = 2.0 * pole.real * y[k - 1] - abs(pole) ** 2 * y[k - 2] + u[k - 1]
    y += 1e-3 * random.standard_normal(1500)
    rows = zip(dt_s * np.arange(1500), u, y, strict=True)
    file.write_text("time,drive,tip\n" + "".join(f"{t:.2f},{a:g},{b:.6f}\n" for t, a, b in rows))


def test_csv_file___with_named_signals___has_the_mode_of_its_oscillator___and_is_compared(
    tmp_path: Path,
) -> None:
    file, folder, page = (tmp_path / name for name in ("log.csv", "second", "page.html"))
    log_of_an_oscillator(file)
    asked = {"bag": str(file), "signals": SIGNALS, "request": {"method": "auto", "order": 2}}
    shown = identified(asked | {"folder": str(folder), "about": {}}, lambda *_: None)
    assert shown["outputs"] == ["tip_rad"]
    (mode,) = shown["modes"]
    assert mode["frequency_hz"] == pytest.approx(HZ, rel=1e-3)
    assert mode["damping"] == pytest.approx(DAMPING, rel=0.05)
    fourth = asked | {"request": {"order": 4}, "others": [str(folder)], "page": str(page)}
    compared(fourth, lambda *_: None)
    text = " ".join(Page(page.read_text("utf-8")).text.split())
    assert "2 models on 1 record. On log.csv, " in text
