"""Answers to a browser's requests for files, with headers that keep everything else out."""

from __future__ import annotations

from http import HTTPStatus
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Response

from flexarm_ident.report.script import content_policy
from flexarm_live.serving.access import refusal, role_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from urllib.parse import SplitResult

    from websockets.http11 import Request

LIVE = "/live"
"""Path of the WebSocket."""
STOP = "/stop"
"""Path of a WebSocket for the stop alone: nothing waits in it before the stop or its answer."""
DROP = "/drop"
"""Path of a WebSocket for one file that is dropped on the page."""
_REPORT = "/report/"
_INDEX = "index.html"
_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# A report has all inside, and of scripts only that of this version runs.
_REPORT_POLICY = f"{content_policy()}; frame-ancestors 'none'"
_TEXT = "text/plain; charset=utf-8"


class Web:
    """What the server answers before, or instead of, a WebSocket.

    Parameters
    ----------
    files : mapping of str to (bytes, str)
        Content and media type of each file of the page, by its name.
    names : frozenset of str
        Names under which the server is called.
    token : str
        Who knows it may command.
    view_only : bool
        Nobody may.
    report : callable
        Returns the report of a model by its name, or None.
    """

    def __init__(
        self,
        files: Mapping[str, tuple[bytes, str]],
        names: frozenset[str],
        token: str,
        *,
        view_only: bool,
        report: Callable[[str], bytes | None],
    ) -> None:
        self._names = names
        self.token = token
        self.view_only = view_only
        self._report = report
        self._files = files

    def answer(self, request: Request, *, has_room: bool) -> Response | None:
        """Return the answer to a request; None for a WebSocket that may be opened."""
        if why := refusal(request.headers, self._names):
            return _text(HTTPStatus.FORBIDDEN, why)
        address = _parts(request.path)
        if address is None:
            return _text(HTTPStatus.BAD_REQUEST, "no address")
        if address.path not in {LIVE, STOP, DROP}:
            return self._file(address.path)
        if role_of(address.query, self.token, view_only=self.view_only) is None:
            return _text(
                HTTPStatus.FORBIDDEN, "wrong token: open the address that `flexarm up` printed"
            )
        if not has_room:
            return _text(HTTPStatus.SERVICE_UNAVAILABLE, "too many pages are open: close one")
        return None

    def _file(self, path: str) -> Response:
        if path.startswith(_REPORT):
            report = self._report(unquote(path.removeprefix(_REPORT)))
            if report is not None:
                return _response(HTTPStatus.OK, report, "text/html; charset=utf-8", _REPORT_POLICY)
        file = self._files.get(path.removeprefix("/") or _INDEX)
        if file is None:
            return _text(HTTPStatus.NOT_FOUND, "there is no such file")
        return _response(HTTPStatus.OK, *file, _PAGE_POLICY)


def address_of(request: Request) -> SplitResult:
    """Return path and query of a request that was not refused."""
    return urlsplit(request.path)


def _parts(path: str) -> SplitResult | None:
    try:
        return urlsplit(path)
    except ValueError:
        return None


def _text(status: HTTPStatus, text: str) -> Response:
    return _response(status, f"{text}\n".encode(), _TEXT, _PAGE_POLICY)


def _response(status: HTTPStatus, body: bytes, media_type: str, policy: str) -> Response:
    headers = Headers(
        {
            "Content-Type": media_type,
            "Content-Length": str(len(body)),
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
            "Connection": "close",
        }
    )
    return Response(status.value, status.phrase, headers, body)
