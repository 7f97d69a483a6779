from __future__ import annotations

import errno
import resource
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from rosbags.highlevel import AnyReader, AnyReaderError

from flexarm_bags.writer import BagWriter, RecordingError, whole_bag
from support.bag_samples import (
    START_NS,
    arm_state,
    experiment,
    information,
    mcap_file,
    recorded_topics,
    reference,
    write_bag,
)
from support.recorded_samples import salvaged

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def limited_file_size(size: int) -> Iterator[None]:
    """Let the operating system refuse to let any file grow beyond a size: a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_write___flush_period_over___flushes_by_itself(tmp_path: Path) -> None:
    messages = experiment(4)
    with BagWriter(tmp_path / "run", recorded_topics(messages), flush_period_s=0.0) as bag:
        for count, message in enumerate(messages, start=1):
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
            assert len(salvaged(mcap_file(tmp_path / "run"))) == count


def test_write___within_the_flush_period___waits_for_flush(tmp_path: Path) -> None:
    messages = experiment(4)
    with BagWriter(tmp_path / "run", recorded_topics(messages), flush_period_s=1e6) as bag:
        for message in messages:
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
        assert salvaged(mcap_file(tmp_path / "run")) == []

        bag.flush()

        assert salvaged(mcap_file(tmp_path / "run")) == [message.raw for message in messages]


KILLED_RECORDER = """
import os, signal, sys
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from support.bag_samples import recorded_topics, reference
from flexarm_bags.writer import BagWriter
messages = [reference(k, float(k)) for k in range(150)]
bag = BagWriter(Path(sys.argv[1]), recorded_topics(messages), flush_period_s=1e6)
for k, message in enumerate(messages):
    bag.write(message.topic, message.raw, k, k)
    if k == 99:
        bag.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_killed_recorder___leaves_everything_up_to_the_last_flush(tmp_path: Path) -> None:
    bag = tmp_path / "run"
    finished = subprocess.run(  # noqa: S603 - our own interpreter and text
        [sys.executable, "-c", KILLED_RECORDER, str(bag), *sys.path], check=False
    )

    assert finished.returncode == -signal.SIGKILL
    assert salvaged(mcap_file(bag)) == [reference(k, float(k)).raw for k in range(100)]
    with pytest.raises(AnyReaderError, match="File end magic is invalid"), AnyReader([bag]):
        pass


def test_cut_file___whole_chunks_survive_and_nothing_else(tmp_path: Path) -> None:
    messages = experiment(40)
    sizes = []
    with BagWriter(tmp_path / "run", recorded_topics(messages), flush_period_s=1e6) as bag:
        file = mcap_file(tmp_path / "run")
        for count, message in enumerate(messages, start=1):
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
            if count % 20 == 0:
                bag.flush()
                sizes.append((file.stat().st_size, count))
    whole = file.read_bytes()

    for start, count in sizes:
        file.write_bytes(whole[: start + 50])
        assert salvaged(file) == [message.raw for message in messages[:count]]


def test_full_disk___says_so_and_keeps_what_was_flushed(tmp_path: Path) -> None:
    messages = experiment(4000)
    path = tmp_path / "run"
    bag = BagWriter(path, recorded_topics(messages), flush_period_s=1e6)
    kept = 0

    def record() -> None:
        nonlocal kept
        for count, message in enumerate(messages, start=1):
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
            if count % 500 == 0:
                bag.flush()
                kept = count

    with (
        limited_file_size(30_000),
        pytest.raises(RecordingError, match=r"run: cannot write: File too large; the first \d+"),
    ):
        record()
    bag.close()

    assert 500 <= kept < len(messages)
    assert salvaged(mcap_file(path)) == [message.raw for message in messages[:kept]]
    assert information(path)["message_count"] == kept
    with pytest.raises(RecordingError, match="is closed"):
        bag.flush()


def test_write___messages_of_more_than_a_period___are_flushed_by_their_own_times(
    tmp_path: Path,
) -> None:
    messages = [arm_state(k + 1, START_NS + k * 100_000_000) for k in range(25)]
    with BagWriter(tmp_path / "run", recorded_topics(messages), flush_period_s=1.0) as bag:
        for message in messages:
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
        kept = salvaged(mcap_file(tmp_path / "run"))
    # At most a second is missing, although they were written within a moment.
    assert len(kept) == 22


def test_flush_if_due___silent_topics___are_on_disk_after_a_period(tmp_path: Path) -> None:
    message = reference(START_NS, 1.0)
    with BagWriter(tmp_path / "run", recorded_topics([message]), flush_period_s=1e6) as bag:
        bag.write(message.topic, message.raw, START_NS, START_NS)
        bag.flush_if_due()
        assert salvaged(mcap_file(tmp_path / "run")) == []
        bag._flush_period_s = 0.0
        bag.flush_if_due()
        assert salvaged(mcap_file(tmp_path / "run")) == [message.raw]


def test_disk___full_at_any_call___is_an_error_and_never_another_exception(
    tmp_path: Path,
) -> None:
    messages = experiment(1500)

    def record(path: Path) -> None:
        with BagWriter(path, recorded_topics(messages), flush_period_s=0.2) as bag:
            for message in messages:
                bag.write(message.topic, message.raw, message.time_ns, message.time_ns)

    whole = mcap_file(write_bag(tmp_path / "whole", messages)).stat().st_size
    for number, size in enumerate(range(5000, whole, whole // 12)):
        path = tmp_path / f"run{number}"
        with (
            limited_file_size(size),
            pytest.raises(RecordingError, match="File too large"),
        ):
            record(path)
        kept = salvaged(mcap_file(path))
        assert kept == [message.raw for message in messages[: len(kept)]]


def test_metadata___whose_writing_ends_half_way___are_those_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages = experiment(20)
    path = tmp_path / "run"
    bag = BagWriter(path, recorded_topics(messages))
    for message in messages:
        bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
    before = information(path)
    write_text = Path.write_text

    def half(target: Path, text: str, *others: Any) -> int:  # noqa: ANN401
        write_text(target, text[: len(text) // 2], *others)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", half)
    with pytest.raises(RecordingError, match="No space left"):
        bag.close()
    assert information(path) == before


@pytest.mark.parametrize("end", [KeyboardInterrupt, SystemExit, ValueError])
def test_bag_that_can_be_made_again___interrupted___leaves_nothing(
    tmp_path: Path, end: type[BaseException]
) -> None:
    messages = experiment(20)

    def interrupted() -> None:
        with whole_bag(tmp_path / "run", recorded_topics(messages)) as bag:
            for message in messages[:10]:
                bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
            raise end

    with pytest.raises(end):
        interrupted()
    assert not (tmp_path / "run").exists()
