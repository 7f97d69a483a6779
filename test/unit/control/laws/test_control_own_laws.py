from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from flexarm_control.laws.registry import FILES, LAWS, LawSpec, own_laws
from flexarm_core.errors import SettingError
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path

EXAMPLE = PROJECT / "examples" / "own_law.py"
GOOD = """
from dataclasses import dataclass
from flexarm_control import Effort, LawSpec, Memoryless
from flexarm_core.specs import Bounded, setting

@dataclass(frozen=True)
class Gains(Bounded):
    kp: float = setting(0.5, 0.0, 5.0, "V/V", "gain")

class Spring(Memoryless):
    def __init__(self, gains):
        self.gains = gains
    def step(self, volts, reference_v):
        return Effort(self.gains.kp * (reference_v - volts[0]), 0.0)

LAWS = (LawSpec("{name}", "a spring", Spring, (Gains,)),)
"""


def write(folder: Path, text: str, name: str = "mine.py") -> str:
    file = folder / name
    file.write_text(text)
    return str(file)


def found(monkeypatch: pytest.MonkeyPatch, *files: str) -> tuple[LawSpec, ...]:
    monkeypatch.setenv(FILES, os.pathsep.join(files))
    return own_laws(list(LAWS))


def test_no_files___no_laws(monkeypatch: pytest.MonkeyPatch) -> None:
    assert found(monkeypatch) == ()
    monkeypatch.delenv(FILES)
    assert own_laws(list(LAWS)) == ()


def test_laws_of_several_files___have_their_parameters_and_answer(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = tmp_path / "with a space"
    folder.mkdir()
    files = [
        write(folder, GOOD.replace("{name}", "spring"), "a.py"),
        write(tmp_path, GOOD.replace("{name}", "other_spring"), "a.py"),
        str(EXAMPLE),
    ]
    spring, other, pid = found(monkeypatch, *files)
    assert [spring.name, other.name, pid.name] == ["spring", "other_spring", "pid"]
    (kp,) = spring.parameters
    assert (kp.name, kp.default, kp.minimum, kp.maximum, kp.unit) == ("kp", 0.5, 0.0, 5.0, "V/V")
    kinds = spring.settings + other.settings
    assert all(sys.modules[kind.__module__].Gains is kind for kind in kinds)
    law = spring.build(*(kind() for kind in spring.settings))
    assert law.step((1.0, 0.0, 0.0, 0.0), 3.0).effort_v == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("LAWS = (1,)", "it has no tuple LAWS of LawSpec rows"),
        ("", "it has no tuple LAWS of LawSpec rows"),
        ("a = 1\nb = 1 / 0", r"mine.py, line 2: ZeroDivisionError: division by zero"),
        ("def f(:\n    pass", r"mine.py, line 1: SyntaxError: "),
        (
            GOOD.replace("{name}", "pdpc"),
            "law 'pdpc': the name is taken: choose another one",
        ),
        (GOOD.replace("{name}", "my law"), "law 'my law': a name is a word in small letters"),
        (GOOD.replace("{name}", "PID"), "law 'PID': a name is a word in small letters"),
        (GOOD.replace("{name}", "models"), "law 'models': the name is taken"),
        ("import sys\nsys.exit(0)", "mine.py, line 2: SystemExit: 0"),
        (
            GOOD.replace("{name}", "spring").replace("self.gains.kp *", "float('nan') *"),
            "law spring does not answer at rest: ValueError: nan V of effort",
        ),
        (
            GOOD.replace("{name}", "spring").replace("(Memoryless)", ""),
            "law spring has no method reset, memory, remember",
        ),
        (
            GOOD.replace("{name}", "spring").replace("volts[0]", "volts[7]"),
            r"law spring does not answer at rest, line 14: IndexError: tuple index out of range",
        ),
        (
            GOOD.replace("{name}", "spring").replace("(0.5, 0.0", "(9.5, 0.0"),
            "kp = 9.5 is outside 0 to 5 V/V",
        ),
    ],
)
def test_file_with_no_law___is_refused_with_its_place(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, text: str, reported: str
) -> None:
    with pytest.raises(SettingError, match=reported):
        found(monkeypatch, write(tmp_path, text))


def test_file_that_is_not_there___is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with pytest.raises(SettingError, match=r"FLEXARM_LAWS: .*gone.py: no such file"):
        found(monkeypatch, str(tmp_path / "gone.py"))
    with pytest.raises(SettingError, match=r"no Python file: name it with the ending \.py"):
        found(monkeypatch, write(tmp_path, "LAWS = ()", "laws.txt"))


def test_same_law_twice___is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SettingError, match="law 'pid'"):
        found(monkeypatch, str(EXAMPLE), str(EXAMPLE))


def test_registry___of_another_process___has_the_law() -> None:
    code = "from flexarm_control import build_law; print(build_law('pid', {'kp': 1.5}).gains.kp)"
    done = subprocess.run(  # noqa: S603 - our own code
        [sys.executable, "-c", code],
        env=os.environ | {FILES: str(EXAMPLE)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.returncode) == ("1.5\n", 0), done.stderr
