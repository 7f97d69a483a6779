"""Servo for models and what is known of their plants: design, controller, steps on twins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexarm_control.servo.controller import Servo, ServoGains
from flexarm_control.servo.regulator import LAWS, loop_plant, tracked_outputs
from flexarm_control.servo.rigid_motion import rigid_motion
from flexarm_control.servo.robustness import (
    FEWEST_PERIODS,
    ROBUSTNESS,
    SPREAD,
    at_bandwidth,
    attainable_hz,
    choose_bandwidth,
    slowest_vibration_hz,
)
from flexarm_control.servo.set_point import plan_for, planned_speeds
from flexarm_control.servo.twin import TWINS, Twin, perturbed, step_results, step_run
from flexarm_core.errors import SettingError, nearest
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.models.state_space import state_space
from flexarm_ident.provenance import signal_fields

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

    from flexarm_control.servo.regulator import Regulator
    from flexarm_control.servo.robustness import Choice
    from flexarm_control.servo.twin import Run, StepResult
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.friction.dry_friction import DryFriction
    from flexarm_ident.records.iodata import IoData

_PERIODS = 8.0
# Periods of the bandwidth that a step may take.
_LONGEST = 1000.0
_WIDTH, _WIDEST = 0.05, 0.1


@dataclass(frozen=True, eq=False)
class Source:
    """Model of a plant, and what its file and its record tell.

    Attributes
    ----------
    name : str
        Name for the user.
    model : control.StateSpace
        The model.
    friction : DryFriction, optional
        Friction at its inputs.
    record : IoData, optional
        Record from which it was identified.
    facts : mapping of str to list of float
        Ends and noise of the signals as its file has them, where there is no record; see
        `flexarm_ident.provenance.signal_fields`.
    """

    name: str
    model: control.StateSpace
    friction: DryFriction | None = None
    record: IoData | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def signals(self) -> Mapping[str, Any]:
        """Ends and noise of the signals of its record, or its file; empty for neither."""
        return self.facts if self.record is None else signal_fields([self.record])

    @property
    def noise(self) -> FloatArray:
        """Standard deviation of each output's noise; zeros where it is not known."""
        return np.asarray(self.signals.get("noise_sd", np.zeros(self.model.noutputs)))

    @property
    def shown_hz(self) -> float:
        """Lowest frequency that its longest record shows as a vibration; 0 without a record."""
        seconds = self.signals.get("record_s")
        return FEWEST_PERIODS / max(seconds) if seconds else 0.0

    def twin(self, delay_s: float) -> Twin:
        """Return the plant of a loop with this model."""
        if self.friction is None:
            levels, speed = np.zeros(self.model.ninputs), np.zeros(np.shape(self.model.B.T))
        else:
            levels, speed = self.friction.levels, self.friction.speed
        return Twin(self.model, levels, speed, self.noise, delay_s)


def with_rigid_motion(source: Source, joints: Sequence[int]) -> tuple[Source, tuple[str, ...]]:
    """Return a source with the rigid motion and friction of its record, where that is better.

    Parameters
    ----------
    source : Source
        Model and record; one without a record, or with friction of its own, stays.
    joints : sequence of int
        Outputs that may be angles of joints: the tracked ones.

    Returns
    -------
    Source
        The model to design with.
    tuple of str
        What a user should know of it.
    """
    if source.record is None or source.friction is not None:
        return source, ()
    found = rigid_motion(source.model, source.record, joints)
    if found is None:
        return source, ()
    levels = ", ".join(
        f"{level:.3g} of {name}"
        for level, name in zip(found.friction.levels, source.model.input_labels, strict=True)
    )
    note = (
        f"{source.name}: rigid motion and dry friction ({levels}) took the place of slow poles "
        f"that stand for friction: they describe the moves in the record with an error of "
        f"{found.error:.2f} instead of {found.former_error:.2f}"
    )
    return replace(source, model=found.model, friction=found.friction), (note,)


