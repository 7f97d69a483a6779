// Hands on the arm: the stop and its way back, set-point, waveforms, law.

import { attempt, byId, fillMenu, tell, write } from "./dom.js";
import { VoltageField } from "./units.js";

const SEND_EVERY_MS = 33;
// The server's word on the set-point is older than the user's while one is on its way.
const OWN_WORD_MS = 800;
const STEP_DEG = { ArrowLeft: 1, ArrowUp: 1, ArrowRight: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 };

/** The set-point: shown by slider, field and arm; sent at once, then at most 30 times a second. */
export class Setpoint {
  #waiting = null;
  #sentMs = -Infinity;
  #movedMs = -Infinity;
  #holding = false;

  constructor(hello, link, units) {
    const { low_v: lowV, high_v: highV } = hello.reference;
    Object.assign(this, { link, units, lowV, highV, valueV: 0, disabled: !hello.hand });
    this.slider = byId("setpoint");
    Object.assign(this.slider, { min: lowV, max: highV, step: (highV - lowV) / 400 });
    this.degPerV = hello.channels.find(({ name }) => name === "position_v").si_per_v;
    this.field = new VoltageField(byId("setpoint_value"), units, "reference_v", { lowV, highV, valueV: 0 });
    this.slider.oninput = () => this.set(Number(this.slider.value));
    byId("setpoint_value").onchange = () => this.set(this.field.valueV);
    byId("hold").onclick = () => attempt(() => link.request(this.#holding ? "let_go" : "hold"));
  }

  /** Move the set-point. */
  set(valueV) {
    if (this.disabled || !Number.isFinite(valueV)) return;
    this.#movedMs = performance.now();
    this.#show(Math.min(this.highV, Math.max(this.lowV, valueV)));
    if (this.#waiting !== null) return;
    const waitMs = Math.max(0, this.#sentMs + SEND_EVERY_MS - this.#movedMs);
    if (waitMs === 0) this.#send();
    else this.#waiting = setTimeout(() => this.#send(), waitMs);
  }

  /** Move by a key; positive is left, as seen from above. */
  key(event) {
    const deg = event.key === "Home" ? -this.valueV * this.degPerV : STEP_DEG[event.key];
    if (deg === undefined) return;
    event.preventDefault();
    this.set(this.valueV + ((event.shiftKey ? 5 : 1) * deg) / this.degPerV);
  }

  /** Take over what the server says is in force. */
  follow({ reference_v: referenceV, holder, holder_name: name }) {
    this.#holding = holder;
    write(byId("hold"), holder ? "Let go" : "Take the hand");
    write(byId("holder"), holder ? "in your hand" : name ? `in the hand of ${name}` : "");
    const isOld = performance.now() - this.#movedMs > OWN_WORD_MS;
    if (isOld && Number.isFinite(referenceV)) this.#show(referenceV);
  }

  #show(valueV) {
    this.valueV = valueV;
    this.slider.value = valueV;
    // Positive is left, as of the arm.
    const places = [0, valueV].map((volts) => (100 * (this.highV - volts)) / (this.highV - this.lowV));
    this.slider.style.setProperty("--from", `${Math.min(...places)}%`);
    this.slider.style.setProperty("--to", `${Math.max(...places)}%`);
    this.slider.setAttribute("aria-valuetext", this.units.shown("reference_v", valueV, 1));
    if (document.activeElement !== this.field.input) this.field.show(valueV);
  }

  #send() {
    this.#waiting = null;
    this.#sentMs = performance.now();
    attempt(() => this.link.request("reference", { value_v: this.valueV }));
  }
}

/** Wire the stop: the space bar wherever the focus is, and the button; latched until released. */
export function wireStop(link, isAllowed) {
  const stop = () => {
    if (!isAllowed()) {
      tell("this page is for viewing: it was opened without the token", true);
      return;
    }
    attempt(async () => {
      await link.stop();
      tell("stopped: the drive is held at zero");
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
  const isStopped = badge === "STOPPED";
  byId("release").hidden = !isStopped;
  write(byId("stop").firstChild, isStopped ? "STOPPED " : "STOP ");
  byId("stop").classList.toggle("latched", isStopped);
  const isActive = Object.values(nodes ?? {}).every((phase) => phase === "active");
  // An experiment has the arm for itself.
  byId("activate").hidden = isStopped || isActive || hasExperiment;
  byId("deactivate").hidden = isStopped || !isActive || hasExperiment;
}

/** Waveforms of the set-point. */
export class Waveform {
  #runs = false;

  constructor(hello, link, units) {
    const { low_v: lowV, high_v: highV } = hello.reference;
    const field = (id, bounds) => new VoltageField(byId(id), units, "reference_v", bounds);
    this.amplitude = field("wave_amplitude", { lowV: 0, highV, valueV: 1 });
    this.offset = field("wave_offset", { lowV, highV, valueV: 0 });
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
      amplitude_v: this.amplitude.valueV,
      offset_v: this.offset.valueV,
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
    return true;
  }
}
