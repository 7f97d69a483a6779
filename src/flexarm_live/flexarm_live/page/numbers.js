// Numbers as they are shown, and the figures of a step.

// The new value counts as reached within this part of the step.
const SETTLED = 0.05;
const LATE_PART = 2 / 3;

/** Number with a fixed count of decimals and a true minus sign. */
export function figure(value, decimals) {
  if (!Number.isFinite(value)) return "–";
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}

const MOST_DECIMALS = 6;

/** Decimals that show a value of this size to about a hundredth of it. */
export function decimalsOf(size) {
  const decade = Math.floor(Math.log10(Math.abs(size)));
  return Number.isFinite(decade) ? Math.min(MOST_DECIMALS, Math.max(0, 2 - decade)) : 0;
}

/** Step of a number field: about a two-hundredth of its range, as 1, 2 or 5 times a power of ten. */
export function stepOf({ kind, low, high }) {
  if (kind === "integer") return 1;
  if (!Number.isFinite(low) || !Number.isFinite(high)) return 0.01;
  const exact = (high - low) / 200;
  const decade = 10 ** Math.floor(Math.log10(exact));
  return Number(([1, 2, 5].find((times) => times * decade >= exact * 0.999) ?? 10) * decade).toPrecision(1);
}

/** About `count` round numbers between two bounds; decades on a logarithmic axis. */
export function ticksOf(low, high, log, count = 6) {
  if (log) {
    const decades = [];
    for (let power = Math.ceil(Math.log10(low)); power <= Math.log10(high); power += 1) {
      decades.push(10 ** power);
    }
    return decades;
  }
  const exact = (high - low) / count;
  const decade = 10 ** Math.floor(Math.log10(exact));
  const step = [1, 2, 5, 10].find((times) => times * decade >= exact) * decade;
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, k) => (first + k) * step);
}

/**
 * Figures of a step of `size` from 0: overshoot as part of the step, when the output stays within
 * 5 % of it (null: not yet), the error of the last sample, and the swing of a signal in the last
 * third.
 */
export function stepFigures({ size, timesS, output, swinging }) {
  const outside = output.findLastIndex((each) => Math.abs(each - size) > SETTLED * size);
  const late = swinging.slice(Math.floor(LATE_PART * swinging.length));
  const mean = late.reduce((sum, each) => sum + each, 0) / late.length;
  return {
    overshoot: Math.max(0, Math.max(...output) / size - 1),
    settledS: timesS[outside + 1] ?? null,
    error: size - output.at(-1),
    swing: Math.sqrt(late.reduce((sum, each) => sum + (each - mean) ** 2, 0) / late.length),
  };
}
