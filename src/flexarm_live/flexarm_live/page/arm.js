// The arm as seen from above: hub, link bent as the gauges say, payload, set-point, stops.

import { angleAt, deflections, linkPoints } from "./bending.js";
import { byId, drawn, write } from "./dom.js";
import { figure } from "./numbers.js";

const RADIANS = Math.PI / 180;
const TICK_DEG = 20;
// Parts of the link's length.
const RIM = 1.06;
const HUB = 0.055;
const HOLDER = 0.02;

const path = (points) => `M${points.map(([x, y]) => `${x.toFixed(4)},${(-y).toFixed(4)}`).join("L")}`;
const ray = (deg, radius) => [-Math.sin(deg * RADIANS) * radius, Math.cos(deg * RADIANS) * radius];

/** Drawing of the arm; it is also a slider, whose value is the set-point. */
export class ArmView {
  #parts;
  #shape;
  #stations;

  constructor(hello, setpoint) {
    this.arm = hello.arm;
    this.setpoint = setpoint;
    this.degPerV = hello.channels.find(({ name }) => name === "position_v").si_per_v;
    this.enlarged = Number(byId("enlarged").value);
    this.#stations = this.arm.mode_shapes.station;
    this.#build();
    byId("enlarged").oninput = ({ target }) => {
      this.enlarged = Number(target.value);
      this.#tellEnlarged();
    };
    this.#tellEnlarged();
  }

  /** Draw one sample. */
  draw({ timeS, positionV, baseV, middleV, referenceV, payloadKg }) {
    const angleDeg = positionV * this.degPerV;
    this.#shape = deflections(this.arm, baseV, middleV);
    const points = linkPoints(this.#stations, this.#shape, angleDeg * RADIANS, this.enlarged);
    const { link, hub, line, ghost, payload, base, middle } = this.#parts;
    link.setAttribute("d", path(points));
    this.#parts.grip.setAttribute("d", path(points));
    hub.setAttribute("transform", `rotate(${-angleDeg})`);
    line.setAttribute("transform", `rotate(${-angleDeg})`);
    ghost.toggleAttribute("hidden", Number.isNaN(referenceV));
    if (!Number.isNaN(referenceV)) ghost.setAttribute("transform", `rotate(${-referenceV * this.degPerV})`);
    const [tipX, tipY] = points.at(-1);
    payload.setAttribute("transform", `translate(${tipX},${-tipY})`);
    payload.setAttribute("r", HOLDER + 0.06 * Math.cbrt((payloadKg ?? 0) / 0.4));
    this.#place(base, points, this.arm.gauge_stations[0]);
    this.#place(middle, points, this.arm.gauge_stations[1]);
    Object.assign(this.node.dataset, { timeS, angleDeg });
  }

  /** Write the figures beside the arm, a few times a second: they are read, not watched. */
  tellFigures({ positionV, referenceV }, units) {
    write(byId("angle"), units.shown("position_v", positionV, 1));
    write(byId("goal"), units.shown("reference_v", referenceV, 1));
    const tipMm = 1000 * (this.#shape?.at(-1) ?? NaN) * this.arm.link_length_m;
    write(byId("tip"), `${figure(tipMm, 0)} mm`);
    this.node.setAttribute("aria-valuenow", (referenceV * this.degPerV).toFixed(1));
    this.node.setAttribute("aria-valuetext", `set-point ${byId("goal").textContent}`);
  }

  #place(mark, points, station) {
    const [x, y] = points[Math.round(station * (points.length - 1))];
    mark.setAttribute("transform", `translate(${x},${-y})`);
  }

  #tellEnlarged() {
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
      drawn("path", { class: "sector", d: `${sector(low, high)}` }),
      ...ticks(low, high),
      ...[low, high].map((deg) => drawn("path", { class: "stop", d: path([ray(deg, 0.12), ray(deg, RIM)]) })),
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
    const follow = (event) => this.setpoint.set(this.#angleDeg(event) / this.degPerV);
    const release = () => {
      this.node.removeEventListener("pointermove", follow);
      this.node.removeEventListener("pointerup", release);
      this.node.removeEventListener("pointercancel", release);
    };
    this.node.setPointerCapture(press.pointerId);
    this.node.addEventListener("pointermove", follow);
    this.node.addEventListener("pointerup", release);
    this.node.addEventListener("pointercancel", release);
  }

  #angleDeg({ clientX, clientY }) {
    const at = new DOMPoint(clientX, clientY).matrixTransform(this.node.getScreenCTM().inverse());
    return angleAt(at.x, -at.y) / RADIANS;
  }
}

function sector(low, high) {
  const [[lowX, lowY], [highX, highY]] = [ray(low, RIM), ray(high, RIM)];
  const large = high - low > 180 ? 1 : 0;
  return `M0,0L${lowX},${-lowY}A${RIM},${RIM} 0 ${large} 0 ${highX},${-highY}Z`;
}

function ticks(low, high) {
  const first = Math.ceil(low / TICK_DEG) * TICK_DEG;
  const count = Math.floor((high - first) / TICK_DEG) + 1;
  return Array.from({ length: count }, (_, k) => first + k * TICK_DEG).flatMap((deg) => {
    const [x, y] = ray(deg, RIM + 0.075);
    const text = drawn("text", { class: "tick", x, y: 0.018 - y }, `${figure(deg, 0)}°`);
    return [drawn("path", { class: "tick", d: path([ray(deg, RIM - 0.03), ray(deg, RIM)]) }), text];
  });
}
