"""Hostile clients of the live server: each is refused with a reason, and the others go on."""

from __future__ import annotations

import json
import math
import os
import socket
from base64 import b64encode
from contextlib import ExitStack, suppress
from hashlib import sha256
from typing import TYPE_CHECKING

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from flexarm_ident.report.script import script
from flexarm_live.serving.desk import LARGEST_MESSAGE, MOST_AT_WORK, MOST_CLIENTS, MOST_WAITING
from flexarm_live.serving.requests import VERBS, RequestError, parse
from support.live_server import (
    PATIENCE_S,
    TOKEN,
    LiveServer,
    ask,
    live_server,
    received,
    reply_to,
    until,
    until_closed,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from websockets.sync.client import ClientConnection


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tempfile.tempdir", str(tmp_path_factory.mktemp("live")))
        with live_server() as server:
            yield server


@pytest.fixture
def good(live: LiveServer) -> Iterator[ClientConnection]:
    """A page of the user, which must not notice anything."""
    with live.page() as page:
        assert received(page)["hand"] is True
        live.laboratory.asked.clear()
        yield page
        assert ask(page, do="bags")["ok"] is True


def test_page___without_a_token___sees_and_cannot_command(
    live: LiveServer, good: ClientConnection
) -> None:
    with live.page(query="") as page:
        assert received(page)["hand"] is False
        assert received(page)["badge"] == "READY"
        assert ask(page, do="bags")["ok"] is True
        for request in ({"do": "stop"}, {"do": "reference", "value": 1.0}, {"do": "hold"}):
            refused = ask(page, **request)
            assert refused["ok"] is False
            assert "may only look on" in refused["message"]
    assert [each.verb for each in live.laboratory.asked] == ["bags"]
    assert good.protocol.state.name == "OPEN"


@pytest.mark.parametrize("token", ["wrong", "", TOKEN[:-1], f"{TOKEN}x", "%00", "%FF", "é"])
@pytest.mark.usefixtures("good")
def test_page___with_a_wrong_token___is_refused(live: LiveServer, token: str) -> None:
    with pytest.raises(InvalidStatus, match="403"), live.page(query=f"?token={token}&x=1"):
        pass


@pytest.mark.usefixtures("good")
def test_page___with_two_tokens___is_refused(live: LiveServer) -> None:
    with pytest.raises(InvalidStatus, match="403"), live.page(f"?token={TOKEN}&token=x"):
        pass


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1", "file://"],
)
@pytest.mark.usefixtures("good")
def test_page___of_a_foreign_origin___is_refused(live: LiveServer, origin: str) -> None:
    with pytest.raises(InvalidStatus, match="403") as refused, live.page(origin=origin):
        pass
    assert origin.encode() in (refused.value.response.body or b"")


@pytest.mark.parametrize("tail", [".evil.example", "0", "@evil.example", "/", " "])
@pytest.mark.usefixtures("good")
def test_page___of_an_origin_that_only_begins_as_ours___is_refused(
    live: LiveServer, tail: str
) -> None:
    status, _, body = live.get("/live", Origin=f"http://127.0.0.1:{live.port}{tail}x")
    assert status == 403
    assert b"is not this server's page" in body


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "x.localhost",
        "xlocalhost:80",
        "localhost.",
        "x127.0.0.1",
        "evil.example:80",
        "127.0.0.1.evil.example",
        "",
        "[",
        "127.0.0.1@evil.example",
    ],
)
@pytest.mark.parametrize("path", ["/", f"/live?token={TOKEN}", "/report/arm"])
def test_request___to_a_rebound_host___is_refused(live: LiveServer, host: str, path: str) -> None:
    status, _, body = live.get(path, Host=host)
    assert status == 403
    assert b"is not this server" in body


@pytest.mark.parametrize("host", ["localhost", "[::1]", "127.0.0.1"])
def test_request___through_a_tunnel___is_answered(live: LiveServer, host: str) -> None:
    status, headers, body = live.get("/", Host=f"{host}:9000", Origin=f"http://{host}:9000")
    assert status == 200
    assert body.startswith(b"<!doctype html>")
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "default-src 'none'; script-src 'self'" in headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    "path",
    [
        "/../server.py",
        "/page/index.html",
        "/%2e%2e/server.py",
        "/..%2fserver.py",
        "//etc/passwd",
        "/report/../arm",
        "/report/",
        "/report/%2e%2e%2farm",
        "/index.html%00.js",
        "/live/../index.html",
        "/__init__.py",
    ],
)
def test_request___for_a_path_out_of_the_page___finds_nothing(live: LiveServer, path: str) -> None:
    status, headers, body = live.get(path)
    assert status == 404
    assert headers["Content-Type"].startswith("text/plain")
    assert body == b"there is no such file\n"


