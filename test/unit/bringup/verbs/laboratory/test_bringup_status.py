from __future__ import annotations

from typing import TYPE_CHECKING

from click.testing import CliRunner

from flexarm_bringup.verbs.laboratory import remote

if TYPE_CHECKING:
    import pytest


class Arm:
    """Arm at an arm whose DAQ node has reported."""

    def reports(self) -> dict[str, tuple[str, dict[str, str]]]:
        values = {"held after s": "", "rate Hz": "300.1", "off rate": "", "late p50 ms": "nan"}
        return {"daq": ("active", {**values, "late histogram": "0 3 4 0"})}

    def page(self) -> str:
        return ""


def test_status___figures_without_a_value_or_a_meaning_as_text___are_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(remote, "through", lambda _, ask: ask(Arm()))
    done = CliRunner().invoke(remote.status)
    lines = [line.split() for line in done.output.splitlines()]
    assert lines == [["daq:", "active"], ["rate", "Hz", "300.1"], ["late", "p50", "ms", "-"]]
