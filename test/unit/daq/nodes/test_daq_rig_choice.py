from __future__ import annotations

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.drivers.registry import require_methods
from flexarm_daq.nodes.daq_node import PARAMETERS
from flexarm_daq.nodes.rig_choice import is_virtual, make_rig
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.rig_protocol import METHODS
from flexarm_daq.rigs.simulated import SimulatedRig
from flexarm_node.loop_node import PARAMETERS as LOOP_PARAMETERS


@pytest.mark.parametrize(
    ("rig", "time", "virtual"),
    [
        ("simulated", "auto", True),
        ("nidaq", "auto", False),
        ("simulated", "real", False),
        ("simulated", "virtual", True),
    ],
)
def test_time___auto___is_virtual_for_the_simulated_rig_alone(
    rig: str, time: str, *, virtual: bool
) -> None:
    assert is_virtual({"rig": rig, "time": time}) == virtual


def test_fast___for_a_real_rig___is_refused_by_its_name() -> None:
    values = {spec.name: spec.default for spec in (*PARAMETERS, *LOOP_PARAMETERS)}
    with pytest.raises(SettingError, match=r"^time = 'virtual', as --fast has it, .* leave it out"):
        make_rig(values | {"rig": "nidaq", "time": "virtual"})


@pytest.mark.parametrize("rig", ["thesis", "quanser-2dsfl"])
def test_viewer___for_a_rig_without_one___is_refused(rig: str) -> None:
    values = {spec.name: spec.default for spec in (*PARAMETERS, *LOOP_PARAMETERS)}
    with pytest.raises(
        SettingError, match=r"^viewer: .* has the driver (simulated|twin), and only mujoco"
    ):
        make_rig(values | {"rig": rig, "viewer": True})


def test_seed___of_the_node___changes_the_noise_of_a_twin() -> None:
    values = {spec.name: spec.default for spec in (*PARAMETERS, *LOOP_PARAMETERS)}
    values |= {"rig": "quanser-2dsfl", "rate_hz": 500.0}

    def first(seed: int) -> np.ndarray:
        rig = make_rig(values | {"seed": seed})
        rig.open()
        return rig.read().outputs

    assert not np.array_equal(first(1), first(2))
    np.testing.assert_array_equal(first(1), first(1))


@pytest.mark.parametrize("rig", [SimulatedRig(), NidaqRig()])
def test_rig___with_all_methods___is_taken(rig: SimulatedRig | NidaqRig) -> None:
    require_methods(rig)


@pytest.mark.parametrize("lacking", METHODS)
def test_rig___that_lacks_a_method___is_refused(
    monkeypatch: pytest.MonkeyPatch, lacking: str
) -> None:
    monkeypatch.setattr(SimulatedRig, lacking, None)
    values = {spec.name: spec.default for spec in (*PARAMETERS, *LOOP_PARAMETERS)}
    with pytest.raises(SettingError, match=rf"class SimulatedRig has no method {lacking}: a rig"):
        make_rig(values)


def test_rig___with_an_absent_channel_that_is_none___is_refused_with_the_nearest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(SimulatedRig, "absent_channels", ("speed",), raising=False)
    values = {spec.name: spec.default for spec in (*PARAMETERS, *LOOP_PARAMETERS)}
    with pytest.raises(SettingError, match=r"absent_channels with 'speed' \(nearest: speed_v\): "):
        make_rig(values)
