"""Access to the server: Host and Origin of a browser's request, and the token of the start.

A browser sends requests of any page that it shows. The name in `Host` is that of the address bar: a
foreign name that was made to mean this machine (DNS rebinding) stands there. `Origin` is the page
that asks for a WebSocket. Who knows the token may command; it is in the opened address behind a
`#`, so that it is in no request but that of the WebSocket, and in nobody's log.
"""

from __future__ import annotations

import hmac
from enum import Enum
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from collections.abc import Mapping

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
"""Names of this machine in an address. The port may be that of a tunnel."""


class Role(Enum):
    """Rights of a client."""

    VIEWER = "viewer"
    """Sees everything, commands nothing."""
    HAND = "hand"
    """May command."""
    OWNER = "owner"
    """The terminal of the user who started the server: may command, and gets the token."""


def refusal(headers: Mapping[str, str], own_names: frozenset[str]) -> str:
    """Return why a request is refused by its headers; empty when it is not.

    Parameters
    ----------
    headers : mapping of str to str
        Headers of the request. A browser always names the origin of a WebSocket, so a program that
        leaves it out is none.
    own_names : frozenset of str
        Names under which the server is called.
    """
    host = headers.get("Host", "")
    if _host_name(host) not in own_names:
        return f"Host {host[:100]!r} is not this server"
    origin = headers.get("Origin")
    if origin is not None and origin != f"http://{host}":
        return f"Origin {origin[:100]!r} is not this server's page"
    return ""


def role_of(query: str, token: str, *, view_only: bool) -> Role | None:
    """Return the rights that the query of an address gives; None for a wrong token.

    Parameters
    ----------
    query : str
        Such as ``token=...``; without a token the client may look on.
    token : str
        The right token.
    view_only : bool
        The right token gives no more rights than none.
    """
    given = parse_qs(query, keep_blank_values=True).get("token")
    if given is None:
        return Role.VIEWER
    if len(given) != 1 or not hmac.compare_digest(given[0].encode(), token.encode()):
        return None
    return Role.VIEWER if view_only else Role.HAND


def _host_name(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
