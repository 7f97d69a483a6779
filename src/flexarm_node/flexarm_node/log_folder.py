"""Folder of ROS's log files where the home folder takes none."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_core.errors import SettingError
from flexarm_core.own_files import OwnFileError, private_folder

if TYPE_CHECKING:
    from collections.abc import Mapping

_LOG = "ROS_LOG_DIR"
_ROS_HOME = "ROS_HOME"


def log_settings(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment variables with which ROS finds a folder for its log files.

    There are none where it can write in `~/.ros/log`, or where the user has chosen the folder.
    Otherwise ROS would not start: the folder is a private one among the temporary files.

    Raises
    ------
    SettingError
        When there is no such folder either.
    """
    if environment.get(_LOG) or environment.get(_ROS_HOME):
        return {}
    if _takes_files(Path(environment.get("HOME", os.devnull), ".ros", "log")):
        return {}
    try:
        return {_LOG: str(private_folder() / "log")}
    except (OwnFileError, OSError) as error:
        raise SettingError(f"no folder for log files: {error}; set {_LOG} to one") from None


def _takes_files(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)
