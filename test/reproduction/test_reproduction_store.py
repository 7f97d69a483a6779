from __future__ import annotations

import operator
import sys
from typing import TYPE_CHECKING

import joblib
import numpy as np
import pytest

from reproduction.framework import source_digest as digests
from reproduction.framework.records import simulated_record
from reproduction.framework.source_digest import source_digest
from reproduction.framework.store import Store
from reproduction.framework.subjects import Call

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import Any

CALL = Call(operator.add, (1, 2))
PACKAGE = "flexarm_madeup"
SOURCE = '''
"""Some words."""
from importlib.resources import files

from flexarm_madeup.other import helped

FACTOR = 2.0


def wanted(x: float) -> float:
    """Say something."""
    return helped(FACTOR * x)


def reads(name: str) -> str:
    return (files("flexarm_madeup") / name).read_text()


def unrelated() -> int:
    return 1
'''
OTHER = "def helped(x: float) -> float:\n    return x + 1.0\n"


def forget() -> None:
    for cached in (digests._digest, digests._module, digests._text, digests._used):
        cached.cache_clear()


@pytest.fixture(autouse=True)
def _fresh() -> Iterator[None]:
    forget()
    yield
    forget()


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / PACKAGE
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "main.py").write_text(SOURCE)
    (folder / "other.py").write_text(OTHER)
    (folder / "data.yaml").write_text("a: 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in [name for name in sys.modules if name.startswith(PACKAGE)]:
        monkeypatch.delitem(sys.modules, name)
    return folder


def madeup(name: str) -> Callable[..., Any]:
    function: Callable[..., Any] = getattr(__import__(f"{PACKAGE}.main").main, name)
    return function


def digest_after(package: Path, file: str, old: str, new: str, name: str = "wanted") -> bool:
    """Whether the digest is another one after a change."""
    function = madeup(name)
    before = source_digest(function)
    path = package / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    forget()
    return source_digest(function) != before


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
    for length in range(0, len(whole), 7):
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


def test_store___write_interrupted___leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(tmp_path)
    store.keep(CALL, 3)

    def interrupted(_content: object, name: str, **_: object) -> None:
        with open(name, "wb") as file:  # noqa: PTH123 - half a file, as it would be
            file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(joblib, "dump", interrupted)
    with pytest.raises(KeyboardInterrupt):
        store.keep(CALL, 4)
    assert store.find([CALL]) == {CALL: 3}
    assert len(list(tmp_path.iterdir())) == 1


def test_store___source_changed___result_is_replaced(tmp_path: Path, package: Path) -> None:
    store, call = Store(tmp_path / "cache"), Call(madeup("wanted"), (1.0,))
    store.keep(call, "old")
    assert digest_after(package, "other.py", "1.0", "2.0")
    assert store.find([call]) == {}
    store.keep(call, "new")
    assert store.find([call]) == {call: "new"}
    assert len(list((tmp_path / "cache").iterdir())) == 1


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("main.py", "FACTOR * x", "x"),
        ("main.py", "FACTOR = 2.0", "FACTOR = 3.0"),
        ("other.py", "x + 1.0", "x - 1.0"),
        ("main.py", "def unrelated", "print()\ndef unrelated"),
    ],
)
def test_source_digest___change_of_what_is_used___changes_it(
    package: Path, file: str, old: str, new: str
) -> None:
    assert digest_after(package, file, old, new)


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("main.py", "return 1", "return 2"),
        ("main.py", "Some words", "Other words"),
        ("main.py", "Say something", "Say nothing"),
        ("main.py", "helped(FACTOR * x)", "helped( FACTOR*x )  # a comment"),
        ("data.yaml", "1", "2"),
    ],
)
def test_source_digest___change_of_what_is_not_used___leaves_it(
    package: Path, file: str, old: str, new: str
) -> None:
    assert not digest_after(package, file, old, new)


def test_source_digest___function_that_reads_files___depends_on_the_data(package: Path) -> None:
    assert digest_after(package, "data.yaml", "1", "2", name="reads")


def test_source_digest___simulated_record___reaches_the_equations_but_no_node_or_plot() -> None:
    places, data = digests._reached((simulated_record.__module__, simulated_record.__name__))
    modules = {module for module, _ in places}
    assert {
        "flexarm_daq.rigs.integrator",
        "flexarm_daq.rigs.beam",
        "flexarm_control.laws.pdpc",
    } <= modules
    assert not {each for each in modules if each.endswith("_node") or "plot" in each}
    assert "catalogue.yaml" in {path.name for path in data}
