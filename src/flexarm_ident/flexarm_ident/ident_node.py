"""The identification service: bags in, a validated reduced model out, as parameters and files.

`identify` reads the bags, and answers with the model as parameters. The node also declares these
parameters on itself and writes a folder with `model.yaml`, ready for `--params-file`, and
`report.html`.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

from rclpy.node import Node
from rclpy.parameter import Parameter

from flexarm_ident.bags import read_bag_report
from flexarm_ident.errors import IdentificationError
from flexarm_ident.results import model_name, write_results
from flexarm_ident.workflow import Outcome, Request, run
from flexarm_msgs.msg import ModeSummary
from flexarm_msgs.srv import Identify
from flexarm_node.parameters import Parameters, ParameterSpec
from flexarm_node.process import run as run_node

if TYPE_CHECKING:
    from flexarm_ident.alignment import BagReading
    from flexarm_ident.modes import Mode

PARAMETERS = (
    ParameterSpec(
        "output_folder", "~/.ros/flexarm/models", "where a folder per identified model is written"
    ),
)


class IdentNode(Node):
    """Wires the service to `workflow.run`."""

    def __init__(self) -> None:
        super().__init__("ident", namespace="/flexarm")
        self._settings = Parameters(self, PARAMETERS)
        self.create_service(Identify, "identify", self._on_identify)

    def stop(self) -> None:
        """Do nothing: nothing runs beside the executor."""

    def _on_identify(
        self, request: Identify.Request, response: Identify.Response
    ) -> Identify.Response:
        try:
            self._identify(request, response)
        except (IdentificationError, OSError) as error:
            response.message = " ".join(str(error).split())
            self.get_logger().error(response.message)
        return response

    def _identify(self, request: Identify.Request, response: Identify.Response) -> None:
        started_s = time.monotonic()
        readings = _read(request.bag_uris)
        outcome = run([reading.data for reading in readings], as_request(request))
        noticed = (text for reading in readings for text in reading.warnings)
        outcome = replace(outcome, warnings=(*noticed, *outcome.warnings))
        name = model_name(outcome)
        folder = Path(self._settings.values()["output_folder"]).expanduser().absolute() / name
        parameters = write_results(folder, outcome)
        self._keep(parameters)
        response.parameters = [
            Parameter(key, value=value).to_parameter_msg() for key, value in parameters.items()
        ]
        response.warnings = list(outcome.warnings)
        response.modes = [_summary(mode) for mode in outcome.modes]
        response.dmv = _with_mean(outcome)
        if outcome.sfv is not None:
            response.sfv = [*outcome.sfv.delta.tolist(), outcome.sfv.mean]
        response.report_path = str(folder)
        response.success = True
        response.message = (
            f"{name}: order {outcome.identification.order}"
            + (f" reduced to {outcome.model.nstates}" if outcome.reduction else "")
            + f", mean data matching error {response.dmv[-1]:.4f},"
            + f" {time.monotonic() - started_s:.1f} s"
        )
        self.get_logger().info(response.message)

    def _keep(self, parameters: dict[str, Any]) -> None:
        for key, value in parameters.items():
            if self.has_parameter(key):
                self.set_parameters([Parameter(key, value=value)])
            else:
                self.declare_parameter(key, value, ignore_override=True)


def as_request(message: Identify.Request) -> Request:
    """Turn a service request into a `Request`; zero and empty fields take the defaults.

    Raises
    ------
    IdentificationError
        When a field has no meaning.
    """
    default = Request()
    return Request(
        train_fraction=message.train_fraction or default.train_fraction,
        method=message.method or default.method,
        block_rows=message.block_rows or default.block_rows,
        order=message.order or None,
        reduction=message.reduction or default.reduction,
        reduced_order=message.reduced_order or None,
        known_modes_hz=tuple(message.known_modes_hz),
        update=message.update or default.update,
        remove_compensation=message.remove_compensation,
        stabilise=message.stabilise,
    )


def _read(uris: list[str]) -> list[BagReading]:
    if not uris:
        raise IdentificationError("bag_uris is empty: name at least one bag")
    return [read_bag_report(_path(uri)) for uri in uris]


def _path(uri: str) -> Path:
    parts = urlsplit(uri)
    return Path(unquote(parts.path) if parts.scheme == "file" else uri).expanduser()


def _summary(mode: Mode) -> ModeSummary:
    return ModeSummary(
        eigenvalue_real=mode.eigenvalue.real,
        eigenvalue_imaginary=abs(mode.eigenvalue.imag),
        frequency_hz=mode.frequency_hz,
        damping_ratio=mode.damping_ratio,
        msv=mode.msv,
        mrm=mode.mrm,
        msv_rank=mode.msv_rank,
        mrm_rank=mode.mrm_rank,
        kept=mode.kept,
    )


def _with_mean(outcome: Outcome) -> list[float]:
    return [*outcome.dmv_errors.tolist(), float(outcome.dmv_errors.mean())]


def main() -> int:
    """Run the node."""
    return run_node(IdentNode)
