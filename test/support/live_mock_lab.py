"""Arm, parameters and results that the mock of the live laboratory shows to a page."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_live.graph.about import about_arm

if TYPE_CHECKING:
    from flexarm_core.rig_description import RigDescription

MAGIC = 0x464C5831
SENSORS = ("position_v", "base_strain_v", "middle_strain_v", "speed_v")
CHANNELS = [
    ("position_v", "deg", 11.6667, "position"),
    ("base_strain_v", "N m", 0.625, "strain"),
    ("middle_strain_v", "N m", 0.9091, "strain"),
    ("speed_v", "rad/s", 4.9652, "speed"),
    ("command_v", "A", 0.5, "command"),
    ("compensation_v", "A", 0.5, "command"),
    ("reference_v", "deg", 11.6667, "position"),
    ("sequence_low", "", 1.0, "sequence"),
]
MODES_HZ = (9.0, 22.8)
STRAIN_PER_MODE = np.array([[-40.0, 60.0], [25.0, 80.0]])
"""Volts of the base and the middle gauge (rows) for an amplitude of each mode (columns)."""
STATIONS = np.linspace(0.0, 1.0, 25)
FIRST = STATIONS**2 * (3.0 - STATIONS) / 2.0
SECOND = STATIONS**2 * (1.0 - 1.4 * STATIONS)
GAINS = {"pd.kp": 1.0, "pd.kd": 2.8, "pdpc.kp": 0.5935, "pdpc.kd": 4.2664, "pdpc.ksg": 0.2538}
RANGES = {"kp": (0.0, 5.0), "kd": (0.0, 20.0), "ksg": (-2.0, 2.0)}
WORDS = {
    "kp": "proportional gain on the position error",
    "kd": "gain of the speed feedback",
    "ksg": "gain of the middle strain gauge",
}


def parameter(name: str, value: object, kind: str, **about: object) -> dict[str, object]:
    """Return a parameter as the greeting lists it."""
    usual: dict[str, object] = {"unit": "", "low": None, "high": None, "choices": []}
    usual |= {"live": True, "read_only": False}
    return {"name": name, "value": value, "kind": kind} | usual | about


THESIS_RIG = {
    "name": "thesis",
    "rate_hz": 300.0,
    "inputs": [{"name": "command_v", "unit": "V", "low": -10.0, "high": 10.0}],
    "outputs": [{"name": name, "unit": "V"} for name in SENSORS],
    "joints": [
        {
            "name": "hub",
            "input": "command_v",
            "angle": "position_v",
            "rate": "speed_v",
            "low": -6.857,
            "high": 6.857,
            "unit": "V",
            "slides": False,
            "link_length_m": 1.0,
            "reference": "reference_v",
        }
    ],
    "tracked": [
        {
            "name": "reference_v",
            "output": "position_v",
            "joint": "hub",
            "unit": "V",
            "low": -6.857,
            "high": 6.857,
        }
    ],
}


def greeting_of(rig: RigDescription, *, hand: bool) -> dict[str, Any]:
    """Return the hello message of an arm that is not the thesis's."""
    thesis = greeting(rig.rate_hz, hand=hand)
    nodes = {"daq": thesis["nodes"]["daq"][1:], "controller": thesis["nodes"]["controller"]}
    of_node = {"type": "hello", "version": 1, "hand": hand, "simulated": False, "nodes": nodes}
    return of_node | {"rate_hz": rig.rate_hz} | about_arm(rig, simulated=False)


