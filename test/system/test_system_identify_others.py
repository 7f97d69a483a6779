"""Records of other rigs, imported and identified by the service."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from scipy.signal import cont2discrete

from flexarm_ident import IoData
from support.foreign_bags import MODES_HZ, driven_joint
from support.identification_service import answered, identify
from support.project import PROJECT, SHARED
from support.rubbing_arms import rubbing_arm
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


def write_csv(folder: Path, record: IoData, unit: tuple[str, str]) -> tuple[Path, Path]:
    """Write a record as a table, and the map that tells inputs, outputs and their units."""
    table, map_file = folder / "rig.csv", folder / "map.yaml"
    np.savetxt(
        table,
        np.column_stack([record.dt_s * np.arange(len(record)), record.u, record.y]),
        delimiter=",",
        header=",".join(["t", *record.inputs, *record.outputs]),
        comments="",
    )
    names = {"inputs": record.inputs, "outputs": record.outputs}
    channels = {
        kind: [{"column": name, "unit": its} for name in names[kind]]
        for kind, its in zip(names, unit, strict=True)
    }
    map_file.write_text("time: t\n" + "".join(f"{kind}: {channels[kind]}\n" for kind in names))
    return table, map_file


def import_csv(graph: Graph, csv: Path, map_file: Path, bag: Path) -> None:
    process = graph.run(
        [str(ROOT / "flexarm"), "import", str(csv), "--map", str(map_file), "-o", str(bag)]
    )
    assert process.exit_code() == 0, process.printed


def test_csv_of_another_rig___is_imported_and_identified(laboratory: Graph, tmp_path: Path) -> None:
    u, y = two_oscillators(1500)
    columns = ["left", "right", "q1", "q2", "v1", "v2"]
    record = IoData(u, y, dt_s=0.01, inputs=tuple(columns[:2]), outputs=tuple(columns[2:]))
    table, map_file = write_csv(tmp_path, record, ("N", "m"))

    import_csv(laboratory, table, map_file, tmp_path / "rig")
    response = identify(laboratory, tmp_path / "rig", order=4, block_rows=15)

    assert response.success, response.message
    parameters = answered(response)
    assert parameters["models.rig.input_names"] == columns[:2]
    assert parameters["models.rig.output_names"] == columns[2:]
    assert len(parameters["models.rig.b"]) == 4 * 2
    assert len(parameters["models.rig.c"]) == 4 * 4
    frequencies = sorted(mode.frequency_hz for mode in response.modes)
    assert frequencies == pytest.approx([3.0, 7.0], rel=0.02)
    assert response.dmv[-1] < 0.05


@pytest.mark.exhaustive
def test_arm_with_dry_friction___command___shows_and_keeps_its_level(
    laboratory: Graph, tmp_path: Path
) -> None:
    true = 0.3
    table, map_file = write_csv(tmp_path, rubbing_arm((true,), samples=1500), ("A", "rad"))
    import_csv(laboratory, table, map_file, tmp_path / "rubbing")

    words = ["identify", str(tmp_path / "rubbing"), "-o", str(tmp_path / "out")]
    process = laboratory.run([str(ROOT / "flexarm"), *words])

    assert process.exit_code() == 0, process.printed
    content = yaml.safe_load((tmp_path / "out" / "model.yaml").read_text("utf-8"))
    (level,) = content["/**"]["ros__parameters"]["models"]["rubbing"]["friction_level"]
    assert level == pytest.approx(true, rel=0.05)
    table_printed = process.printed[process.printed.index("Coulomb level") :]
    found = re.search(r"drive1_a +([0-9.]+) \u00b1 ([0-9.]+) .* A", table_printed)
    assert found
    assert float(found[1]) == pytest.approx(level, abs=float(found[2]))


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
