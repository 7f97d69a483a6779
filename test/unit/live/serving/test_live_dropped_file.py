"""Files that are dropped on the page: whole in their own folder, or refused in one line."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from flexarm_core.errors import FlexarmError
from flexarm_live.graph.store import Store, signals_of
from flexarm_live.serving import desk
from flexarm_live.serving.desk import receive_file
from support.exhaustive import first_of
from support.live_server import PATIENCE_S, TOKEN, LiveServer, MemoryLaboratory, live_server, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PIECE = 60_000


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tempfile.tempdir", str(tmp_path_factory.mktemp("live")))
        laboratory = MemoryLaboratory()
        laboratory.store = Store(tmp_path_factory.mktemp("records"))
        with live_server(laboratory) as server:
            yield server


@pytest.fixture
def folder(live: LiveServer) -> Path:
    assert live.laboratory.store is not None
    return live.laboratory.store.folder / "dropped"


def dropped(
    live: LiveServer,
    name: str,
    content: bytes = b"t,u,y\n",
    *,
    query: str = f"?token={TOKEN}&",
    origin: str | None = None,
) -> dict[str, Any]:
    """Send a file as the page does and return the answer."""
    address = f"ws://127.0.0.1:{live.port}/drop{query}name={name}"
    with connect(address, origin=origin, compression=None, close_timeout=2.0) as page:  # type: ignore[arg-type]
        # A refusal comes while pieces are on their way.
        with suppress(ConnectionClosed):
            for at in range(0, len(content), PIECE):
                page.send(content[at : at + PIECE])
            page.send("end")
        answer: dict[str, Any] = json.loads(page.recv(PATIENCE_S))
    return answer


def test_file___dropped_in_pieces___is_a_record_with_its_bytes(
    live: LiveServer, folder: Path
) -> None:
    content = bytes(range(256)) * 500
    answer = dropped(live, "my%20run.csv", content)
    assert (answer["ok"], answer["data"]) == (True, {"bag": "my run.csv"})
    assert (folder / "my run.csv").read_bytes() == content
    store = live.laboratory.store
    assert store is not None
    assert store.bag("my run.csv") == folder / "my run.csv"


def test_folder_of_a_bag___dropped_file_by_file___is_a_record(
    live: LiveServer, folder: Path
) -> None:
    for file in ("metadata.yaml", "run_0.mcap"):
        assert dropped(live, f"run/{file}")["data"] == {"bag": "run"}
    store = live.laboratory.store
    assert store is not None
    assert store.bag("run") == folder / "run"
    assert not list(folder.rglob(".*"))


@pytest.mark.parametrize(
    "name",
    first_of(
        [
            "..%2Fx.csv",
            "a/b/c.csv",
            "%2Fetc%2Fx.csv",
            ".x.csv",
            "a/..",
            "..%5Cx.csv",
            "",
            "x%00.csv",
            "x" * 300 + ".csv",
            "page.html",
            "metadata.yaml",
            "table.xlsx",
        ],
        4,
    ),
)
@pytest.mark.slow
def test_name___that_is_none_of_a_record___is_refused_and_nothing_is_written(
    live: LiveServer, folder: Path, name: str
) -> None:
    def there() -> set[Path]:
        return set(folder.parent.parent.rglob("*"))

    before = there()
    answer = dropped(live, name)
    assert answer["ok"] is False
    assert "drop a" in answer["message"]
    assert there() == before


def test_name_of_a_record_of_the_arm___is_refused(tmp_path: Path) -> None:
    bag = tmp_path / "live_1.csv"
    bag.mkdir()
    (bag / "metadata.yaml").touch()
    with pytest.raises(FlexarmError, match=r"live_1\.csv: a record of the arm has that name"):
        Store(tmp_path).place_for("live_1.csv")


def test_page_without_a_token___that_drops_a_file___may_only_look_on(
    live: LiveServer, folder: Path
) -> None:
    answer = dropped(live, "viewer.csv", query="?")
    assert "may only look on" in answer["message"]
    assert not (folder / "viewer.csv").exists()


@pytest.mark.parametrize(
    ("query", "origin"), [("?token=wrong&", None), (f"?token={TOKEN}&", "http://evil.example")]
)
def test_drop___with_a_wrong_token_or_origin___is_refused(
    live: LiveServer, query: str, origin: str | None
) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        dropped(live, "x.csv", query=query, origin=origin)


def test_file___larger_than_allowed___is_refused_and_leaves_nothing(
    live: LiveServer, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def receive_little(connection: Any, place: Path) -> None:  # noqa: ANN401
        await receive_file(connection, place, 1000)

    monkeypatch.setattr(desk, "receive_file", receive_little)
    assert "large.csv is larger than 0.001 MB" in dropped(live, "large.csv", bytes(1001))["message"]
    assert not (folder / "large.csv").exists()
    assert not [*folder.glob(".*")]


def test_file___of_a_page_that_goes_away___leaves_nothing(live: LiveServer, folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    with connect(f"ws://127.0.0.1:{live.port}/drop?token={TOKEN}&name=half.csv") as page:
        page.send(b"t,u")
        until(lambda: any(folder.glob(".*")))
    until(lambda: not any(folder.glob(".*")))
    assert not (folder / "half.csv").exists()
    with pytest.raises(ConnectionClosed):
        page.recv(0.0)


def test_signals_of_a_table___have_their_units_and_the_roles_that_names_say(
    tmp_path: Path,
) -> None:
    file = tmp_path / "log.csv"
    file.write_text("time_ms,torque,angle [deg],tip_v\n0,1,2,3\n1,1,2,3\n2,1,2,3\n")
    reported = signals_of(file)
    rows = [(each["name"], each["role"], each["unit"]) for each in reported["signals"]]
    assert rows == [
        ("time_ms", "time", ""),
        ("torque", "input", ""),
        ("angle [deg]", "output", "deg"),
        ("tip_v", "output", "V"),
    ]
    assert reported["endings"]["rad/s"] in {"_rad_per_s", "_rad_s"}
