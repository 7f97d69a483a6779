"""Arm of a commissioning without nodes: excitations and laws of the project on a rig, in a loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.loop_setup import PARAMETERS as LAW_PARAMETERS
from flexarm_control.rig_setup import RigSetup, first_references
from flexarm_core.channels import is_thesis_arm
from flexarm_core.signals import Sample
from flexarm_daq.loop.limiter import arm_gate, rig_gate
from flexarm_daq.nodes.experiment_node import PARAMETERS, driven_inputs
from flexarm_ident import IoData

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from flexarm_control.commissioning.programme import Measurement
    from flexarm_control.twin import TwinRig
    from flexarm_core.rig_description import RigDescription
    from flexarm_daq.rigs.rig_protocol import Rig


class DirectArm:
    """A rig in a loop with the gate, the experiment node's waveforms and the controller's laws.

    `runs` has the measurements by name. That with the name `dies_in` ends as a process does that is
    interrupted.
    """

    delay_s = 0.0

    def __init__(self, rig: RigDescription, driver: Rig | TwinRig, folder: Path) -> None:
        self.rig, self.driver, self.folder = rig, driver, folder
        self.runs: list[str] = []
        self.dies_in = ""
        self._references: tuple[float, ...] | None = None

    def bag(self, name: str) -> Path:
        """Return the place of a record."""
        return self.folder / f"{name}.csv"

    def measured(self, wanted: Measurement) -> IoData:
        """Return the record of a measurement, which is made unless it is there."""
        if not self.bag(wanted.name).exists():
            if wanted.name == self.dies_in:
                raise KeyboardInterrupt
            self.runs.append(wanted.name)
            u, y, shares = self._run(wanted)
            np.save(self.bag(wanted.name).with_suffix(".npy"), shares)
            names = ",".join((*self.rig.input_names, *self.rig.output_names))
            table = np.column_stack([u, y])
            np.savetxt(self.bag(wanted.name), table, delimiter=",", header=names, comments="")
        return self.record(wanted.name)

    def record(self, name: str) -> IoData:
        """Return a record."""
        file = self.bag(name.removesuffix(".csv"))
        inputs = len(self.rig.inputs)
        found = np.loadtxt(file, delimiter=",", skiprows=1)
        return IoData(
            found[:, :inputs],
            found[:, inputs:],
            dt_s=1.0 / self.rig.rate_hz,
            inputs=self.rig.input_names,
            outputs=self.rig.output_names,
            compensation=np.load(file.with_suffix(".npy")),
            closed_loop=not name.startswith("pulses"),
            source=name,
        )

    def forget(self, name: str) -> None:
        """Remove a record."""
        self.bag(name).unlink(missing_ok=True)

    def set_references(self, values: Mapping[str, float]) -> None:
        """Take set-points, from the next run on."""
        self._references = tuple(values.values())

    def _run(self, wanted: Measurement) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rig, is_law = self.rig, wanted.commander == "controller"
        specs = LAW_PARAMETERS if is_law else PARAMETERS
        values = {spec.name: spec.default for spec in specs} | wanted.parameters
        setup = RigSetup.of(values, rig) if is_law else None
        loop = setup.loop() if setup else None
        if loop:
            loop.reset()
        driven = None if is_law else driven_inputs(rig, values)
        gate = arm_gate() if is_thesis_arm(rig) else rig_gate(rig)
        count = round(wanted.length_s * rig.rate_hz)
        u = np.empty((count, len(rig.inputs)))
        parts = np.empty_like(u)
        y = np.empty((count, len(rig.outputs)))
        commands, shares = gate.rest, (0.0,) * len(rig.inputs)
        self.driver.open()
        for k in range(count):
            time_s = k / rig.rate_hz
            y[k] = self.driver.read().outputs
            sample = Sample(round(time_s * 1e9), k + 1, tuple(y[k]), commands, shares, k)
            if loop and setup:
                references = self._references or first_references(setup, sample)
                if setup.has_profile:
                    references = setup.profile(time_s)
                else:
                    self._references = references
                efforts, shares = loop.step(sample, references)
            else:
                assert driven is not None
                efforts = tuple(each.effort(time_s, sample.outputs) for each in driven)
                shares = (0.0,) * len(efforts)
            limited = gate.apply(efforts, shares, sample.outputs, 1.0 / rig.rate_hz)
            commands, shares = limited.commands, limited.compensations
            self.driver.write(commands)
            u[k], parts[k] = commands, shares
        self.driver.close()
        return u, y, parts
