"""Subspace identification, modal reduction, model updating and validation."""

from typing import TYPE_CHECKING

from flexarm_core.fronts import late

if TYPE_CHECKING:
    from flexarm_core.errors import BagError, DataError, IdentificationError
    from flexarm_ident.arm.fit import ArmFit, fit_arm
    from flexarm_ident.estimation.identification import Identification
    from flexarm_ident.estimation.output_only import OutputModes, identify_modes
    from flexarm_ident.estimation.pipeline import identify
    from flexarm_ident.fitting.refinement import Refinement, refine_model
    from flexarm_ident.fitting.validation import (
        Dmv,
        Gains,
        Sfv,
        recover_gains,
        validate_dmv,
        validate_sfv,
    )
    from flexarm_ident.friction.dry_friction import load_friction, simulate_with_friction
    from flexarm_ident.friction.first_motion import validate_with_friction
    from flexarm_ident.friction.layout import Drive
    from flexarm_ident.friction.levels import estimate_coulomb
    from flexarm_ident.models.files import load_model, save_model
    from flexarm_ident.models.modes import ModeShape, RankTable, mode_shapes, rank_table
    from flexarm_ident.reading.channels import Selection, selection
    from flexarm_ident.reading.read import read_bag, read_bag_report, read_channels
    from flexarm_ident.records.iodata import IoData, from_columns, to_columns
    from flexarm_ident.records.preprocess import preprocess
    from flexarm_ident.records.span import Span
    from flexarm_ident.reduction.balanced import (
        BalancedTruncation,
        balanced_truncation,
        thesis_realisation,
    )
    from flexarm_ident.reduction.modal import Reduction, reduce_model
else:
    __getattr__, __dir__ = late(__name__, __file__)

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
    "ModeShape",
    "OutputModes",
    "RankTable",
    "Reduction",
    "Refinement",
    "Selection",
    "Sfv",
    "Span",
    "balanced_truncation",
    "estimate_coulomb",
    "fit_arm",
    "from_columns",
    "identify",
    "identify_modes",
    "load_friction",
    "load_model",
    "mode_shapes",
    "preprocess",
    "rank_table",
    "read_bag",
    "read_bag_report",
    "read_channels",
    "recover_gains",
    "reduce_model",
    "refine_model",
    "save_model",
    "selection",
    "simulate_with_friction",
    "thesis_realisation",
    "to_columns",
    "validate_dmv",
    "validate_sfv",
    "validate_with_friction",
]
