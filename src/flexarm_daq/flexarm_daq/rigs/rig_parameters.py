"""Physical parameters of the rig: every figure of the simulation, with its origin."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final

from flexarm_core.channels import (
    BASE_STRAIN_V_PER_NM,
    MIDDLE_STRAIN_V_PER_NM,
    POSITION_V_PER_RAD,
    SPEED_V_S_PER_RAD,
    TRAVEL_DEG,
)
from flexarm_core.errors import SettingError

LOW_NOISE_V: Final = (0.005, 0.05, 0.03, 0.02)
"""Standard deviation of the sensor noise of a well shielded rig, position to speed."""

THESIS_NOISE_V: Final = (0.01, 0.4, 0.2, 0.03)
"""Sensor noise that makes the gauge errors of an identified model as large as in Table 2-4."""

NO_HUM_V: Final = (0.0, 0.0, 0.0, 0.0)
"""Mains hum of a rig whose cables take none."""

_MAY_BE_ZERO: Final = frozenset(
    {
        "tip_mass_kg",
        "payload_kg",
        "tip_inertia_kg_m2",
        "loop_delay_s",
        "coulomb_friction_nm",
        "viscous_friction_nm_s_per_rad",
        "mass_damping_per_s",
        "stiffness_damping_s",
        "gear_damping_nm_s_per_rad",
        "backlash_deg",
        "stop_damping_nm_s_per_rad",
    }
)
_CONVERTER_BITS: Final = range(1, 33)


@dataclass(frozen=True)
class RigParameters:
    """Parameters of motor, gear, arm and sensors; by default the thesis's rig without payload.

    Attributes
    ----------
    length_m, width_m, thickness_m : float
        Dimensions of the beam (section 2.3).
    youngs_modulus_pa, density_kg_per_m3 : float
        Handbook values of aluminium 6061-T6, the alloy of section 2.3.
    motor_inertia_kg_m2, load_inertia_kg_m2 : float
        Hub inertia on either side of the gear. The sum is fitted to the modes identified in Table
        3-1 (9.0, 22.8 and 46.0 Hz), the split is chosen.
    tip_mass_kg : float
        Mass of the payload holder, fitted to the same modes.
    payload_kg : float
        Point mass at the tip; 0, 0.2, 0.3 and 0.4 kg in Table A-3.
    tip_inertia_kg_m2 : float
        Inertia of holder and payload about the tip; the thesis has point masses.
    motor_gain_nm_per_v : float
        Torque at the arm's axis per volt of command. The rigid gains of Appendix B times the
        inertia give 0.55 at 0 g.
    stall_torque_nm, gear_ratio : float
        Rated stall torque of the motor (section 2.3), which it does not exceed, and the gear behind
        it. No ratio is printed: the default one passes all that the drive gives.
    disturbance_v : float
        Constant added to the drive's command, of either sign: d of Figure 4-14.
    coulomb_friction_nm : float
        Coulomb friction level, 0.64 V of command. With `breakaway_ratio` it is the 0.4 A of section
        2.4.3 less the margin that the 0.7 V of equation (4-8) needs.
    breakaway_ratio : float
        Ratio of static to sliding friction, chosen with `coulomb_friction_nm`.
    stribeck_speed_rad_per_s : float
        Speed over which static friction falls to sliding friction; chosen.
    viscous_friction_nm_s_per_rad, mass_damping_per_s, stiffness_damping_s : float
        Viscous friction of the motor and Rayleigh damping of the arm, fitted to identified damping
        ratios.
    gear_stiffness_nm_per_rad, gear_damping_nm_s_per_rad, backlash_deg : float
        Contact of the teeth and total gap; chosen to give the gear hitting of Figure 4-10.
    stop_angle_deg : float
        Angle of the end stops (section 2.4.1).
    stop_stiffness_nm_per_rad, stop_damping_nm_s_per_rad : float
        Contact with the end stops; chosen.
    position_gain_v_per_rad : float
        Gain of the potentiometer: 3 V is 35 degrees (section 2.4.2).
    base_gauge_at_m, middle_gauge_at_m : float
        Distance of the gauges from the axis: the base, and half the length (section 2.3).
    base_gauge_v_per_nm, middle_gauge_v_per_nm, tacho_gain_v_s_per_rad : float
        Sensor gains from the frequency responses of Appendix B.
    tacho_cutoff_hz, tacho_damping_ratio : float
        Analogue filter of the tachometer, two modes (section 3.2); its values are chosen. A slower
        filter reduces the phase margin of the thesis's PDP loop, which was stable.
    noise_v : tuple of float
        Standard deviation of the noise of the four channels; chosen.
    hum_v : tuple of float
        Amplitude of the mains hum of the four channels, all in phase; none by default.
    hum_hz : float
        Frequency of the mains.
    adc_bits, dac_bits : int
        Resolution of the converters (section 2.3): inputs over -10 to 10 V, output magnitude over 0
        to 10 V with a separate direction.
    loop_delay_s : float
        Time from a sample until its command acts: the measured reply time of the project's nodes.
        The thesis does not state its own.

    Raises
    ------
    SettingError
        If a parameter is not finite, has the wrong sign, lies off the beam or out of range.
    """

    length_m: float = 1.0
    width_m: float = 0.051
    thickness_m: float = 0.003
    youngs_modulus_pa: float = 68.9e9
    density_kg_per_m3: float = 2700.0
    motor_inertia_kg_m2: float = 0.0018
    load_inertia_kg_m2: float = 0.0008
    tip_mass_kg: float = 0.010
    payload_kg: float = 0.0
    tip_inertia_kg_m2: float = 0.0
    motor_gain_nm_per_v: float = 0.55
    stall_torque_nm: float = 2.938
    gear_ratio: float = 3.0
    disturbance_v: float = 0.0
    coulomb_friction_nm: float = 0.64 * 0.55
    breakaway_ratio: float = 1.1
    stribeck_speed_rad_per_s: float = 0.02
    viscous_friction_nm_s_per_rad: float = 0.05
    mass_damping_per_s: float = 0.5
    stiffness_damping_s: float = 1.5e-4
    gear_stiffness_nm_per_rad: float = 2000.0
    gear_damping_nm_s_per_rad: float = 0.5
    backlash_deg: float = 0.2
    stop_angle_deg: float = TRAVEL_DEG
    stop_stiffness_nm_per_rad: float = 500.0
    stop_damping_nm_s_per_rad: float = 2.0
    position_gain_v_per_rad: float = POSITION_V_PER_RAD
    base_gauge_at_m: float = 0.02
    middle_gauge_at_m: float = 0.5
    base_gauge_v_per_nm: float = BASE_STRAIN_V_PER_NM
    middle_gauge_v_per_nm: float = MIDDLE_STRAIN_V_PER_NM
    tacho_gain_v_s_per_rad: float = SPEED_V_S_PER_RAD
    tacho_cutoff_hz: float = 80.0
    tacho_damping_ratio: float = 0.7
    noise_v: tuple[float, float, float, float] = LOW_NOISE_V
    hum_v: tuple[float, float, float, float] = NO_HUM_V
    hum_hz: float = 60.0
    adc_bits: int = 12
    dac_bits: int = 12
    loop_delay_s: float = 5e-4

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name in {"noise_v", "hum_v"}:
                _check_volts(field.name, getattr(self, field.name))
            elif field.name in {"adc_bits", "dac_bits"}:
                _check_bits(field.name, getattr(self, field.name))
            else:
                _check_scalar(field.name, getattr(self, field.name))
        if self.breakaway_ratio < 1.0:
            raise SettingError(f"breakaway_ratio must be at least 1, got {self.breakaway_ratio}")
        for name in ("base_gauge_at_m", "middle_gauge_at_m"):
            if getattr(self, name) > self.length_m:
                raise SettingError(
                    f"{name} must lie on the beam, at most length_m = {self.length_m}, "
                    f"got {getattr(self, name)}"
                )
        if self.tacho_damping_ratio >= 1.0:
            raise SettingError(
                f"tacho_damping_ratio must be below 1, got {self.tacho_damping_ratio}"
            )

    @property
    def bending_stiffness_nm2(self) -> float:
        """Bending stiffness EI of the beam."""
        return self.youngs_modulus_pa * self.width_m * self.thickness_m**3 / 12.0

    @property
    def mass_per_length_kg_per_m(self) -> float:
        """Mass of the beam per unit of length."""
        return self.density_kg_per_m3 * self.width_m * self.thickness_m


def _check_scalar(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise SettingError(f"{name} must be finite, got {value}")
    if name == "disturbance_v":
        return
    if name in _MAY_BE_ZERO:
        if value < 0.0:
            raise SettingError(f"{name} must not be negative, got {value}")
    elif value <= 0.0:
        raise SettingError(f"{name} must be positive, got {value}")


def _check_volts(name: str, volts: tuple[float, ...]) -> None:
    if len(volts) != len(LOW_NOISE_V):
        raise SettingError(f"{name} must have 4 entries, position to speed, got {len(volts)}")
    if not all(math.isfinite(each) and each >= 0.0 for each in volts):
        raise SettingError(f"{name} must be finite and not negative, got {volts}")


def _check_bits(name: str, bits: int) -> None:
    if bits not in _CONVERTER_BITS:
        raise SettingError(f"{name} must be an integer from 1 to 32, got {bits}")