def greeting(rate_hz: float, *, hand: bool) -> dict[str, Any]:
    """Return the hello message of a simulated arm."""
    gains = [
        parameter(
            name,
            value,
            "double",
            unit="V/V",
            low=low,
            high=high,
            description=WORDS[name.split(".")[1]],
        )
        for name, value in GAINS.items()
        for low, high in [RANGES[name.split(".")[1]]]
    ]
    daq = [
        parameter("payload_kg", 0.0, "double", unit="kg", low=0.0, high=1.0, description="mass"),
        parameter(
            "max_command_v",
            10.0,
            "double",
            unit="V",
            low=0.1,
            high=10.0,
            description="limiter: largest command",
        ),
        parameter(
            "on_fault",
            "stop",
            "string",
            choices=["stop", "hold"],
            description="what a fault of the rig leads to",
        ),
    ]
    return {
        "type": "hello",
        "version": 1,
        "hand": hand,
        "rate_hz": rate_hz,
        "simulated": True,
        "channels": [
            {"name": name, "unit": "V", "si_unit": si, "si_per_unit": factor, "group": group}
            for name, si, factor, group in CHANNELS
        ],
        "arm": {
            "link_length_m": 1.0,
            "stops_deg": [-80.0, 80.0],
            "mode_shapes": {
                "station": STATIONS.tolist(),
                "first": FIRST.tolist(),
                "second": SECOND.tolist(),
            },
            "gauges": ["base_strain_v", "middle_strain_v"],
            "gauge_stations": [0.02, 0.5],
            "strain_to_amplitude": np.linalg.inv(STRAIN_PER_MODE).tolist(),
        },
        "rig": THESIS_RIG,
        "laws": ["pd", "pdpc"],
        "tunable_laws": ["pdpc", "pi"],
        "laws_with_margins": ["pdpc"],
        "law_titles": {"pd": "PD", "pdpc": "PDP with conditional friction compensation"},
        "experiments": [
            {"name": "C_dat3", "description": "closed loop, varying square wave of 3 V"},
            {"name": "C_dat4", "description": "closed loop, varying square wave of 2 V"},
        ],
        "faults": [{"name": "stuck", "description": "a sensor keeps its reading"}],
        "nodes": {"daq": daq, "controller": gains},
    }


class MockArm:
    """Arm with two bending modes under a PD law, a step at a time."""

    def __init__(self, rate_hz: float) -> None:
        self.dt_s = 1.0 / rate_hz
        self.sequence = 0
        self.reference_v = 0.0
        self.gains = dict(GAINS)
        self.law = "pdpc"
        self.driven = True
        self.fixed: tuple[float, ...] | None = None
        self._position_v = self._speed = 0.0
        self._bend = np.zeros((2, 2))
        self._random = np.random.default_rng(1)

    @property
    def references(self) -> list[float]:
        """Set-point in force."""
        return [self.reference_v]

    def move(self, _: str, value: float) -> None:
        """Take a set-point."""
        self.reference_v = value

    def row(self) -> tuple[float, ...]:
        """Return the next sample: time, then all channels."""
        kp, kd = (self.gains[f"{self.law}.{name}"] for name in ("kp", "kd"))
        feedback_v = kp * (self.reference_v - self._position_v) - 0.2 * kd * 0.2 * self._speed
        command_v = float(np.clip(feedback_v, -10.0, 10.0)) if self.driven else 0.0
        acceleration = 60.0 * command_v - 4.0 * self._speed
        self._speed += acceleration * self.dt_s
        self._position_v += self._speed * self.dt_s
        omega = 2.0 * math.pi * np.array(MODES_HZ)
        forced = -(omega**2) * self._bend[0] - 0.04 * omega * self._bend[1] - acceleration * 0.4
        self._bend[1] += forced * self.dt_s
        self._bend[0] += self._bend[1] * self.dt_s
        strains = STRAIN_PER_MODE @ self._bend[0] + self._random.normal(0.0, 0.03, 2)
        sensors = self.fixed or (self._position_v, *strains, 0.04 * self._speed)
        self.sequence += 1
        compensation_v = 0.7 * math.copysign(1.0, command_v) if abs(command_v) > 0.1 else 0.0
        rest = (command_v, compensation_v, self.reference_v, self.sequence % 2**20)
        return (self.sequence * self.dt_s, *sensors, *rest)


class MockLinks:
    """Arm of a description, whose tracked outputs go to their set-points."""

    def __init__(self, rig: RigDescription) -> None:
        self.rig = rig
        self.dt_s = 1.0 / rig.rate_hz
        self.sequence = 0
        self.references = [0.0] * len(rig.tracked)
        self.gains = dict(GAINS)
        self.law = "pd"
        self.driven = True
        self.fixed: tuple[float, ...] | None = None
        self._outputs = dict.fromkeys(rig.output_names, 0.0)

    def move(self, joint: str, value: float) -> None:
        """Take the set-point of a joint; of the first one where none is named."""
        angles = {each.name: each.angle for each in self.rig.joints}
        name = angles.get(joint, joint) or self.rig.tracked[0]
        self.references[self.rig.tracked.index(name)] = value

    def row(self) -> tuple[float, ...]:
        """Return the next sample: time, then all channels."""
        for name, reference in zip(self.rig.tracked, self.references, strict=True):
            if self.driven:
                self._outputs[name] += 4.0 * self.dt_s * (reference - self._outputs[name])
        self.sequence += 1
        outputs = self.fixed or tuple(self._outputs.values())
        inputs = [0.1 * each.high for each in self.rig.inputs]
        rest = (*inputs, *(0.0 for _ in inputs), *self.references, self.sequence % 2**20)
        return (self.sequence * self.dt_s, *outputs, *rest)


