"""What the live server says to a page and to a terminal."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING

import numpy as np
import pytest
from websockets.sync.client import connect as connect_page

from flexarm_live.serving.desk import LARGEST_MESSAGE, Outbox, RateLimit
from flexarm_live.serving.encoding import HEAD, as_json, frame_of
from flexarm_live.terminal_socket import connect, listen
from support.live_server import (
    PATIENCE_S,
    TOKEN,
    LiveServer,
    MemoryLaboratory,
    ask,
    live_server,
    received,
    until,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with pytest.MonkeyPatch.context() as patch:
        # Deeper than a name of a socket may be long.
        deep = tmp_path_factory.mktemp("live") / ("d" * 100)
        deep.mkdir()
        patch.setattr("tempfile.tempdir", str(deep))
        with live_server() as server:
            yield server


def test_page___at_first___gets_hello_and_state(live: LiveServer) -> None:
    with live.page() as page:
        assert received(page) == {"type": "hello", "version": 1, "hand": True, "rate_hz": 300.0}
        state = received(page)
    assert state["badge"] == "READY"
    assert state["late_ms"] == {"p50": None}
    assert state["holder"] is False


def test_state___on_a_hold___says_each_page_who_has_it(live: LiveServer) -> None:
    with live.page() as first, live.page() as second:
        assert ask(first, do="hold")["ok"] is True
        while not (state := received(first)).get("holder"):
            pass
        assert state["holder_name"] == ""
        while not (state := received(second)).get("holder_name"):
            pass
        assert state["holder"] is False
        assert state["holder_name"].startswith("page ")


def test_request___carried_out___is_answered_by_its_number(live: LiveServer) -> None:
    with live.page() as page:
        reply = ask(page, do="law", name="pdpc")
        assert reply["ok"] is True
        assert reply["data"] == {"verb": "law"}
        refused = ask(page, do="law", name="none")
        assert refused["ok"] is False
        assert refused["message"] == "law = 'none': must be one of pd, pdpc"


def test_connection_for_the_stop___is_reported_of_the_stop_alone(live: LiveServer) -> None:
    pages = live.server.pages
    with connect_page(f"ws://127.0.0.1:{live.port}/stop?token={TOKEN}") as stop:
        live.server.send_samples(b"a frame of samples")
        live.server.send_state()
        stop.send(json.dumps({"id": 5, "do": "stop"}))
        answer = json.loads(stop.recv(PATIENCE_S))
        assert (answer["id"], answer["ok"]) == (5, True)
        # Those of other tests may still be leaving.
        assert live.server.pages <= pages


def test_samples___reach_every_page___as_they_were(live: LiveServer) -> None:
    times_s = np.array([1e9, 1e9 + 0.002, 1e9 + 0.004])
    rows = np.arange(24.0).reshape(3, 8)
    frame = frame_of(times_s, rows)
    magic, count, columns, reserved, start_s = HEAD.unpack_from(frame)
    assert struct.pack("<I", magic) == b"1XLF"
    assert (count, columns, reserved, start_s) == (3, 9, 0, 1e9)
    content = np.frombuffer(frame, "<f4", offset=HEAD.size).reshape(3, 9)
    np.testing.assert_allclose(content[:, 0], [0.0, 0.002, 0.004], atol=1e-6)
    np.testing.assert_array_equal(content[:, 1:], rows)
    with live.page() as one, live.page() as other:
        until(lambda: live.server.pages == 2)
        live.server.send_samples(frame)
        for page in (one, other):
            while not isinstance(got := page.recv(PATIENCE_S), bytes):
                pass
            assert got == frame


def test_terminal___asks_and_commands___without_a_token_or_the_hand(live: LiveServer) -> None:
    with live.page() as page, connect(live.namespace) as terminal:
        assert ask(page, do="hold")["ok"] is True
        lines = terminal.makefile("rw")
        for request in (
            {"id": 1, "do": "address"},
            {"id": 2, "do": "reference", "value": 1.5},
            {"id": 3, "do": "status"},
        ):
            lines.write(json.dumps(request) + "\n")
        lines.flush()
        address, reference, status = (json.loads(lines.readline()) for _ in range(3))
    assert address["data"] == {"url": f"http://127.0.0.1:{live.port}/#token={TOKEN}"}
    assert reference["ok"] is True
    assert status["data"]["badge"] == "READY"
    assert status["data"]["holder_name"].startswith("page ")


def test_terminal___that_gave_up___has_its_request_withdrawn_unless_it_is_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    laboratory = MemoryLaboratory()
    laboratory.slow = {"law", "stop"}
    with live_server(laboratory) as server:
        for request in ('{"do": "stop"}', '{"do": "law", "name": "pdp"}'):
            with connect(server.namespace) as terminal:
                terminal.sendall(f"{request}\n".encode())
        until(lambda: laboratory.withdrawn == ["law"])
        server.server.call(laboratory.let_on.set)
        until(lambda: [each.verb for each in laboratory.asked] == ["stop"])


def test_terminal___asks_for_hello_and_samples___which_no_page_may(live: LiveServer) -> None:
    with live.page() as page, connect(live.namespace) as terminal:
        lines = terminal.makefile("rw")
        lines.write('{"do": "hello"}\n{"do": "samples", "after": 7}\n')
        lines.flush()
        hello, samples = (json.loads(lines.readline()) for _ in range(2))
        refused = ask(page, do="samples", after=7)
    assert hello["data"]["rate_hz"] == 300.0
    assert samples["data"] == {"verb": "samples"}
    assert "only the terminal" in refused["message"]


def test_terminal___that_waits_when_the_server_ends___is_no_news_for_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with live_server() as server, connect(server.namespace) as terminal:
        terminal.sendall(b'{"do": "status"}\n')
        terminal.makefile().readline()
        server.server.stop()
        assert terminal.recv(1) == b""
    assert caplog.records == []


def test_terminal___with_an_endless_line___is_cut_off(live: LiveServer) -> None:
    with connect(live.namespace) as terminal:
        terminal.settimeout(PATIENCE_S)
        try:
            terminal.sendall(b"x" * (2 * LARGEST_MESSAGE + 1000))
            assert terminal.recv(100) == b""
        except (BrokenPipeError, ConnectionResetError):
            pass
    with connect(live.namespace) as terminal:
        terminal.sendall(b'{"id": 1, "do": "status"}\n')
        assert json.loads(terminal.makefile().readline())["ok"] is True


def test_socket___that_is_served___is_not_taken_over(live: LiveServer) -> None:
    with pytest.raises(FileExistsError, match="another process"):
        listen(live.namespace)


def test_rate_limit___allows___so_many_in_any_second() -> None:
    rate = RateLimit(3)
    times_s = (0.0, 0.5, 0.9, 0.99, 1.1, 2.2)
    assert [rate.allows(time_s) for time_s in times_s] == [True, True, True, False, False, True]


def test_outbox___is_bounded___by_bytes() -> None:
    outbox = Outbox(10)
    assert outbox.put(b"12345")
    assert outbox.put("12345")
    assert not outbox.put("1")
    assert outbox.take() == b"12345"
    assert outbox.put("1")
    assert outbox.waiting_bytes == 6


def test_json___of_figures_that_are_none___has_null() -> None:
    message = {"a": float("nan"), "b": [np.float64(1.5), np.inf], "c": np.array([1, 2]), "d": "NaN"}
    assert json.loads(as_json(message)) == {"a": None, "b": [1.5, None], "c": [1, 2], "d": "NaN"}
