// Tuning on models, its margins, the new law on the arm, and its step beside the former one.

import { Toggles, attempt, byId, announce, fillMenu, fillTable, write } from "./dom.js";
import { chart } from "./charts.js";
import { askCommand, showCommand, showStage } from "./chain.js";
import { figure, stepFigures } from "./numbers.js";
import { SignalField } from "./units.js";

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
  constructor(hello, link, jobs, parameters, step) {
    Object.assign(this, { link, jobs, parameters, step });
    this.models = new Toggles(byId("models"), () => this.#showCommand(), NOMINAL);
    const { tunable_laws: laws = [], laws_with_margins: withMargins = [] } = hello;
    this.isOffered = laws.length > 0;
    this.hasMargins = (law) => withMargins.includes(law);
    fillMenu(byId("tuned_law"), laws.map((law) => [law, law]), USUAL_LAW);
    for (const id of ["tuned_law", "gain_margin", "phase_margin"]) byId(id).onchange = () => this.#showCommand();
    byId("tune").onclick = () => attempt(() => this.#tune());
    byId("apply").onclick = () => attempt(() => this.#apply());
    this.offer([]);
  }

  /** Offer identified models beside the packaged ones. */
  offer(models, chosen) {
    this.models.offer([...models, ...NOMINAL], chosen);
    this.#showCommand();
  }

  get #wanted() {
    const law = byId("tuned_law").value;
    const margins = { gain_margin_db: Number(byId("gain_margin").value), phase_margin_deg: Number(byId("phase_margin").value) };
    return { law, models: this.models.chosen, ...(this.hasMargins(law) ? margins : {}) };
  }

  #showCommand() {
    if (!this.isOffered) return;
    const wanted = this.#wanted;
    for (const id of ["gain_margin", "phase_margin"]) byId(id).disabled = !this.hasMargins(wanted.law);
    attempt(() => askCommand(this.link, "tune", "tune", wanted.models.length === 0 ? null : wanted));
  }

  async #tune() {
    if (this.models.chosen.length === 0) throw new Error("tune: choose a model, or identify one first");
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
    announce(`The arm is held by ${law} with ${gainsText(gains)}.`);
    showCommand("step", `./flexarm set controller law=${law} ${gainsText(gains)}`);
    showStage("step");
  }
}

// Times what a wait takes when nothing is late.
const LONGEST_WAIT = 4;
// Samples come as float32.
const ROUNDING = 1e-6;
const isNear = (one, other, size) => Math.abs(one - other) <= ROUNDING * (Math.abs(one) + Math.abs(size));
const SWINGING = /^(strain|moment)/;

/** Stage Step: a step of a set-point, out and back, each beside the one before it. */
export class StepStage {
  #former = null;
  #latest = null;
  #home = null;

