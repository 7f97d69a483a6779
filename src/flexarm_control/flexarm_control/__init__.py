"""Control laws, margins and the controller node."""

from flexarm_control.criteria import StepFigures, itae, step_figures
from flexarm_control.errors import ControlError
from flexarm_control.gains import Compensation, Coulomb, PdGains, PdpGains, PiGains
from flexarm_control.ilqr import Ilqr, IlqrWeights, design_ilqr
from flexarm_control.law import Effort, Law
from flexarm_control.laws import LAWS, Pd, Pi, build_law
from flexarm_control.lqg import LqgWeights, design_lqg
from flexarm_control.margins import Margins, margins
from flexarm_control.nominal_models import nominal_model, nominal_payloads_kg
from flexarm_control.pdpc import Pdp, Pdpc
from flexarm_control.pdpc_plus import PdpcPlus
from flexarm_control.references import REFERENCES, Reference, build_reference
from flexarm_control.simulation import LoopRun, simulate_loop
from flexarm_control.tuning import PdpTuning, PiTuning, tune_pdp, tune_pi

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
    "LoopRun",
    "LqgWeights",
    "Margins",
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
    "StepFigures",
    "build_law",
    "build_reference",
    "design_ilqr",
    "design_lqg",
    "itae",
    "margins",
    "nominal_model",
    "nominal_payloads_kg",
    "simulate_loop",
    "step_figures",
    "tune_pdp",
    "tune_pi",
]
