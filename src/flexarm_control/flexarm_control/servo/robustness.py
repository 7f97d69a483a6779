"""Disk margins of servo loops over uncertain models, and the bandwidth that they allow.

The disk margin of several loops is the largest size of simultaneous gain and phase errors, one in
each loop, that the closed loop tolerates: 1 / mu(S - I/2) with the sensitivity S and a diagonal
uncertainty (Seiler, Packard, Gahinet, "An introduction to disk margins", IEEE Control Systems
Magazine 40, 2020). It is taken at all inputs together and at each output alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_control.servo.regulator import FILTERS, design_regulator, loop_radius
from flexarm_core.errors import SettingError
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.models.state_space import state_space, with_matrices

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

    from flexarm_control.servo.regulator import Filter, Regulator
    from flexarm_core.arrays import ComplexArray, FloatArray

ROBUSTNESS = 0.5
"""Disk margin that a bandwidth is to have where none is said."""
SPREAD = 0.2
"""Part by which the frequency of a vibration may be another one, such as with another payload."""
VIBRATES = 0.3
"""Damping ratio below which a mode is a vibration."""
FEWEST_PERIODS = 3.0
"""Periods in a record below which a pair does not count as a vibration, but as friction."""
BELOW_VIBRATION = 3.0
"""Frequency of the slowest vibration over the largest bandwidth: a faster loop would excite it."""
_SAMPLES = 20.0
_STEP = 2.0**0.5
_HALVINGS = 3
_RANGE = 1e2
# Part of the largest margin for which a slower design is not worth it.
_NEARLY = 0.9
_POINTS = 150
_AROUND = np.linspace(-3.0, 3.0, 13)
_NARROWEST = 1e-3
_SWEEPS = 20
# A pole at zero has no logarithm.
_TINY = 1e-300
# Disk margin with a model itself below which no controller of it holds a plant.
_LEAST = 0.05


class LoopMargin(NamedTuple):
    """Smallest disk margin of a loop, its frequency, and where it was taken; 0 when unstable."""

    disk: float
    frequency_hz: float
    place: str


@dataclass(frozen=True, eq=False)
class Choice:
    """A servo with its margins.

    Attributes
    ----------
    regulator : Regulator
        Design for the first model.
    margins : dict of str to LoopMargin
        Smallest disk margin with each model and each of its variations.
    limit : str
        What keeps the bandwidth from being larger.
    caution : str
        What a user should know of the margins; empty for nothing.
    """

    regulator: Regulator
    margins: dict[str, LoopMargin]
    limit: str = ""
    caution: str = ""

    @property
    def worst(self) -> tuple[str, LoopMargin]:
        """The model with the smallest margin, and that margin."""
        return min(self.margins.items(), key=lambda each: each[1].disk)

    @property
    def ranked(self) -> list[float]:
        """Disk margins from the smallest on: the larger list is the more robust servo."""
        return sorted(each.disk for each in self.margins.values())


def variations(
    name: str, plant: control.StateSpace, shown_hz: float = 0.0
) -> dict[str, control.StateSpace]:
    """Return a plant and variations of its `vibrations`, by name.

    All frequencies are higher or lower, and the slowest one alone.
    """
    modes = vibrations(plant, shown_hz)
    found = {name: plant}
    if not modes:
        return found
    slowest = min(modes, key=lambda value: abs(np.log(value)))
    for which, words in ((modes, "all vibrations"), ([slowest], "the slowest vibration")):
        for sign, said in ((1.0, "+"), (-1.0, "-")):
            factors = dict.fromkeys(which, 1.0 + sign * SPREAD + 0.0j)
            changed = with_modes(plant, factors)
            found[f"{name}, {words} {said}{100.0 * SPREAD:.0f} %"] = changed
    return found


def with_modes(plant: control.StateSpace, factors: Mapping[complex, complex]) -> control.StateSpace:
    """Return a plant whose modes have other frequencies and dampings, and the same shapes.

    Parameters
    ----------
    plant : control.StateSpace
        The plant.
    factors : mapping of complex to complex
        Eigenvalues with positive imaginary part, and the factor on the logarithm of each.
    """
    values, left, right = scipy.linalg.eig(plant.A, left=True)
    A = np.array(plant.A)
    for value, factor in factors.items():
        i = int(np.argmin(np.abs(values - value)))
        row = left[:, i].conj()
        moved = np.exp(np.log(value) * factor) - value
        # A pair changes by twice the real part; other modes, defective ones too, stay.
        A += 2.0 * np.real(moved * np.outer(right[:, i], row) / (row @ right[:, i]))
    return with_matrices(plant, A=A)


def slowest_vibration_hz(
    plant: control.StateSpace, tracked: Sequence[int], shown_hz: float = 0.0
) -> float:
    """Return the frequency of the slowest vibration, Hz; infinite without one.

    It is one of the free plant, or one with as many tracked outputs as inputs held: the faster they
    are controlled, the nearer do poles of the loop come to these zeros (the arm then swings as if
    its hub was clamped). Pairs and zeros below `shown_hz` are left out, as by `vibrations`.
    """
    values = np.linalg.eigvals(plant.A).astype(complex)
    vibrating = _vibrating(np.append(values, _zeros(plant, tracked)), _speed(plant, shown_hz))
    speeds = [abs(np.log(value)) for value in vibrating]
    return float(min(speeds, default=np.inf) / (2.0 * np.pi * plant.dt))


def attainable_hz(plant: control.StateSpace, tracked: Sequence[int]) -> float:
    """Return the bandwidth that real zeros outside the unit circle leave, Hz; infinite without one.

    An output with such a zero first answers backwards (non-minimum phase), as the tip of a flexible
    arm does. It leaves no controller much more than half of its frequency (Skogestad and
    Postlethwaite, "Multivariable feedback control", section 5.7, 2005). Negative zeros come from
    sampling and limit nothing.
    """
    zeros = _zeros(plant, tracked)
    outside = zeros.real[(zeros.real > 1.0) & (zeros.imag == 0.0)]
    return float(np.log(outside).min(initial=np.inf) / (4.0 * np.pi * plant.dt))


def _zeros(plant: control.StateSpace, tracked: Sequence[int]) -> ComplexArray:
    """Return the zeros from the inputs to as many tracked outputs; none for fewer of them."""
    if len(tracked) != plant.ninputs:
        return np.zeros(0, dtype=complex)
    rows = list(tracked)
    held = state_space(plant.A, plant.B, plant.C[rows], plant.D[rows], float(plant.dt))
    return np.asarray(held.zeros(), dtype=complex)


def loop_margin(found: Regulator, plant: control.StateSpace) -> LoopMargin:
    """Return the smallest disk margin of a servo with a plant, of its inputs and each output.

    python-control's `disk_margins` does so with one input; several need the package slycot, which
    is not part of this environment.
    """
    if not loop_radius(found, plant) < 1.0:
        return LoopMargin(0.0, np.nan, "unstable")
    frequency_hz = loop_frequencies_hz(found, plant)
    at_inputs, at_outputs = sensitivities(found, plant, frequency_hz)
    half = 0.5 * np.eye(plant.ninputs)
    sizes = {"inputs": _mu(at_inputs - half)}
    for output, name in enumerate(plant.output_labels):
        sizes[name] = np.abs(at_outputs[:, output, output] - 0.5)
    margins = {
        place: LoopMargin(1.0 / size.max(), float(frequency_hz[size.argmax()]), place)
        for place, size in sizes.items()
    }
    return min(margins.values())


def sensitivities(
    found: Regulator, plant: control.StateSpace, frequency_hz: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return the sensitivities at inputs and outputs, (frequencies, signals, signals)."""
    P = frequency_response(plant, frequency_hz)
    K = -frequency_response(found.controller, frequency_hz)
    inner = np.linalg.inv(np.eye(plant.ninputs) + K @ P)
    outer = np.eye(plant.noutputs) - P @ inner @ K
    return np.asarray(inner, dtype=complex), np.asarray(outer, dtype=complex)


