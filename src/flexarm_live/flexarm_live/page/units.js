// Units: every signal is a voltage, shown in volts or in its SI unit.

import { figure } from "./numbers.js";

const PRETTY = { deg: "°", "N m": "N m", "deg/s": "°/s" };

/** Scales of the channels, with the choice between volts and SI units. */
export class Units extends EventTarget {
  #si = true;

  constructor(channels) {
    super();
    this.channels = new Map(channels.map((channel) => [channel.name, channel]));
  }

  get si() {
    return this.#si;
  }

  set si(chosen) {
    this.#si = chosen;
    this.dispatchEvent(new Event("change"));
  }

  factor(name) {
    return this.#si ? this.channels.get(name).si_per_v : 1;
  }

  unit(name) {
    if (!this.#si) return "V";
    const unit = this.channels.get(name).si_unit;
    return PRETTY[unit] ?? unit;
  }

  shown(name, volts, decimals = 2) {
    const unit = this.unit(name);
    return `${figure(volts * this.factor(name), decimals)}${unit === "°" ? "" : " "}${unit}`;
  }
}

/** Number field of a voltage that is typed and read in the chosen unit. */
export class VoltageField {
  constructor(input, units, name, { lowV, highV, valueV }) {
    Object.assign(this, { input, units, name, lowV, highV, valueV });
    input.addEventListener("change", () => this.#read());
    units.addEventListener("change", () => this.show(this.valueV));
    this.show(valueV);
  }

  show(valueV) {
    this.valueV = valueV;
    const factor = this.units.factor(this.name);
    const bounds = [this.lowV * factor, this.highV * factor];
    [this.input.min, this.input.max] = bounds.map((bound) => bound.toFixed(2));
    this.input.step = this.units.si ? "0.5" : "0.05";
    this.input.value = (valueV * factor).toFixed(2);
  }

  #read() {
    const typed = Number.parseFloat(this.input.value) / this.units.factor(this.name);
    const within = Math.min(this.highV, Math.max(this.lowV, typed));
    this.show(Number.isFinite(within) ? within : this.valueV);
  }
}
