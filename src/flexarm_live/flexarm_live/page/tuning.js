// Tuning on models, its margins, the new law on the arm, and its step beside the former one.

import { attempt, byId, element, fillMenu, fillTable, tell } from "./dom.js";
import { chart } from "./charts.js";
import { askCommand, showCommand, showStage } from "./chain.js";
import { figure, stepFigures } from "./numbers.js";
import { VoltageField } from "./units.js";

const NOMINAL = ["nominal:0", "nominal:0.2", "nominal:0.4"];
const USUAL_LAW = "pdpc";

// A law that is designed on a model comes with that model, which no person reads.
const numbersOf = (gains) => Object.entries(gains).filter(([, value]) => typeof value === "number");
const gainsText = (gains) =>
  numbersOf(gains)
    .map(([name, value]) => `${name}=${Number(value.toPrecision(6))}`)
    .join(" ");

/** Stage Tune. */
export class TuneStage {
  #chosen = new Set(NOMINAL);

  constructor(hello, link, jobs, parameters, step) {
    Object.assign(this, { link, jobs, parameters, step });
    const { tunable_laws: laws, laws_with_margins: withMargins } = hello;
    this.hasMargins = (law) => withMargins.includes(law);
    fillMenu(byId("tuned_law"), laws.map((law) => [law, law]), USUAL_LAW);
    for (const id of ["tuned_law", "gain_margin", "phase_margin"]) byId(id).onchange = () => this.#tellCommand();
    byId("tune").onclick = () => attempt(() => this.#tune());
    byId("apply").onclick = () => attempt(() => this.#apply());
    this.offer([]);
  }

  /** Offer identified models beside the packaged ones. */
  offer(models, chosen = [...this.#chosen]) {
    const offered = [...models, ...NOMINAL];
    this.#chosen = new Set(chosen.filter((model) => offered.includes(model)));
    byId("models").replaceChildren(...offered.map((model) => this.#toggle(model)));
    this.#tellCommand();
  }

  #toggle(model) {
    const button = element("button", { "aria-pressed": `${this.#chosen.has(model)}` }, model);
    button.onclick = () => {
      if (!this.#chosen.delete(model)) this.#chosen.add(model);
      button.setAttribute("aria-pressed", `${this.#chosen.has(model)}`);
      this.#tellCommand();
    };
    return button;
  }

  get #wanted() {
    const law = byId("tuned_law").value;
    const margins = { gain_margin_db: Number(byId("gain_margin").value), phase_margin_deg: Number(byId("phase_margin").value) };
    return { law, models: [...this.#chosen], ...(this.hasMargins(law) ? margins : {}) };
  }

  #tellCommand() {
    const wanted = this.#wanted;
    for (const id of ["gain_margin", "phase_margin"]) byId(id).disabled = !this.hasMargins(wanted.law);
    attempt(() => askCommand(this.link, "tune", "tune", wanted.models.length === 0 ? null : wanted));
  }

  async #tune() {
    if (this.#chosen.size === 0) throw new Error("tune: choose a model, or identify one first");
    this.result = await this.jobs.run("tune", this.#wanted);
    this.#show(this.result);
  }

  #show({ gains, margins, required, step, command }) {
    byId("tuned").hidden = false;
    byId("loop_charts").hidden = margins.length === 0;
    byId("step_chart").hidden = step === null;
    showCommand("tune", command);
    fillTable(
      byId("tuned_gains"),
      numbersOf(gains).map(([name, value]) => [name, figure(this.parameters.value(name), 4), figure(value, 4)]),
    );
    fillTable(
      byId("margins"),
      margins.map((each) => [each.model, `${figure(each.gain_margin_db, 1)} dB`, `${figure(each.phase_margin_deg, 1)}°`]),
    );
    if (margins.length > 0) this.#showLoop(margins, required);
    if (step !== null) this.#showStep(step);
  }

  #showLoop(margins, required) {
    const x = { label: "Hz", log: true };
    chart(byId("loop_gain"), {
      label: "Magnitude of the loop, with the gain margin",
      x,
      y: { label: "dB" },
      curves: margins.map(({ response }) => ({ kind: "now", x: response.hz, y: response.db })),
      marks: [
        { y: 0, kind: "zero" },
        { y: -required.gain_margin_db, kind: "required", at: "start", text: `−${required.gain_margin_db} dB` },
        ...margins.filter(({ gain_hz: hz }) => hz > 0).map((each) => ({
          x: each.gain_hz,
          between: [0, -each.gain_margin_db],
          kind: "margin",
          text: `${figure(each.gain_margin_db, 1)} dB`,
        })),
      ],
    });
    chart(byId("loop_phase"), {
      label: "Phase of the loop, with the phase margin",
      x,
      y: { label: "°" },
      curves: margins.map(({ response }) => ({ kind: "now", x: response.hz, y: response.phase_deg })),
      marks: [
        { y: -180, kind: "zero" },
        { y: required.phase_margin_deg - 180, kind: "required", at: "start", text: `${required.phase_margin_deg}°` },
        ...margins.filter(({ phase_hz: hz }) => hz > 0).map((each) => ({
          x: each.phase_hz,
          between: [each.phase_margin_deg - 180, -180],
          kind: "margin",
          text: `${figure(each.phase_margin_deg, 1)}°`,
        })),
      ],
    });
  }

  #showStep({ t_s: x, before, after }) {
    const curves = [{ kind: "now", x, y: after }];
    if (before !== null) curves.unshift({ kind: "former", x, y: before });
    chart(byId("predicted"), { label: "Predicted step", x: { label: "s" }, y: { label: "V" }, curves });
  }

  async #apply() {
    const { gains, law } = this.result;
    await this.link.request("apply", { gains, law });
    tell(`The arm is held by ${law} with ${gainsText(gains)}.`);
    showCommand("step", `./flexarm set controller law=${law} ${gainsText(gains)}`);
    showStage("step");
  }
}

// Times what a wait takes when nothing is late.
const LONGEST_WAIT = 4;

/** Stage Step: a step of the set-point, out and back, each beside the one before it. */
export class StepStage {
  #former = null;
  #latest = null;
  #homeV = null;

  constructor(hello, ring, units, setpoint, parameters) {
    Object.assign(this, { ring, units, setpoint, parameters });
    const { low_v: lowV, high_v: highV } = hello.reference;
    this.size = new VoltageField(byId("step_size"), units, "reference_v", { lowV, highV, valueV: 1 });
    byId("step").onclick = () => attempt(() => this.#step());
    units.addEventListener("change", () => this.#show());
    showCommand("step", "");
  }

  async #step() {
    const fromV = this.setpoint.valueV;
    const isOut = this.#homeV !== null && Math.abs(fromV - this.#homeV - this.size.valueV) < 1e-3;
    const toV = isOut ? this.#homeV : fromV + this.size.valueV;
    if (Math.abs(toV) > this.setpoint.highV) throw new Error("step: it ends beyond the stops; choose a smaller one");
    this.#homeV = isOut ? this.#homeV : fromV;
    showCommand("step", `./flexarm reference ${Number(toV.toFixed(3))}`);
    const button = byId("step");
    button.disabled = true;
    try {
      const begun = await this.#sent(toV);
      const seenS = Number(byId("step_seen").value);
      await this.#until(() => this.ring.end && this.#newestS() >= this.ring.time(begun) + seenS, seenS);
      [this.#former, this.#latest] = [this.#latest, this.#cut(begun, seenS, fromV, toV)];
      this.#show();
    } finally {
      button.disabled = false;
    }
  }

  /** Send the set-point and return the index of the first sample that has it. */
  async #sent(toV) {
    let next = this.ring.end;
    this.setpoint.set(toV);
    const hasIt = () => {
      for (; next < this.ring.end; next += 1) {
        if (Math.abs(this.ring.value("reference_v", next) - toV) < 1e-3) return true;
      }
      return false;
    };
    await this.#until(hasIt, 1);
    return next;
  }

  #newestS() {
    return this.ring.time(this.ring.end - 1);
  }

  async #until(isReached, usualS) {
    const deadline = performance.now() + 1000 * (LONGEST_WAIT * usualS + 2);
    while (!isReached()) {
      if (performance.now() > deadline) throw new Error("step: the arm did not get there; does the law drive it?");
      await new Promise((resolve) => setTimeout(resolve, 30));
    }
  }

  #cut(begun, seenS, fromV, toV) {
    const indices = [];
    const startS = this.ring.time(begun);
    for (let k = begun; k < this.ring.end && this.ring.time(k) <= startS + seenS; k += 1) indices.push(k);
    const sign = Math.sign(toV - fromV);
    return {
      law: this.parameters.law,
      gains: this.parameters.gainsText(),
      sizeV: Math.abs(toV - fromV),
      timesS: indices.map((k) => this.ring.time(k) - startS),
      positionV: indices.map((k) => sign * (this.ring.value("position_v", k) - fromV)),
      strainV: indices.map((k) => this.ring.value("base_strain_v", k)),
    };
  }

