from __future__ import annotations

import io
import shlex
from math import exp, nan
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from rich.console import Console

from flexarm_bringup.console import terminal
from flexarm_bringup.console.terminal import (
    fit_table,
    friction_table,
    mode_table,
    progress_bar,
)

if TYPE_CHECKING:
    from pathlib import Path

    import pytest
    from rich.table import Table


def cells(table: Table) -> list[tuple[str, ...]]:
    """Return the rows of a table."""
    return list(zip(*(column.cells for column in table.columns), strict=True))


def mode(
    frequency_hz: float, mrm_rank: int, *, kept: bool, eigenvalue: complex = 0.9 + 0.1j
) -> Any:  # noqa: ANN401 - a double
    weights = {"mrm": 0.5, "mrm_rank": mrm_rank, "msv": 2.0, "msv_rank": 1}
    return SimpleNamespace(
        eigenvalue=eigenvalue,
        frequency_hz=frequency_hz,
        damping_ratio=0.05,
        kept=kept,
        **weights,
    )


def test_mode_table___modes___stand_by_their_mrm_rank() -> None:
    slow = mode(0.0, 1, kept=True, eigenvalue=complex(exp(-0.01 / 0.62)))
    growing = mode(0.0, 3, kept=True, eigenvalue=complex(1.01))
    rows = cells(mode_table([mode(9.4, 2, kept=False), growing, slow], dt_s=0.01))
    assert rows == [
        ("0.62 s", "0.0500", "0.5", "1", "2", "1", "yes"),
        ("9.400", "0.0500", "0.5", "2", "2", "1", ""),
        ("grows, 1 s", "0.0500", "0.5", "3", "2", "1", "yes"),
    ]


def test_mode_table___deviations___stand_by_their_frequencies() -> None:
    slow = mode(0.0, 1, kept=True, eigenvalue=complex(exp(-0.01 / 0.62)))
    found = mode_table(
        [mode(9.4, 3, kept=True), slow, mode(24.0, 2, kept=True)], 0.01, [0.05, 1, 2]
    )
    assert [row[0] for row in cells(found)] == ["0.62 s", "24.0 ± 2.0", "9.400 ± 0.050"]


def test_fit_table___errors___are_fits_beside_the_mean_error() -> None:
    rows = cells(fit_table(["position_v"], [("DMV", [0.25, 0.125])]))
    assert rows == [("DMV", "75.0", "87.5", "0.1250")]


def test_show_table___narrow_terminal___prints_every_name_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown = io.StringIO()
    monkeypatch.setattr(terminal, "CONSOLE", Console(file=shown, width=40))
    names = [f"acceleration_of_the_wing_{number}" for number in range(5)]
    terminal.show_table(fit_table(names, [("DMV", [0.25] * 6)]))
    assert all(name in shown.getvalue() for name in names)


def test_fit_table___output_without_an_error___has_a_dash() -> None:
    rows = cells(fit_table(["position_v", "gauge_v"], [("DMV", [0.25, nan, 0.25])]))
    assert rows == [("DMV", "75.0", "-", "75.0", "0.2500")]


def test_friction_table___levels___have_their_scatter_and_unit() -> None:
    parameters = {
        "models.arm.input_names": ["current1_a"],
        "models.arm.friction_level": [0.15],
        "models.arm.friction_level_std": [0.01],
        "models.arm.friction_offset": [0.0],
        "models.arm.friction_offset_std": [0.002],
    }
    levels = ("current1_a", "0.150 ± 0.010", "0.0000 ± 0.0020")
    assert cells(friction_table(parameters)) == [(*levels, "A")]
    assert friction_table({"models.arm.dt": 0.01}).row_count == 0
    parameters |= {
        "models.arm.friction_rise": [0.2],
        "models.arm.friction_rise_std": [0.05],
        "models.arm.friction_load": [0.0],
        "models.arm.friction_load_std": [0.0],
    }
    assert cells(friction_table(parameters)) == [(*levels, "0.200 ± 0.050", "-", "A")]


def test_progress_bar___without_a_terminal___prints_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress_bar("recording", 40) as show:
        for done in range(13):
            show(done)
    assert capsys.readouterr().out == "  recording\n"


def test_progress___without_a_terminal___prints_a_line_for_each_stage(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with terminal.progress() as show:
        for text, done in (("reading", 0.0), ("fit", 0.2), ("fit", 0.6), ("writing", 0.9)):
            show(text, done)
    assert capsys.readouterr().out.splitlines() == ["  reading", "  fit", "  writing"]


def test_note___on_a_narrow_terminal___hangs_below_its_first_words(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page = io.StringIO()
    narrow = Console(file=page, width=30, force_terminal=True, color_system=None)
    monkeypatch.setattr(terminal, "CONSOLE", narrow)
    terminal.note("caution: run1: speed_v stands still in the last tenth")
    lines = page.getvalue().splitlines()
    assert [line[:4].isspace() for line in lines] == [False, *(True for _ in lines[1:])]
    assert all(len(line) <= 30 for line in lines)
    assert " ".join(page.getvalue().split()).startswith("caution: run1: speed_v stands still")


def test_names_with_brackets___are_printed_as_they_are() -> None:
    with terminal.CONSOLE.capture() as shown:
        terminal.CONSOLE.print("order 4, results in out/run [a]")
        rows = [("DMV", [0.1, 0.2, 0.3])]
        terminal.CONSOLE.print(fit_table(["pos [/s]", "x_1 [mm]"], rows))
        terminal.step("begin [bold]")
        terminal.marked("ok", "green", "  a [/red] name")
    for name in ("run [a]", "pos [/s]", "x_1 [mm]", "begin [bold]", "ok  a [/red] name"):
        assert name in shown.get()


def test_next_step___path_with_a_space___is_quoted(tmp_path: Path) -> None:
    assert shlex.split(f"flexarm identify {terminal.quoted(tmp_path / 'my bag')}") == [
        "flexarm",
        "identify",
        str(tmp_path / "my bag"),
    ]
