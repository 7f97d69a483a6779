"""Double of the part of `nidaqmx` that flexarm uses, on boards of `nidaq_board`.

It keeps the rules that the package and its driver have: names must exist, a channel belongs to one
running task, a task is used up by `close`, samples come by the board's clock and are lost when the
buffer is full, an output keeps its voltage when its task ends. Every call can be made to fail.
"""

from __future__ import annotations

from collections import Counter, deque
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from support.nidaqmx_system import Device, System
from support.nidaqmx_values import (
    NOT_SUPPORTED,
    OUT_OF_RANGE,
    OVERRUN,
    REMOVED,
    RESERVED,
    TASK_GONE,
    TIMEOUT,
    UNKNOWN_CHANNEL,
    UNKNOWN_DEVICE,
    AcquisitionType,
    DaqError,
    DaqNotFoundError,
    DaqNotSupportedError,
    Edge,
    Error,
    Fault,
    TerminalConfiguration,
    VoltageUnits,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from support.nidaq_board import Board

_SENSORS = 4


class NidaqmxDouble:
    """Double of the module `nidaqmx`."""

    def __init__(self, *boards: Board) -> None:
        self.boards = {board.name: board for board in boards}
        self.has_driver = True
        self.removed = False
        self.faults: list[Fault] = []
        self.calls: Counter[str] = Counter()
        self.tasks: list[Task] = []
        self.Task = partial(Task, double=self)
        self.constants = SimpleNamespace(
            TerminalConfiguration=TerminalConfiguration, AcquisitionType=AcquisitionType
        )
        self.errors = SimpleNamespace(
            Error=Error,
            DaqError=DaqError,
            DaqNotFoundError=DaqNotFoundError,
            DaqNotSupportedError=DaqNotSupportedError,
        )
        self.stream_readers = SimpleNamespace(AnalogMultiChannelReader=AnalogMultiChannelReader)
        self.stream_writers = SimpleNamespace(AnalogSingleChannelWriter=AnalogSingleChannelWriter)
        self.system = SimpleNamespace(
            System=SimpleNamespace(local=lambda: System(self)),
            Device=lambda name: Device(self, name),
        )

    def board_of(self, path: str, channels: list[str] | None = None) -> Board:
        """Return the board of a channel, or the error of the driver."""
        board = self.boards.get(path.partition("/")[0])
        if board is None:
            raise DaqError("Device identifier is invalid.", UNKNOWN_DEVICE)
        if channels is not None and path not in channels:
            raise DaqError(
                "Physical channel specified does not exist on this device.", UNKNOWN_CHANNEL
            )
        return board

    def call(self, site: str) -> None:
        """Note a call, and fail if it is to fail."""
        if not self.has_driver:
            raise DaqNotFoundError("Could not find an installation of NI-DAQmx.")
        self.calls[site] += 1
        if self.removed:
            raise DaqError("Device cannot be accessed.\nPossible causes:", REMOVED)
        number = self.calls[site]
        for fault in self.faults:
            if fault.site == site and fault.at <= number < fault.at + fault.times:
                raise DaqError("The fault of this test.\nMore of it.", fault.code)


class Task:
    """As `nidaqmx.Task`: channels of one kind, and a clock for inputs."""

    def __init__(self, new_task_name: str = "", *, double: NidaqmxDouble) -> None:
        double.call("Task")
        double.tasks.append(self)
        self.name = new_task_name or f"_unnamedTask<{len(double.tasks)}>"
        self.double = double
        self.board: Board | None = None
        self.channels: list[str] = []
        self.kind = ""
        self.started = False
        self.closed = False
        self.ai_channels = SimpleNamespace(add_ai_voltage_chan=self._add_ai_voltage_chan)
        self.ao_channels = SimpleNamespace(add_ao_voltage_chan=self._add_ao_voltage_chan)
        self.timing = _Timing(self)
        self.in_stream = _InStream(self)
        self.out_stream = self
        self.range_v = (0.0, 0.0)

    def call(self, what: str) -> None:
        """Note a call of this task."""
        if self.closed:
            raise DaqError("Specified task is not valid.", TASK_GONE, self.name)
        self.double.call(f"{self.kind}.{what}")

    def start(self) -> None:
        """Take hold of the channels and begin."""
        self.call("start")
        assert self.board is not None
        holders = self.board.holders
        resources = ["ai"] if self.kind == "ai" else self.channels
        for resource in resources:
            if holders.get(resource, self) is not self:
                raise DaqError("The specified resource is reserved.", RESERVED, self.name)
        holders.update(dict.fromkeys(resources, self))
        self.started = True
        self.in_stream.begin()

    def close(self) -> None:
        """Give the channels back; outputs keep their voltage."""
        if self.closed:
            raise AssertionError("the package warns of a task that is closed twice")
        if self.board is not None:
            for resource in [key for key, task in self.board.holders.items() if task is self]:
                del self.board.holders[resource]
        try:
            self.call("close")
        finally:
            self.closed = True

    def _add_ai_voltage_chan(  # noqa: PLR0917 - as the package has it
        self,
        physical_channel: str,
        name_to_assign_to_channel: str = "",  # noqa: ARG002
        terminal_config: TerminalConfiguration = TerminalConfiguration.DEFAULT,
        min_val: float = -5.0,
        max_val: float = 5.0,
        units: VoltageUnits = VoltageUnits.VOLTS,  # noqa: ARG002
        custom_scale_name: str = "",  # noqa: ARG002
    ) -> None:
        self.kind = "ai"
        self.call("add_ai_voltage_chan")
        board = self.double.board_of(physical_channel)
        readback = [f"{board.name}/_ao{n}_vs_aognd" for n in (0, 1)] if board.has_readback else []
        self.board = self.double.board_of(physical_channel, board.inputs + readback)
        if terminal_config.name not in (*board.terminals, "DEFAULT"):
            raise DaqError("Requested value is not a supported value.", NOT_SUPPORTED)
        if not -board.input_range_v <= min_val < max_val <= board.input_range_v:
            raise DaqError("Requested value is not a supported value.", NOT_SUPPORTED)
        self.channels.append(physical_channel)

    def _add_ao_voltage_chan(  # noqa: PLR0917
        self,
        physical_channel: str,
        name_to_assign_to_channel: str = "",  # noqa: ARG002
        min_val: float = -10.0,
        max_val: float = 10.0,
        units: VoltageUnits = VoltageUnits.VOLTS,  # noqa: ARG002
        custom_scale_name: str = "",  # noqa: ARG002
    ) -> None:
        self.kind = "ao"
        self.call("add_ao_voltage_chan")
        board = self.double.board_of(physical_channel)
        self.board = self.double.board_of(physical_channel, list(board.outputs_v))
        low_v, high_v = board.output_range_v
        if not low_v <= min_val < max_val <= high_v:
            raise DaqError("Requested value is not a supported value.", NOT_SUPPORTED)
        self.range_v = (min_val, max_val)
        self.channels.append(physical_channel)


class _Timing:
    def __init__(self, task: Task) -> None:
        self._task = task
        self.rate_hz = 0.0
        self.buffer = 0

    @property
    def samp_clk_rate(self) -> float:
        self._task.call("samp_clk_rate")
        return self.rate_hz

    def cfg_samp_clk_timing(
        self,
        rate: float,
        source: str = "",  # noqa: ARG002
        active_edge: Edge = Edge.RISING,  # noqa: ARG002
        sample_mode: AcquisitionType = AcquisitionType.FINITE,
        samps_per_chan: int = 1000,
    ) -> None:
        self._task.call("cfg_samp_clk_timing")
        board = self._task.board
        assert board is not None
        assert sample_mode is AcquisitionType.CONTINUOUS
        if rate * len(self._task.channels) > board.fastest_hz:
            raise DaqError("Sample rate, number of channels do not go together.", -200081)
        # The clock is 20 MHz divided by a whole number.
        self.rate_hz = 20e6 / round(20e6 / rate)
        self.buffer = samps_per_chan


class _InStream:
    """The samples that the board has taken and nobody has read."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self._unread: deque[NDArray[np.float64]] = deque()
        self._taken = 0
        self._overrun = False
        self._started_s = 0.0

    @property
    def num_chans(self) -> int:
        return len(self.task.channels)

    @property
    def avail_samp_per_chan(self) -> int:
        self.task.call("avail_samp_per_chan")
        self.sample_until_now()
        return len(self._unread)

    def begin(self) -> None:
        assert self.task.board is not None
        self._started_s = self.task.board.clock()

    def sample_until_now(self) -> None:
        """Take the samples that are due, each at its own time."""
        board = self.task.board
        assert board is not None
        timing = self.task.timing
        if self.task.started and timing.rate_hz > 0.0:
            while self.due_s <= board.clock():
                board.advance(self.due_s)
                self._unread.append(self._sample(board))
                self._taken += 1
            if len(self._unread) > timing.buffer:
                self._overrun = True
        board.advance(board.clock())

    def next(self, timeout_s: float) -> NDArray[np.float64]:
        """Wait for a sample."""
        board = self.task.board
        assert board is not None
        self.sample_until_now()
        if not self.task.timing.rate_hz:
            return self._sample(board)
        if self._overrun:
            raise DaqError("The application is not able to keep up.", OVERRUN, self.task.name)
        until_s = board.clock() + timeout_s
        if not self._unread:
            wait_s = min(self.due_s, until_s) - board.clock()
            # Rounding of a sum must not leave the clock just before the sample.
            board.clock.sleep(wait_s + 1e-9)
            self.sample_until_now()
        if not self._unread:
            raise DaqError("Some or all of the samples are not yet there.", TIMEOUT, self.task.name)
        return self._unread.popleft()

    @property
    def due_s(self) -> float:
        return self._started_s + self._taken / self.task.timing.rate_hz

    def _sample(self, board: Board) -> NDArray[np.float64]:
        if "_vs_aognd" in self.task.channels[0]:
            names = [name.replace("_vs_aognd", "").replace("_", "") for name in self.task.channels]
            return np.array([board.outputs_v[name] for name in names])
        volts = board.sample()
        order = [int(name.partition("/ai")[2]) for name in self.task.channels]
        return np.array([volts[number] if number < _SENSORS else 0.0 for number in order])


class AnalogMultiChannelReader:
    """As in `nidaqmx.stream_readers`."""

    def __init__(self, task_in_stream: _InStream) -> None:
        self._in_stream = task_in_stream
        self.verify_array_shape = True

    def read_one_sample(self, data: NDArray[np.float64], timeout: float = 10) -> None:
        """Wait for one sample of every channel."""
        self._in_stream.task.call("read_one_sample")
        assert data.shape == (self._in_stream.num_chans,)
        data[:] = self._in_stream.next(timeout)


class AnalogSingleChannelWriter:
    """As in `nidaqmx.stream_writers`."""

    def __init__(self, task_out_stream: Task, auto_start: bool = True) -> None:  # noqa: FBT001, FBT002
        self._task = task_out_stream
        self._auto_start = auto_start

    def write_one_sample(self, data: float, timeout: float = 10) -> None:  # noqa: ARG002
        """Put a voltage on the output."""
        task = self._task
        task.call("write_one_sample")
        assert task.board is not None
        if not task.started and not self._auto_start:
            raise DaqError("The task is not started.", -200846, task.name)
        if not task.range_v[0] <= data <= task.range_v[1]:
            raise DaqError("A value to be written is out of range.", OUT_OF_RANGE, task.name)
        for other in task.double.tasks:
            if other.board is task.board and other.kind == "ai" and not other.closed:
                other.in_stream.sample_until_now()
        (channel,) = task.channels
        task.board.put(channel, float(data))
