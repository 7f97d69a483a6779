"""Linear quadratic Gaussian control from all four signals, with a disturbance in its observer.

The observer is the stationary Kalman filter of the arm, of the loop's delay and of a disturbance at
the input that drifts. The disturbance stands for what friction its compensation leaves. The
regulator takes it out, which is the integral action of the law: there is no sum of errors that
could wind up. The compensation of friction has the sign of the effort. At the set-point the law
rests as `pdpc_plus` does, and the disturbance is forgotten.

The law has designs for some payloads. All observers run, and the effort is that of the payload
that is detected.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.gains import CompensationLevel
from flexarm_control.laws.ilqr import (
    PLAUSIBLE_V,
    IlqrDesign,
    Observer,
    RegulatorWeights,
    design_regulator,
    quadratic_gain,
    radius,
    rounded,
)
from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, limited
from flexarm_control.laws.payload import NO_ESTIMATE, PayloadDetection, PayloadEstimator
from flexarm_control.laws.pdpc_plus import CalmRest
from flexarm_control.laws.strain_limit import StrainLimiter
from flexarm_control.models.arm_model import check_arm_model, check_no_feedthrough, delayed
from flexarm_control.models.nominal_models import nominal_payloads_kg, rig_model
from flexarm_core.specs import setting

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_control.laws.law_protocol import Memory
    from flexarm_control.laws.payload import PayloadEstimate, PayloadSensing
    from flexarm_control.laws.pdpc_plus import RestThresholds
    from flexarm_control.laws.strain_limit import StrainLimit

# Share of the input's variance that drives every state, so that no state is without a gain.
_STATE_SHARE = 1e-6
_DISTURBANCE = -1
"""Place of the disturbance in the state of the observer."""
_ASK_EVERY = 10


@dataclass(frozen=True)
class LqgWeights(RegulatorWeights):
    """Weights and noise levels of the design, found by trial on the simulated rig.

    The noise levels are standard deviations. Those of the gauges and the position are larger than
    the sensors' noise: they stand for what the model does not know as well.
    """

    strain: float = setting(0.05, 0.0, 1e3, "1/V^2", "weight of the gauges")
    speed: float = setting(0.5, 0.0, 1e3, "1/V^2", "weight of the speed")
    effort: float = setting(0.35, 1e-3, 1e3, "1/V^2", "weight of the effort")
    loop_delay_s: float = setting(0.001, 0.0, 0.05, "s", "loop delay that the model has not")
    disturbance_v: float = setting(
        0.9, 1e-3, 10.0, "V", "disturbance at the input, sample by sample"
    )
    drift_v: float = setting(0.03, 1e-4, 1.0, "V", "change of the lasting disturbance in a sample")
    position_noise_v: float = setting(0.09, 1e-4, 10.0, "V", "noise of the position")
    strain_noise_v: float = setting(0.17, 1e-4, 10.0, "V", "noise of the gauges")
    speed_noise_v: float = setting(0.06, 1e-4, 10.0, "V", "noise of the tachometer")


@dataclass(frozen=True)
class LqgSettings(CompensationLevel):
    """Compensation of friction and first payload of the law.

    The design for the heaviest payload works with a light one, and not the other way round.
    """

    full_effort_v: float = setting(0.1, 0.001, 5.0, "V", "effort of the full compensation")
    payload_kg: float = setting(0.4, 0.0, 1.0, "kg", "payload until one is detected")


@dataclass(frozen=True)
class PayloadDesign:
    """Design for one payload, kg."""

    payload_kg: float
    design: IlqrDesign


def design_lqg(model: control.StateSpace, weights: LqgWeights | None = None) -> IlqrDesign:
    """Design regulator, Kalman filter and reference gain.

    Parameters
    ----------
    model : control.StateSpace
        Model of the arm with D = 0.
    weights : LqgWeights, optional
        Weights of the design.

    Returns
    -------
    IlqrDesign
        Gains of the controller. Its model has the states of the given one, the commands that are
        on their way, and the disturbance at the input. Its observer corrects by all four outputs.

    Raises
    ------
    SettingError
        When the model cannot be used.
    """
    # The identification is loaded only to make a model.
    from flexarm_ident.models.state_space import with_matrices  # noqa: PLC0415

    weights = weights if weights is not None else LqgWeights()
    check_arm_model(model)
    check_no_feedthrough(model)
    late = delayed(model, weights.loop_delay_s)
    kc, kp = design_regulator(late, weights)
    order, none = late.nstates, np.zeros((1, late.nstates))
    a, c = rounded(late.A), np.hstack([late.C, np.zeros((len(late.C), 1))])
    b = rounded(late.B)
    moved = np.zeros((order + 1, order + 1))
    moved[:-1, :-1] = weights.disturbance_v**2 * (b @ b.T + _STATE_SHARE * np.eye(order))
    moved[-1, -1] = weights.drift_v**2
    strain = weights.strain_noise_v
    noise_v = np.array([weights.position_noise_v, strain, strain, weights.speed_noise_v])
    disturbed = with_matrices(
        late,
        A=np.block([[a, b], [none, np.ones((1, 1))]]),
        B=np.vstack([b, [[0.0]]]),
        C=c,
        D=np.zeros((len(c), 1)),
    )
    observer = quadratic_gain(disturbed.A.T, c.T, moved, np.diag(noise_v**2)).T
    return IlqrDesign(
        model=disturbed,
        channels=tuple(range(len(c))),
        # The regulator takes the disturbance out.
        kc=np.append(kc, 1.0),
        observer=observer,
        kp=kp,
        ki=0.0,
        regulator_radius=radius(a - b @ kc[None]),
        observer_radius=radius(disturbed.A - observer @ c),
    )


@lru_cache(maxsize=4)
def packaged_designs(weights: LqgWeights) -> tuple[PayloadDesign, ...]:
    """Return the designs on the packaged models of the rig, smallest payload first.

    Raises
    ------
    SettingError
        When there is no design with these weights.
    """
    return tuple(
        PayloadDesign(payload_kg, design_lqg(rig_model(payload_kg), weights))
        for payload_kg in nominal_payloads_kg()
    )


class Lqg:
    """LQG law, one sample at a time.

    The observers start at rest at the position of the arm. Their input is the effort that is sent.
    A measurement beyond 100 V is a fault: the answer is zero and the states do not
    change.

    Parameters
    ----------
    designs : IlqrDesign or tuple of PayloadDesign
        Design on one model, or designs on models of some payloads.
    settings : LqgSettings
        Compensation of friction and first payload.
    limit : StrainLimit
        Limit on the base gauge.
    thresholds : RestThresholds
        Thresholds of the rest, and help to the bent arm.
    sensing : PayloadSensing
        Settings of the estimator of the payload.
    """

    def __init__(
        self,
        designs: IlqrDesign | tuple[PayloadDesign, ...],
        settings: LqgSettings,
        limit: StrainLimit,
        thresholds: RestThresholds,
        sensing: PayloadSensing,
    ) -> None:
        if isinstance(designs, IlqrDesign):
            designs = (PayloadDesign(settings.payload_kg, designs),)
        rate_hz = 1.0 / float(designs[0].design.model.dt)
        self._settings = settings
        self._payloads_kg = [each.payload_kg for each in designs]
        self._observers = [Observer(each.design) for each in designs]
        limit_v = limit.strain_limit_v
        self._limiters = [
            StrainLimiter(each.design.model, each.design.kc, each.design.kp, limit_v)
            for each in designs
            if limit_v
        ]
        self._rest = CalmRest(thresholds, rate_hz)
        self._estimator = PayloadEstimator(PayloadDetection(**asdict(sensing), rate_hz=rate_hz))
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._rest.reset()
        self._estimator.reset()
        self._payload = NO_ESTIMATE
        self._active = self._nearest(self._settings.payload_kg)
        self._samples = 0

    @property
    def payload(self) -> PayloadEstimate:
        """Present estimate of the payload."""
        return self._payload

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        for value_v in (*volts, reference_v):
            if not -PLAUSIBLE_V < value_v < PLAUSIBLE_V:
                return NO_EFFORT
        position_v, base_v, _, speed_v = volts
        if not self._samples:
            for each in self._observers:
                each.begin(position_v)
        self._weigh(volts)
        observer, rest = self._observers[self._active], self._rest
        compensation_v = rest.step(reference_v - position_v, base_v, speed_v)
        effort_v = observer.effort_v(reference_v)
        if rest.resting:
            effort_v += float(observer.state[_DISTURBANCE])
        else:
            if self._limiters:
                limiter = self._limiters[self._active]
                effort_v = limiter.limited_v(effort_v, observer.state, base_v, reference_v)
            share = min(1.0, max(-1.0, effort_v / self._settings.full_effort_v))
            compensation_v = share * self._settings.compensation_v
        answer = limited(effort_v, compensation_v)
        for each in self._observers:
            each.move(volts, answer.effort_v)
            if rest.resting:
                each.state[_DISTURBANCE] = 0.0
        return answer

    def hear(self, missing_v: float, cut_v: float) -> None:  # noqa: ARG002 - it sums no errors
        """Hear what became of the last effort; see `HearingLaw.hear`."""
        for each in self._observers:
            each.correct(missing_v)

    def _weigh(self, volts: Sequence[float]) -> None:
        """Give the estimator a sample, and choose the design of the payload that it detects."""
        self._estimator.step(volts)
        self._samples += 1
        if self._samples % _ASK_EVERY == 0:
            self._payload = self._estimator.estimate
            if self._payload.detected:
                self._active = self._nearest(self._payload.payload_kg)

    def _nearest(self, payload_kg: float) -> int:
        """Return the place of the design whose payload is nearest."""
        distances_kg = [abs(payload_kg - each_kg) for each_kg in self._payloads_kg]
        return distances_kg.index(min(distances_kg))

    def memory(self) -> Memory:
        """Return observers, rest and estimator; see `LawWithMemory.memory`."""
        return {
            **self._rest.memory(),
            **self._estimator.memory(),
            "observers": [float(each) for one in self._observers for each in one.state],
            "active": (float(self._active), float(self._samples)),
        }

    def remember(self, memory: Memory) -> None:
        """Go on from observers, a rest and an estimator; see `LawWithMemory.remember`."""
        self._rest.remember(memory)
        self._estimator.remember(memory)
        numbers = iter(memory["observers"])
        for observer in self._observers:
            observer.state[:] = [next(numbers) for _ in observer.state]
        active, samples = memory["active"]
        self._active, self._samples = int(active), int(samples)
