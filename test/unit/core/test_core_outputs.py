from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from flexarm_core.outputs import (
    HEAD_BYTES,
    MARK,
    OutputError,
    is_replaceable,
    require_folder,
    require_place,
)

if TYPE_CHECKING:
    from pathlib import Path

OURS = [
    f"# {MARK}\nx: 1\n",
    f"<!DOCTYPE html>\n<!-- {MARK} -->\n",
    '{\n "written_by": "flexarm",\n "a": 1}',
    '{"written_by":"flexarm"}',
    "",
]
OTHERS = ["mine\n", "/flexarm/controller:\n", " " * HEAD_BYTES + MARK, "written by hand"]


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize("text", OURS)
def test_file___with_the_mark_or_empty___may_be_replaced(tmp_path: Path, text: str) -> None:
    file = tmp_path / "file"
    file.write_text(text)
    assert is_replaceable(file)
    require_place([file])
    assert file.read_text() == text


@pytest.mark.parametrize("text", OTHERS)
def test_file___of_somebody_else___is_refused_unless_forced(tmp_path: Path, text: str) -> None:
    missing, file = tmp_path / "missing", tmp_path / "file"
    file.write_text(text)
    assert not is_replaceable(file)
    with pytest.raises(OutputError, match=r"file: was not written by flexarm: .* with --force"):
        require_place([missing, file])
    require_place([missing, file], force=True)
    assert file.read_text() == text
    assert names_in(tmp_path) == {"file"}


def test_link___counts_as_what_it_leads_to(tmp_path: Path) -> None:
    ours, mine = tmp_path / "ours", tmp_path / "mine"
    ours.write_text(MARK)
    mine.write_text("mine")
    found = {}
    for target in (ours, mine, tmp_path / "nowhere"):
        link = tmp_path / f"to_{target.name}"
        link.symlink_to(target)
        found[target.name] = is_replaceable(link)
    assert found == {"ours": True, "mine": False, "nowhere": False}


@pytest.mark.timeout(60)
def test_pipe___is_refused_without_waiting_for_a_writer(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OutputError, match="pipe: was not written by flexarm"):
        require_place([pipe])


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("name", ["file/inside/x.yaml", "folder", "nul\0/x.yaml", "a" * 300])
def test_place___that_cannot_be_written___is_refused_and_leaves_no_trace(
    tmp_path: Path,
    name: str,
    force: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="cannot be written: "):
        require_place([tmp_path / name], force=force)
    assert names_in(tmp_path) == {"file", "folder"}


def test_place___in_folders_that_are_missing___is_good_and_is_not_made(tmp_path: Path) -> None:
    require_place([tmp_path / "a" / "b" / "x.yaml"])
    assert names_in(tmp_path) == set()


def test_folder___that_cannot_be_written___is_named_with_its_option(tmp_path: Path) -> None:
    require_folder(tmp_path / "a" / "b", "-o")
    assert names_in(tmp_path) == set()
    (tmp_path / "file").touch()
    with pytest.raises(
        OutputError, match=r"file: cannot be written: it is not a folder; .* with -o"
    ):
        require_folder(tmp_path / "file", "-o")
    with pytest.raises(OutputError, match=r"b: cannot be written in .*file: it is not a folder"):
        require_folder(tmp_path / "file" / "b", "-o")