def test_request___for_the_report___runs_no_script_but_its_own(live: LiveServer) -> None:
    status, headers, body = live.get("/report/arm")
    assert (status, body) == (200, b"<!DOCTYPE html>")
    digest = b64encode(sha256(script().encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}';" in headers["Content-Security-Policy"]
    assert headers["Content-Security-Policy"].startswith("default-src 'none'")


@pytest.mark.parametrize(
    "sent",
    [
        b"\x00\xff" * 200 + b"\r\n\r\n",
        b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 3\r\n\r\nabc",
        b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"X: y\r\n" * 1000 + b"\r\n",
        b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ],
)
@pytest.mark.usefixtures("good")
def test_request___that_is_none___ends_the_connection(live: LiveServer, sent: bytes) -> None:
    with suppress(ConnectionResetError):
        assert b"HTTP/1.1 200" not in live.raw(sent)


@pytest.mark.usefixtures("good")
def test_page___with_an_oversized_message___is_closed(live: LiveServer) -> None:
    with live.page() as page:
        page.send("x" * (LARGEST_MESSAGE + 1))
        assert until_closed(page)[0] == 1009


@pytest.mark.usefixtures("good")
@pytest.mark.parametrize(
    ("messages", "reported"),
    # A page that is too busy to answer the close within a second is cut off without a word.
    [(500, {"more than 200 messages a second"}), (10_000, {"more than 200 messages a second", ""})],
)
def test_page___with_many_messages_at_once___is_closed(
    live: LiveServer, messages: int, reported: set[str]
) -> None:
    with live.page() as page:
        with suppress(ConnectionClosed):
            for number in range(messages):
                page.send(json.dumps({"id": number, "do": "hold"}))
        assert until_closed(page)[1] in reported
    until(lambda: live.server.holder == "")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "garbage",
        "[]",
        "7",
        "null",
        b"\xff\xfe\x00",
        "[" * 50_000,
        '{"id": 7, "do": "status"',
        '{"id": 7, "do": NaN}',
        '{"id": 7, "do": 1e999}',
        '{"id": 1e99, "do": "status"}',
        '{"id": true, "do": "status"}',
        '{"id": false, "do": "status"}',
        '{"id": 9007199254740993, "do": "status"}',
        '{"id": -9007199254740993, "do": "status"}',
        '{"id": 7}',
        '{"id": 7, "do": ["stop"]}',
        '{"id": 7, "do": "__init__"}',
        '{"id": 7, "do": "status", "more": 1}',
    ],
)
def test_garbage___is_refused___with_a_reason(good: ClientConnection, text: str | bytes) -> None:
    good.send(text)
    while (message := received(good))["type"] != "reply":
        pass
    assert message["ok"] is False
    assert message["message"]


@pytest.mark.parametrize(
    ("request_", "word"),
    [
        ('"do": "reference", "value": NaN', "JSON"),
        ('"do": "reference", "value": Infinity', "JSON"),
        ('"do": "reference", "value": 1e999', "finite"),
        ('"do": "reference", "value": 1, "joint": 2', "text"),
        ('"do": "reference", "value": "1"', "finite"),
        ('"do": "reference", "value": true', "finite"),
        ('"do": "reference", "value": ' + "9" * 400, "finite"),
        ('"do": "reference"', "missing"),
        ('"do": "payload", "kg": 2', "outside 0 to 1"),
        ('"do": "referense", "value": 1', "nearest: reference"),
        ('"do": "law", "name": ' + json.dumps("x" * 501), "at most 500"),
        ('"do": "law", "name": "a\\nb"', "one line"),
        ('"do": "set", "node": "daq", "name": "a", "value": {"b": 1}', "value"),
        ('"do": "waveform", "kind": "noise"', "one of none, sine"),
        ('"do": "identify", "bag": "a", "order": 1.5', "whole number"),
        ('"do": "apply", "gains": {}', "1 to 64"),
        ('"do": "address"', "terminal"),
    ],
)
def test_value___that_cannot_be___is_refused(
    live: LiveServer, good: ClientConnection, request_: str, word: str
) -> None:
    good.send(f'{{"id": 7, {request_}}}')
    while (message := received(good))["type"] != "reply":
        pass
    assert message["ok"] is False
    assert word in message["message"]
    assert live.laboratory.asked == []


