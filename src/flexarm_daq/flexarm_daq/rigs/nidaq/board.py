"""Rig behind a National Instruments board, sampled by its clock."""

from __future__ import annotations

import atexit
import math
from typing import TYPE_CHECKING

from flexarm_daq.rigs.nidaq.driver import load_nidaqmx
from flexarm_daq.rigs.nidaq.terminals import Drive, NidaqSettings, Sensors
from flexarm_daq.rigs.rig_protocol import DriveNotStoppedError, RigError

if TYPE_CHECKING:
    from flexarm_daq.rigs.nidaq.driver import Nidaqmx
    from flexarm_daq.rigs.rig_protocol import RigSample


class NidaqRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig` on a board of National Instruments.

    The voltages are the thesis's channels as they are; `flexarm_core.channels` has their scale.
    Whatever fails, the magnitude is set to zero before the error goes on: by the running task,
    else by a new one, else by a reset of the board. The same happens when the interpreter ends
    with the rig open.

    Parameters
    ----------
    settings : NidaqSettings, optional
        Where the rig is connected; by default as in section 2.3.
    nidaqmx : Nidaqmx, optional
        The package, imported by `open` if it is not given.
    """

    def __init__(
        self, settings: NidaqSettings | None = None, *, nidaqmx: Nidaqmx | None = None
    ) -> None:
        self.settings = settings if settings is not None else NidaqSettings()
        self._nidaqmx = nidaqmx
        self._parts: tuple[Sensors, Drive] | None = None

    def open(self) -> None:
        """Set the drive to zero and start the sampling; does nothing on an open rig.

        Raises
        ------
        RigError
            If the package, the driver or the board is missing, in use or refuses.
        """
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
        """Wait for the next sample of the board's clock; of several take the newest.

        Returns
        -------
        RigSample
            The sample; its time counts the periods of the board's clock.

        Raises
        ------
        RigError
            If the rig is not open, no sample came within three periods, or the board failed.
        """
        sensors, _ = self._opened()
        try:
            return sensors.read()
        except BaseException:
            self.safe_stop()
            raise

    def write(self, command_v: float) -> None:
        """Command the drive.

        Parameters
        ----------
        command_v : float
            Command of the drive; beyond 10 V it is clipped.

        Raises
        ------
        RigError
            If the rig is not open, the command is not finite or the board failed.
        """
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
        """Set the drive to zero; never raises. Where that fails, `close` will say so."""
        if self._parts is not None:
            try:
                self._parts[1].stop()
            except RigError:
                return

    def close(self) -> None:
        """Set the drive to zero and let go of the board; does nothing on a closed rig.

        Raises
        ------
        DriveNotStoppedError
            If the drive could not be set to zero.
        """
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