def loop_frequencies_hz(found: Regulator, plant: control.StateSpace) -> FloatArray:
    """Return frequencies of a loop, Hz: evenly on a scale, and near each of its vibrations."""
    half_hz = 0.5 / float(plant.dt)
    places = [np.geomspace(0.01 * found.bandwidth_hz, half_hz, _POINTS)]
    for matrix in (plant.A, found.controller.A):
        speeds = np.log(np.linalg.eigvals(matrix).astype(complex) + _TINY) / (
            2.0 * np.pi * plant.dt
        )
        places += [
            speed.imag + _AROUND * max(abs(speed.real), _NARROWEST * speed.imag)
            for speed in speeds[speeds.imag > 0.0]
        ]
    grid = np.unique(np.concatenate(places))
    return np.asarray(grid[(grid > 0.0) & (grid <= half_hz)])


def choose_bandwidth(
    plants: Mapping[str, control.StateSpace],
    tracked: Sequence[int],
    *,
    robustness: float,
    limits: FloatArray,
    shown_hz: float = 0.0,
    filters: Sequence[Filter] = FILTERS,
) -> Choice:
    """Return the design with the largest bandwidth whose worst disk margin meets a bound.

    It is searched from above, from a third of the slowest vibration or a twentieth of the rate on,
    with each of the filters. Where no bandwidth meets the bound, it is that with nearly the largest
    margin, and says so.

    Parameters
    ----------
    plants : mapping of str to control.StateSpace
        Plants by name; the first one is designed for.
    tracked : sequence of int
        Outputs that follow set-points.
    robustness : float
        Least disk margin, with each plant and its `variations`.
    limits : ndarray, (inputs,)
        Largest inputs.
    shown_hz : float
        Frequency below which a pair does not count as a vibration; see `vibrations`.
    filters : sequence of Filter
        Filters of the law.

    Raises
    ------
    SettingError
        When no bandwidth stabilises all plants, or only with next to no margin.
    """
    highest_hz, reason = _highest(plants, tracked, shown_hz)
    every = _all(plants, shown_hz)
    made: list[Choice] = []
    best, least_hz = None, highest_hz / _RANGE
    for through in filters:
        tries = _Tries(every, tracked, limits, robustness, through)
        found = tries.fastest(highest_hz, least_hz)
        made += tries.made
        if found is None or (best is not None and found.regulator.bandwidth_hz <= least_hz):
            continue
        least_hz = found.regulator.bandwidth_hz
        if least_hz == highest_hz:
            return replace(found, limit=reason)
        best = replace(found, limit=tries.limit())
    if best is not None:
        return best
    if not made:
        raise tries.error or SettingError("no stabilising design")
    return _most_robust(made, plants, robustness)


