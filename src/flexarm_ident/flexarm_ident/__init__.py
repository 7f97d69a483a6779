"""Subspace identification, modal reduction, model updating and validation."""

from flexarm_ident.arm_fit import ArmFit, fit_arm
from flexarm_ident.arm_layout import Drive
from flexarm_ident.bags import BagError, read_bag, read_bag_report
from flexarm_ident.balanced_truncation import BalancedTruncation, balanced_truncation
from flexarm_ident.coulomb import estimate_coulomb
from flexarm_ident.errors import DataError, IdentificationError
from flexarm_ident.exports import load_model, save_model
from flexarm_ident.friction import simulate_with_friction
from flexarm_ident.identification import Identification
from flexarm_ident.iodata import IoData
from flexarm_ident.pipeline import identify
from flexarm_ident.preprocess import preprocess
from flexarm_ident.rank_table import RankTable, rank_table
from flexarm_ident.reduction import Reduction, reduce_model
from flexarm_ident.refinement import Refinement, refine_model
from flexarm_ident.thesis_realisation import thesis_realisation
from flexarm_ident.validation import Dmv, Gains, Sfv, recover_gains, validate_dmv, validate_sfv

__all__ = [
    "ArmFit",
    "BagError",
    "BalancedTruncation",
    "DataError",
    "Dmv",
    "Drive",
    "Gains",
    "Identification",
    "IdentificationError",
    "IoData",
    "RankTable",
    "Reduction",
    "Refinement",
    "Sfv",
    "balanced_truncation",
    "estimate_coulomb",
    "fit_arm",
    "identify",
    "load_model",
    "preprocess",
    "rank_table",
    "read_bag",
    "read_bag_report",
    "recover_gains",
    "reduce_model",
    "refine_model",
    "save_model",
    "simulate_with_friction",
    "thesis_realisation",
    "validate_dmv",
    "validate_sfv",
]