  #show() {
    const kept = [["former", this.#former], ["now", this.#latest]].filter(([, step]) => step !== null);
    if (kept.length === 0) return;
    const factor = this.units.factor("position_v");
    chart(byId("steps"), {
      label: "Step of the arm, beside the one before it",
      x: { label: "s" },
      y: { label: this.units.unit("position_v") },
      curves: kept.map(([kind, step]) => ({ kind, x: step.timesS, y: step.positionV.map((volts) => volts * factor) })),
      marks: [{ y: this.#latest.sizeV * factor, kind: "zero", text: "set-point" }],
    });
    const columns = [this.#former, this.#latest].map((step) => (step === null ? {} : worded(step)));
    fillTable(
      byId("step_figures"),
      ["Law", "Gains", "Overshoot", "Settled to 5 %", "Error at the end", "Swing at the end"].map((name) => [name, ...columns.map((column) => column[name] ?? "–")]),
    );
  }
}

function worded(step) {
  const { overshoot, settledS, errorV, swingV } = stepFigures(step);
  return {
    Law: step.law,
    Gains: step.gains,
    Overshoot: `${figure(100 * overshoot, 1)} %`,
    "Settled to 5 %": settledS === null ? "not yet" : `${figure(settledS, 2)} s`,
    "Error at the end": `${figure(errorV, 3)} V`,
    "Swing at the end": `${figure(swingV, 3)} V rms`,
  };
}