class _Tries:
    """Designs with one filter, and the last refusal of one."""

    def __init__(
        self,
        every: Mapping[str, control.StateSpace],
        tracked: Sequence[int],
        limits: FloatArray,
        robustness: float,
        through: Filter,
    ) -> None:
        self._all = every
        self._tracked, self._limits, self._robustness = tracked, limits, robustness
        self._through = through
        self.made: list[Choice] = []
        self.error: SettingError | None = None

    def fastest(self, highest_hz: float, least_hz: float) -> Choice | None:
        """Return the design with the largest bandwidth that suffices; None without one."""
        low_hz = high_hz = highest_hz
        while (best := self._suffices(low_hz)) is None:
            if low_hz <= least_hz:
                return None
            high_hz, low_hz = low_hz, max(low_hz / _STEP, least_hz)
        for _ in range(_HALVINGS if low_hz < high_hz else 0):
            middle_hz = (low_hz * high_hz) ** 0.5
            found = self._suffices(middle_hz)
            if found is None:
                high_hz = middle_hz
            else:
                best, low_hz = found, middle_hz
        return best

    def limit(self) -> str:
        """Return which margin the last design that failed misses."""
        failed = [each.worst for each in self.made if each.worst[1].disk < self._robustness]
        if not failed:
            return "no design above stabilises the model"
        name, margin = failed[-1]
        place = f"{margin.place}, at {margin.frequency_hz:.3g} Hz" if margin.disk else "unstable"
        return f"above, the disk margin with {name} ({place}) falls below {self._robustness:g}"

    def design(self, bandwidth_hz: float) -> Choice | None:
        """Return the design for a bandwidth; None where there is none."""
        try:
            made = _designed(self._all, self._tracked, bandwidth_hz, self._limits, self._through)
        except SettingError as error:
            self.error = error
            return None
        self.made.append(made)
        return made

    def _suffices(self, bandwidth_hz: float) -> Choice | None:
        made = self.design(bandwidth_hz)
        return made if made is not None and made.worst[1].disk >= self._robustness else None


def _most_robust(
    made: Sequence[Choice], plants: Mapping[str, control.StateSpace], robustness: float
) -> Choice:
    """Return the fastest design that nearly has the largest margin, and say what it lacks."""
    best = max(made, key=lambda each: each.ranked)
    least = _NEARLY * best.worst[1].disk
    if least:
        near = [each for each in made if each.worst[1].disk >= least]
        best = max(near, key=lambda each: each.regulator.bandwidth_hz)
    for name in plants:
        if not best.margins[name].disk:
            raise SettingError(
                f"no stabilising design: with {name} the loop is unstable at every bandwidth; "
                "identify the plant again, or give models that are nearer to each other"
            )
        if best.margins[name].disk < _LEAST:
            raise SettingError(_no_margin(name, best.margins[name]))
    name, margin = best.worst
    most = f"the largest is {margin.disk:.2f}" if margin.disk else "the loop is unstable"
    return replace(
        best,
        limit=f"the disk margin with {name}, which is largest there",
        caution=f"caution: no bandwidth has a disk margin of {robustness:g}; with {name} {most}: "
        "begin with small steps, or give a record that shows the vibrations better",
    )


def _no_margin(name: str, margin: LoopMargin) -> str:
    return (
        f"no stabilising design: the disk margin with {name} is {margin.disk:.1g} at most, which "
        "no plant keeps to; a zero nearly cancels an unstable pole, or the pole is too fast for "
        "the rate and the delay: measure another output, or sample faster"
    )