def frame(rows: list[tuple[float, ...]]) -> bytes:
    """Return rows as a binary frame of the contract."""
    values = np.array(rows)
    start_s = float(values[0, 0])
    values[:, 0] -= start_s
    head = struct.pack("<4Id", MAGIC, *values.shape, 0, start_s)
    return head + values.astype("<f4").tobytes()


def identified(request: dict[str, Any]) -> dict[str, Any]:
    """Return the result of an identification with the order that was asked for."""
    random = np.random.default_rng(2)
    hz = np.linspace(0.5, 60.0, 400)
    frequencies, damping = [9.02, 22.84, 46.1, 55.3], [0.021, 0.014, 0.011, 0.2]
    stable = [
        [order, f + random.normal(0.0, 0.6 / order), True]
        for order in range(2, 41, 2)
        for k, f in enumerate(frequencies[:3])
        if order >= 4 + 4 * k
    ]
    noise = [
        [order, random.uniform(1.0, 60.0), False] for order in range(4, 41, 2) for _ in range(4)
    ]
    gains = [
        20.0 * np.log10(sum(abs(1 / (f**2 - hz**2 + 2j * 0.02 * f * hz)) for f in frequencies[k:3]))
        for k in (0, 0, 1, 1)
    ]
    t_s = np.arange(0.0, 8.0, 0.01)
    waves = [np.sin(t_s * (1.0 + k)) * np.exp(-0.1 * t_s) for k in range(4)]
    return {
        "modes": [
            {"frequency_hz": f, "damping": d, "kind": "physical" if d < 0.1 else "rare"}
            for f, d in zip(frequencies, damping, strict=True)
        ],
        "outputs": list(SENSORS),
        "dmv": [0.012, 0.043, 0.051, 0.024, 0.0325],
        "verdict": "good",
        "verdict_line": "The model matches the record on every output.",
        "order": request.get("order") or 10,
        "stabilisation": {"orders": list(range(2, 41, 2)), "points": stable + noise},
        "spectrum": {"hz": hz.tolist(), "db": [gain.tolist() for gain in gains]},
        "fit": {
            "t_s": t_s.tolist(),
            "measured": [(wave + random.normal(0, 0.03, len(t_s))).tolist() for wave in waves],
            "simulated": [wave.tolist() for wave in waves],
        },
        "report": f"/report/{request['bag']}",
        "bag": request["bag"],
        "models": [request["bag"], "yesterday"],
        "warnings": ["The record is short."],
        "command": f"./flexarm identify {request['bag']} --order {request.get('order') or 10}",
    }


def compared(request: dict[str, Any]) -> dict[str, Any]:
    """Return the result of a comparison."""
    return {
        "comparison": f"/report/{request['bag']}/comparison",
        "command": f"./flexarm report {request['bag']} {' '.join(request['models'])}",
    }


def tuned(request: dict[str, Any]) -> dict[str, Any]:
    """Return the result of a tuning."""
    law = request["law"]
    hz = np.geomspace(0.05, 100.0, 200)
    loop = 4.0 / (2j * np.pi * hz * (1.0 + 0.05j * hz)) * np.exp(-0.004j * hz)
    t_s = np.arange(0.0, 3.0, 0.02)
    response = {
        "hz": hz.tolist(),
        "db": (20.0 * np.log10(abs(loop))).tolist(),
        "phase_deg": np.degrees(np.unwrap(np.angle(loop))).tolist(),
    }
    figures = {"gain_margin_db": 12.1, "phase_margin_deg": 61.0, "gain_hz": 40.0, "phase_hz": 0.63}
    return {
        "law": law,
        "gains": {f"{law}.kp": 0.8, f"{law}.kd": 5.0},
        "margins": [{"model": name, **figures, "response": response} for name in request["models"]],
        "required": {key: request[key] for key in ("gain_margin_db", "phase_margin_deg")},
        "step": {
            "t_s": t_s.tolist(),
            "before": (1.0 - np.exp(-2.0 * t_s)).tolist(),
            "after": (1.0 - np.exp(-4.0 * t_s)).tolist(),
        },
        "command": tuned_line(request),
    }


def tuned_line(request: dict[str, Any]) -> str:
    """Return the command line of a tuning."""
    margins = "".join(f" {key} {request[key]:g}" for key in sorted(request) if "margin" in key)
    return f"./flexarm tune --law {request['law']} {' '.join(request['models'])}{margins}"
