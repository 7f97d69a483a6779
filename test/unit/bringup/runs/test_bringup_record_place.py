from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from flexarm_bags.check import check_bag
from flexarm_bags.writer import BagWriter
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.runs.recorded_run import new_record, put_in_place, require_whole, workplace
from flexarm_ident.reading.read import read_bag_report
from support.bag_samples import START_NS, Sent, arm_state, recorded_topics, write_bag

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_ident.reading.alignment import BagReading


def samples(count: int) -> list[Sent]:
    return [arm_state(k + 1, START_NS + k * 10_000_000) for k in range(count)]


def messages_in(folder: Path) -> dict[str, int]:
    """Return what is in each entry of a folder of bags; none of them has a problem."""
    found = {path.name: check_bag(path) for path in folder.iterdir()}
    assert not any(bag.problems for bag in found.values())
    return {name: bag.messages for name, bag in found.items()}


@pytest.mark.parametrize("old", [False, True])
def test_new_record___complete___is_the_bag_and_nothing_else_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], *, old: bool
) -> None:
    bag = tmp_path / "run"
    if old:
        write_bag(bag, samples(5))
    with new_record(bag) as record:
        put_in_place(write_bag(record, samples(20)), bag)
    assert messages_in(tmp_path) == {"run": 20}
    assert [file.name for file in bag.glob("*.mcap")] == ["run_0.mcap"]
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_new_record___not_completed___is_kept_beside_the_old_bag_and_older_partials(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], error: type[BaseException]
) -> None:
    bag = write_bag(tmp_path / "run", samples(5))
    for count, kept in ((20, "run.partial"), (30, "run.partial2"), (40, "run.partial3")):
        with pytest.raises(error), new_record(bag) as record:  # noqa: PT012 - as in a run
            write_bag(record, samples(count))
            raise error
        assert capsys.readouterr().out == f"what was recorded is kept in {tmp_path / kept}\n"
    parts = {"run.partial": 20, "run.partial2": 30, "run.partial3": 40}
    assert messages_in(tmp_path) == {"run": 5} | parts


def test_new_record___its_recorder_was_killed___is_kept(tmp_path: Path) -> None:
    bag = tmp_path / "run"
    with new_record(bag) as record:
        writer = BagWriter(record, recorded_topics(samples(1)))
        for message in samples(20):
            writer.write(message.topic, message.raw, message.time_ns, message.time_ns)
        writer.flush()
    assert check_bag(tmp_path / "run.partial").messages == 20


@pytest.mark.parametrize("opened", [False, True])
def test_new_record___without_a_message___leaves_everything_as_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], *, opened: bool
) -> None:
    bag = write_bag(tmp_path / "run", samples(5))
    write_bag(tmp_path / "run.partial", samples(7))
    with new_record(bag) as record:
        if opened:
            BagWriter(record, recorded_topics(samples(1))).close()
    assert messages_in(tmp_path) == {"run": 5, "run.partial": 7}
    assert capsys.readouterr().out == ""


def test_new_record___interrupted_between_the_two_renames___loses_neither_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_bag(tmp_path / "run", samples(5))
    path_type = type(bag)
    rename = path_type.rename

    def interrupted(self: Path, target: Path) -> Path:
        moved = rename(self, target)
        if self == bag:
            raise KeyboardInterrupt
        return moved

    with pytest.raises(KeyboardInterrupt), new_record(bag) as record:  # noqa: PT012 - as in a run
        write_bag(record, samples(20))
        monkeypatch.setattr(path_type, "rename", interrupted)
        put_in_place(record, bag)
    assert messages_in(tmp_path) == {"run": 5, "run.partial": 20}


def test_new_record___interrupted_while_the_old_bag_is_removed___is_the_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_bag(tmp_path / "run", samples(5))

    def interrupted(_: Path) -> None:
        monkeypatch.undo()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), new_record(bag) as record:  # noqa: PT012 - as in a run
        write_bag(record, samples(20))
        monkeypatch.setattr(shutil, "rmtree", interrupted)
        put_in_place(record, bag)
    assert messages_in(tmp_path) == {"run": 20}


def test_new_record___workplace_of_another_run___is_left_alone(tmp_path: Path) -> None:
    bag = tmp_path / "run"
    write_bag(workplace(bag), samples(5))
    with pytest.raises(FileExistsError), new_record(bag):
        pass
    assert messages_in(tmp_path) == {"run.new": 5}


def reading(tmp_path: Path, in_force: list[int], *, without: int | None = None) -> BagReading:
    """Return what a bag holds whose samples were taken under these commands."""
    states = [
        arm_state(k, START_NS + k * 10_000_000, command_sequence=command)
        for k, command in enumerate(in_force, start=1)
        if k != without
    ]
    return read_bag_report(write_bag(tmp_path / "run", states))


def test_require_whole___answered_or_in_real_time___passes(tmp_path: Path) -> None:
    require_whole(reading(tmp_path, [0, 1, 2, 3]), 4, lockstep=True)
    require_whole(reading(tmp_path / "real", [0, 1, 1, 2]), 4, lockstep=False)


def test_require_whole___unanswered_in_virtual_time___is_refused(tmp_path: Path) -> None:
    with pytest.raises(LaunchError, match=r"^1 of 4 samples had no command of their own: "):
        require_whole(reading(tmp_path, [0, 1, 1, 2]), 4, lockstep=True)


@pytest.mark.parametrize("lockstep", [False, True])
def test_require_whole___ends_too_early___is_refused(tmp_path: Path, *, lockstep: bool) -> None:
    with pytest.raises(LaunchError, match=r"^1 of 5 samples are not in the record: see nodes\.log"):
        require_whole(reading(tmp_path, [0, 1, 2, 3]), 5, lockstep=lockstep)


@pytest.mark.parametrize("lockstep", [False, True])
def test_require_whole___sample_taken_and_not_recorded___is_refused(
    tmp_path: Path, *, lockstep: bool
) -> None:
    with_gap = reading(tmp_path, [0, 1, 2, 3, 4, 5], without=3)
    with pytest.raises(LaunchError, match=r"^1 of 6 samples are not in the record"):
        require_whole(with_gap, 6, lockstep=lockstep)


def test_require_whole___period_skipped_in_real_time___passes(tmp_path: Path) -> None:
    require_whole(reading(tmp_path, [0, 1, 2, 3, 4, 5], without=3), 5, lockstep=False)
