// Solids in 3D: their faces, placed by their bodies, as they are seen from a side and from above.
//
// A quaternion is w, x, y, z; angles are rad. Seen from azimuth 0, x points away and y to the left.

const ARC = Array.from({ length: 7 }, (_, k) => [Math.cos((k / 6 - 0.5) * Math.PI), Math.sin((k / 6 - 0.5) * Math.PI)]);
const BARREL = [[0, -1], [1, -1], [1, 1], [0, 1]];

/** Profile of a solid (radius, z), which turns about z, its scale along x, y and z, and its corners. */
const SHAPES = {
  box: ([a, b, c]) => [BARREL, [a * Math.SQRT2, b * Math.SQRT2, c], 4],
  cylinder: ([a, b]) => [BARREL, [a, a, b], 16],
  sphere: ([a]) => [ARC, [a, a, a], 12],
  ellipsoid: (halves) => [ARC, halves, 12],
  capsule: ([a, b]) => [[...ARC.slice(0, 4).map(([r, z]) => [a * r, a * z - b]), ...ARC.slice(3).map(([r, z]) => [a * r, a * z + b])], [1, 1, 1], 12],
};

/** Faces of a solid, four points each, counter-clockwise from outside. */
export function facesOf(kind, sizeM) {
  const [profile, [scaleX, scaleY, scaleZ], corners] = SHAPES[kind](sizeM);
  const point = ([radius, z], corner) => {
    const at = (2 * Math.PI * (corner + 0.5)) / corners;
    return [scaleX * radius * Math.cos(at), scaleY * radius * Math.sin(at), scaleZ * z];
  };
  return profile.slice(1).flatMap((above, k) =>
    Array.from({ length: corners }, (_, c) => [point(profile[k], c), point(profile[k], c + 1), point(above, c + 1), point(above, c)]),
  );
}

export const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];

/** A point in the frame around a pose (x, y, z and the quaternion). */
export function placed([x, y, z, w, ...axis], point) {
  const twice = cross(axis, point).map((each) => 2 * each);
  const turned = cross(axis, twice);
  return [x, y, z].map((at, k) => at + point[k] + w * twice[k] + turned[k]);
}

/** A point as it is seen: to the right, up, and towards the viewer. */
export function seenFrom(azimuth, elevation, [x, y, z]) {
  const [away, right] = [x * Math.cos(azimuth) + y * Math.sin(azimuth), x * Math.sin(azimuth) - y * Math.cos(azimuth)];
  const [sine, cosine] = [Math.sin(elevation), Math.cos(elevation)];
  return [right, away * sine + z * cosine, z * sine - away * cosine];
}
