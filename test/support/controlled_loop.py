"""Controlled runs that no law of the project had a part in: its formulas are written out here."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_control.replaying.comparison import LawRecord, LoopRecord
from support.bag_samples import START_NS, Sent, arm_state, header, motor_command, serialised

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_core.arrays import FloatArray

PERIOD_NS = 3_333_333
_FADE_V = 0.1


def outputs(k: int) -> tuple[float, float, float, float]:
    """Return the outputs of an arm in motion at a sample, V."""
    return (math.sin(0.02 * k), 0.1, -0.1, 0.3 * math.cos(0.02 * k))


def pd_answer(volts: Sequence[float], reference_v: float, kp: float) -> tuple[float, float]:
    """Return the answer of section 2.4.3 with kd = 2.8 and 0.8 V."""
    effort_v = kp * (reference_v - volts[0]) - 2.8 * volts[3]
    return effort_v, math.copysign(0.8, effort_v)


def pd_parameters(kp: float, **more: float | str) -> dict[str, Any]:
    """Return the parameters of the PD law as a controller tells them."""
    return {"law": "pd", "reference": "topic", "pd.kp": kp, "pd.kd": 2.8, **more}


@dataclass
class ControlledRun:
    """Run that is written down sample by sample.

    Attributes
    ----------
    answers : list of (int, int, float, float)
        Number of the command, sample that it answers, effort and compensation, V.
    laws : list of LawRecord
        Laws as they were told.
    """

    answers: list[tuple[int, int, float, float]] = field(default_factory=list)
    laws: list[LawRecord] = field(default_factory=list)

    def answer(self, k: int, answer: tuple[float, float]) -> None:
        """Answer sample k + 1."""
        self.answers.append((len(self.answers) + 1, k + 1, *answer))

    def report(
        self,
        k: int,
        parameters: Mapping[str, Any],
        *,
        reference_v: float = 0.0,
        handover: Sequence[float] = (0.0, 0.0, 0.0),
        **memory: Sequence[float],
    ) -> None:
        """Tell the law that the next answer, to sample k + 1, is of."""
        self.laws.append(
            LawRecord(
                stamp_ns=START_NS + k * PERIOD_NS,
                run_time_ns=k * PERIOD_NS,
                command_sequence=len(self.answers) + 1,
                reference_v=reference_v,
                parameters=parameters,
                memory={"handover": list(handover), **memory},
            )
        )

    def record(self, samples: int) -> LoopRecord:
        """Return the record of all samples and answers."""
        numbers = np.arange(1, samples + 1)
        return LoopRecord(
            sequence=numbers,
            stamps_ns=START_NS + (numbers - 1) * PERIOD_NS,
            volts=np.array([outputs(k) for k in range(samples)]),
            drive=np.zeros((samples, 2)),
            command_sequence=np.array([answer[0] for answer in self.answers]),
            answered=np.array([answer[1] - 1 for answer in self.answers]),
            answers=np.array([answer[2:] for answer in self.answers]),
            laws=tuple(self.laws),
        )

    def messages(self, samples: int) -> list[Sent]:
        """Return what a recorder gets of the run, but for the declaration of the commander."""
        sent = [arm_state(k + 1, START_NS + k * PERIOD_NS, outputs(k)) for k in range(samples)]
        sent += [_command(*answer) for answer in self.answers]
        sent += [_law(reported) for reported in self.laws]
        return sorted(sent, key=lambda message: message.time_ns)


def pd_run(samples: int, *, kp: float = 1.0, reference_v: float = 0.5) -> ControlledRun:
    """Return a run with the PD law that is told once."""
    run = ControlledRun()
    run.report(0, pd_parameters(kp), reference_v=reference_v)
    for k in range(samples):
        run.answer(k, pd_answer(outputs(k), reference_v, kp))
    return run


def faded(own_v: FloatArray, command_v: float) -> FloatArray:
    """Return commands that begin at the one in force and fade to a law's own by 0.1 V a sample."""
    apart_v = command_v - own_v[0]
    left_v = np.maximum(0.0, abs(apart_v) - _FADE_V * np.arange(len(own_v)))
    commands_v: FloatArray = own_v + np.copysign(left_v, apart_v)
    return commands_v


def _command(number: int, sample: int, effort_v: float, compensation_v: float) -> Sent:
    time_ns = START_NS + (sample - 1) * PERIOD_NS + 1000
    return motor_command(
        number, time_ns, effort_v, state_sequence=sample, compensation_v=compensation_v
    )


def _law(reported: LawRecord) -> Sent:
    type_name = "flexarm_msgs/msg/LawInForce"
    raw = serialised(
        type_name,
        header=header(reported.stamp_ns),
        command_sequence=reported.command_sequence,
        run_time_ns=reported.run_time_ns,
        reference_v=reported.reference_v,
        parameters=json.dumps(reported.parameters),
        memory_names=list(reported.memory),
        memory_sizes=np.array([len(group) for group in reported.memory.values()], dtype=np.uint32),
        memory=np.concatenate([np.array(group, float) for group in reported.memory.values()]),
    )
    return Sent("/flexarm/law", type_name, reported.stamp_ns + 2000, raw)
