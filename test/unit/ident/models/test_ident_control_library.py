"""Tests of python-control without what takes long: it comes with its first use, and still works."""

import subprocess
import sys
from pathlib import Path

import pytest

_LIGHT = """
import sys
from flexarm_ident.models.control_library import control_library
control = control_library()
assert control_library() is control
later = "matplotlib control.grid scipy.integrate scipy.optimize scipy.signal scipy.stats"
print(*(name for name in later.split() if name in sys.modules))
"""
_PLOTS = (
    _LIGHT
    + """
import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
model, other = control.ss(-1.0, 1.0, 1.0, 0.0), control.tf([1.0], [1.0, 1.0, 4.0])
draw = {
    "bode": lambda: control.bode_plot(model),
    "nyquist": lambda: control.nyquist_plot(model),
    "nichols": lambda: control.nichols_plot(other),
    "poles": lambda: control.pole_zero_plot(other, grid=True),
    "discrete poles": lambda: control.pole_zero_plot(control.sample_system(other, 0.1), grid=True),
    "root locus": lambda: control.root_locus_plot(other, grid=True),
    "step": lambda: control.step_response(model).plot(),
    "singular values": lambda: control.singular_values_plot(model),
}
for name, call in draw.items():
    figure = plt.figure()
    call()
    print(name, len(figure.axes) > 0)
"""
)
_STATISTICS = (
    _LIGHT
    + """
import numpy as np, scipy
print(scipy.signal.find_peaks_cwt(np.sin(np.arange(0.0, 6.0, 0.1)), np.arange(5, 10)))
print(scipy.stats.norm.cdf(0.0))
"""
)
_FUNCTIONS = (
    _LIGHT
    + """
oscillator = control.ss([[0.0, 1.0], [-4.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0]], 0.0)
print(control.sample_system(oscillator, 0.1).dt, control.sample_system(control.tf(1, [1, 1]), 1).dt)
print(abs(control.margin(control.tf(4.0, [1.0, 2.0, 1.0]))[1] - 60.0) < 1e-6)
print(control.frd(oscillator, [0.1, 1.0, 3.0, 9.0], smooth=True).eval(1.0).real > 0.0)
import control.optimal
print(control.optimal.OptimalControlProblem.__name__)
"""
)
_KNOWN = """
import matplotlib.pyplot, sys
before = sys.modules["matplotlib.pyplot"]
from flexarm_ident.models.control_library import control_library
print(sys.modules["matplotlib.pyplot"] is before, control_library().ctrlplot.plt is before)
"""


_EAGER = """
import matplotlib.pyplot as plt
import scipy.stats
half = scipy.stats.norm.cdf(0.0)
"""


def output(program: str) -> list[str]:
    command = [sys.executable, "-W", "ignore", "-c", program]
    done = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - ours
    return done.stdout.splitlines()


def test_control_library___loads_neither_plots_nor_what_of_scipy_it_seldom_uses() -> None:
    assert output(_LIGHT) == [""]


@pytest.mark.slow
def test_control_library__plots___draw_as_ever() -> None:
    light, *drawn = output(_PLOTS)
    assert light == ""
    assert len(drawn) == 8
    assert [line for line in drawn if not line.endswith("True")] == []


@pytest.mark.slow
@pytest.mark.exhaustive
def test_control_library__statistics___come_with_their_first_use() -> None:
    light, peaks, half = output(_STATISTICS)
    assert light == ""
    assert abs(int(peaks.strip("[]")) - 16) <= 1  # the sine's maximum is at pi / 2
    assert abs(float(half) - 0.5) < 1e-12


@pytest.mark.slow
@pytest.mark.exhaustive
def test_control_library__sampling_and_optimal_control___come_with_their_first_use() -> None:
    light, *found = output(_FUNCTIONS)
    assert light == ""
    assert found == ["0.1 1", "True", "True", "OptimalControlProblem"]


@pytest.mark.slow
@pytest.mark.exhaustive
def test_control_library__pyplot_imported_before___stays() -> None:
    assert output(_KNOWN) == ["True True"]


@pytest.mark.slow
def test_control_library__that_uses_a_module_at_once___gets_the_real_one(tmp_path: Path) -> None:
    (tmp_path / "control.py").write_text(_EAGER)
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from flexarm_ident.models.control_library import control_library\n"
        "print(abs(control_library().half - 0.5) < 1e-12)\n"
        "import scipy.stats; print(scipy.stats.__file__ is not None)\n"
        "print('matplotlib' in sys.modules)"
    )
    assert output(program) == ["True", "True", "False"]
