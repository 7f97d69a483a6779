"""What acted on the arm while no sample was recorded."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_bags.reader import Recorded
from flexarm_ident.reading.alignment import arm_alignment
from flexarm_ident.records.iodata import ARM_OUTPUTS, IoData

START_NS = 1_700_000_000_000_000_000
RATE_HZ = 300.0
SAMPLES = 60


def recorded(instants: np.ndarray, **columns: np.ndarray) -> Recorded:
    stamps_ns = START_NS + np.rint(instants / RATE_HZ * 1e9).astype(np.int64)
    stamp = {"header.stamp.sec": stamps_ns // 10**9, "header.stamp.nanosec": stamps_ns % 10**9}
    return Recorded(stamps_ns, {**stamp, **columns})


def states(rows: np.ndarray, in_force: np.ndarray, in_force_sequence: np.ndarray) -> Recorded:
    return recorded(
        rows.astype(np.float64),
        sequence=rows + 1,
        command_v=in_force,
        compensation_v=0.1 * in_force,
        command_sequence=in_force_sequence,
        **{name: np.sin(rows / 9.0 + k) for k, name in enumerate(ARM_OUTPUTS)},
    )


def commands(
    instants: np.ndarray, answered: np.ndarray, values: np.ndarray, sequence: np.ndarray
) -> Recorded:
    return recorded(
        instants,
        sequence=sequence,
        state_sequence=answered,
        effort_v=0.9 * values,
        compensation_v=0.1 * values,
    )


def read(state: Recorded, command: Recorded | None) -> IoData:
    reported = [] if command is None else [command]
    aligned = arm_alignment(lambda: [state], lambda: reported, source="run")
    return aligned.reading(state, declared=[True]).data


def loop() -> tuple[np.ndarray, np.ndarray]:
    """Return the rows and the commands that answer their samples, one after the other."""
    rows = np.arange(SAMPLES)
    return rows, np.cos(rows / 7.0)


def test_hole___samples_lost_commands_recorded___the_commands_act() -> None:
    rows, answer = loop()
    kept = (rows < 20) | (rows >= 30)
    in_force = np.concatenate([[0.0], answer[:-1]])
    reported = commands(rows + 0.2, rows + 1, answer, rows + 1)
    data = read(states(rows[kept], in_force[kept], rows[kept]), reported)
    np.testing.assert_allclose(data.u[:, 0], answer[:-1], rtol=1e-12)
    assert data.compensation is not None
    np.testing.assert_allclose(data.compensation[:, 0], 0.1 * answer[:-1], rtol=1e-12)
    assert np.flatnonzero(~data.usable).tolist() == list(range(20, 30))


@pytest.mark.parametrize("recorded_commands", [True, False])
def test_hole___samples_and_commands_lost___lines_between_what_is_known(
    *, recorded_commands: bool
) -> None:
    rows, answer = loop()
    kept = (rows < 20) | (rows >= 30)
    in_force = np.concatenate([[0.0], answer[:-1]])
    reported = commands(rows[kept] + 0.2, rows[kept] + 1, answer[kept], rows[kept] + 1)
    data = read(
        states(rows[kept], in_force[kept], rows[kept]), reported if recorded_commands else None
    )
    # Known is what acted before row 19 and from row 29 on; of row 19 where commands were recorded.
    known = [18, 19, 29] if recorded_commands else [18, 29]
    inside = np.arange(19, 30)
    expected = answer.copy()
    expected[inside] = np.interp(inside, known, answer[known])
    np.testing.assert_allclose(data.u[:, 0], expected[:-1], rtol=1e-12)


# The machine stands still from row 20 to 30. An answer to sample 19 that is sent within its period
# acts from then on; one that is sent three periods late acts only when sampling goes on.
@pytest.mark.parametrize(("sent", "acting"), [(19.2, 19), (22.0, 18)])
def test_hole___sampling_stood_still___holds_the_answer_that_came_in_time(
    sent: float, acting: int
) -> None:
    rows, answer = loop()
    taken = rows[(rows < 20) | (rows >= 30)]
    answers = answer[taken]
    number = np.arange(len(taken))
    in_force = np.concatenate([[0.0], answers[:-1]])
    instants = taken + 0.2
    instants[19] = sent
    reported = commands(instants, taken + 1, answers, number + 1)
    data = read(states(taken, in_force, number), reported)
    expected = answer.copy()
    expected[19:30] = answer[acting]
    np.testing.assert_allclose(data.u[:, 0], expected[:-1], rtol=1e-12)


def test_late_sample___input_of_its_period___is_the_mean_over_it() -> None:
    rows, answer = loop()
    in_force = np.concatenate([[0.0], answer[:-1]])
    state = states(rows, in_force, rows)
    stamps_ns = state.stamps_ns()
    stamps_ns[25] += round(0.4 / RATE_HZ * 1e9)
    columns = {**state.columns, "header.stamp.nanosec": stamps_ns % 10**9}
    data = read(Recorded(state.log_times_ns, columns), None)
    # The command that answers sample 25 acts from 0.4 periods behind its row on.
    assert data.u[25, 0] == pytest.approx(0.4 * answer[24] + 0.6 * answer[25], rel=1e-3)
    np.testing.assert_allclose(np.delete(data.u[:, 0], 25), np.delete(answer[:-1], 25), rtol=1e-12)
