"""Verb replay: its one line, its differences and its refusals."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from support.bag_samples import write_bag
from support.controlled_loop import ControlledRun, outputs, pd_answer, pd_parameters, pd_run
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path

    from click.testing import Result

SAMPLES = 40


def replayed(folder: Path, run: ControlledRun, *options: str) -> Result:
    """Replay a run from its bag."""
    bag = write_bag(folder / "bag", run.messages(SAMPLES))
    return CliRunner().invoke(main, ["replay", str(bag), *options])


def with_gain_from(first: int, kp: float, *, reported: bool) -> ControlledRun:
    """Return a run whose gain changes at a sample."""
    run = pd_run(first - 1)
    if reported:
        run.report(first - 1, pd_parameters(kp), reference_v=0.5)
    for k in range(first - 1, SAMPLES):
        run.answer(k, pd_answer(outputs(k), 0.5, kp))
    return run


def test_replay___of_equal_commands___says_so_in_one_line(tmp_path: Path) -> None:
    result = replayed(tmp_path, pd_run(SAMPLES))

    assert result.exit_code == 0
    assert result.output == f"{tmp_path / 'bag'}: pd, 40 samples, 40 commands: equal to the bit\n"


def test_replay___gain_that_is_not_the_recorded_one___is_named_at_its_first_sample(
    tmp_path: Path,
) -> None:
    result = replayed(tmp_path, with_gain_from(21, 1.5, reported=False))

    assert result.exit_code == 1
    verdict, first, *_, more = result.output.splitlines()
    assert verdict.startswith(f"{tmp_path / 'bag'}: pd, 40 samples, 40 commands: 20 differ, by 0.")
    recorded, recomputed = (pd_answer(outputs(20), 0.5, kp)[0] for kp in (1.5, 1.0))
    assert first == (
        f"  difference at sample 21 (0.0667 s): effort {recorded!r} V recorded, "
        f"{recomputed!r} V recomputed"
    )
    assert more == "  and 15 more"


def test_replay___change_that_was_reported___is_named_also_with_a_difference(
    tmp_path: Path,
) -> None:
    run = with_gain_from(21, 1.5, reported=True)
    number, sample, _, compensation_v = run.answers[30]
    run.answers[30] = (number, sample, 3.0, compensation_v)

    result = replayed(tmp_path, run)

    assert result.exit_code == 1
    _, change, difference = result.output.splitlines()
    assert change == "  change at sample 21 (0.0667 s): pd.kp 1 to 1.5"
    assert difference.startswith("  difference at sample 31 (0.1000 s): effort 3.0 V recorded, ")
    assert difference.endswith("; after pd.kp 1 to 1.5 at sample 21 (0.0667 s)")


@pytest.mark.parametrize("options", [(), ("--tolerance", "1e-9")])
def test_replay___difference_as_of_another_machine___is_reported_with_the_way_out(
    tmp_path: Path, options: tuple[str, ...]
) -> None:
    run = pd_run(SAMPLES)
    number, sample, effort_v, compensation_v = run.answers[7]
    run.answers[7] = (number, sample, effort_v + 2e-12, compensation_v)

    result = replayed(tmp_path, run, *options)

    if options:
        assert result.exit_code == 0
        assert result.output.endswith("40 commands: equal within 1e-09 V, by 2e-12 V at most\n")
    else:
        assert result.exit_code == 1
        assert "1 differ, by 2e-12 V at most" in result.output
        assert "--tolerance 1e-09" in result.output


def test_replay___commands_before_the_law_was_reported___are_counted(tmp_path: Path) -> None:
    run = pd_run(10)
    run.laws.clear()
    run.report(10, pd_parameters(1.0), reference_v=0.5)
    for k in range(10, SAMPLES):
        run.answer(k, pd_answer(outputs(k), 0.5, 1.0))

    result = replayed(tmp_path, run)

    assert result.exit_code == 0
    assert "40 samples, 30 commands: equal to the bit" in result.output
    assert "  not compared: 10 commands before the first recorded control law" in result.output


def test_replay___without_a_command_that_can_be_compared___is_refused(tmp_path: Path) -> None:
    run = pd_run(SAMPLES)
    run.laws[0] = replace(run.laws[0], command_sequence=SAMPLES + 1)

    result = replayed(tmp_path, run)

    assert result.exit_code == 1
    assert f"flexarm: {tmp_path / 'bag'}: no command can be compared" in result.output


def test_replay___example_bag___is_refused_with_what_it_lacks() -> None:
    result = CliRunner().invoke(main, ["replay", str(PROJECT / "bags" / "c_dat3_0g")])

    assert result.exit_code == 1
    assert "bags/c_dat3_0g: has no law (/flexarm/law)" in result.output
