"""Records of other rigs, imported and identified by the service."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.signal import cont2discrete

from support.foreign_bags import MODES_HZ, driven_joint
from support.identification_service import answered, identify
from support.project import PROJECT, SHARED
from support.system_graph import ROOT, Graph

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

pytestmark = pytest.mark.system

QUANSER = SHARED / "data" / "quanser_2dsfl_fsf.csv"


def two_oscillators(samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return random inputs and the outputs of two coupled oscillators of 3 and 7 Hz, at 100 Hz."""
    pulsations = 2.0 * np.pi * np.array([3.0, 7.0])
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = -np.diag(pulsations**2)
    a[2:, 2:] = -2.0 * 0.05 * np.diag(pulsations)
    b = np.vstack([np.zeros((2, 2)), [[1.0, 0.2], [-0.3, 1.0]]])
    c = np.block([[np.diag(pulsations**2), np.zeros((2, 2))], [np.zeros((2, 2)), np.eye(2)]])
    ad, bd, cd, _, _ = cont2discrete((a, b, c, np.zeros((4, 2))), 0.01)
    u = np.random.default_rng(5).standard_normal((samples, 2))
    x = np.zeros(4)
    y = np.zeros((samples, 4))
    for k in range(samples):
        y[k] = cd @ x
        x = ad @ x + bd @ u[k]
    return u, y


def import_csv(graph: Graph, csv: Path, map_file: Path, bag: Path) -> None:
    process = graph.run(
        [str(ROOT / "flexarm"), "import", str(csv), "--map", str(map_file), "-o", str(bag)]
    )
    assert process.exit_code() == 0, process.printed


def test_csv_of_another_rig___is_imported_and_identified(laboratory: Graph, tmp_path: Path) -> None:
    u, y = two_oscillators(1500)
    time_s = 0.01 * np.arange(1500)
    columns = ["t", "left", "right", "q1", "q2", "v1", "v2"]
    np.savetxt(
        tmp_path / "rig.csv",
        np.column_stack([time_s, u, y]),
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    channels = {
        "inputs": [{"column": name, "unit": "N"} for name in columns[1:3]],
        "outputs": [{"column": name, "unit": "m"} for name in columns[3:]],
    }
    (tmp_path / "map.yaml").write_text(
        "time: t\n" + "".join(f"{key}: {value}\n" for key, value in channels.items())
    )

    import_csv(laboratory, tmp_path / "rig.csv", tmp_path / "map.yaml", tmp_path / "rig")
    response = identify(laboratory, tmp_path / "rig", order=4, block_rows=15)

    assert response.success, response.message
    parameters = answered(response)
    assert parameters["models.rig.input_names"] == columns[1:3]
    assert parameters["models.rig.output_names"] == columns[3:]
    assert len(parameters["models.rig.b"]) == 4 * 2
    assert len(parameters["models.rig.c"]) == 4 * 4
    frequencies = sorted(mode.frequency_hz for mode in response.modes)
    assert frequencies == pytest.approx([3.0, 7.0], rel=0.02)
    assert response.dmv[-1] < 0.05


@pytest.mark.skipif(not QUANSER.is_file(), reason=f"the measurements are not there: {QUANSER}")
def test_quanser_measurements___give_a_model_with_2_inputs_and_4_outputs(
    laboratory: Graph, tmp_path: Path
) -> None:
    map_file = PROJECT / "src" / "flexarm_bringup" / "config" / "quanser_2dsfl.yaml"
    import_csv(laboratory, QUANSER, map_file, tmp_path / "quanser")

    # Without friction, which takes a minute here and is tried on the command line.
    response = identify(laboratory, tmp_path / "quanser", friction=False)

    assert response.success, response.message
    assert len(response.dmv) == 5
    parameters = answered(response)
    states = parameters["models.quanser.states"]
    assert len(parameters["models.quanser.b"]) == states * 2
    assert len(parameters["models.quanser.c"]) == 4 * states
    assert response.warnings


def test_bag_of_another_program___is_identified_by_named_signals(
    laboratory: Graph, tmp_path: Path
) -> None:
    bag = driven_joint(tmp_path / "run1", seed=1)
    names = {
        "inputs": ["torque_nm=/joint_states.effort[arm]"],
        "outputs": ["/joint_states.position[0]"],
    }

    response = identify(laboratory, bag, **names)

    assert response.success, response.message
    assert answered(response)["models.run1.input_names"] == ["torque_nm"]
    frequencies = sorted(mode.frequency_hz for mode in response.modes if mode.damping_ratio < 0.1)
    assert frequencies == pytest.approx(MODES_HZ, rel=0.005)
    for wrong, text in (
        ({**names, "outputs": ["/joint_states.position[leg]"]}, r"has no number position\[leg\]"),
        ({"inputs": names["inputs"]}, "no output was named"),
        ({**names, "clock": "sun"}, "clock must be one of header, receive: 'sun'"),
        ({"interpolated": True}, "clock and interpolated belong to named inputs and outputs"),
    ):
        refused = identify(laboratory, bag, **wrong)
        assert not refused.success
        assert re.search(text, refused.message), refused.message
