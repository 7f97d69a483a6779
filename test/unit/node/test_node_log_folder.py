"""Log files of ROS: in the home folder, or in a private one where that takes none."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexarm_core.errors import SettingError
from flexarm_node.transport import log_settings

NOWHERE = "/proc/none"


def test_home___that_takes_files___is_left_to_ros(tmp_path: Path) -> None:
    assert log_settings({"HOME": str(tmp_path)}) == {}
    assert (tmp_path / ".ros" / "log").is_dir()


@pytest.mark.parametrize("chosen", ["ROS_LOG_DIR", "ROS_HOME"])
def test_folder___that_the_user_has_chosen___stays(chosen: str) -> None:
    assert log_settings({"HOME": NOWHERE, chosen: "/elsewhere"}) == {}


@pytest.mark.parametrize("environment", [{"HOME": NOWHERE}, {}])
def test_home___that_takes_no_files___gives_way_to_a_private_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, environment: dict[str, str]
) -> None:
    monkeypatch.setattr("flexarm_core.own_files.gettempdir", lambda: str(tmp_path))
    folder = Path(log_settings(environment)["ROS_LOG_DIR"])
    assert folder.name == "log"
    assert folder.parent.parent == tmp_path
    assert folder.parent.stat().st_mode & 0o077 == 0


def test_home___and_temporary_folder_that_take_none___are_reported_in_a_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("flexarm_core.own_files.gettempdir", lambda: NOWHERE)
    with pytest.raises(SettingError, match=r"no folder for log files: .*set ROS_LOG_DIR"):
        log_settings({"HOME": NOWHERE})
