"""Tuning for a page: gains, the loop's response on each model, and the step that follows."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_control.design.model_sources import friction_levels_v, load_models
from flexarm_control.design.tuning import pdp_step_response
from flexarm_control.design.tuning_job import TuneRequest, tune
from flexarm_control.laws.gains import PdpGains
from flexarm_control.laws.registry import LAWS
from flexarm_control.models.arm_model import MIDDLE_STRAIN, POSITION, SPEED
from flexarm_core.computation import serve
from flexarm_core.errors import SettingError
from flexarm_ident.fitting.validation import frequency_response

if TYPE_CHECKING:
    from collections.abc import Mapping

    import control

    from flexarm_control.design.margins import Margins
    from flexarm_core.arrays import FloatArray
    from flexarm_core.computation import Report

_FREQUENCIES = 400
_LOWEST_HZ = 0.05
_STEP_S = 5.0
_STEP_POINTS = 500
_PDP = "pdp"


def tuned(asked: Mapping[str, Any], report: Report) -> dict[str, Any]:
    """Tune a law and return what a page shows of it.

    Parameters
    ----------
    asked : mapping
        The law, model files by their names, the margins, and the gains in force.
    report : callable
        Progress.

    Raises
    ------
    SettingError
        When the law cannot be tuned, or no gains meet the request.
    """
    law = asked["law"]
    if not LAWS[law].tuning:
        raise SettingError(f"law {law!r} is not tunable")
    report("reading", 0.05)
    models = load_models(asked["models"])
    request = TuneRequest(law=LAWS[law].tuning, **asked["margins"])
    report("searching", 0.1)
    result = tune(models, request, friction_levels_v(asked["models"]))
    report("drawing", 0.9)
    start = f"{law}."
    gains = {
        name: value
        for name, value in result.parameters.items()
        if name.startswith((start, "models."))
    }
    if LAWS[law].tuning != _PDP:
        curves: dict[str, Any] = {"margins": [], "step": None, "required": {}}
    else:
        required = request.requirements()
        curves = {
            "margins": [
                # A file's model is called by its file and its name.
                _loop(name.rpartition(" ")[2], model, found, _pdp_gains(law, gains))
                for (name, model), found in zip(models.items(), result.margins, strict=True)
            ],
            "step": _step(list(models.values()), law, asked["before"], gains),
            "required": {
                name: getattr(required, name) for name in ("gain_margin_db", "phase_margin_deg")
            },
        }
    return {"law": law, "gains": gains, "notes": list(result.notes), **curves}


def _pdp_gains(law: str, values: Mapping[str, Any]) -> PdpGains:
    return PdpGains(**{each.name: values[f"{law}.{each.name}"] for each in fields(PdpGains)})


def _loop(
    name: str, model: control.StateSpace, margins: Margins, gains: PdpGains
) -> dict[str, Any]:
    """Return the margins of one model, and the loop (4-2) opened at the position error."""
    hz = np.geomspace(_LOWEST_HZ, 0.5 / model.dt, _FREQUENCIES)
    position, strain, speed = frequency_response(model, hz)[
        :, [POSITION, MIDDLE_STRAIN, SPEED], 0
    ].T
    loop = gains.kp * position / (1.0 + gains.ksg * strain + gains.kd * speed)
    return {
        "model": name,
        "gain_margin_db": margins.gain_margin_db,
        "phase_margin_deg": margins.phase_margin_deg,
        "gain_hz": margins.gain_margin_hz,
        "phase_hz": margins.phase_margin_hz,
        "response": {
            "hz": hz,
            "db": 20.0 * np.log10(np.abs(loop)),
            "phase_deg": np.degrees(np.unwrap(np.angle(loop))),
        },
    }


def _step(
    models: list[control.StateSpace],
    law: str,
    before: Mapping[str, Any],
    after: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the step of 1 V with the gains of before and after, on average over the models."""
    dt_s = float(models[0].dt)
    samples = round(_STEP_S / dt_s)
    every = max(1, samples // _STEP_POINTS)
    known = _pdp_gains(law, before) if before else None

    def mean(gains: PdpGains) -> FloatArray:
        steps = [pdp_step_response(model, gains, samples)[:, POSITION] for model in models]
        average: FloatArray = np.mean(steps, axis=0)[::every]
        return average

    return {
        "t_s": dt_s * np.arange(samples)[::every],
        "before": None if known is None else mean(known),
        "after": mean(_pdp_gains(law, after)),
    }


if __name__ == "__main__":
    serve(tuned)
