from __future__ import annotations

import operator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from reproduction.framework import computing
from reproduction.framework.computing import Store, source_digest
from reproduction.framework.findings import Call

if TYPE_CHECKING:
    from collections.abc import Iterator

CALL = Call(operator.add, (1, 2))


@pytest.fixture(autouse=True)
def _fresh() -> Iterator[None]:
    source_digest.cache_clear()
    yield
    source_digest.cache_clear()


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder that stands for all sources."""
    folder = tmp_path / "package"
    (folder / "room").mkdir(parents=True)
    (folder / "main.py").write_text("FACTOR = 2.0\n")
    (folder / "room" / "other.py").write_text("LEVEL = 1.0\n")
    (folder / "room" / "data.yaml").write_text("a: 1\n")
    (folder / "words.md").write_text("Some words.\n")
    monkeypatch.setattr(computing, "SOURCES", (folder,))
    return folder


def digest_anew() -> str:
    source_digest.cache_clear()
    return source_digest()


@pytest.mark.parametrize("result", [3, None, (1.5, "x"), {"a": [1]}])
def test_store___result_kept___is_found_again(tmp_path: Path, result: object) -> None:
    Store(tmp_path / "new").keep(CALL, result)
    assert Store(tmp_path / "new").find([CALL]) == {CALL: result}


def test_store___array_kept___comes_back_bit_for_bit(tmp_path: Path) -> None:
    values = np.random.default_rng(1).normal(size=(50, 3))
    store = Store(tmp_path)
    store.keep(CALL, values)
    assert store.find([CALL])[CALL].tobytes() == values.tobytes()


def test_store___other_arguments_or_function___are_not_there(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.keep(CALL, 3)
    others = [Call(operator.add, (1, 3)), Call(operator.sub, (1, 2)), Call(operator.add, (1.0, 2))]
    assert store.find(others) == {}


def test_store___file_cut_anywhere___counts_as_none(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.keep(CALL, list(range(100)))
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        assert store.find([CALL]) == {}
    store.keep(CALL, 5)
    assert store.find([CALL]) == {CALL: 5}


def test_store___entry_of_another_call_in_its_place___counts_as_none(tmp_path: Path) -> None:
    store, other = Store(tmp_path), Call(operator.add, (5, 6))
    store.keep(CALL, 3)
    (path,) = tmp_path.iterdir()
    store.keep(other, 11)
    (theirs,) = set(tmp_path.iterdir()) - {path}
    theirs.replace(path)
    assert store.find([CALL]) == {}


def test_store___file_that_others_may_write_or_a_link___counts_as_none(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    store.keep(CALL, 3)
    (path,) = (tmp_path / "store").iterdir()
    path.chmod(0o666)
    assert store.find([CALL]) == {}

    path.chmod(0o600)
    assert store.find([CALL]) == {CALL: 3}
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    assert store.find([CALL]) == {}


def test_store___write_interrupted___leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(tmp_path)
    store.keep(CALL, 3)

    def interrupted(path: Path, _content: bytes) -> None:
        path.write_text("half")
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_bytes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        store.keep(CALL, 4)
    assert store.find([CALL]) == {CALL: 3}
    assert len(list(tmp_path.iterdir())) == 1


def test_store___source_changed___result_is_replaced(tmp_path: Path, package: Path) -> None:
    store = Store(tmp_path / "cache")
    store.keep(CALL, "old")
    (package / "main.py").write_text("FACTOR = 3.0\n")
    source_digest.cache_clear()
    assert store.find([CALL]) == {}
    store.keep(CALL, "new")
    assert store.find([CALL]) == {CALL: "new"}
    assert len(list((tmp_path / "cache").iterdir())) == 1


@pytest.mark.parametrize("name", ["main.py", "room/other.py", "room/data.yaml"])
def test_source_digest___file_changed_moved_or_gone___is_another(package: Path, name: str) -> None:
    path, digests = package / name, {digest_anew()}
    path.write_text(path.read_text().replace("1", "4").replace("2", "4"))
    digests.add(digest_anew())
    path = path.rename(path.with_stem("moved"))
    digests.add(digest_anew())
    path.unlink()
    digests.add(digest_anew())
    assert len(digests) == 4


def test_source_digest___nothing_or_no_source_changed___is_the_same(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = digest_anew()
    (package / "words.md").write_text("Other words.\n")
    assert digest_anew() == before
    # The same sources may lie elsewhere on another machine.
    moved = package.rename(tmp_path / "elsewhere")
    monkeypatch.setattr(computing, "SOURCES", (moved,))
    assert digest_anew() == before


def test_sources___have_the_equations_the_experiments_and_the_thesis() -> None:
    names = {path.name for folder in computing.SOURCES for path in folder.rglob("*")}
    assert {"integrator.py", "beam.py", "pdpc.py", "catalogue.yaml", "table_2_1.yaml"} <= names
