from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.verbs.offline.bags import bag
from support.bag_samples import START_NS, io_sample, write_bag
from support.damaged_bags import Recording, damaged_copy

if TYPE_CHECKING:
    from pathlib import Path


def a_bag(path: Path) -> Path:
    samples = [io_sample(k + 1, START_NS + k * 10_000_000, [0.1], [0.2, 0.3]) for k in range(20)]
    return write_bag(path, samples)


def test_bag_repair___damaged_bag___counts_what_is_lost_and_says_each_damage_in_a_line(
    tmp_path: Path,
) -> None:
    recording = Recording(tmp_path / "whole")
    raw = bytearray(recording.file.read_bytes())
    raw[recording.chunks[1][0]] = 0x7F
    raw[recording.chunks[2][1] - 3] ^= 0xFF
    damaged = damaged_copy(recording, tmp_path / "run", bytes(raw))
    result = CliRunner().invoke(bag, ["repair", str(damaged), "-o", str(tmp_path / "new")])
    assert result.exit_code == 0
    first, *damage = result.output.splitlines()
    assert first == f"{tmp_path / 'new'}: 89 messages, 32 of 121 are lost"
    assert len(damage) == 2
    assert all(line.startswith(f"  damage: {recording.file.name}: a chunk") for line in damage)


@pytest.mark.parametrize("lost", [False, True])
def test_bag_check___folder_of_bags___every_one_of_them_even_without_its_metadata(
    tmp_path: Path, *, lost: bool
) -> None:
    for name in ("a", "b"):
        a_bag(tmp_path / name)
    tmp_path.joinpath("notes").mkdir()
    if lost:
        tmp_path.joinpath("b", "metadata.yaml").unlink()
    result = CliRunner().invoke(bag, ["check", str(tmp_path)])
    assert result.exit_code == int(lost)
    verdicts = [line for line in result.output.splitlines() if "messages, " in line]
    assert len(verdicts) == 2
    assert verdicts[0].endswith("good")
    assert verdicts[1].endswith("1 problem" if lost else "good")


@pytest.mark.parametrize("without", ["end", "metadata", "messages"])
def test_bag_check___bag_that_is_cut_off___says_how_it_is_repaired(
    tmp_path: Path, without: str
) -> None:
    a_bag(tmp_path / "run")
    (file,) = tmp_path.joinpath("run").glob("*.mcap")
    if without == "metadata":
        tmp_path.joinpath("run", "metadata.yaml").unlink()
    else:
        file.write_bytes(file.read_bytes()[:-40] if without == "end" else b"")
    result = CliRunner().invoke(bag, ["check", str(tmp_path / "run")])
    assert result.exit_code == 1
    # The file was written a moment ago.
    advice = f"end the record if it still runs, else try `flexarm bag repair {tmp_path / 'run'}"
    assert (advice in " ".join(result.output.split())) is (without != "messages")
