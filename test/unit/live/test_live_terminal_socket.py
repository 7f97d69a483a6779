"""Unix socket of the terminal, and what a killed process leaves."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

import pytest

from flexarm_live.terminal_socket import connect, listen

if TYPE_CHECKING:
    from pathlib import Path


def test_socket___left_by_a_killed_process___is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    listen("/left").close()
    with listen("/left") as listening, connect("/left"):
        assert listening.family is socket.AF_UNIX
    with pytest.raises(OSError, match="refused"):
        connect("/left")
    with pytest.raises(FileNotFoundError):
        connect("/never")
