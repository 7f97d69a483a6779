from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from flexarm_bringup import processes
from flexarm_bringup.processes import NodeProgram


@pytest.mark.parametrize(
    ("value", "read"),
    [
        (Path("/a b/it's"), "/a b/it's"),
        ("1e3", "1e3"),
        (True, True),
        (0.5, 0.5),
        (3, 3),
        (["state", "command"], ["state", "command"]),
    ],
)
def test_node_program___parameter___is_read_back_as_given(
    monkeypatch: pytest.MonkeyPatch, value: object, read: object
) -> None:
    monkeypatch.setattr(processes, "find_executable", lambda *_: Path("/bin/node"))
    command = NodeProgram("flexarm_daq", "player_node", {"bag": value}).command()
    assert command[:3] == ["/bin/node", "--ros-args", "-p"]
    name, _, text = command[3].partition(":=")
    assert name == "bag"
    assert yaml.safe_load(text) == read
