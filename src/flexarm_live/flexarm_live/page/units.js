// Units: every signal is shown in its own unit or in its SI unit.

import { decimalsOf, figure, stepOf } from "./numbers.js";

const PRETTY = { deg: "°", "deg/s": "°/s", "m/s^2": "m/s²", 1: "" };
const pretty = (unit) => PRETTY[unit] ?? unit;
const FIELD_DECIMALS = 2;
const STEPS = { "°": 0.5, V: 0.05 };

/** Scales of the channels, with the choice between their own units and SI units. */
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

  /** SI units, or degrees, of one unit of a signal. */
  siFactor(name) {
    return this.channels.get(name).si_per_unit;
  }

  factor(name) {
    return this.#si ? this.siFactor(name) : 1;
  }

  isAngle(name) {
    return this.channels.get(name).si_unit === "deg";
  }

  /** Unit in which a signal is recorded. */
  ownUnit(name) {
    return this.channels.get(name)?.unit ?? "";
  }

  unit(name) {
    const { unit, si_unit: siUnit } = this.channels.get(name);
    return pretty(this.#si ? siUnit : unit);
  }

  /** Units of some signals for a button: SI units, or their own. */
  listed(names, si) {
    const units = names.map((name) => this.channels.get(name)).map((channel) => (si ? channel.si_unit : channel.unit));
    return [...new Set(units.map(pretty))].filter(Boolean).join(", ");
  }

  shown(name, value, decimals = 2) {
    const unit = this.unit(name);
    const number = value * this.factor(name);
    const { low } = this.channels.get(name);
    // So many decimals serve degrees, and all signals of the thesis's arm, which states no range.
    const isUsual = low === undefined || unit.startsWith("°");
    const finest = isUsual ? decimals : Math.max(decimals, decimalsOf(this.#full(name) ?? number));
    return `${figure(number, finest)}${unit === "°" || unit === "" ? "" : " "}${unit}`;
  }

  /** Full scale of a signal in the unit that is shown; null where it is not known. */
  #full(name) {
    const { low, high } = this.channels.get(name);
    const known = [low, high].filter(Number.isFinite).map(Math.abs);
    return known.length === 0 ? null : Math.max(...known) * this.factor(name);
  }
}

/** Number field of a signal that is typed and read in the chosen unit. */
export class SignalField {
  constructor(input, units, name, { low, high, value }) {
    Object.assign(this, { input, units, name, low: low ?? -Infinity, high: high ?? Infinity, value });
    input.addEventListener("change", () => this.#read());
    units.addEventListener("change", () => this.show(this.value));
    this.show(value);
  }

  show(value) {
    this.value = value;
    const factor = this.units.factor(this.name);
    const [low, high] = [this.low * factor, this.high * factor];
    const isBounded = Number.isFinite(low) && Number.isFinite(high);
    const decimals = isBounded ? Math.max(FIELD_DECIMALS, 1 + decimalsOf(Math.max(-low, high))) : FIELD_DECIMALS;
    for (const [bound, at] of [["min", low], ["max", high]]) {
      if (Number.isFinite(at)) this.input[bound] = at.toFixed(decimals);
    }
    this.input.step = STEPS[this.units.unit(this.name)] ?? stepOf({ low, high });
    this.input.value = (value * factor).toFixed(decimals);
  }

  #read() {
    const typed = Number.parseFloat(this.input.value) / this.units.factor(this.name);
    const within = Math.min(this.high, Math.max(this.low, typed));
    this.show(Number.isFinite(within) ? within : this.value);
  }
}
