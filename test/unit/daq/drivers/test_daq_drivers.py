from __future__ import annotations

from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_core.rig_description import described, load_rig
from flexarm_daq.drivers import registry
from flexarm_daq.drivers.at_rest import read_at_rest
from flexarm_daq.drivers.registry import driven
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.rig_protocol import RigError
from flexarm_daq.rigs.simulated import SimulatedRig

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from flexarm_core.rig_description import RigDescription

DRIVER = """\
import time
import numpy as np
from flexarm_daq.rigs.rig_protocol import RigSample

class Mine:
    def __init__(self, level=0.0, channels=2):
        self.level, self.channels, self.written = level, channels, []
        if level > 10.0:
            raise ValueError("level is beyond the range")
    def open(self):
        self.begun_s = time.monotonic()
    def read(self):
        return RigSample(time.monotonic() - self.begun_s, np.full(self.channels, self.level))
    def write(self, command):
        self.written.append(command)
    def safe_stop(self):
        self.written.append(0.0)
    def close(self):
        self.written.append("closed")

class Half:
    def open(self):
        pass

def make():
    pass
"""


def rig(driver: str, settings: str = "{}") -> RigDescription:
    return described(
        f"""\
name: mine
rate_hz: 100
inputs: {{u: {{unit: x, limits: 1}}}}
outputs:
  a: {{unit: counts, scale: 0.5, offset: 10, range: 100}}
  b: {{unit: x}}
driver: {driver}
settings: {settings}
"""
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text(DRIVER)
    (tmp_path / "broken.py").write_text("x = 1\nraise OSError('no such board')\n")
    return tmp_path


def test_driver___of_a_file___gets_its_settings(folder: Path) -> None:
    made = driven(rig("mine.py:Mine", "{level: 2.5}"), folder)
    assert getattr(made, "level") == pytest.approx(2.5)  # noqa: B009 - of the user's class


def test_driver___that_comes_with_flexarm___is_made_for_the_rate() -> None:
    assert isinstance(driven(load_rig("thesis"), folder=None), SimulatedRig)  # type: ignore[arg-type]
    assert isinstance(driven(load_rig("thesis-nidaq"), folder=None), NidaqRig)  # type: ignore[arg-type]


def test_driver___of_an_installed_package___is_found_by_its_entry_point(
    monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    def installed(group: str) -> Sequence[EntryPoint]:
        place = "flexarm_daq.rigs.simulated"
        return [
            EntryPoint("other", f"{place}:SimulatedRig", group),
            EntryPoint("lost", f"{place}:X", group),
        ]

    monkeypatch.setattr(registry, "entry_points", installed)
    assert isinstance(driven(rig("other", "{seed: 3}"), folder), SimulatedRig)
    lost = r"^rig\.yaml:7: driver lost of flexarm_daq\.rigs\.simulated:X: AttributeError"
    with pytest.raises(SettingError, match=lost):
        driven(rig("lost"), folder)


@pytest.mark.parametrize(
    ("driver", "settings", "said"),
    [
        ("simulatd", "{}", r"driver 'simulatd' is not known \(nearest: simulated\): name one of"),
        ("none.py:Mine", "{}", r"driver none.py:Mine: .*none.py: no such file"),
        ("mine.py:Mime", "{}", r"has no class 'Mime' \(nearest: Mine\)"),
        # What the file imports is none of its classes.
        ("mine.py:make", "{}", r"has no class 'make' \(known: Mine, Half\)"),
        ("mine.py:Half", "{}", r"class Half has no method read, write, safe_stop, close: a rig"),
        ("mine.py:Mine", "{lvel: 1}", r"settings lvel do not make it: TypeError: .*lvel"),
        (
            "mine.py:Mine",
            "{level: 11}",
            r"mine.py:Mine, line 9: settings level .*: ValueError: level",
        ),
        ("broken.py:Mine", "{}", r"broken.py, line 2: OSError: no such board"),
        ("simulated", "{seed: 1}", r"the thesis's arm, whose input is command_v: simulate another"),
        (
            "nidaq",
            "{devise: Dev2}",
            r"settings.devise is not a setting of the driver nidaq \(nearest: device\)",
        ),
        ("nidaq", "{device: ''}", r"names no board or channel"),
        # The line of the setting, not of the driver.
        ("serial", "\n  port: /dev/x\n  baud: fast", r"^rig.yaml:10: settings.baud = 'fast' must"),
        ("serial", "\n  port: /dev/x\n  rate: 1", r"^rig.yaml:10: settings.rate is not a setting"),
    ],
)
def test_driver___that_cannot_be_made___is_refused_in_a_line(
    folder: Path, driver: str, settings: str, said: str
) -> None:
    with pytest.raises(SettingError, match=said) as refused:
        driven(rig(driver, settings), folder)
    assert "\n" not in str(refused.value)


def test_read_at_rest___own_rig___has_levels_and_rate_and_writes_nothing(folder: Path) -> None:
    description = rig("mine.py:Mine", "{level: 6.0}")
    made = driven(description, folder)
    reading = read_at_rest(made, description, 0.2)
    assert reading.raw.shape == (20, 2)
    np.testing.assert_allclose(reading.values(0, description.outputs[0]), 0.5 * (6.0 - 10.0))
    assert 50.0 < reading.rate_hz < 110.0
    assert getattr(made, "written") == [0.0, "closed"]  # noqa: B009 - of the user's class


def test_read_at_rest___other_number_of_channels___names_the_outputs(folder: Path) -> None:
    description = rig("mine.py:Mine", "{channels: 3}")
    with pytest.raises(RigError, match="reads 3 channels, and rig mine has 2 outputs: a, b"):
        read_at_rest(driven(description, folder), description, 0.2)


@pytest.mark.parametrize("driver", ["serial", "topics", "mujoco", "nidaq"])
def test_driver_that_stops_at_zero___with_an_input_that_rests_elsewhere___is_refused(
    driver: str, folder: Path
) -> None:
    aside = described(rig(driver).text.replace("limits: 1", "limits: [1, 9], rest: 5"))
    with pytest.raises(SettingError, match=f"the driver {driver} stops .* and u rests at 5 x"):
        driven(aside, folder)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("return self.levels", r"read\(\) of the driver failed: AttributeError: .*levels.* \(mine"),
        ("return [1.0, 2.0]", r"read\(\) of the driver returned \[1\.0, 2\.0\]: .*RigSample\("),
        ("raise OSError('cable off')", r"failed: OSError: cable off \(mine\.py:\d+\)"),
    ],
)
def test_read_at_rest___mistake_in_a_driver___names_its_line(
    folder: Path, line: str, said: str
) -> None:
    reading = (
        "return RigSample(time.monotonic() - self.begun_s, np.full(self.channels, self.level))"
    )
    (folder / "mine.py").write_text(DRIVER.replace(reading, line))
    description = rig("mine.py:Mine", "{}")
    with pytest.raises(RigError, match=said) as refused:
        read_at_rest(driven(description, folder), description, 0.2)
    assert "\n" not in str(refused.value)
