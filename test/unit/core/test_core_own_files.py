from __future__ import annotations

import os
import tempfile
from typing import TYPE_CHECKING

import pytest

from flexarm_core.own_files import OwnFileError, claimed, is_own_file, private_folder

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make the temporary folder another one, and return where the private one belongs."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path / f"flexarm-{os.getuid()}"


def test_private_folder___is_made_for_this_user_alone_and_found_again(folder: Path) -> None:
    before = os.umask(0)
    try:
        assert private_folder() == folder
    finally:
        os.umask(before)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert private_folder() == folder


def test_private_folder___link_file_or_open_folder___is_refused(
    folder: Path, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir(mode=0o700)
    folder.symlink_to(elsewhere)
    with pytest.raises(OwnFileError, match="is not a folder of this user alone"):
        private_folder()
    folder.unlink()

    folder.write_text("")
    folder.chmod(0o700)
    with pytest.raises(OwnFileError, match="is not a folder of this user alone"):
        private_folder()
    folder.unlink()

    folder.mkdir()
    folder.chmod(0o750)
    with pytest.raises(OwnFileError, match="is not a folder of this user alone"):
        private_folder()


def test_private_folder___of_another_user___is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    private_folder()
    other = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: other)
    folder.rename(folder.with_name(f"flexarm-{other}"))
    with pytest.raises(OwnFileError, match="is not a folder of this user alone"):
        private_folder()


def test_own_file___is_neither_a_link_nor_open_to_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "kept.pickle"
    file.write_text("")
    file.chmod(0o644)
    assert is_own_file(file)

    link = tmp_path / "link.pickle"
    link.symlink_to(file)
    assert not is_own_file(link)

    file.chmod(0o666)
    assert not is_own_file(file)

    file.chmod(0o644)
    monkeypatch.setattr(os, "getuid", lambda: file.stat().st_uid + 1)
    assert not is_own_file(file)


def test_claimed___folder___is_held_for_the_block_alone(tmp_path: Path) -> None:
    def claim() -> int:
        return os.open(tmp_path, os.O_RDONLY)

    with claimed(claim(), OwnFileError("first")):
        with pytest.raises(OwnFileError, match="second"), claimed(claim(), OwnFileError("second")):
            pass
        with pytest.raises(OwnFileError, match="third"), claimed(claim(), OwnFileError("third")):
            pass
    with claimed(claim(), OwnFileError("fourth")):
        pass