@pytest.mark.parametrize(
    ("verb", "name"),
    [
        (verb, name)
        for verb, each in VERBS.items()
        for name, field in each.fields.items()
        if math.isfinite(field.most)
    ],
)
def test_number___at_a_bound___is_taken_and_the_next_one_is_refused(verb: str, name: str) -> None:
    field = VERBS[verb].fields[name]
    for bound, beyond in ((field.least, -math.inf), (field.most, math.inf)):
        whole = field.kind == "integer"
        at = int(bound) if whole else bound
        past = at + int(math.copysign(1, beyond)) if whole else math.nextafter(bound, beyond)
        assert field.checked(name, at) == at
        with pytest.raises(RequestError, match=r"outside|must be a whole number"):
            field.checked(name, past)


@pytest.mark.parametrize("number", [2**53, -(2**53), 0])
def test_id___of_the_largest_size___is_taken(number: int) -> None:
    assert parse(json.dumps({"id": number, "do": "status"})).number == number


def test_two_commanders___the_second___is_refused_until_the_first_lets_go(
    live: LiveServer, good: ClientConnection
) -> None:
    assert ask(good, do="reference", value=1.0)["ok"] is True
    with live.page() as second:
        refused = ask(second, do="reference", value=2.0)
        assert refused["ok"] is False
        assert "has control of the set-point" in refused["message"]
        # Whoever sees danger may stop.
        assert ask(second, do="stop")["ok"] is True
        assert ask(good, do="let_go")["ok"] is True
        assert ask(second, do="reference", value=2.0)["ok"] is True
        assert ask(good, do="reference", value=3.0)["ok"] is False
    until(lambda: live.server.holder == "")
    volts = [each.fields["value"] for each in live.laboratory.asked if each.verb == "reference"]
    assert volts == [1.0, 2.0]


def test_commander___that_goes_away___lets_go(live: LiveServer, good: ClientConnection) -> None:
    with live.page() as first:
        assert ask(first, do="hold")["ok"] is True
        until(lambda: live.server.holder != "")
    until(lambda: live.server.holder == "")
    assert ask(good, do="hold")["ok"] is True
    assert ask(good, do="let_go")["ok"] is True


def test_stop___behind_requests_that_take_long___is_carried_out_at_once(
    live: LiveServer, good: ClientConnection
) -> None:
    for number in range(MOST_AT_WORK + 1):
        good.send(json.dumps({"id": 100 + number, "do": "activate"}))
    assert "are at work" in reply_to(good, 100 + MOST_AT_WORK)["message"]
    assert ask(good, do="stop")["ok"] is True
    assert [each.verb for each in live.laboratory.asked] == ["stop"]
    live.server.call(live.laboratory.let_on.set)
    assert reply_to(good, 100)["ok"] is True
    until(lambda: len(live.laboratory.asked) == 1 + MOST_AT_WORK)
    assert ask(good, do="let_go")["ok"] is True


def test_page___that_does_not_read___is_dropped_and_not_waited_for(
    live: LiveServer, good: ClientConnection
) -> None:
    frame = bytes(500_000)
    with socket.socket() as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", live.port))
        head = f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{live.port}\r\nUpgrade: websocket\r\n"
        key = "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        slow.sendall(f"{head}{key}Sec-WebSocket-Key: {'A' * 22}==\r\n\r\n".encode())
        until(lambda: live.server.pages == 2)
        sent = 0
        while live.server.pages == 2:
            assert sent < 20_000_000
            live.server.send_samples(frame)
            sent += len(frame)
            while not isinstance(good.recv(PATIENCE_S), bytes):
                pass
    assert sent > MOST_WAITING


def test_pages___too_many_of_them___are_refused(live: LiveServer, good: ClientConnection) -> None:
    with ExitStack() as pages:
        for _ in range(MOST_CLIENTS - 1):
            pages.enter_context(live.page())
        with pytest.raises(InvalidStatus, match="503"), live.page():
            pass
    until(lambda: live.server.pages == 1)
    assert ask(good, do="bags")["ok"] is True


def test_page___that_breaks_off_in_a_frame___is_forgotten(live: LiveServer) -> None:
    with live.page() as page:
        until(lambda: live.server.pages == 1)
        page.socket.sendall(b"\x81\xfe\x01\x00half")
        page.socket.shutdown(socket.SHUT_RDWR)
        until(lambda: live.server.pages == 0)


def test_view_only___with_the_right_token___cannot_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with live_server(view_only=True) as live, live.page() as page:
        assert TOKEN not in live.server.address
        assert received(page)["hand"] is False
        assert ask(page, do="stop")["ok"] is False


def test_socket_of_the_terminal___is_for_its_user_alone(live: LiveServer) -> None:
    from flexarm_live.terminal_socket import socket_file  # noqa: PLC0415 - used once

    file = socket_file(live.namespace)
    assert file.stat().st_mode & 0o777 == 0o600
    assert file.parent.stat().st_mode & 0o777 == 0o700
    assert file.stat().st_uid == os.getuid()
