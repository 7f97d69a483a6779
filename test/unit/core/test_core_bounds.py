from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from flexarm_core import bounds
from flexarm_core.bounds import BoundError, YamlError, read_text_bytes, shown, yaml_content
from flexarm_core.errors import SettingError, one_line, reason
from support.hostile_texts import doubled

if TYPE_CHECKING:
    from pathlib import Path


def test_yaml___anchors_of_a_few_values___are_read() -> None:
    assert yaml_content("a: &x {b: 1, c: 2.5}\nd: *x\n") == {
        "a": {"b": 1, "c": 2.5},
        "d": {"b": 1, "c": 2.5},
    }


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (doubled(40), "has more than 200000 values, aliases spelt out"),
        ("{<<: " + doubled(40) + "}", "has more than 200000 values"),
        ("b: 2\na: &a [*a]", r"line 2: \*a names nothing that is complete before"),
        ("*a", r"\*a names nothing"),
        ("[" * 65 + "]" * 65, "is nested deeper than 64 levels"),
        ("[" * 200_000, "is nested deeper than 64 levels"),
        ("- " * 200_000 + "1", "is nested deeper than 64 levels"),
        ("9" * 401, "a number has 401 characters, allowed are 400"),
        ("0x" + "f" * 100_000, "a number has 100002 characters"),
        ("1" + ":59" * 100_000, "a number has 300001 characters"),
        ("!!int ''", "no YAML: "),
        ("2026-99-99", "no YAML: month must be in 1..12"),
        ("a: 1\nb: [2,\nc", r"no YAML: line 2: .* \(while parsing a flow sequence\)"),
        ("{[1]: 2}", "no YAML: line 1: found unhashable key"),
        ("!!python/object/apply:os.getpid []", "no YAML: line 1: could not determine a constr"),
    ],
)
def test_yaml___hostile_text___is_refused_in_one_short_line(text: str, complaint: str) -> None:
    with pytest.raises(YamlError, match=complaint) as caught:
        yaml_content(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1100


def test_yaml___sixty_four_levels_and_four_hundred_digits___are_read() -> None:
    found: object = yaml_content("[" * 64 + "]" * 64)
    depth = 0
    while found:
        assert isinstance(found, list)
        (found,), depth = found, depth + 1
    assert depth == 63
    assert yaml_content("1" * 400) == int("1" * 400)


@pytest.mark.parametrize("text", ["1e-5", "-1E5", "1.5e3", "+.5e2", "2.e-1"])
def test_yaml___number_with_an_exponent___is_a_number_as_for_ros(text: str) -> None:
    assert yaml_content(f"noise: [{text}]") == {"noise": [float(text)]}


@pytest.mark.parametrize("text", ["'1e-5'", "1e", "e5", "1e5m", "a1e5", "1e5-2"])
def test_yaml___what_only_looks_like_a_number___is_text(text: str) -> None:
    assert yaml_content(f"name: {text}") == {"name": text.strip("'")}


def test_text___longer_than_allowed___is_refused(tmp_path: Path) -> None:
    file = tmp_path / "map.yaml"
    file.write_bytes(b"x" * 11)
    assert read_text_bytes(file, 11) == b"x" * 11
    with pytest.raises(BoundError, match=r"map\.yaml: is longer than"):
        read_text_bytes(file, 10)


def test_text___pipe_and_device___are_refused_unread(tmp_path: Path) -> None:
    pipe = tmp_path / "map.yaml"
    os.mkfifo(pipe)
    link = tmp_path / "zero.yaml"
    link.symlink_to("/dev/zero")
    for path in (pipe, link):
        with pytest.raises(BoundError, match="is not a plain file"):
            read_text_bytes(path)


def test_file___of_holes___is_refused_and_so_it_is_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "bag.mcap"
    file.write_bytes(b"x" * 100_000)
    os.truncate(file, 10 << 30)
    with pytest.raises(BoundError, match=r"bag\.mcap: 102\d\d of its 10240 MB are holes") as caught:
        bounds.require_plain_file(file)
    assert bounds.READ_VARIABLE in str(caught.value)

    monkeypatch.setenv(bounds.READ_VARIABLE, "10240")
    assert bounds.require_plain_file(file) == 10 << 30


def test_allowance___is_the_configured_one_or_twenty_times_the_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(bounds.READ_VARIABLE, raising=False)
    assert bounds.unpacked_bytes_allowed(1 << 20) == 256 << 20
    assert bounds.unpacked_bytes_allowed(100 << 20) == 2000 << 20
    monkeypatch.setenv(bounds.READ_VARIABLE, "8")
    assert bounds.unpacked_bytes_allowed(1) == 8 << 20


@pytest.mark.parametrize("text", ["", "0", "-1", "many", "1e3", "9" * 5000])
def test_allowance___no_number_of_megabytes___is_refused(
    monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.setenv(bounds.READ_VARIABLE, text)
    with pytest.raises(SettingError, match=r"FLEXARM_READ_MB = .*: must be a whole number"):
        bounds.read_bytes_allowed()


def test_value_in_a_message___is_short() -> None:
    nested: object = [0] * 1000
    for _ in range(50):
        nested = [nested, nested]
    assert len(shown(nested)) < 200
    assert len(shown("9" * 10_000_000)) < 100
    assert shown("oops") == "'oops'"


def test_error_of_a_library___is_cut_to_a_line() -> None:
    assert one_line(ValueError("a\n b")) == "a b"
    assert one_line(KeyError()) == "KeyError"
    assert len(one_line(ValueError("9" * 1_000_000))) < 1100


def test_error_of_the_system___is_reported_without_its_number(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    with pytest.raises(OSError) as caught:  # noqa: PT011 - its text is asserted
        gone.read_text()
    assert one_line(caught.value) == f"{gone}: No such file or directory"
    assert reason(caught.value) == "No such file or directory"
    assert reason(ValueError("no\nnumber")) == "no number"
    with pytest.raises(UnicodeDecodeError) as wrong:
        b"\xb0".decode()
    assert reason(wrong.value) == "it is not text in UTF-8"


@pytest.mark.parametrize(("beyond", "refused"), [(0, False), (4096, True)])
def test_holes___up_to_what_is_allowed_and_a_block_more___are_distinguished(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    beyond: int,
    refused: bool,  # noqa: FBT001 - a parameter
) -> None:
    monkeypatch.setenv(bounds.READ_VARIABLE, "1")
    file = tmp_path / "bag.mcap"
    with file.open("wb") as stream:
        stream.seek((1 << 20) + beyond)
        stream.write(b"x" * 4096)
    assert file.stat().st_blocks * 512 < 1 << 20
    if refused:
        with pytest.raises(BoundError, match="are holes"):
            bounds.require_plain_file(file)
    else:
        assert bounds.require_plain_file(file) == (1 << 20) + 4096
