"""Files of SQLite that are not bags, or cut ones, are called so."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import pytest

from flexarm_bags.check import check_bag
from flexarm_bags.reader import opened
from flexarm_core.errors import BagError

if TYPE_CHECKING:
    from pathlib import Path


def database(file: Path, table: str) -> Path:
    with closing(sqlite3.connect(file)) as opened_file, opened_file:
        opened_file.execute(f"CREATE TABLE {table} (value INTEGER)")
        opened_file.executemany(f"INSERT INTO {table} VALUES (?)", ((k,) for k in range(5000)))  # noqa: S608
    return file


def cut(file: Path) -> Path:
    database(file, "messages")
    file.write_bytes(file.read_bytes()[:20_000])
    return file


def written(file: Path, content: bytes) -> Path:
    file.write_bytes(content)
    return file


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda file: written(file, b""), "is empty: nothing was recorded"),
        (lambda file: written(file, b"t,u,y\n" * 100), "is not a SQLite file"),
        (lambda file: database(file, "readings"), "and no bag, .* tables: readings$"),
        (cut, r"is cut off, 20000 of its \d+ bytes are there: .* `sqlite3 FILE \.recover`"),
    ],
)
def test_database___that_is_no_whole_bag___is_called_what_it_is(
    tmp_path: Path, make: object, said: str
) -> None:
    assert callable(make)
    file = make(tmp_path / "run.db3")

    with pytest.raises(BagError, match=said), opened(file):
        pass
    assert any(word.startswith("run.db3: is ") for word in check_bag(file).problems)
