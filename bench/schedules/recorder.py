"""Process of the recorder: the real recording and bag writer, on a disk that may be full."""

from __future__ import annotations

import errno
import io
import math
import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from bench.schedules.messages import TOPICS, recorded_topics
from bench.schedules.processes import Killed, Process
from flexarm_bags.writer import BagWriter, RecordingError
from flexarm_daq.nodes.recording import Recording

if TYPE_CHECKING:
    from pathlib import Path
    from typing import BinaryIO

    from bench.schedules.messages import Raw
    from bench.schedules.world import World

_IDLE_S: Final = 0.1
_DRAIN_S: Final = 5.0
_QUIET_S: Final = 0.5
# A backlog is read in parts of what is left of it.
_PORTIONS: Final = 4
_LEAST_PORTION: Final = 8


class Disk:
    """Disk of one process.

    Attributes
    ----------
    free : float
        Bytes that it still takes.
    killed_at : float
        Share of the next write after which the process is killed; NaN: it lives.
    dead : bool
        True when the process is dead: what it still holds never comes.
    """

    def __init__(self) -> None:
        self.free = math.inf
        self.killed_at = math.nan
        self.dead = False

    def require_room(self) -> None:
        """Refuse whatever a full disk refuses."""
        if self.free <= 0.0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class _File(io.RawIOBase):
    """File on such a disk."""

    def __init__(self, path: Path, disk: Disk) -> None:
        super().__init__()
        self._file = path.open("xb", buffering=0)
        self._disk = disk

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._file.tell()

    def write(self, data: object) -> int:
        content = memoryview(data).cast("B")  # type: ignore[arg-type]
        disk = self._disk
        if disk.dead:
            return len(content)
        if disk.killed_at < 1.0:
            self._file.write(content[: int(disk.killed_at * len(content))])
            disk.dead = True
            raise Killed
        if content:
            disk.require_room()
        written = self._file.write(content[: int(min(disk.free, len(content)))])
        disk.free -= written
        return written

    def close(self) -> None:
        self._file.close()
        super().close()


class _Writer(BagWriter):
    """Bag writer on such a disk."""

    def __init__(self, path: Path, disk: Disk, world: World) -> None:
        self._disk = disk
        super().__init__(path, recorded_topics(), clock=world)

    def _create(self, file: Path) -> BinaryIO:
        return io.BufferedWriter(_File(file, self._disk))

    def _write_metadata(self) -> None:
        self._disk.require_room()
        super()._write_metadata()


@dataclass
class Ledger:
    """What a bag must hold.

    Attributes
    ----------
    path : Path
        The bag.
    handed : list of Raw and float
        Messages that the recorder received while it recorded, with the instants.
    end : str
        How the recording ended: closed, failed or killed.
    claim : str
        What the recorder said at the end.
    awake_s : float
        Last instant at which a recorder that was killed did some work.
    asked_s : float
        Instant at which a user asked for the end.
    before : int
        Messages that were handed before that.
    heard : list of Raw and float
        Messages that the process received before that, whether it recorded or not.
    wall_clock_holds : bool
        False when the wall clock was set while the bag was recorded.
    """

    path: Path
    handed: list[tuple[Raw, float]] = field(default_factory=list)
    end: str = "killed"
    claim: str = ""
    awake_s: float = 0.0
    asked_s: float = math.inf
    before: int = 0
    heard: list[tuple[Raw, float]] = field(default_factory=list)
    wall_clock_holds: bool = True


