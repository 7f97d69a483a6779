"""Arms that are not the thesis's: one joint with two sensors, and two joints with five."""

from __future__ import annotations

from flexarm_core.rig_description import described

ONE_JOINT = described(
    """\
name: one-joint
rate_hz: 200
inputs:
  motor_nm: {quantity: torque, unit: N m, limits: 2}
outputs:
  hub_deg: {quantity: angle, unit: deg}
  base_v: {quantity: moment, unit: V, per_si: 4, range: 5}
joints:
  hub: {input: motor_nm, angle: hub_deg, travel: [-60, 90], link_length_m: 0.5}
driver: twin
"""
)
TWO_JOINTS = described(
    """\
name: two-joints
rate_hz: 500
inputs:
  shoulder_v: {quantity: torque, unit: V, per_si: 0.5, limits: 10}
  elbow_nm: {quantity: torque, unit: N m, limits: [-0.5, 0.8]}
outputs:
  shoulder_count: {quantity: angle, unit: count, per_si: 651.8986469044033}
  elbow_rad: {quantity: angle, unit: rad}
  elbow_rad_per_s: {quantity: rate, unit: rad/s}
  tip_g: {quantity: acceleration, unit: g, range: 8}
  light: {unit: lux}
joints:
  shoulder: {input: shoulder_v, angle: shoulder_count, travel: 1024, link_length_m: 0.4}
  elbow:
    input: elbow_nm
    angle: elbow_rad
    rate: elbow_rad_per_s
    travel: [-1.5, 2.0]
    link_length_m: 0.3
driver: rig.py:Mine
"""
)
"""4096 counts are a turn."""
CART = described(
    """\
name: cart
rate_hz: 100
inputs:
  motor_n: {quantity: force, unit: N, limits: 20}
outputs:
  cart_mm: {quantity: position, unit: mm}
  pole_rad: {quantity: angle, unit: rad}
joints:
  cart: {input: motor_n, angle: cart_mm, travel: 250, link_length_m: 0.01}
tracked: [cart_mm]
driver: rig.py:Mine
"""
)
"""One that slides."""
