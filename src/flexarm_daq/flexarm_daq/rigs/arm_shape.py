"""Shape of the arm from its two gauges: angles of the virtual joints that its URDF has.

The arm is `BENDS` equal pieces, each stiff but for a joint in its middle. The joint takes the
change of slope over its piece, the integral of the curvature. The curvature is that of the gauges
where they are, zero at the free tip, and linear in between.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.rigs.rig_parameters import RigParameters

BENDS = 4
HUB = "hub"
BEND_JOINTS = tuple(f"bend{number}" for number in range(1, BENDS + 1))
"""Names of the virtual joints, from the hub to the tip."""
# Of a piece: the mean over their middles is its integral to 1e-6.
_POINTS = 1000


def bend_angles(parameters: RigParameters) -> NDArray[np.float64]:
    """Return the angles of the virtual joints per volt of the base and the middle gauge.

    Parameters
    ----------
    parameters : RigParameters
        Rig, with its beam and its gauges.

    Returns
    -------
    ndarray, (BENDS, 2)
        Angles in rad per V, positive as the hub's.
    """
    # The gauges' signs are those of the wiring: see `plant`.
    curvature_per_v = np.array(
        [-1.0 / parameters.base_gauge_v_per_nm, 1.0 / parameters.middle_gauge_v_per_nm]
    )
    curvature_per_v /= parameters.bending_stiffness_nm2
    known_m = [parameters.base_gauge_at_m, parameters.middle_gauge_at_m, parameters.length_m]
    piece_m = parameters.length_m / BENDS
    middles_m = piece_m * (np.arange(BENDS * _POINTS) + 0.5) / _POINTS
    shares = [
        np.interp(middles_m, known_m, one_of_three).reshape(BENDS, _POINTS).mean(axis=1)
        for one_of_three in np.eye(3)[:2]
    ]
    angles: NDArray[np.float64] = piece_m * np.column_stack(shares) * curvature_per_v
    return angles
