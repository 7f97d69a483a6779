"""Folders of installed packages."""

from __future__ import annotations

from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory


def share_of(package: str) -> Path | None:
    """Return the share folder of a package, which holds its message files; None without one."""
    try:
        return Path(get_package_share_directory(package))
    except PackageNotFoundError:
        return None
