"""Rig on a double of a board, and a session with it."""

from __future__ import annotations

from typing import Any

from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.nidaq.terminals import NidaqSettings
from support.nidaq_board import Board
from support.nidaqmx_double import NidaqmxDouble

MAGNITUDE, DIRECTION = "Dev1/ao0", "Dev1/ao1"


def make(**options: Any) -> tuple[Board, NidaqmxDouble, NidaqRig]:  # noqa: ANN401
    board = Board()
    double = NidaqmxDouble(board)
    return board, double, NidaqRig(NidaqSettings(**options), nidaqmx=double)


def session(rig: NidaqRig) -> None:
    """Drive to and fro, as the sampling loop does."""
    try:
        rig.open()
        for k in range(12):
            rig.read()
            rig.write([-3.0 if k % 4 < 2 else 5.0])
    finally:
        rig.safe_stop()
        rig.close()