class ServoRequest(NamedTuple):
    """What a servo is to do.

    Attributes
    ----------
    track : tuple of str
        Outputs that follow set-points.
    limits : mapping of str to float
        Largest commands by input; those of the record for the others.
    bandwidth_hz : float, optional
        Bandwidth; None: as large as the margin allows.
    robustness : float
        Least disk margin of a bandwidth that is chosen.
    delay_s : float
        Delay of the loop, s.
    law : str
        A name of `LAWS`.
    """

    track: tuple[str, ...]
    limits: Mapping[str, float]
    bandwidth_hz: float | None = None
    robustness: float = ROBUSTNESS
    delay_s: float = 0.0
    law: str = "servo"

    def tracked(self, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[int, ...]:
        """Return the places of the tracked outputs, after a look at the names.

        Raises
        ------
        SettingError
            When an input or output is not among these, or fewer inputs than tracked outputs.
        """
        for name, limit in self.limits.items():
            if name not in inputs:
                raise SettingError(f"--limit {name}: no such input{nearest(name, inputs)}")
            if not limit > 0.0:
                raise SettingError(f"--limit {name}={limit:g}: must be above zero")
        return tracked_outputs(inputs, outputs, self.track)


@dataclass(frozen=True, eq=False)
class ServoDesign:
    """A designed servo.

    Attributes
    ----------
    law : str
        Its name in `LAWS`.
    gains : ServoGains
        The controller.
    choice : Choice
        The design with its margins.
    plants : dict of str to control.StateSpace
        Plants of the design by name.
    shown_hz : float
        Frequency below which a pair does not count as a vibration.
    twin : Twin
        Twin of the first model.
    steps : ndarray, (tracked,)
        Steps of the tracked outputs on the twins.
    run : Run
        Step on the twin.
    results : tuple of StepResult
        Its figures.
    others : tuple of Run
        Steps on perturbed twins.
    notes : tuple of str
        What a user should know.
    """

    law: str
    gains: ServoGains
    choice: Choice
    plants: dict[str, control.StateSpace]
    shown_hz: float
    twin: Twin
    steps: FloatArray
    run: Run
    results: tuple[StepResult, ...]
    others: tuple[Run, ...]
    notes: tuple[str, ...]

    @property
    def other_results(self) -> list[tuple[StepResult, ...]]:
        """Figures of the steps on perturbed twins."""
        servo = Servo(self.gains)
        return [step_results(servo, run, self.steps) for run in self.others]


def design_servo(sources: Sequence[Source], request: ServoRequest) -> ServoDesign:
    """Design a servo, and step it on twins.

    Parameters
    ----------
    sources : sequence of Source
        Models of one rig, such as with several payloads; the first one is designed for.
    request : ServoRequest
        What it is to do.

    Raises
    ------
    SettingError
        When the models differ in their signals or periods, an output or input is not known, or no
        design has what is asked for.
    """
    first = sources[0]
    _require_alike(sources)
    tracked = request.tracked(list(first.model.input_labels), list(first.model.output_labels))
    limits, notes = _limits(sources, request)
    moved = [with_rigid_motion(source, tracked) for source in sources]
    sources = [source for source, _ in moved]
    first, notes = sources[0], (*notes, *(note for _, each in moved for note in each))
    plants = {each.name: loop_plant(each.model, request.delay_s) for each in sources}
    shown_hz = max(each.shown_hz for each in sources)
    known: dict[str, Any] = {"limits": limits, "shown_hz": shown_hz, "filters": LAWS[request.law]}
    if request.bandwidth_hz is None:
        choice = choose_bandwidth(plants, tracked, robustness=request.robustness, **known)
    else:
        choice = at_bandwidth(plants, tracked, request.bandwidth_hz, **known)
    backwards = _backwards(plants, tracked, shown_hz)
    notes = tuple(filter(None, (choice.caution, backwards, *notes)))
    steps = _steps(first, tracked)
    gains = _gains(choice, first, limits, steps)
    servo = Servo(gains)
    slowest = np.max(np.abs(steps) / gains.slopes, initial=0.0) / gains.rate_hz
    seconds = _PERIODS / gains.bandwidth_hz + slowest
    if not seconds < _LONGEST / gains.bandwidth_hz:
        raise SettingError(
            f"a step would take {seconds:.3g} s within the limits of the inputs, "
            f"{', '.join(f'{each:.4g}' for each in limits)}: say larger ones by --limit, or "
            "identify the plant again"
        )
    twin = first.twin(request.delay_s)
    run = step_run(servo, twin, steps, seconds, seed=0)
    others = tuple(
        step_run(servo, perturbed(twin, seed, SPREAD), steps, seconds, seed=seed)
        for seed in range(1, TWINS + 1)
    )
    results = step_results(servo, run, steps)
    return ServoDesign(
        request.law, gains, choice, plants, shown_hz, twin, steps, run, results, others, notes
    )


def _backwards(
    plants: Mapping[str, control.StateSpace], tracked: Sequence[int], shown_hz: float
) -> str:
    """Return what zeros outside the unit circle leave, where it is less than the vibrations do."""
    left = {name: attainable_hz(plant, tracked) for name, plant in plants.items()}
    name = min(left, key=left.__getitem__)
    if not left[name] < slowest_vibration_hz(plants[name], tracked, shown_hz):
        return ""
    outputs = ", ".join(plants[name].output_labels[output] for output in tracked)
    return (
        f"{outputs} first moves backwards (non-minimum phase): {name} has a zero outside the unit "
        f"circle at {2.0 * left[name]:.3g} Hz, which leaves a bandwidth of about "
        f"{left[name]:.2g} Hz"
    )


def _require_alike(sources: Sequence[Source]) -> None:
    def signals(source: Source) -> tuple[list[str], list[str], float]:
        model = source.model
        return list(model.input_labels), list(model.output_labels), float(model.dt)

    first, *others = sources
    for other in others:
        if signals(other) != signals(first):
            raise SettingError(
                f"{other.name} and {first.name} differ in inputs, outputs or period: give models "
                "of one rig, made from the same columns at one rate"
            )


def _limits(sources: Sequence[Source], request: ServoRequest) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the largest commands, (inputs,), and notes on those that nobody said."""
    names = list(sources[0].model.input_labels)
    found, notes = np.full(len(names), np.inf), []
    measured = [each.signals for each in sources if "input_low" in each.signals]
    for i, name in enumerate(names):
        if name in request.limits:
            found[i] = request.limits[name]
        elif measured:
            ends = [each[end][i] for each in measured for end in ("input_low", "input_high")]
            found[i] = float(np.max(np.abs(ends)))
            notes.append(
                f"limit of {name}: {found[i]:.4g}, the largest command in the record; "
                f"--limit {name}=VALUE sets another"
            )
        else:
            notes.append(f"{name} has no limit: say --limit {name}=VALUE")
    return found, tuple(notes)


def _steps(source: Source, tracked: Sequence[int]) -> FloatArray:
    """Return steps of the tracked outputs: half of what the record covers, else one unit."""
    signals = source.signals
    if "output_low" not in signals:
        return np.ones(len(tracked))
    covered = (np.array(signals["output_high"]) - signals["output_low"])[list(tracked)]
    return np.where(covered > 0.0, 0.5 * covered, 1.0)


def _gains(choice: Choice, source: Source, limits: FloatArray, steps: FloatArray) -> ServoGains:
    regulator = choice.regulator
    plant = regulator.plant
    order, states = plant.nstates, len(regulator.A)
    levels, speed = np.zeros(plant.ninputs), np.zeros((plant.ninputs, order))
    if source.friction is not None:
        levels = np.minimum(source.friction.levels, limits)
        # Friction is the same whichever direction counts as forwards: here it is the force's.
        forwards = np.sign(np.diag(source.friction.speed @ source.model.B))
        speed[:, : source.model.nstates] = source.friction.speed * forwards[:, np.newaxis]
    # A joint at rest has no speed, and an identified map takes a part of the position for it.
    speed -= speed @ regulator.rest @ plant.C[list(regulator.tracked)]
    plan = plan_for(regulator, limits, levels)
    headings = planned_speeds(regulator, plan.windows, speed)
    moves = np.abs(headings) @ np.abs(steps) / plan.windows[0]
    widths = _widths(regulator, speed, levels, moves)
    rest = np.zeros((states, len(regulator.tracked)))
    rest[:order] = regulator.rest
    return ServoGains(
        inputs=tuple(plant.input_labels),
        outputs=tuple(plant.output_labels),
        tracked=tuple(plant.output_labels[each] for each in regulator.tracked),
        rate_hz=1.0 / float(plant.dt),
        bandwidth_hz=regulator.bandwidth_hz,
        disk_margin=float(choice.worst[1].disk),
        limits=limits,
        A=regulator.A,
        B=regulator.B,
        C=regulator.C,
        feedback=regulator.feedback,
        correction=regulator.correction,
        deviation=regulator.deviation,
        planning=regulator.planning,
        forward=regulator.forward,
        rest=rest,
        slopes=plan.slopes,
        windows=np.array(plan.windows, dtype=np.int64),
        levels=levels,
        onsets=headings / widths[:, np.newaxis],
    )


def _widths(
    regulator: Regulator, speed: FloatArray, levels: FloatArray, moves: FloatArray
) -> FloatArray:
    """Return planned speeds from which friction is compensated in full, (inputs,).

    They are a twentieth of the speeds that a force of the friction's size makes at the bandwidth,
    and a tenth of the speeds `moves` of a step at most: strong friction is met in small moves too.
    """
    plant = regulator.plant
    speeds = state_space(plant.A, plant.B, speed, 0.0, float(plant.dt))
    gains = np.abs(frequency_response(speeds, [regulator.bandwidth_hz])[0])
    sizes = np.minimum(_WIDTH * np.diag(gains) * levels, _WIDEST * moves)
    return np.where(sizes > 0.0, sizes, 1.0)
