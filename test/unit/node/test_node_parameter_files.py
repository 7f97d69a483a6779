from __future__ import annotations

from pathlib import Path

import pytest

from flexarm_node.parameter_files import (
    complaint,
    given_files,
    is_for,
    unknown_nodes,
    unreadable,
    wrong_words,
)

KNOWN = {"/flexarm/daq", "/flexarm/controller"}


@pytest.mark.parametrize(
    ("text", "unknown"),
    [
        ("/flexarm/daq: {ros__parameters: {rig: nidaq}}", []),
        ("flexarm: {daq: {ros__parameters: {}}, controller: {ros__parameters: {}}}", []),
        ("/**: {ros__parameters: {use_sim_time: true}}", []),
        ("/**/daq: {ros__parameters: {rig: nidaq}}", []),
        ("/flexarm/controler: {ros__parameters: {law: pd}}", ["/flexarm/controler"]),
        ("/**/controler: {ros__parameters: {law: pd}}", ["/**/controler"]),
        # Without its namespace the name is another one.
        ("controller: {ros__parameters: {law: pd}}", ["/controller"]),
        ("law: pd", []),
        ("[1, 2]", []),
        ("{: no yaml", []),
    ],
)
def test_unknown_nodes___are_those_that_nobody_has(
    tmp_path: Path, text: str, unknown: list[str]
) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(text)
    assert unknown_nodes(file, KNOWN) == unknown


def test_unknown_nodes___file_that_is_not_there___is_left_to_the_nodes(tmp_path: Path) -> None:
    assert unknown_nodes(tmp_path / "none.yaml", KNOWN) == []


# As rcl of Jazzy takes them: tried with files of these sections.
@pytest.mark.parametrize(
    ("section", "node", "expected"),
    [
        ("/**", "/flexarm/daq", True),
        ("/**/daq", "/flexarm/daq", True),
        ("/**/daq", "/daq", True),
        ("/**/daq", "/lab/arm2/daq", True),
        ("/*/daq", "/flexarm/daq", True),
        ("/*/daq", "/lab/arm2/daq", False),
        ("/flexarm/*", "/flexarm/daq", True),
        ("/flexarm/**", "/flexarm/daq", True),
        ("/**/flexarm/daq", "/flexarm/daq", True),
        ("/daq", "/flexarm/daq", False),
        ("/**/daq", "/flexarm/daq2", False),
        ("/flexarm/daq", "/flexarm/daq", True),
    ],
)
def test_section___is_for_the_nodes_that_its_pattern_names(
    section: str, node: str, *, expected: bool
) -> None:
    assert is_for(section, node) == expected


def test_given_files___are_those_of_ros_arguments() -> None:
    line = "node --params-file a --ros-args -p x:=1 --params-file b -- --params-file c"
    more = " --ros-args --params-file d"
    assert given_files((line + more).split()) == [Path("b"), Path("d")]


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        (["/flexarm/daq", "/flexarm/dac"], ""),
        (["/**", "/flexarm/controller"], ""),
        (["/**/daq", "/other/daq"], ""),
        # The node of somebody else, or a node of that name that was renamed.
        (["/flexarm/camera"], ""),
        (["/daq_manager"], ""),
        (["/flexarm/daq2"], ""),
        (["/**", "/flexarm/dac"], "has parameters for /flexarm/dac, no node here (nearest: "),
        (["/arm1/daq"], "has parameters for /arm1/daq and none for /flexarm/daq: write /**/daq"),
        (["/daq"], "has parameters for /daq and none for /flexarm/daq: write /**/daq"),
    ],
)
def test_complaint___names_a_section_that_was_meant_for_the_node(
    tmp_path: Path, sections: list[str], said: str
) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text("\n".join(f"{name}: {{ros__parameters: {{a: 1}}}}" for name in sections))
    found = complaint([tmp_path / "none.yaml", file], "/flexarm/daq")
    assert found.startswith(f"{file} {said}" if said else "")
    assert bool(found) == bool(said)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("/**/daq: {ros__parameters: {rig: nidaq}}", ""),
        ("", ""),
        ("/**/daq:\n  ros__parameters:\n    a: [1\nb: 2", "no YAML: line 3: did not find expected"),
        ("rate_hz: 500", "has parameters of no node: write them below the node's name, /**/daq"),
        ("- 1", "has parameters of no node"),
        ("\xff", "it is not text in UTF-8"),
    ],
)
def test_unreadable___file_of_parameters___says_what_is_wrong_and_where(
    tmp_path: Path, text: str, wrong: str
) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_bytes(text.encode("latin-1"))
    assert unreadable(file).startswith(f"{file}: {wrong}" if wrong else "")
    assert bool(unreadable(file)) == bool(wrong)
    assert wrong_words(["node", "--ros-args", "--params-file", str(file)]) == unreadable(file)


@pytest.mark.parametrize("given", ["rig=two_mass", "rig", ":=1"])
def test_wrong_words___parameter_without_its_sign___is_named(given: str) -> None:
    words = ["node", "--ros-args", "-p", "rate_hz:=300.0", "-p", given]
    assert wrong_words(words[:4]) == ""
    assert wrong_words(words) == f"-p {given}: write NAME:=VALUE, such as rate_hz:=300.0"
