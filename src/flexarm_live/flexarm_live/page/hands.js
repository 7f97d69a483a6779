// Manual control: the stop and its way back, set-point, waveforms, controller.

import { announce, attempt, byId, element, fillMenu, write } from "./dom.js";
import { SignalField } from "./units.js";

const SEND_EVERY_MS = 33;
// The server's word on the set-point is older than the user's while one is on its way.
const OWN_WORD_MS = 800;
const KEY_STEPS = { ArrowLeft: 1, ArrowUp: 1, ArrowRight: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 };

/** Control of the set-points, which one page has at a time. */
export class Hold {
  #isOurs = false;

  constructor(link) {
    byId("hold").onclick = () => attempt(() => link.request(this.#isOurs ? "let_go" : "hold"));
  }

  follow({ holder, holder_name: name }) {
    this.#isOurs = holder;
    write(byId("hold"), holder ? "Release control" : "Take control");
    write(byId("holder"), holder ? "you have control" : name ? `${name} has control` : "");
  }
}

/** All set-points, in the order of the tracked outputs; the first has the page's own controls. */
export function setpointsOf(hello, link, units) {
  const { tracked } = hello.rig;
  byId("setpoints").hidden = tracked.length === 0;
  return tracked.map((about, place) => {
    const controls =
      place === 0
        ? { slider: byId("setpoint"), input: byId("setpoint_value"), unit: byId("setpoint_unit"), row: byId("setpoint_row") }
        : addControls();
    controls.unit.dataset.unit = about.name;
    if (tracked.length > 1) {
      controls.row.prepend(element("span", { class: "joint" }, about.joint));
      controls.slider.setAttribute("aria-label", `Set-point of ${about.joint}`);
      controls.input.setAttribute("aria-label", `Set-point of ${about.joint} as a number`);
    }
    const joint = tracked.length > 1 ? { joint: about.joint } : {};
    return new Setpoint({ ...about, place, joint, isUsable: hello.hand }, controls, link, units);
  });
}

function addControls() {
  const slider = element("input", { class: "setpoint", type: "range", dir: "rtl" });
  const input = element("input", { type: "number" });
  const unit = element("span", { class: "unit" });
  const row = element("div", { class: "slide" }, slider, input, unit);
  byId("setpoints").append(row);
  return { slider, input, unit, row };
}

/** A set-point: shown by slider, field and arm; sent at once, then at most 30 times a second. */
export class Setpoint {
  #waiting = null;
  #sentMs = -Infinity;
  #movedMs = -Infinity;

  constructor({ name, output, joint, place, low, high, isUsable }, { slider, input }, link, units) {
    Object.assign(this, { name, output, joint, place, slider, link, units, value: 0, disabled: !isUsable });
    Object.assign(this, { low: low ?? -Infinity, high: high ?? Infinity });
    const isBounded = Number.isFinite(this.high - this.low);
    slider.hidden = !isBounded;
    if (isBounded) Object.assign(slider, { min: low, max: high, step: (high - low) / 400 });
    // Of the keys: a degree, or a two-hundredth of the travel.
    this.keyStep = units.isAngle(name) ? 1 / units.siFactor(name) : isBounded ? (high - low) / 200 : 1;
    this.field = new SignalField(input, units, name, { low, high, value: 0 });
    slider.oninput = () => this.set(Number(slider.value));
    input.onchange = () => this.set(this.field.value);
  }

  /** Move the set-point. */
  set(value) {
    if (this.disabled || !Number.isFinite(value)) return;
    this.#movedMs = performance.now();
    this.#show(Math.min(this.high, Math.max(this.low, value)));
    if (this.#waiting !== null) return;
    const waitMs = Math.max(0, this.#sentMs + SEND_EVERY_MS - this.#movedMs);
    if (waitMs === 0) this.#send();
    else this.#waiting = setTimeout(() => this.#send(), waitMs);
  }

  /** Move by a key; positive is left, as seen from above. */
  key(event) {
    const steps = event.key === "Home" ? -this.value / this.keyStep : KEY_STEPS[event.key];
    if (steps === undefined) return;
    event.preventDefault();
    this.set(this.value + (event.shiftKey ? 5 : 1) * steps * this.keyStep);
  }

  /** Take over what the server says is in force; before the first one, where the arm is. */
  follow({ references }, ring) {
    const inForce = Number.isFinite(references[this.place]) ? references[this.place] : ring.newest(this.output);
    const isOld = performance.now() - this.#movedMs > OWN_WORD_MS;
    if (isOld && Number.isFinite(inForce)) this.#show(inForce);
  }

  #show(value) {
    this.value = value;
    this.slider.value = value;
    // Positive is left, as of the arm.
    const part = (at) => (100 * (this.high - Math.min(this.high, Math.max(this.low, at)))) / (this.high - this.low);
    const places = [0, value].map(part);
    this.slider.style.setProperty("--from", `${Math.min(...places)}%`);
    this.slider.style.setProperty("--to", `${Math.max(...places)}%`);
    this.slider.setAttribute("aria-valuetext", this.units.shown(this.name, value, 1));
    if (document.activeElement !== this.field.input) this.field.show(value);
  }

  #send() {
    this.#waiting = null;
    this.#sentMs = performance.now();
    attempt(() => this.link.request("reference", { value: this.value, ...this.joint }));
  }
}

/** Wire the stop: the space bar wherever the focus is, and the button; latched until released. */
export function wireStop(link, isAllowed) {
  const stop = () => {
    if (!isAllowed()) {
      announce("this page is for viewing: it was opened without the token", true);
      return;
    }
    attempt(async () => {
      await link.stop();
      announce("stopped: the drive is held at zero");
    });
  };
  byId("stop").onclick = stop;
  byId("stop").disabled = false;
  const isSpace = (event) => event.code === "Space" || event.key === " ";
  const catching = (act) => (event) => {
    if (!isSpace(event)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    act(event);
  };
  addEventListener("keydown", catching((event) => event.repeat || stop()), { capture: true });
  addEventListener("keyup", catching(() => {}), { capture: true });
  byId("release").onclick = () => attempt(() => link.request("release"));
  for (const verb of ["activate", "deactivate"]) {
    byId(verb).onclick = () => attempt(() => link.request(verb));
  }
}

/** Show which of the stop's and the drive's buttons lead on. */
export function showPower({ badge, nodes, has_experiment: hasExperiment }) {
  const isHeld = badge === "HELD";
  byId("release").hidden = !isHeld;
  write(byId("stop").firstChild, isHeld ? "STOPPED " : "STOP ");
  byId("stop").classList.toggle("latched", isHeld);
  const isActive = Object.values(nodes ?? {}).every((phase) => phase === "active");
  // An experiment has the arm for itself.
  byId("activate").hidden = isHeld || isActive || hasExperiment;
  byId("deactivate").hidden = isHeld || !isActive || hasExperiment;
}

/** Waveforms of the set-point of the thesis's arm. */
export class Waveform {
  #runs = false;

  constructor(hello, link, units) {
    byId("waveform").hidden = hello.arm === undefined;
    if (hello.arm === undefined) return;
    const [{ name, low, high }] = hello.rig.tracked;
    const field = (id, bounds) => new SignalField(byId(id), units, name, bounds);
    this.amplitude = field("wave_amplitude", { low: 0, high, value: 1 });
    this.offset = field("wave_offset", { low, high, value: 0 });
    byId("wave").onclick = () =>
      attempt(() => link.request("waveform", this.#runs ? { kind: "none" } : this.#wanted()));
  }

  follow({ waveform }) {
    this.#runs = waveform !== undefined && waveform.kind !== "none";
    write(byId("wave"), this.#runs ? `Stop the ${waveform.kind}` : "Start the waveform");
  }

  #wanted() {
    return {
      kind: byId("wave_kind").value,
      amplitude_v: this.amplitude.value,
      offset_v: this.offset.value,
      period_s: Number(byId("wave_period").value),
    };
  }
}

/** The law's menu. */
export class LawMenu {
  constructor(hello, link) {
    this.menu = byId("law");
    const titles = hello.law_titles ?? {};
    fillMenu(this.menu, hello.laws.map((name) => [name, titles[name] ? `${name}: ${titles[name]}` : name]));
    this.menu.onchange = () =>
      attempt(
        () => link.request("law", { name: this.menu.value }),
        () => (this.menu.value = this.law),
      );
  }

  follow({ law }) {
    if (law === this.law) return false;
    this.law = law;
    this.menu.value = law;
    if (this.menu.value !== law) {
      // One of the user's own, from a file.
      this.menu.append(element("option", { value: law }, law));
      this.menu.value = law;
    }
    return true;
  }
}
