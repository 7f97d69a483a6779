"""Rig of one's own that logs what its output has, so that this outlives the process."""

from __future__ import annotations

from pathlib import Path

DRIVER = """
import time
from pathlib import Path

from flexarm_daq.rigs.simulated import SimulatedRig

class LoggingRig(SimulatedRig):
    def __init__(self, log):
        super().__init__(clock=time.monotonic)
        self._log = Path(log).open("a", buffering=1)

    def write(self, commands):
        super().write(commands)
        print(*commands, file=self._log)

    def safe_stop(self):
        super().safe_stop()
        print(0.0, file=self._log)
"""


class LoggingRig:
    """Description and log of a simulated arm, behind a driver that logs each output.

    Parameters
    ----------
    folder : Path
        Where both are put.
    """

    def __init__(self, folder: Path) -> None:
        thesis = (
            Path(__file__).parents[2] / "src/flexarm_core/flexarm_core/rigs/packaged/thesis.yaml"
        )
        self._log = folder / "outputs"
        self.description = folder / "logging.yaml"
        (folder / "logging.py").write_text(DRIVER)
        text = thesis.read_text("utf-8").replace(
            "driver: simulated",
            f"driver: logging.py:LoggingRig\nsettings: {{log: {str(self._log)!r}}}",
        )
        self.description.write_text(text)

    @property
    def parameters(self) -> dict[str, object]:
        """Parameters of the DAQ node."""
        return {"rig": str(self.description), "self_test": "off"}

    @property
    def outputs_v(self) -> list[float]:
        """Every output so far, V."""
        if not self._log.is_file():
            return []
        return [float(line) for line in self._log.read_text().split("\n")[:-1]]

    def is_driven(self) -> bool:
        """Return whether the last output is not zero."""
        return bool(self.outputs_v) and self.outputs_v[-1] != 0.0