  constructor(hello, ring, units, setpoints, parameters) {
    Object.assign(this, { ring, units, setpoints, parameters });
    const { tracked } = hello.rig;
    byId("tab_step").hidden = tracked.length === 0;
    showCommand("step", "");
    if (tracked.length === 0) return;
    byId("step_which").hidden = tracked.length === 1;
    fillMenu(byId("step_joint"), tracked.map(({ joint }, place) => [`${place}`, joint]));
    byId("step_joint").onchange = ({ target }) => this.#choose(setpoints[Number(target.value)]);
    // What vibrates is best seen by a gauge.
    this.gauge = hello.channels.find(({ group }) => SWINGING.test(group))?.name;
    this.size = new SignalField(byId("step_size"), units, setpoints[0].name, { value: 0 });
    this.#choose(setpoints[0]);
    byId("step").onclick = () => attempt(() => this.#step());
    units.addEventListener("change", () => this.#show());
  }

  #choose(setpoint) {
    this.setpoint = setpoint;
    this.#former = this.#latest = this.#home = null;
    byId("step_unit").dataset.unit = setpoint.name;
    const { name, low, high } = setpoint;
    write(byId("step_unit"), this.units.unit(name));
    Object.assign(this.size, { name, low, high });
    this.size.show(this.#usual(setpoint));
  }

  /** A volt of the thesis's arm, else about a tenth of the way to the end of the travel. */
  #usual({ name, high }) {
    if (this.units.ownUnit(name) === "V" || !Number.isFinite(high)) return 1;
    return Number((high / 10).toPrecision(1));
  }

  async #step() {
    const from = this.setpoint.value;
    const { value: size } = this.size;
    const isOut = this.#home !== null && isNear(from, this.#home + size, size);
    const to = isOut ? this.#home : from + size;
    if (to > this.setpoint.high || to < this.setpoint.low) {
      throw new Error("step: it ends beyond the stops; choose a smaller one");
    }
    this.#home = isOut ? this.#home : from;
    const words = ["./flexarm reference", ...Object.values(this.setpoint.joint), Number(to.toPrecision(4))];
    showCommand("step", words.join(" "));
    const button = byId("step");
    button.disabled = true;
    try {
      const begun = await this.#sent(to, size);
      const seenS = Number(byId("step_seen").value);
      await this.#until(() => this.ring.end && this.#newestS() >= this.ring.time(begun) + seenS, seenS);
      [this.#former, this.#latest] = [this.#latest, this.#cut(begun, seenS, from, to)];
      this.#show();
    } finally {
      button.disabled = false;
    }
  }

  /** Send the set-point and return the index of the first sample that has it. */
  async #sent(to, size) {
    let next = this.ring.end;
    this.setpoint.set(to);
    const hasIt = () => {
      for (; next < this.ring.end; next += 1) {
        if (isNear(this.ring.value(this.setpoint.name, next), to, size)) return true;
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
      if (performance.now() > deadline) throw new Error("step: the arm did not get there; does the controller drive it?");
      await new Promise((resolve) => setTimeout(resolve, 30));
    }
  }

  #cut(begun, seenS, from, to) {
    const indices = [];
    const startS = this.ring.time(begun);
    for (let k = begun; k < this.ring.end && this.ring.time(k) <= startS + seenS; k += 1) indices.push(k);
    const sign = Math.sign(to - from);
    const { output } = this.setpoint;
    const swinging = this.gauge ?? output;
    return {
      law: this.parameters.law,
      gains: this.parameters.gainsText(),
      size: Math.abs(to - from),
      timesS: indices.map((k) => this.ring.time(k) - startS),
      output: indices.map((k) => sign * (this.ring.value(output, k) - from)),
      swinging: indices.map((k) => this.ring.value(swinging, k)),
      units: [output, swinging].map((name) => this.units.ownUnit(name)),
    };
  }

  #show() {
    const kept = [["former", this.#former], ["now", this.#latest]].filter(([, step]) => step !== null);
    if (kept.length === 0) return;
    const { output } = this.setpoint;
    const factor = this.units.factor(output);
    chart(byId("steps"), {
      label: "Step of the arm, beside the one before it",
      x: { label: "s" },
      y: { label: this.units.unit(output) },
      curves: kept.map(([kind, step]) => ({ kind, x: step.timesS, y: step.output.map((each) => each * factor) })),
      marks: [{ y: this.#latest.size * factor, kind: "zero", text: "set-point" }],
    });
    const columns = [this.#former, this.#latest].map((step) => (step === null ? {} : worded(step)));
    fillTable(
      byId("step_figures"),
      ["Control law", "Gains", "Overshoot", "Settling time (5 %)", "Steady-state error", "Residual vibration"].map((name) => [name, ...columns.map((column) => column[name] ?? "–")]),
    );
  }
}

function worded(step) {
  const { overshoot, settledS, error, swing } = stepFigures(step);
  const [unit, swingUnit] = step.units;
  return {
    "Control law": step.law,
    Gains: step.gains,
    Overshoot: `${figure(100 * overshoot, 1)} %`,
    "Settling time (5 %)": settledS === null ? "not yet" : `${figure(settledS, 2)} s`,
    "Steady-state error": `${figure(error, 3)} ${unit}`,
    "Residual vibration": `${figure(swing, 3)} ${swingUnit} rms`,
  };
}
