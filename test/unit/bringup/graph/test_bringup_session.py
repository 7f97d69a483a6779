from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest

from flexarm_bringup.graph.operator import interruptible, ros_domain
from flexarm_bringup.graph.processes import LaunchError

if TYPE_CHECKING:
    from collections.abc import Iterator

STOPS = [signal.SIGINT, signal.SIGTERM]


@pytest.fixture(autouse=True)
def _handlers() -> Iterator[None]:
    before = [signal.getsignal(stop) for stop in STOPS]
    yield
    for stop, handler in zip(STOPS, before, strict=True):
        signal.signal(stop, handler)


def _binding(stop: signal.Signals, error: Exception) -> None:
    """Do as a binding that calls Python, is interrupted there, and says something else."""
    try:
        signal.raise_signal(stop)
    except KeyboardInterrupt:
        raise error from None


@pytest.mark.parametrize("stop", STOPS)
def test_interruptible___signal___interrupts(stop: signal.Signals) -> None:
    with pytest.raises(KeyboardInterrupt), interruptible():
        signal.raise_signal(stop)


@pytest.mark.parametrize("stop", STOPS)
def test_interruptible___signal_reported_as_another_error___interrupts(
    stop: signal.Signals,
) -> None:
    with pytest.raises(KeyboardInterrupt), interruptible():
        _binding(stop, RuntimeError("Unable to convert call argument '0' to Python object"))


def test_interruptible___error_without_a_signal___is_reported() -> None:
    with pytest.raises(RuntimeError, match="broken"), interruptible():
        raise RuntimeError("broken")


def test_interruptible___node_that_failed_at_a_signal___is_reported() -> None:
    with pytest.raises(LaunchError, match="daq ended"), interruptible():
        _binding(signal.SIGINT, LaunchError("daq ended"))


@pytest.mark.parametrize(("text", "domain"), [("", "0"), ("0", "0"), ("71", "71"), ("232", "232")])
def test_ros_domain___number___is_taken(
    monkeypatch: pytest.MonkeyPatch, text: str, domain: str
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert ros_domain() == domain


@pytest.mark.parametrize("text", ["233", "-3", "abc", "1.5", "9" * 5000])
def test_ros_domain___that_has_no_ports___is_refused(
    monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(LaunchError, match=r"^ROS_DOMAIN_ID = '.{1,90}': must be a whole number of"):
        ros_domain()
