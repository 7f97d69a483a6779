"""Subspace identification, modal reduction, model updating and validation."""

from flexarm_ident.arm_fit import ArmFit, fit_arm
from flexarm_ident.arm_layout import Drive
from flexarm_ident.bags import BagError, read_bag, read_bag_report
from flexarm_ident.coulomb import estimate_coulomb
from flexarm_ident.errors import DataError, IdentificationError
from flexarm_ident.exports import load_model, save_model
from flexarm_ident.friction import simulate_with_friction
from flexarm_ident.identification import Identification
from flexarm_ident.iodata import IoData
from flexarm_ident.pipeline import identify
from flexarm_ident.preprocess import preprocess
from flexarm_ident.reduction import Reduction, reduce_model
from flexarm_ident.refinement import Refinement, refine_model
from flexarm_ident.validation import Dmv, Gains, Sfv, recover_gains, validate_dmv, validate_sfv

__all__ = [
    "ArmFit",
    "BagError",
    "DataError",
    "Dmv",
    "Drive",
    "Gains",
    "Identification",
    "IdentificationError",
    "IoData",
    "Reduction",
    "Refinement",
    "Sfv",
    "estimate_coulomb",
    "fit_arm",
    "identify",
    "load_model",
    "preprocess",
    "read_bag",
    "read_bag_report",
    "recover_gains",
    "reduce_model",
    "refine_model",
    "save_model",
    "simulate_with_friction",
    "validate_dmv",
    "validate_sfv",
]
