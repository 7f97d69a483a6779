// The thesis's arm as seen from above: hub, link bent as the gauges say, payload, set-point, stops.

import { angleAt, deflections, linkPoints } from "./bending.js";
import { grasp, path, placeIn, sector, stops, ticks } from "./dial.js";
import { byId, drawn, write } from "./dom.js";
import { figure } from "./numbers.js";

const RADIANS = Math.PI / 180;
// Parts of the link's length.
const RIM = 1.06;
const HUB = 0.055;
const HOLDER = 0.02;

/** Drawing of the arm; it is also a slider, whose value is the set-point. */
export class ArmView {
  #parts;
  #shape;
  #stations;

  constructor({ arm, rig: { joints } }, units, setpoint) {
    const [{ angle, reference }] = joints;
    Object.assign(this, { arm, units, setpoint, angle, reference, degPerV: units.siFactor(angle) });
    this.enlarged = Number(byId("enlarged").value);
    this.#stations = this.arm.mode_shapes.station;
    this.#build();
    byId("enlarged").oninput = ({ target }) => {
      this.enlarged = Number(target.value);
      this.#showEnlarged();
    };
    this.#showEnlarged();
  }

  /** Draw the newest sample. */
  draw(ring, payloadKg) {
    const angleDeg = ring.newest(this.angle) * this.degPerV;
    const referenceDeg = ring.newest(this.reference) * this.degPerV;
    const [baseV, middleV] = this.arm.gauges.map((gauge) => ring.newest(gauge));
    this.#shape = deflections(this.arm, baseV, middleV);
    const points = linkPoints(this.#stations, this.#shape, angleDeg * RADIANS, this.enlarged);
    const { link, hub, line, ghost, payload, base, middle } = this.#parts;
    link.setAttribute("d", path(points));
    this.#parts.grip.setAttribute("d", path(points));
    hub.setAttribute("transform", `rotate(${-angleDeg})`);
    line.setAttribute("transform", `rotate(${-angleDeg})`);
    ghost.toggleAttribute("hidden", Number.isNaN(referenceDeg));
    if (!Number.isNaN(referenceDeg)) ghost.setAttribute("transform", `rotate(${-referenceDeg})`);
    const [tipX, tipY] = points.at(-1);
    payload.setAttribute("transform", `translate(${tipX},${-tipY})`);
    payload.setAttribute("r", HOLDER + 0.06 * Math.cbrt((payloadKg ?? 0) / 0.4));
    this.#place(base, points, this.arm.gauge_stations[0]);
    this.#place(middle, points, this.arm.gauge_stations[1]);
    Object.assign(this.node.dataset, { timeS: ring.time(ring.end - 1), angleDeg });
  }

  /** Write the figures beside the arm, a few times a second: they are read, not watched. */
  showFigures(ring) {
    const referenceV = ring.newest(this.reference);
    write(byId("angle"), this.units.shown(this.angle, ring.newest(this.angle), 1));
    write(byId("goal"), this.units.shown(this.reference, referenceV, 1));
    const tipMm = 1000 * (this.#shape?.at(-1) ?? NaN) * this.arm.link_length_m;
    write(byId("tip"), `${figure(tipMm, 0)} mm`);
    this.node.setAttribute("aria-valuenow", (referenceV * this.degPerV).toFixed(1));
    this.node.setAttribute("aria-valuetext", `set-point ${byId("goal").textContent}`);
  }

  #place(mark, points, station) {
    const [x, y] = points[Math.round(station * (points.length - 1))];
    mark.setAttribute("transform", `translate(${x},${-y})`);
  }

  #showEnlarged() {
    write(byId("enlarged_by"), `× ${this.enlarged}`);
  }

  #build() {
    const [low, high] = this.arm.stops_deg;
    const parts = {
      ghost: drawn("g", { class: "ghost" }, drawn("line", { y2: -RIM }), drawn("circle", { cy: -RIM, r: 0.03 })),
      line: drawn("line", { class: "rigid", y2: -1 }),
      grip: drawn("path", { class: "grip" }),
      link: drawn("path", { class: "link" }),
      payload: drawn("circle", { class: "payload" }),
      base: drawn("circle", { class: "gauge", r: 0.012 }),
      middle: drawn("circle", { class: "gauge", r: 0.012 }),
      hub: drawn("g", { class: "hub" }, drawn("circle", { r: HUB }), drawn("line", { y2: -HUB })),
    };
    this.#parts = parts;
    this.node = byId("arm");
    this.node.replaceChildren(
      sector(low, high, RIM),
      ...ticks(low, high, RIM),
      ...stops(low, high, 0.12, RIM),
      ...Object.values(parts),
    );
    this.node.setAttribute("aria-valuemin", low);
    this.node.setAttribute("aria-valuemax", high);
    parts.grip.addEventListener("pointerdown", (event) => this.#grasp(event));
    parts.ghost.addEventListener("pointerdown", (event) => this.#grasp(event));
    this.node.onkeydown = (event) => this.setpoint.key(event);
  }

  #grasp(press) {
    if (this.setpoint.disabled) return;
    grasp(this.node, press, (event) => {
      const at = placeIn(this.node, event);
      this.setpoint.set(angleAt(at.x, -at.y) / RADIANS / this.degPerV);
    });
  }
}
