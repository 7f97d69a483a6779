// The arm's true bodies in 3D, where the rig knows them; a drag or the arrow keys turn the view.

import { grasp } from "./dial.js";
import { byId } from "./dom.js";
import { cross, facesOf, placed, seenFrom } from "./solids.js";

const DEGREE = Math.PI / 180;
const [HIGHEST, KEY] = [Math.PI / 2, 5 * DEGREE];
const PER_PIXEL = 0.5 * DEGREE;
// From above on the left, towards the viewer; the rest is everywhere.
const [LIGHT, AMBIENT] = [[-0.35, 0.6, 0.72], 0.5];
const MARGIN = 1.06;

/** Drawing of the bodies, hidden where there are none. */
export class Bodies {
  #solids = [];
  #poses = [];
  #isOld = false;
  #view = { azimuth: 0, elevation: 35 * DEGREE };

  constructor() {
    this.node = byId("bodies");
    this.node.addEventListener("pointerdown", (press) => {
      let before = press;
      grasp(this.node, press, (moved) => {
        this.#turn((before.clientX - moved.clientX) * PER_PIXEL, (moved.clientY - before.clientY) * PER_PIXEL);
        before = moved;
      });
    });
    this.node.onkeydown = (event) => {
      const by = { ArrowLeft: [KEY, 0], ArrowRight: [-KEY, 0], ArrowUp: [0, KEY], ArrowDown: [0, -KEY] }[event.key];
      if (by === undefined) return;
      event.preventDefault();
      this.#turn(...by);
    };
    new ResizeObserver(() => { this.#isOld = true; }).observe(this.node);
  }

  /** Take what the bodies are made of. */
  build(solids) {
    this.#solids = solids.map((solid) => {
      const pose = [...solid.place_m, ...solid.turn];
      const faces = facesOf(solid.kind, solid.size_m).map((face) => face.map((point) => placed(pose, point)));
      return { ...solid, faces };
    });
    this.#poses = [];
    Object.assign(this, { centre: null, across: 0, high: 0 });
    this.node.parentElement.hidden = solids.length === 0;
  }

  /** Take where the bodies are. */
  move(poses) {
    this.#poses = poses;
    this.#isOld = true;
    this.centre ??= poses[Math.min(1, poses.length - 1)].slice(0, 3);
  }

  #turn(azimuth, elevation) {
    this.#view.azimuth += azimuth;
    this.#view.elevation = Math.min(HIGHEST, Math.max(0, this.#view.elevation + elevation));
    this.#isOld = true;
  }

  /** Draw what is new, the nearest face last. */
  draw() {
    if (!this.#isOld || this.centre === null || this.node.parentElement.hidden) return;
    this.#isOld = false;
    const { azimuth, elevation } = this.#view;
    const seen = this.#solids.flatMap((solid) => this.#faces(solid)).sort((a, b) => a.order - b.order);
    const [width, height] = [this.node.clientWidth, this.node.clientHeight].map((each) => each * devicePixelRatio);
    Object.assign(this.node, { width, height });
    const tall = this.across * Math.sin(elevation) + this.high * Math.cos(elevation);
    const scale = Math.min(width / this.across, height / tall) / 2 / MARGIN;
    const pen = this.node.getContext("2d");
    pen.translate(width / 2, height / 2);
    pen.scale(scale, -scale);
    pen.lineWidth = 1 / scale;
    pen.strokeStyle = getComputedStyle(this.node).color;
    pen.beginPath();
    pen.ellipse(0, 0, this.across, this.across * Math.sin(elevation), 0, 0, 2 * Math.PI);
    pen.stroke();
    for (const { corners, colour } of seen) {
      pen.beginPath();
      for (const [right, up] of corners) pen.lineTo(right, up);
      pen.closePath();
      pen.fillStyle = pen.strokeStyle = colour;
      pen.fill();
      pen.stroke();
    }
    this.node.dataset.azimuthDeg = azimuth / DEGREE;
  }

  /** Faces of a solid that are seen from their outside. */
  #faces({ body, faces, rgba }) {
    const { azimuth, elevation } = this.#view;
    return faces.flatMap((face) => {
      const corners = face.map((point) => {
        const at = placed(this.#poses[body], point).map((each, k) => each - this.centre[k]);
        if (body > 0) this.#fit(at);
        return seenFrom(azimuth, elevation, at);
      });
      const diagonal = (from, to) => corners[to].map((each, k) => each - corners[from][k]);
      const normal = cross(diagonal(0, 2), diagonal(1, 3));
      if (!(normal[2] > 0)) return [];
      const lit = normal.reduce((sum, each, k) => sum + each * LIGHT[k], 0) / Math.hypot(...normal);
      const shade = 255 * (AMBIENT + (1 - AMBIENT) * Math.max(0, lit));
      const colour = `rgb(${rgba.slice(0, 3).map((each) => Math.round(shade * each)).join(" ")} / ${rgba[3]})`;
      // What stands still is behind: a floor has no place among the bodies on it.
      const order = corners.reduce((sum, [, , towards]) => sum + towards, body > 0 ? 0 : -1e9);
      return [{ corners, colour, order }];
    });
  }

  /** See to it that a point is in the view from every side. */
  #fit([x, y, z]) {
    this.across = Math.max(this.across, Math.hypot(x, y));
    this.high = Math.max(this.high, Math.abs(z));
  }
}
