"""Subspace identification, modal reduction, model updating and validation."""

from flexarm_ident.bags import BagError, read_bag, read_bag_report
from flexarm_ident.errors import DataError, IdentificationError
from flexarm_ident.iodata import IoData
from flexarm_ident.pipeline import Identification, identify
from flexarm_ident.preprocess import preprocess
from flexarm_ident.reduction import Reduction, reduce_model
from flexarm_ident.validation import Dmv, Gains, Sfv, recover_gains, validate_dmv, validate_sfv

__all__ = [
    "BagError",
    "DataError",
    "Dmv",
    "Gains",
    "Identification",
    "IdentificationError",
    "IoData",
    "Reduction",
    "Sfv",
    "identify",
    "preprocess",
    "read_bag",
    "read_bag_report",
    "recover_gains",
    "reduce_model",
    "validate_dmv",
    "validate_sfv",
]
