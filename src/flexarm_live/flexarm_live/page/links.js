// Any arm as seen from above: a chain of links in a plane, with a handle for the set-point of each joint.
//
// Lengths are parts of the arm's reach. A link turns by its joint as the one before it has turned, or
// slides across it; positive is left. The set-points have a chain of their own.

import { angleAt } from "./bending.js";
import { grasp, nextTo, placeIn, sector, stops, ticks } from "./dial.js";
import { byId, drawn, element, write } from "./dom.js";

const HUB = 0.05;
// Of the reach beyond the tip, and of the links that have another one behind them.
const HANDLE_BEYOND = 0.06;
const HANDLE_ALONG = 0.6;
// Of its link: a dial of a joint behind another one shall not hide what is around it.
const DIAL = 0.3;
// Beyond that angle an arm points back.
const SIDEWAYS_DEG = 95;
const MARGIN = 0.25;

/** Drawing of the arm; each handle is a slider, whose value is the set-point of its joint. */
export class LinksView {
  #joints;

  constructor({ rig }, units, setpoints) {
    Object.assign(this, { units, node: byId("arm") });
    const slidesM = (joint) => units.siFactor(joint.angle) * Math.max(Math.abs(joint.low), Math.abs(joint.high));
    const reachM = rig.joints.reduce(
      (sum, joint) => sum + joint.link_length_m + (joint.slides ? slidesM(joint) : 0),
      0,
    );
    this.#joints = rig.joints.map((joint, k) => ({
      ...joint,
      setpoint: setpoints.find(({ name }) => name === joint.reference),
      length: joint.link_length_m / reachM,
      // Degrees, or parts of the reach.
      factor: units.siFactor(joint.angle) / (joint.slides ? reachM : 1),
      isLast: k === rig.joints.length - 1,
    }));
    byId("arm_card").hidden = rig.joints.length === 0;
    this.#build();
    this.#listFigures();
  }

  /** Draw the newest sample. */
  draw(ring) {
    for (const { angle, reference, factor, slides, links, goals } of this.#joints) {
      const here = ring.newest(angle) * factor;
      const known = reference === null ? NaN : ring.newest(reference) * factor;
      // An arm that nobody gave a set-point stays where it is.
      const goal = Number.isFinite(known) ? known : here;
      const move = (value) => (slides ? `translate(${-value},0)` : `rotate(${-value})`);
      if (Number.isFinite(here)) links.setAttribute("transform", move(here));
      if (Number.isFinite(goal)) goals.setAttribute("transform", move(goal));
    }
    const [first] = this.#joints;
    if (first === undefined) return;
    Object.assign(this.node.dataset, {
      timeS: ring.time(ring.end - 1),
      angleDeg: ring.newest(first.angle) * first.factor,
    });
  }

  /** Write the figures beside the arm, a few times a second: they are read, not watched. */
  showFigures(ring) {
    for (const { angle, reference, ghost, shown, goal } of this.#joints) {
      write(shown, this.units.shown(angle, ring.newest(angle), 1));
      if (reference === null) continue;
      const value = ring.newest(reference);
      write(goal, this.units.shown(reference, value, 1));
      if (Number.isFinite(value)) ghost.setAttribute("aria-valuenow", (value * this.units.siFactor(reference)).toFixed(3));
      ghost.setAttribute("aria-valuetext", goal.textContent);
    }
  }

  #build() {
    const top = -1 - MARGIN;
    this.node.setAttribute("viewBox", `${top} ${top} ${-2 * top} ${this.#behind() + MARGIN / 2 - top}`);
    this.node.setAttribute("preserveAspectRatio", "xMidYMin");
    // Its handles are the sliders.
    for (const name of ["tabindex", "aria-valuemin", "aria-valuemax"]) this.node.removeAttribute(name);
    this.node.setAttribute("role", "group");
    this.node.setAttribute("aria-label", "Arm from above; arrow keys move the set-point of the joint in focus");
    const base = { dial: drawn("g"), goals: drawn("g"), links: drawn("g") };
    this.node.replaceChildren(...Object.values(base));
    this.#joints.reduce((before, joint) => this.#add(before, joint), base);
  }

  /** How far the arm may reach back. */
  #behind() {
    let [turnedDeg, left] = [0, 1];
    for (const { slides, low, high, factor, length } of this.#joints) {
      if (!slides) turnedDeg += factor * Math.max(Math.abs(low), Math.abs(high));
      if (turnedDeg > SIDEWAYS_DEG) return left + MARGIN / 2;
      left -= length;
    }
    return 0;
  }

  /** Add a joint at the end of the link before it; return the frames at the end of its own. */
  #add(before, joint) {
    const { length, slides, low, high, factor, isLast } = joint;
    const isFirst = before.dial !== undefined;
    // A dial below the set-points; that of a joint behind another one goes with the link.
    const dial = before.dial ?? before.links;
    const [lowDeg, highDeg] = [low * factor, high * factor];
    if (!slides) {
      const rim = isFirst ? length + (isLast ? HANDLE_BEYOND : 0) : DIAL * length;
      dial.append(
        sector(lowDeg, highDeg, rim),
        ...(isFirst ? ticks(lowDeg, highDeg, rim) : []),
        ...stops(lowDeg, highDeg, isFirst ? 0.12 : 0, rim),
      );
    } else {
      dial.append(drawn("line", { class: "rail", x1: -lowDeg, x2: -highDeg }));
    }
    const ends = { goals: drawn("g"), links: drawn("g") };
    for (const end of Object.values(ends)) end.setAttribute("transform", `translate(0,${-length})`);
    const grip = drawn("line", { class: "grip", y2: -length });
    const hub = slides
      ? drawn("rect", { x: -1.6 * HUB, y: -HUB, width: 3.2 * HUB, height: 2 * HUB })
      : drawn("circle", { r: HUB });
    joint.links = drawn(
      "g",
      {},
      grip,
      drawn("line", { class: "link", y2: -length }),
      ends.links,
      drawn("g", { class: "hub" }, hub, drawn("line", { y2: -HUB })),
    );
    joint.goals = drawn("g", {}, ends.goals);
    before.links.append(joint.links);
    before.goals.append(joint.goals);
    if (joint.setpoint !== undefined) this.#addHandle(before.goals, joint, grip);
    return ends;
  }

  #addHandle(frame, joint, grip) {
    const { name, length, low, high, isLast, setpoint, reference } = joint;
    const at = -(isLast ? length + HANDLE_BEYOND : HANDLE_ALONG * length);
    const si = (value) => (value * this.units.siFactor(reference)).toFixed(3);
    joint.ghost = drawn(
      "g",
      {
        class: "ghost",
        role: "slider",
        tabindex: 0,
        "aria-label": `Set-point of ${name}`,
        "aria-valuemin": si(low),
        "aria-valuemax": si(high),
      },
      drawn("line", { y2: -length - (isLast ? HANDLE_BEYOND : 0) }),
      drawn("circle", { cy: at, r: 0.035 }),
    );
    joint.goals.prepend(joint.ghost);
    joint.ghost.onkeydown = (event) => setpoint.key(event);
    const press = (event) => {
      if (setpoint.disabled) return;
      grasp(this.node, event, (moved) => setpoint.set(this.#pointed(joint, placeIn(frame, moved))));
    };
    grip.addEventListener("pointerdown", press);
    joint.ghost.addEventListener("pointerdown", press);
  }

  /** Value of a joint whose link points to a place. */
  #pointed({ slides, factor, setpoint }, { x, y }) {
    if (slides) return -x / factor;
    const deg = (angleAt(x, -y) * 180) / Math.PI;
    return nextTo(deg, setpoint.value * factor) / factor;
  }

  #listFigures() {
    const rows = this.#joints.flatMap((joint) => {
      joint.shown = element("dd", {}, "–");
      joint.goal = element("dd", {}, "–");
      const shown = element("div", { class: "main" }, element("dt", {}, joint.name), joint.shown);
      if (joint.reference === null) return [shown];
      return [shown, element("div", {}, element("dt", {}, `set-point of ${joint.name}`), joint.goal)];
    });
    byId("arm_figures").replaceChildren(...rows);
  }
}
