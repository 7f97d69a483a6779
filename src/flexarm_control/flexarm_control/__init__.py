"""Control laws, margins and the controller node."""

from typing import TYPE_CHECKING

from flexarm_core.fronts import late

if TYPE_CHECKING:
    from flexarm_control.design.criteria import StepFigures, itae, step_figures
    from flexarm_control.design.margins import Margins, margins
    from flexarm_control.design.tuning import PdpTuning, PiTuning, tune_pdp, tune_pi
    from flexarm_control.laws.gains import Compensation, Coulomb, PdGains, PdpGains, PiGains
    from flexarm_control.laws.ilqr import Ilqr, IlqrWeights, design_ilqr
    from flexarm_control.laws.law_protocol import Effort, Law, Memoryless, limited
    from flexarm_control.laws.lqg import LqgWeights, design_lqg
    from flexarm_control.laws.pdpc import Pd, Pdp, Pdpc, Pi
    from flexarm_control.laws.pdpc_plus import PdpcPlus
    from flexarm_control.laws.registry import LAWS, LawSpec, build_law
    from flexarm_control.models.nominal_models import nominal_model, nominal_payloads_kg
    from flexarm_control.references import REFERENCES, Reference, build_reference
    from flexarm_control.servo.controller import Servo
    from flexarm_control.servo.files import load_controller
    from flexarm_control.simulation import LoopRun, simulate, simulate_loop

    # This is the public name of the errors of this package.
    from flexarm_core.errors import SettingError as ControlError
else:
    __getattr__, __dir__ = late(__name__, __file__)

__all__ = [
    "LAWS",
    "REFERENCES",
    "Compensation",
    "ControlError",
    "Coulomb",
    "Effort",
    "Ilqr",
    "IlqrWeights",
    "Law",
    "LawSpec",
    "LoopRun",
    "LqgWeights",
    "Margins",
    "Memoryless",
    "Pd",
    "PdGains",
    "Pdp",
    "PdpGains",
    "PdpTuning",
    "Pdpc",
    "PdpcPlus",
    "Pi",
    "PiGains",
    "PiTuning",
    "Reference",
    "Servo",
    "StepFigures",
    "build_law",
    "build_reference",
    "design_ilqr",
    "design_lqg",
    "itae",
    "limited",
    "load_controller",
    "margins",
    "nominal_model",
    "nominal_payloads_kg",
    "simulate",
    "simulate_loop",
    "step_figures",
    "tune_pdp",
    "tune_pi",
]
