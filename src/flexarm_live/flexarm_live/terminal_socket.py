"""Unix socket between the terminal and a running `up`: its place, and both ends of it.

The folder belongs to this user alone, so that no other one can connect. This module imports next to
nothing: a command that only asks a running laboratory has to start quickly.
"""

from __future__ import annotations

import os
import socket
from contextlib import contextmanager
from typing import TYPE_CHECKING

from flexarm_core.clock import slowness
from flexarm_core.own_files import private_folder

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_CONNECT_S = 2.0
_SLASH = "+"
"""In the name of a file, in the place of the slash of a namespace: none has it otherwise."""


def socket_file(namespace: str) -> Path:
    """Return the file of the socket of an arm in this ROS domain."""
    return private_folder() / f"{_prefix()}{namespace.replace('/', _SLASH)}.sock"


def namespaces() -> list[str]:
    """Return the namespaces of the arms that have or had a socket in this ROS domain."""
    prefix = _prefix()
    files = private_folder().glob(f"{prefix}{_SLASH}*.sock")
    return sorted(file.stem.removeprefix(prefix).replace(_SLASH, "/") for file in files)


def _prefix() -> str:
    return f"live_{os.environ.get('ROS_DOMAIN_ID') or '0'}"


def connect(namespace: str) -> socket.socket:
    """Return a connection to the laboratory of an arm.

    Raises
    ------
    OSError
        When there is none.
    """
    connection = socket.socket(socket.AF_UNIX)
    try:
        connection.settimeout(_CONNECT_S * slowness())
        with _short(socket_file(namespace)) as name:
            connection.connect(name)
    except OSError:
        connection.close()
        raise
    return connection


def listen(namespace: str) -> socket.socket:
    """Return a listening socket in the place of one that nobody serves any more.

    Raises
    ------
    OSError
        When another process serves it, or it cannot be made.
    """
    file = socket_file(namespace)
    try:
        connect(namespace).close()
    except OSError:
        file.unlink(missing_ok=True)
    else:
        raise FileExistsError(f"{file} is served by another process")
    listening = socket.socket(socket.AF_UNIX)
    with _short(file) as name:
        listening.bind(name)
    file.chmod(0o600)
    listening.listen()
    return listening


@contextmanager
def _short(file: Path) -> Iterator[str]:
    """Yield another name of a file: that of a socket has at most 107 characters."""
    folder = os.open(file.parent, os.O_PATH | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{file.name}"
    finally:
        os.close(folder)
