"""Samples that a viewer of the Foxglove protocol gets from a running arm.

The graph is that of `flexarm up --foxglove`, at the pace of the wall clock. A client of the
protocol reads the samples beside it. Each sample that was taken must come once and in order, else
the exit code is 1.
"""

from __future__ import annotations

import socket
import sys
import tempfile
import threading
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from websockets.exceptions import ConnectionClosed

from bench.tools import cpu_s, json_option, write_json
from flexarm_bags.sequence import sequence_of
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.laboratory import LABORATORY, running_graph
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.laboratory.live_page import FOXGLOVE_NODE, foxglove_parameters
from flexarm_core.errors import SettingError
from flexarm_live.serving.foxglove_server import ADDRESS, require_foxglove

# The client is that of the tests.
sys.path.insert(0, str(Path(__file__).parents[2] / "test"))

from support.foxglove_client import FoxgloveClient

if TYPE_CHECKING:
    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.graph.processes import NodeProcesses

_STATE, _REPORTS = "/flexarm/state", "/diagnostics"
_PATIENCE_S = 20.0


@dataclass(frozen=True)
class Figures:
    """Figures of a run; `cpu` is the share of one core that the node for the viewers used."""

    rate_hz: float
    seconds: float
    sampled: int
    received: int
    in_order: bool
    skipped: int
    real_time_factor: float
    cpu: float


@click.command()
@click.option("--rate", "rate_hz", type=click.FloatRange(10.0, 2000.0), default=500.0)
@click.option("--seconds", type=click.FloatRange(1.0), default=60.0, show_default=True)
@json_option
def main(*, rate_hz: float, seconds: float, json_file: Path | None) -> None:
    """Run the arm with a viewer, print what reached it, and write the figures on request."""
    try:
        require_foxglove()
        with tempfile.TemporaryDirectory(prefix="flexarm_foxglove_") as folder:
            figures = measured(rate_hz, seconds, Path(folder, "nodes.log"))
    except (LaunchError, SettingError) as error:
        raise click.ClickException(str(error)) from None
    except TimeoutError:
        raise click.ClickException(f"no message came to the viewer for {_PATIENCE_S:g} s") from None
    order = "in order" if figures.in_order else "not in order"
    terminal.CONSOLE.print(
        f"A Foxglove-protocol client got {figures.received} of {figures.sampled} samples in"
        f" {seconds:g} s at {rate_hz:g} Hz, {order}; {figures.skipped} periods skipped, factor of"
        f" real time {figures.real_time_factor:.3f}, node foxglove {100 * figures.cpu:.1f} % of a"
        " core"
    )
    write_json(json_file, asdict(figures))
    sys.exit(not (figures.in_order and figures.received == figures.sampled))


def measured(rate_hz: float, seconds: float, log: Path) -> Figures:
    """Sample for some time with a viewer connected."""
    port = _free_port()
    parameters: dict[str, dict[str, Any]] = {
        "daq": {"rate_hz": rate_hz},
        "controller": {"law": "pdpc", "reference": "varying_square"},
        FOXGLOVE_NODE: foxglove_parameters(port, "thesis"),
    }
    nodes = (*LABORATORY, FOXGLOVE_NODE)
    with running_graph(parameters, log, nodes=nodes) as (operator, processes):
        operator.wait(lambda: bool(processes.announcement(FOXGLOVE_NODE)), "the node foxglove")
        with closing(FoxgloveClient(port, _PATIENCE_S)) as viewer:
            return _watched(operator, processes, viewer, rate_hz, seconds)


def _watched(
    operator: Operator,
    processes: NodeProcesses,
    viewer: FoxgloveClient,
    rate_hz: float,
    seconds: float,
) -> Figures:
    samples = round(rate_hz * seconds)
    viewer.subscribe([_STATE, _REPORTS])
    # A report shows that the subscriptions are there.
    messages = viewer.messages()
    next(messages)
    numbers: list[int] = []

    def read() -> None:
        """Read until the last sample is there or nothing comes any more."""
        with suppress(TimeoutError, ConnectionClosed):
            for message in messages:
                if message.topic == _STATE:
                    numbers.append(sequence_of(message.raw))
                    if numbers[-1] >= samples:
                        return

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    operator.activate("controller")
    before_s = cpu_s(processes)["foxglove_node"]
    with terminal.progress_bar("sampling", samples) as progress:
        run = operator.sample(samples, progress)
    used_s = cpu_s(processes)["foxglove_node"] - before_s
    reader.join(_PATIENCE_S)
    return Figures(
        rate_hz=rate_hz,
        seconds=seconds,
        sampled=run.taken,
        received=len(set(numbers)),
        in_order=numbers == sorted(set(numbers)),
        skipped=run.missed,
        real_time_factor=run.real_time_factor,
        cpu=used_s / seconds * run.real_time_factor,
    )


def _free_port() -> int:
    with socket.create_server((ADDRESS, 0)) as free:
        return int(free.getsockname()[1])


if __name__ == "__main__":
    main()
