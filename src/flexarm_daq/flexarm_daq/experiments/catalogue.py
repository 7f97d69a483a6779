"""Catalogue of the experiments of the thesis (section 2.4, Tables A-1 to A-4)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import yaml

from flexarm_core.channels import MAX_COMMAND_V, TRAVEL_V, is_thesis_arm
from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_core.rig_description import RigDescription

KINDS: Mapping[str, str] = MappingProxyType(
    {
        "open_loop": "open loop (2.4.1, Table A-1)",
        "bounded": "bounded position (2.4.2, Table A-2)",
        "closed_loop": "closed loop (2.4.3, Table A-3)",
        "controller": "controller run (chapter 4, Table A-4)",
    }
)
"""Kinds of experiments, with their places in the thesis."""


class CatalogueError(FlexarmError):
    """Unknown experiment."""


@dataclass(frozen=True)
class Experiment:
    """One entry of the tables.

    Open-loop and bounded experiments have a waveform and a magnitude. The others have a law with
    its gains and a reference with its profile, by the names of the controller's parameters.

    Attributes
    ----------
    name, kind, file : str
        Name in the thesis, such as ``C_dat3``, key of `KINDS`, and the thesis's data file.
    samples : int
        Number of samples.
    rate_hz, payload_kg : float
        Sampling rate, Hz, and payload at the tip, kg.
    waveform, magnitude_v : str, float
        Key of `excitation.EXCITATIONS`, empty with a law, and its magnitude, V.
    law, gains : str, mapping of str to float
        Law of the controller, empty with a waveform, and its gains that differ from the defaults.
    reference, profile : str, mapping of str to float
        Reference of the controller, and its values.
    """

    name: str
    kind: str
    file: str
    samples: int
    rate_hz: float
    payload_kg: float = 0.0
    waveform: str = ""
    magnitude_v: float = 0.0
    law: str = ""
    gains: Mapping[str, float] = field(default_factory=dict)
    reference: str = ""
    profile: Mapping[str, float] = field(default_factory=dict)

    @property
    def length_s(self) -> float:
        """Length of the record, s."""
        return self.samples / self.rate_hz

    @property
    def closed_loop(self) -> bool:
        """True when a controller makes the commands."""
        return bool(self.law)

    @property
    def input_text(self) -> str:
        """Input of the thesis's arm, in words."""
        if not self.closed_loop:
            return f"{self._wave} {self.magnitude_v:g} V"
        profile = ", ".join(f"{name} {value:g}" for name, value in self.profile.items())
        return f"{self._law}, {self._wave} ({profile})"

    def input_text_on(self, rig: RigDescription) -> str:
        """Return the input of a rig in words: on another one a share of its limits or travel."""
        if is_thesis_arm(rig):
            return self.input_text
        if not self.closed_loop:
            return f"{self._wave} of {100.0 * self.magnitude_v / MAX_COMMAND_V:.0f} % of the limits"
        part = 100.0 * self.profile["amplitude_v"] / TRAVEL_V
        return f"{self._law}, {self._wave} of {part:.0f} % of the travel"

    @property
    def _wave(self) -> str:
        return (self.waveform or self.reference).replace("_", " ")

    @property
    def _law(self) -> str:
        gains = ", ".join(f"{name} {value:g}" for name, value in self.gains.items())
        return f"{self.law} ({gains})" if gains else self.law

    def commander_parameters(self, seed: int) -> dict[str, Any]:
        """Return the parameters of the node that commands, controller or experiment."""
        if not self.closed_loop:
            return {"waveform": self.waveform, "magnitude_v": self.magnitude_v, "seed": seed}
        parameters: dict[str, Any] = {"law": self.law, "reference": self.reference}
        parameters |= _below(self.law, self.gains) | _below(self.reference, self.profile)
        if self.reference == "varying_square":
            parameters["varying_square.seed"] = seed
        return parameters


def _below(prefix: str, values: Mapping[str, float]) -> dict[str, float]:
    return {f"{prefix}.{name}": float(value) for name, value in values.items()}


@cache
def catalogue() -> Mapping[str, Experiment]:
    """Return every experiment by its name, in the order of the tables."""
    text = (files("flexarm_daq.experiments") / "catalogue.yaml").read_text("utf-8")
    entries: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return MappingProxyType({name: Experiment(name, **entry) for name, entry in entries.items()})


def experiment(name: str) -> Experiment:
    """Return an experiment by its name; case and blanks do not matter.

    Raises
    ------
    CatalogueError
        When there is no such experiment; the message lists the names.

    Examples
    --------
    >>> experiment("C_dat3").length_s
    40.0
    """
    wanted = name.strip().replace(" ", "_").lower()
    for known, entry in catalogue().items():
        if known.lower() == wanted:
            return entry
    kinds = dict.fromkeys(known.rstrip("0123456789") for known in catalogue())
    ranges = [
        f"{kind}1 to {kind}{sum(known.startswith(kind) for known in catalogue())}" for kind in kinds
    ]
    raise CatalogueError(f"no experiment {name!r}; there are {', '.join(ranges)}")


def on_rig(entry: Experiment, rig: RigDescription) -> Experiment:
    """Return an experiment on a rig, at its rate; the limits of its inputs stand for 10 V.

    In closed loop its law is `pd`, also for a controller run, whose law is one of the thesis's arm.
    The gains are to be those of a soft position loop of the rig. Several joints have half-periods
    of random length, from a half of those of a square wave on, which is what C_dat3 has beside
    C_dat2: an identification tells the inputs apart by them.
    """
    if is_thesis_arm(rig):
        return entry
    reference, profile = entry.reference, entry.profile
    if reference == "square" and len(rig.joints) > 1:
        half_s = 0.5 * profile["period_s"]
        reference = "varying_square"
        profile = {
            "amplitude_v": profile["amplitude_v"],
            "shortest_s": 0.5 * half_s,
            "longest_s": half_s,
        }
    return replace(
        entry,
        samples=round(entry.length_s * rig.rate_hz),
        rate_hz=rig.rate_hz,
        payload_kg=0.0,
        law="pd" if entry.closed_loop else "",
        gains={},
        reference=reference,
        profile=profile,
    )
