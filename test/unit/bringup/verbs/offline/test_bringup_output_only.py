"""The option --output-only of identify, in this process."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy
from click.testing import CliRunner

from flexarm_bringup.cli import main

if TYPE_CHECKING:
    from pathlib import Path

RATE_HZ = 200.0


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Log of an axis with a mode at 6 Hz and a damping ratio of 0.03, and of one with noise."""
    rng = np.random.default_rng(0)
    pole = np.exp(2.0 * np.pi * 6.0 / RATE_HZ * complex(-0.03, np.sqrt(1.0 - 0.03**2)))
    denominator = [1.0, -2.0 * pole.real, abs(pole) ** 2]
    y = scipy.signal.lfilter([1.0], denominator, rng.standard_normal(12000))
    columns = np.arange(12000) / RATE_HZ, y, rng.standard_normal(12000)
    path = tmp_path / "log.csv"
    header = "time,accel_x,accel_y"
    np.savetxt(path, np.column_stack(columns), "%.6f", ",", header=header, comments="")
    return path


def reported(*arguments: object) -> str:
    result = CliRunner().invoke(main, ["identify", *map(str, arguments)])
    return f"{result.output}{result.exception or ''}"


def test_identify___of_outputs_alone___prints_modes_and_shapers_and_writes_them(
    log: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    text = reported(log, "--output-only", "-o", out)
    found = json.loads((out / "modes.json").read_text())
    (mode,) = found["modes"]
    (shapers,) = found["shapers"]

    assert abs(mode["frequency_hz"] - 6.0) < 3.0 * mode["frequency_std_hz"] < 0.3
    assert "1 mode from outputs alone" in text
    assert "Not known without an input: gains" in text
    assert f"shaper_type_x: {shapers['recommended']}" in text
    assert "shaper_type_y" not in text
    assert len(shapers["shapers"]) == 6
    assert "Input shapers of accel_x" in (out / "report.html").read_text()


def test_identify___of_noise_alone___says_that_there_is_no_mode(log: Path, tmp_path: Path) -> None:
    text = reported(log, "--output-only", "--output", "accel_y", "-o", tmp_path / "out")

    assert "no mode: no resonance stands out of the noise" in text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--output", "accel_x"], "modes alone need no input: --output-only"),
        ([], "modes alone need no input: --output-only"),
        (["--output-only", "--input", "accel_x"], "--output-only takes no --input"),
        (["--output-only", "--each"], "makes no model"),
        (["--output-only", "--order", "4"], "makes no model: leave out the options of one"),
        (["--output-only", "--reduction", "mrm"], "makes no model: leave out the options of one"),
    ],
)
def test_identify___of_a_log_without_an_input___names_the_way(
    log: Path, tmp_path: Path, options: list[str], words: str
) -> None:
    assert words in reported(log, *options, "-o", tmp_path / "out")


def test_identify___of_outputs_alone___leaves_files_of_others(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "modes.json").write_text("{}")

    assert "was not written by flexarm" in reported(log, "--output-only", "-o", out)
    assert (out / "modes.json").read_text() == "{}"
