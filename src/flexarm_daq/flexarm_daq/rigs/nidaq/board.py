"""Rig behind a National Instruments board, sampled by its clock."""

from __future__ import annotations

import atexit
import math
from typing import TYPE_CHECKING, ClassVar

from flexarm_daq.rigs.nidaq.driver import load_nidaqmx
from flexarm_daq.rigs.nidaq.terminals import Drive, NidaqSettings, Sensors
from flexarm_daq.rigs.rig_protocol import DriveNotStoppedError, RigError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_daq.rigs.nidaq.driver import Nidaqmx
    from flexarm_daq.rigs.rig_protocol import RigSample


class NidaqRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig` on a board of National Instruments.

    The voltages are the thesis's channels without conversion; `flexarm_core.channels` has their
    scale. After any failure the magnitude is set to zero before the error goes on: by the running
    task, else by a new one, else by a reset of the board. The same happens when the interpreter
    ends with the rig open.

    Parameters
    ----------
    settings : NidaqSettings, optional
        Terminals of the rig; by default as in section 2.3.
    nidaqmx : Nidaqmx, optional
        Driver package; `open` imports it if it is not given.
    """

    has_own_clock: ClassVar[bool] = True

    def __init__(
        self, settings: NidaqSettings | None = None, *, nidaqmx: Nidaqmx | None = None
    ) -> None:
        self.settings = settings if settings is not None else NidaqSettings()
        self._nidaqmx = nidaqmx
        self._parts: tuple[Sensors, Drive] | None = None

    def open(self) -> None:
        """Set the drive to zero and start the sampling, unless it is open; see `Rig.open`."""
        if self._parts is not None:
            return
        nidaqmx = self._nidaqmx if self._nidaqmx is not None else load_nidaqmx()
        sensors, drive = Sensors(nidaqmx, self.settings), Drive(nidaqmx, self.settings)
        self._parts = sensors, drive
        atexit.register(self.safe_stop)
        try:
            drive.open()
            sensors.open()
        except BaseException:
            self.close()
            raise

    def read(self) -> RigSample:
        """Wait for the newest sample of the board, at most three periods; see `Rig.read`."""
        sensors, _ = self._opened()
        try:
            return sensors.read()
        except BaseException:
            self.safe_stop()
            raise

    def write(self, commands: Sequence[float]) -> None:
        """Command the drive, clipped beyond 10 V; see `Rig.write`."""
        (command_v,) = commands
        _, drive = self._opened()
        if not math.isfinite(command_v):
            self.safe_stop()
            raise RigError(f"command_v must be finite, got {command_v}")
        try:
            drive.write(command_v)
        except BaseException:
            self.safe_stop()
            raise

    def safe_stop(self) -> None:
        """Set the drive to zero; never raises. `close` reports a failure."""
        if self._parts is not None:
            try:
                self._parts[1].stop()
            except RigError:
                return

    def close(self) -> None:
        """Set the drive to zero and release the board; see `Rig.close`."""
        if self._parts is None:
            return
        sensors, drive = self._parts
        try:
            drive.stop()
        except RigError as error:
            raise DriveNotStoppedError(
                f"the drive may still be driven, press the emergency stop: {error}"
            ) from error
        finally:
            sensors.close()
            drive.close()
            self._parts = None
            atexit.unregister(self.safe_stop)

    def _opened(self) -> tuple[Sensors, Drive]:
        if self._parts is None:
            raise RigError("the NI-DAQ rig is not open: call open() first")
        return self._parts
