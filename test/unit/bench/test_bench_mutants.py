from __future__ import annotations

from importlib import import_module

import pytest

from bench.loop import mutants
from bench.loop.mutants import MODULES, SUBJECTS, Score
from support.project import PROJECT

STATES = {
    "flexarm_daq.loop.limiter.x_clamp__mutmut_1": "killed",
    "flexarm_daq.loop.limiter.x_clamp__mutmut_2": "timeout",
    "flexarm_daq.loop.limiter.x_clamp__mutmut_3": "survived",
    "flexarm_daq.loop.limiter.x_share__mutmut_1": "no tests",
    "flexarm_core.channels.x_to_si__mutmut_1": "killed",
}


def test_scores___by_subject___count_what_lived() -> None:
    found = {score.subject: score for score in mutants._scores(STATES, [*mutants.SUBJECTS])}
    assert tuple(found) == tuple(SUBJECTS)
    assert found["limiter"] == Score(
        "limiter",
        4,
        (
            "flexarm_daq.loop.limiter.x_clamp__mutmut_3",
            "flexarm_daq.loop.limiter.x_share__mutmut_1",
        ),
    )
    assert found["watchdog"].mutants == 0


def test_rows___end_with_all_of_them() -> None:
    assert list(mutants._rows([Score("a", 4, ("x", "y")), Score("b", 4, ())])) == [
        ("a", "4", "2", "50.0 %"),
        ("b", "4", "4", "100.0 %"),
        ("all", "8", "6", "75.0 %"),
    ]


def test_modules_and_tests___that_are_named___are_there() -> None:
    for module in MODULES:
        package, _, rest = module.partition("/")
        assert (PROJECT / "src" / package / package / rest).is_file()
    for test in mutants._TESTS:
        assert (PROJECT / test).exists()


@pytest.mark.parametrize(
    ("source", "mutants"),
    [
        ("a < b", ["b < a"]),
        ("a < b < c", []),
        ('host == "x"', ['host.startswith("x")', 'host.endswith("x")']),
        ("host == other", []),
        ("self.at_v = 1.0", ["pass"]),
        ("at_v = 1.0", []),
        ('path.with_suffix(".part")', ["path"]),
        ("min(value, bound)", ["value", "bound"]),
        ("min(values)", []),
        ("sum(a, b)", []),
    ],
)
def test_kinds___of_our_own___are_planted(source: str, mutants: list[str]) -> None:
    libcst = pytest.importorskip("libcst", reason="it comes with mutmut")
    kinds = import_module("bench.loop.mutation_kinds").KINDS
    (statement,) = libcst.parse_module(source).body[0].body
    node = getattr(statement, "value", statement)
    nodes = (node, statement) if source.startswith("self") else (node,)
    found = [
        libcst.Module([]).code_for_node(mutant)
        for each in nodes
        for kind, plant in kinds
        if isinstance(each, kind)
        for mutant in plant(each)
    ]
    assert found == mutants
