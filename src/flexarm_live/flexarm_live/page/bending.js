// Shape of the arm: what the two gauges say of its first two bending modes.
//
// Lengths are parts of the link's, the hub is the origin, x points right and y away from the hub.
// The arm points away at 0, and its angle grows counter-clockwise, as seen from above.

/** Deflection from the hub's line at each station, as part of the length. */
export function deflections(arm, baseV, middleV) {
  const amplitudes = arm.strain_to_amplitude.map(([base, middle]) => base * baseV + middle * middleV);
  const { station, first, second } = arm.mode_shapes;
  return station.map(
    (_, k) => (first[k] * amplitudes[0] + second[k] * amplitudes[1]) / arm.link_length_m,
  );
}

/** Points of the link for an angle of its hub and deflections, enlarged. */
export function linkPoints(stations, deflected, angleRad, enlarged) {
  const [sine, cosine] = [Math.sin(angleRad), Math.cos(angleRad)];
  return stations.map((along, k) => {
    const across = enlarged * deflected[k];
    return [-along * sine - across * cosine, along * cosine - across * sine];
  });
}

/** Angle of the arm that points at (x, y), rad. */
export const angleAt = (x, y) => Math.atan2(-x, y);
