"""Answer to a call of the node `ident`: what `identify_bags` found, in a process of its own."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_core.computation import serve
from flexarm_ident.job import identify_bags
from flexarm_ident.reading.channels import selection
from flexarm_ident.workflow.request import Request

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_core.computation import Report
    from flexarm_ident.models.modes import Mode


def answered(asked: Mapping[str, Any], report: Report) -> dict[str, Any]:
    """Identify one model from bags and return the fields of the answer.

    Parameters
    ----------
    asked : mapping
        Arguments of `identify_bags`; ``channels`` are those of `selection`, or None.
    report : callable
        Progress.
    """
    started_s, channels = time.monotonic(), asked["channels"]
    results = identify_bags(
        list(map(Path, asked["bags"])),
        Path(asked["folder"]),
        request_of(asked["request"]),
        channels=None if channels is None else selection(**channels),
        exports=asked["exports"],
        force=asked["force"],
        progress=report,
    )
    return {
        "parameters": results.parameters,
        "warnings": results.outcome.warnings,
        "modes": [_summary(mode) for mode in results.outcome.modes],
        "dmv": results.dmv,
        "sfv": results.sfv,
        "left_out": results.left_out,
        "report_path": str(results.folder),
        "message": results.text(time.monotonic() - started_s),
    }


def request_of(fields: Mapping[str, Any]) -> Request:
    """Return a request from its fields, as JSON has them."""
    return Request(**{**fields, "known_modes_hz": tuple(fields.get("known_modes_hz", ()))})


def _summary(mode: Mode) -> dict[str, Any]:
    """Return the fields of a `ModeSummary`."""
    return {
        "eigenvalue_real": mode.eigenvalue.real,
        "eigenvalue_imaginary": abs(mode.eigenvalue.imag),
        "frequency_hz": mode.frequency_hz,
        "damping_ratio": mode.damping_ratio,
        "msv": mode.msv,
        "mrm": mode.mrm,
        "msv_rank": mode.msv_rank,
        "mrm_rank": mode.mrm_rank,
        "kept": mode.kept,
    }


if __name__ == "__main__":
    serve(answered)
