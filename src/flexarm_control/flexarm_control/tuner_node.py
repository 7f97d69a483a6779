"""Tuner node: models in, gains as parameters of the controller out."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.parameter import Parameter

from flexarm_control.design.model_sources import friction_levels_v, load_models
from flexarm_control.design.tuning_job import TuneRequest, tune
from flexarm_core.errors import SettingError, one_line
from flexarm_msgs.srv import Tune
from flexarm_node import qos
from flexarm_node.parameters import Parameters
from flexarm_node.process import run


class TunerNode(Node):
    """Node that connects the service to `tuning_job.tune`."""

    def __init__(self) -> None:
        super().__init__("tuner", namespace="/flexarm")
        Parameters(self, ())
        self.create_service(Tune, "tune", self._on_tune, qos_profile=qos.CALLS)

    def stop(self) -> None:
        """Do nothing: the node has no state."""

    def _on_tune(self, request: Tune.Request, response: Tune.Response) -> Tune.Response:
        try:
            result = tune(
                load_models(request.models),
                TuneRequest(
                    law=request.law or TuneRequest.law,
                    error_weight=request.error_weight or None,
                    strain_weight=request.strain_weight or None,
                    gain_margin_db=request.gain_margin_db or None,
                    phase_margin_deg=request.phase_margin_deg or None,
                    delay_s=request.delay_s,
                    duration_s=request.duration_s or None,
                ),
                friction_levels_v(request.models),
            )
        except (SettingError, OSError) as error:
            response.message = one_line(error)
            self.get_logger().error(response.message)
            return response
        response.success = True
        response.message = f"J {result.criteria[0]:.4g}"
        response.warnings = list(result.notes)
        response.parameters = [
            Parameter(name, value=value).to_parameter_msg()
            for name, value in result.parameters.items()
        ]
        response.gain_margins_db = [each.gain_margin_db for each in result.margins]
        response.phase_margins_deg = [each.phase_margin_deg for each in result.margins]
        response.criteria = list(result.criteria)
        return response


def main() -> int:
    """Run the node."""
    return run(TunerNode)
