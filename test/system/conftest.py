from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.system_graph import Graph

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    with Graph(tmp_path) as made:
        yield made


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Return a graph with an ident node."""
    folder = tmp_path_factory.mktemp("laboratory")
    with Graph(folder) as graph:
        graph.start("ident", {"output_folder": str(folder / "models")})
        yield graph
