"""System and devices of the double of `nidaqmx`."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from support.nidaqmx_values import TerminalConfiguration

if TYPE_CHECKING:
    from support.nidaq_board import Board
    from support.nidaqmx_double import NidaqmxDouble


class System:
    def __init__(self, double: NidaqmxDouble) -> None:
        self._double = double

    @property
    def driver_version(self) -> Any:  # noqa: ANN401 - a named tuple of the package
        self._double.call("system.driver_version")
        return SimpleNamespace(major_version=25, minor_version=3, update_version=0)

    @property
    def devices(self) -> list[Device]:
        self._double.call("system.devices")
        return [Device(self._double, name) for name in self._double.boards]


class Device:
    """As `nidaqmx.system.Device`."""

    def __init__(self, double: NidaqmxDouble, name: str) -> None:
        self._double = double
        self.name = name

    @property
    def _board(self) -> Board:
        self._double.call("system.device")
        return self._double.board_of(self.name)

    @property
    def product_type(self) -> str:
        assert self._board
        return "PCIe-6321"

    @property
    def is_simulated(self) -> bool:
        return self._board.name.startswith("Sim")

    @property
    def ai_physical_chans(self) -> list[Any]:
        board = self._board
        terminals = [TerminalConfiguration[name] for name in board.terminals]
        return [SimpleNamespace(name=name, ai_term_cfgs=terminals) for name in board.inputs]

    @property
    def ao_physical_chans(self) -> list[Any]:
        return [SimpleNamespace(name=name) for name in self._board.outputs_v]

    @property
    def ai_voltage_rngs(self) -> list[float]:
        return [-1.0, 1.0, -self._board.input_range_v, self._board.input_range_v]

    @property
    def ao_voltage_rngs(self) -> list[float]:
        return list(self._board.output_range_v)

    @property
    def ai_max_multi_chan_rate(self) -> float:
        return self._board.fastest_hz

    def reset_device(self) -> None:
        """Abort what runs and take every output to zero."""
        self._double.call("system.reset_device")
        board = self._board
        board.resets += 1
        board.holders.clear()
        for channel in board.outputs_v:
            board.put(channel, 0.0)
