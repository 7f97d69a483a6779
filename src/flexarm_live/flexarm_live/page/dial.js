// Dial of a joint: the sector of its travel, its ticks and stops, and the hand that turns it.
//
// Angles are degrees, counter-clockwise from straight ahead, as seen from above.

import { drawn } from "./dom.js";
import { figure } from "./numbers.js";

const TICK_DEG = 20;
const TURN_DEG = 360;

export const path = (points) => `M${points.map(([x, y]) => `${x.toFixed(4)},${(-y).toFixed(4)}`).join("L")}`;

/** Point at an angle and a distance. */
export function ray(deg, radius) {
  const rad = (deg * Math.PI) / 180;
  return [-Math.sin(rad) * radius, Math.cos(rad) * radius];
}

/** Sector between two angles; one of a turn or more is a disk. */
export function sector(low, high, rim) {
  if (high - low >= TURN_DEG) return drawn("circle", { class: "sector", r: rim });
  const [[lowX, lowY], [highX, highY]] = [ray(low, rim), ray(high, rim)];
  const large = high - low > 180 ? 1 : 0;
  return drawn("path", { class: "sector", d: `M0,0L${lowX},${-lowY}A${rim},${rim} 0 ${large} 0 ${highX},${-highY}Z` });
}

/** Ticks with their angles along the rim; of a turn or more those of one turn. */
export function ticks(low, high, rim) {
  const first = high - low >= TURN_DEG ? TICK_DEG - 180 : Math.ceil(low / TICK_DEG) * TICK_DEG;
  const last = high - low >= TURN_DEG ? 180 : high;
  const count = Math.floor((last - first) / TICK_DEG) + 1;
  return Array.from({ length: count }, (_, k) => first + k * TICK_DEG).flatMap((deg) => {
    const [x, y] = ray(deg, rim + 0.075);
    const text = drawn("text", { class: "tick", x, y: 0.018 - y }, `${figure(deg, 0)}°`);
    return [drawn("path", { class: "tick", d: path([ray(deg, rim - 0.03), ray(deg, rim)]) }), text];
  });
}

/** Stops at both ends of the travel. */
export const stops = (low, high, from, rim) =>
  high - low >= TURN_DEG ? [] : [low, high].map((deg) => drawn("path", { class: "stop", d: path([ray(deg, from), ray(deg, rim)]) }));

/** The angle that points the same way as `deg` and is next to another one. */
export const nextTo = (deg, other) => deg + TURN_DEG * Math.round((other - deg) / TURN_DEG);

/** Follow a pointer that has pressed a part of a drawing until it lets go. */
export function grasp(drawing, press, follow) {
  const release = () => {
    drawing.removeEventListener("pointermove", follow);
    drawing.removeEventListener("pointerup", release);
    drawing.removeEventListener("pointercancel", release);
  };
  drawing.setPointerCapture(press.pointerId);
  drawing.addEventListener("pointermove", follow);
  drawing.addEventListener("pointerup", release);
  drawing.addEventListener("pointercancel", release);
}

/** Where a pointer is in the frame of a part of a drawing. */
export const placeIn = (part, { clientX, clientY }) =>
  new DOMPoint(clientX, clientY).matrixTransform(part.getScreenCTM().inverse());