def _highest(
    plants: Mapping[str, control.StateSpace], tracked: Sequence[int], shown_hz: float
) -> tuple[float, str]:
    """Return the largest bandwidth that is tried, and why."""
    vibration_hz = min(slowest_vibration_hz(plant, tracked, shown_hz) for plant in plants.values())
    rate_hz = 1.0 / float(next(iter(plants.values())).dt)
    if vibration_hz / BELOW_VIBRATION < rate_hz / _SAMPLES:
        return (
            vibration_hz / BELOW_VIBRATION,
            f"the slowest vibration, {vibration_hz:.3g} Hz: a faster loop would excite it",
        )
    return rate_hz / _SAMPLES, f"the rate, {rate_hz:.4g} Hz: {_SAMPLES:.0f} samples for a period"


def at_bandwidth(
    plants: Mapping[str, control.StateSpace],
    tracked: Sequence[int],
    bandwidth_hz: float,
    *,
    limits: FloatArray,
    shown_hz: float = 0.0,
    filters: Sequence[Filter] = FILTERS,
) -> Choice:
    """Return the design for a bandwidth that was said; arguments as in `choose_bandwidth`.

    Raises
    ------
    SettingError
        When it is above half of the rate, or does not hold one of the plants.
    """
    half_hz = 0.5 / float(next(iter(plants.values())).dt)
    if not bandwidth_hz < half_hz:
        raise SettingError(
            f"--bandwidth {bandwidth_hz:g} Hz: must be below half of the rate, {half_hz:g} Hz; say "
            "a smaller one, or auto"
        )
    every = _all(plants, shown_hz)
    tries = [_Tries(every, tracked, limits, 0.0, through) for through in filters]
    made = [found for each in tries if (found := each.design(bandwidth_hz)) is not None]
    if not made:
        raise tries[0].error or SettingError("no stabilising design")
    choice = max(made, key=lambda each: each.ranked)
    for name in plants:
        if not choice.margins[name].disk:
            raise SettingError(
                f"no stabilising design at {bandwidth_hz:g} Hz: the loop with {name} is unstable; "
                "say a smaller --bandwidth, or auto"
            )
    return replace(choice, limit="it was said")


def _designed(
    plants: Mapping[str, control.StateSpace],
    tracked: Sequence[int],
    bandwidth_hz: float,
    limits: FloatArray,
    through: Filter,
) -> Choice:
    """Return the design for the first plant with its margins with all of them."""
    first = next(iter(plants.values()))
    found = design_regulator(first, tracked, bandwidth_hz, limits=limits, through=through)
    return Choice(found, {name: loop_margin(found, plant) for name, plant in plants.items()})


def _all(
    plants: Mapping[str, control.StateSpace], shown_hz: float
) -> dict[str, control.StateSpace]:
    return {
        said: each
        for name, plant in plants.items()
        for said, each in variations(name, plant, shown_hz).items()
    }


def vibrations(plant: control.StateSpace, shown_hz: float = 0.0) -> list[complex]:
    """Return the eigenvalues of vibrations with positive imaginary part.

    A pair below `shown_hz` is left out: a record with fewer than `FEWEST_PERIODS` of it does not
    show whether it vibrates, creeps or stands for friction.
    """
    return _vibrating(np.linalg.eigvals(plant.A).astype(complex), _speed(plant, shown_hz))


def _speed(plant: control.StateSpace, frequency_hz: float) -> float:
    """Return a frequency in radians a sample."""
    return 2.0 * np.pi * frequency_hz * float(plant.dt)


def _vibrating(values: ComplexArray, slowest: float) -> list[complex]:
    """Return those of some eigenvalues or zeros that vibrate, with positive imaginary part."""
    found = []
    for value in values.tolist():
        speed = np.log(value) if value.imag > 0.0 else 0.0
        if value.imag > 0.0 and -speed.real < VIBRATES * abs(speed) and abs(speed) >= slowest:
            found.append(value)
    return found


def _mu(matrices: ComplexArray) -> FloatArray:
    """Return an upper bound of mu for a diagonal uncertainty, by scaling (Osborne 1960)."""
    count = matrices.shape[1]
    scaled = matrices.copy()
    for _ in range(_SWEEPS if count > 1 else 0):
        for i in range(count):
            rows = np.linalg.norm(np.delete(scaled[:, i, :], i, axis=1), axis=1)
            columns = np.linalg.norm(np.delete(scaled[:, :, i], i, axis=1), axis=1)
            factor = np.sqrt((columns + _TINY) / (rows + _TINY))
            scaled[:, i, :] *= factor[:, None]
            scaled[:, :, i] /= factor[:, None]
    return np.asarray(np.linalg.svd(scaled, compute_uv=False)[:, 0])