class Recorder(Process):
    """Node that records all topics; it opens a new bag whenever it starts.

    Parameters
    ----------
    world : World
        Its time.
    folder : Path
        Gets the bags.

    Attributes
    ----------
    ledgers : list of Ledger
        One per bag.
    disk : Disk
        Its disk.
    portion_s : float
        Time in which it reads a part of what has come while it stood still, s; 0: all at once.
    """

    def __init__(self, world: World, folder: Path) -> None:
        super().__init__(world)
        self.ledgers: list[Ledger] = []
        self.latched: Raw | None = None
        self.disk = Disk()
        self.portion_s = 0.0
        self._folder = folder
        self._bags = 0
        self._recording = Recording(TOPICS, TOPICS[:1], quiet_s=_QUIET_S)
        self._waiting: list[Raw] = []
        self._heard: list[tuple[Raw, float]] = []
        self._drain_until_s = math.inf
        self._woken_s = 0.0

    def start(self) -> None:
        """Start the process: it records at once."""
        free = self.disk.free
        self.alive, self.disk, self._waiting, self._heard = True, Disk(), [], []
        self.disk.free = free
        self.stalled_until_s, self.portion_s = -math.inf, 0.0
        self._recording = Recording(TOPICS, TOPICS[:1], quiet_s=_QUIET_S)
        self.open()
        if self.latched is not None:
            self.receive(self.latched)
        self.world.at(self.world.now_s + _IDLE_S, self._idle, self.disk)

    def open(self) -> None:
        """Begin a bag, if there is none."""
        if not self.alive or self._recording.writer is not None:
            return
        self._bags += 1
        path = self._folder / f"bag_{self._bags}"
        try:
            writer = _Writer(path, self.disk, self.world)
        except RecordingError:
            return
        except Killed:
            self._die()
            return
        self._recording.open(writer, self.world.wall_ns())
        self.ledgers.append(Ledger(path))

    def notice_wall_clock(self) -> None:
        """Note that the wall clock was set: it no longer tells what was sent before an end."""
        if self.ledgers:
            self.ledgers[-1].wall_clock_holds = False

    def kill(self, share: float = 0.0) -> None:
        """Kill the process, at once or within its next write to the disk."""
        if share:
            self.disk.killed_at = share
        elif self.alive:
            self._die()

    def receive(self, message: Raw) -> None:
        """Take a message: messages wait until the process runs."""
        if not self.alive:
            return
        if self.stalled or self._waiting:
            if not self._waiting:
                self.world.at(self.stalled_until_s, self._resume)
            self._waiting.append(message)
        else:
            self._work([message])

    def close(self) -> None:
        """Begin to end the bag, with what is on its way."""
        if self.stalled:
            self.world.at(self.stalled_until_s, self.close)
        elif self.alive and not self._recording.ending:
            self._recording.end(self.world.monotonic_ns())
            self._drain_until_s = self.world.now_s + _DRAIN_S
            if self._recording.ending:
                ledger = self.ledgers[-1]
                ledger.asked_s, ledger.before = self.world.now_s, len(ledger.handed)
                ledger.heard = list(self._heard)

    def _resume(self) -> None:
        if self.stalled:
            self.world.at(self.stalled_until_s, self._resume)
            return
        most = len(self._waiting)
        if self.portion_s:
            most = max(_LEAST_PORTION, math.ceil(most / _PORTIONS))
            self.world.at(self.world.now_s + self.portion_s, self._resume)
        messages, self._waiting = self._waiting[:most], self._waiting[most:]
        if self.alive and messages:
            self._work(messages)
        if not self._waiting:
            self.portion_s = 0.0

    def _idle(self, disk: Disk) -> None:
        """Wake up without a message."""
        if self.alive and disk is self.disk:
            if not self.stalled:
                self._work([])
            self.world.at(self.world.now_s + _IDLE_S, self._idle, disk)

    def _work(self, messages: list[Raw]) -> None:
        now_s, recording = self.world.now_s, self._recording
        received = [(message, now_s) for message in messages]
        if recording.writer is not None:
            self.ledgers[-1].handed += received
        try:
            if recording.ending:
                recording.finish(messages, self.world.monotonic_ns())
                self._finish_if_over()
            else:
                self._heard += received
                recording.take(messages, self.world.monotonic_ns())
            self._woken_s = now_s
        except RecordingError as error:
            self._note_end("failed", str(error))
        except Killed:
            self._die()

    def _finish_if_over(self) -> None:
        if self._recording.ending and self.world.now_s < self._drain_until_s:
            return
        if self._recording.writer is not None:
            # What it has not read is none the less there.
            self.ledgers[-1].handed += [(each, self.world.now_s) for each in self._waiting]
            self._note_end("closed", self._recording.close())

    def _note_end(self, end: str, claim: str) -> None:
        self.ledgers[-1].end, self.ledgers[-1].claim = end, claim

    def _die(self) -> None:
        self.alive, self.disk.dead = False, True
        if self._recording.writer is not None:
            self.ledgers[-1].awake_s = self._woken_s
