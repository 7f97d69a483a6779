"""Tests of the verb import."""

from __future__ import annotations

from typing import TYPE_CHECKING

from click.testing import CliRunner

from flexarm_bringup.cli import main

if TYPE_CHECKING:
    from pathlib import Path

MAP = "time: t\ninputs: [{column: u}]\noutputs: [{column: y}]\n"


def test_import___table_with_holes___says_how_many(tmp_path: Path) -> None:
    (tmp_path / "columns.yaml").write_text(MAP)
    rows = [f"{k},{k % 3},{k if k not in (0, 4) else ''}" for k in range(21) if k not in (7, 8)]
    (tmp_path / "run.csv").write_text("\n".join(["t,u,y", *rows]))
    words = ["import", str(tmp_path / "run.csv"), "--map", str(tmp_path / "columns.yaml")]
    done = CliRunner().invoke(main, [*words, "-o", str(tmp_path / "bag")], prog_name="flexarm")
    assert done.exit_code == 0
    assert done.stdout.splitlines()[:3] == [
        f"  {tmp_path / 'run.csv'}: line 2 is left out: y has no value there yet",
        f"{tmp_path / 'bag'}: 18 samples at 1 Hz, 19.00 s",
        "  note: 2 rows and 1 cell are missing: holes of the record",
    ]
