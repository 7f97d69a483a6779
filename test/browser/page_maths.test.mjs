// Mathematics of the page, without a browser: `node --test`.

import assert from "node:assert/strict";
import { test } from "node:test";

const PAGE = new URL("../../src/flexarm_live/flexarm_live/page/", import.meta.url);
const { decode, decimated, Ring, withHoles } = await import(new URL("samples.js", PAGE));
const { nextTo, ray } = await import(new URL("dial.js", PAGE));
const { angleAt, deflections, linkPoints } = await import(new URL("bending.js", PAGE));
const { decimalsOf, figure, stepFigures, stepOf, ticksOf } = await import(new URL("numbers.js", PAGE));
const { cross, facesOf, placed, seenFrom } = await import(new URL("solids.js", PAGE));
const { Units } = await import(new URL("units.js", PAGE));

const near = (value, wanted, within = 1e-9) =>
  assert.ok(Math.abs(value - wanted) <= within, `${value} instead of ${wanted}`);

/** A frame byte for byte as the contract has it: magic, rows, columns, reserved, start, rows. */
function frameOf(startS, rows) {
  const columns = rows[0].length;
  const bytes = new DataView(new ArrayBuffer(24 + 4 * rows.length * columns));
  [0x464c5831, rows.length, columns, 0].forEach((word, k) => bytes.setUint32(4 * k, word, true));
  bytes.setFloat64(16, startS, true);
  rows.flat().forEach((value, k) => bytes.setFloat32(24 + 4 * k, value, true));
  return bytes.buffer;
}

const frame = (startS, rows) => decode(frameOf(startS, rows));
const ramp = (from, count) => Array.from({ length: count }, (_, k) => [k, from + k]);

test("a frame is decoded to its rows", () => {
  const { startS, rows, columns, values } = frame(1e9, [[0, 1.5], [0.25, -2]]);
  assert.deepEqual([startS, rows, columns, [...values]], [1e9, 2, 2, [0, 1.5, 0.25, -2]]);
});

test("a foreign, short or truncated frame is refused", () => {
  const foreign = frameOf(0, [[0, 1]]);
  new DataView(foreign).setUint32(0, 7, true);
  assert.throws(() => decode(foreign), /not one of samples/);
  assert.throws(() => decode(new ArrayBuffer(3)), /too short/);
  assert.throws(() => decode(frameOf(0, [[0, 1]]).slice(0, 28)), /1 by 2 samples has 28 bytes/);
});

test("a ring keeps the newest samples under their indices", () => {
  const ring = new Ring(["a"], 10);
  ring.push(frame(100, ramp(0, 7)));
  ring.push(frame(107, ramp(7, 6)));
  assert.deepEqual([ring.begin, ring.end, ring.newest("a")], [3, 13, 12]);
  assert.deepEqual([ring.time(3), ring.value("a", 3)], [103, 3]);
  assert.deepEqual([ring.indexAt(0), ring.indexAt(104.5), ring.indexAt(999)], [3, 5, 13]);
});

test("time that steps back begins a new run", () => {
  const ring = new Ring(["a"], 10);
  ring.push(frame(100, ramp(0, 5)));
  assert.equal(ring.originS, 100);
  ring.push(frame(2.5, ramp(50, 3)));
  assert.deepEqual([ring.begin, ring.end, ring.time(0), ring.newest("a")], [0, 3, 2.5, 52]);
  assert.equal(ring.originS, 2);
});

test("a frame of other channels is refused", () => {
  assert.throws(() => new Ring(["a", "b"], 4).push(frame(0, [[0, 1]])), /1 channels instead of 2/);
});

test("samples that got lost on the way are counted, over the wrap of their number too", () => {
  const ring = new Ring(["sequence_low"], 10, 300);
  ring.push(frame(0, [[0, 2 ** 20 - 2], [1, 2 ** 20 - 1], [2, 0], [3, 4]]));
  assert.equal(ring.lost, 3);
});

test("a run that begins anew has lost nothing, however late its number is in the span", () => {
  for (const [before, pauseS] of [[5000, 0.4], [2 ** 20 - 6000, 0.4], [5000, 200], [5000, 1200]]) {
    const ring = new Ring(["sequence_low"], 10, 300);
    ring.push(frame(0, [[0, before], [pauseS, 1], [pauseS + 0.0033, 2], [pauseS + 0.01, 4]]));
    assert.equal(ring.lost, 1);
  }
});

test("few samples are drawn as they are", () => {
  const ring = new Ring(["a"], 10);
  ring.push(frame(0, ramp(5, 4)));
  assert.deepEqual(decimated(ring, ["a"], 0, 9, 100), [[0, 1, 2, 3], [5, 6, 7, 8]]);
});

test("each bucket gives its extremes in the order in which they came", () => {
  const ring = new Ring(["a"], 8);
  ring.push(frame(0, [3, 9, 1, 4, 7, 7, 0, 2].map((value, k) => [k, value])));
  assert.deepEqual(decimated(ring, ["a"], 0, 7, 2), [[0, 2, 4, 6], [9, 1, 7, 0]]);
});

test("a spike of one sample among many is drawn", () => {
  const ring = new Ring(["a"], 40_000);
  ring.push(frame(0, Array.from({ length: 40_000 }, (_, k) => [k / 512, k === 12_345 ? 8 : 0])));
  const [times, values] = decimated(ring, ["a"], 0, 100, 300);
  assert.ok(times.length <= 602 && times.length === values.length);
  near(times[values.indexOf(8)], 12_345 / 512, 0.5);
});

test("a bucket keeps its extremes while the picture moves on", () => {
  const ring = new Ring(["a"], 1000);
  const noise = (k) => Math.sin(k * k);
  ring.push(frame(0, Array.from({ length: 900 }, (_, k) => [k, noise(k)])));
  const before = decimated(ring, ["a"], 100, 899, 100);
  ring.push(frame(900, Array.from({ length: 3 }, (_, k) => [k, noise(900 + k)])));
  const after = decimated(ring, ["a"], 103, 902, 100);
  const at = (curve, timeS) => curve[1][curve[0].indexOf(timeS)];
  for (const timeS of [208, 400, 848]) assert.equal(at(after, timeS), at(before, timeS));
});

test("what is not known yet is passed over", () => {
  const ring = new Ring(["a"], 8);
  ring.push(frame(0, [NaN, NaN, 1, 4, NaN, NaN, NaN, NaN].map((value, k) => [k, value])));
  const [, values] = decimated(ring, ["a"], 0, 7, 2);
  assert.deepEqual(values, [1, 4, NaN, NaN]);
});

test("a hole of the samples is not drawn across", () => {
  const times = [0, 1, 2, 3, 20, 21, 22];
  const [at, a, b] = withHoles([times, [1, 2, 3, 4, 5, 6, 7], [7, 6, 5, 4, 3, 2, 1]], 2);
  assert.deepEqual(at, [0, 1, 2, 3, 11.5, 20, 21, 22]);
  assert.deepEqual(a, [1, 2, 3, 4, NaN, 5, 6, 7]);
  assert.deepEqual(b, [7, 6, 5, 4, NaN, 3, 2, 1]);
});

test("several holes, also at the ends, are kept apart", () => {
  const times = [0, ...Array.from({ length: 50 }, (_, k) => 30 + k), 110];
  const [at, values] = withHoles([times, times], 2);
  assert.deepEqual([at[1], at.at(-2), at.length], [15, 94.5, times.length + 2]);
  assert.deepEqual(values.map(Number.isNaN).reduce((sum, none) => sum + none, 0), 2);
});

test("samples without a hole stay as they are, at any rate", () => {
  for (const period of [0.1, 1, 7]) {
    const times = Array.from({ length: 20 }, (_, k) => k * period);
    assert.deepEqual(withHoles([times, times], 2), [times, times]);
  }
  assert.deepEqual(withHoles([[], []], 2), [[], []]);
  assert.deepEqual(withHoles([[3], [1]], 2), [[3], [1]]);
});

test("gauges that measure one mode alone bend the arm in its shape", () => {
  const station = [0, 0.5, 1];
  const arm = {
    link_length_m: 2,
    // Volts per amplitude: [[-40, 60], [25, 80]]; this is its inverse.
    strain_to_amplitude: [[80, -60], [-25, -40]].map((row) => row.map((each) => each / -4700)),
    mode_shapes: { station, first: station.map((s) => s ** 2), second: station.map((s) => s ** 2 - s ** 3) },
  };
  deflections(arm, -40 * 0.1, 25 * 0.1).forEach((part, k) => near(part, (0.1 * station[k] ** 2) / 2));
  deflections(arm, 60 * 0.1, 80 * 0.1).forEach((part, k) => near(part, (0.1 * (station[k] ** 2 - station[k] ** 3)) / 2));
});

test("the link turns counter-clockwise from ahead, and bends to the side of its angle", () => {
  const [hub, tip] = linkPoints([0, 1], [0, 0], Math.PI / 6, 5);
  assert.deepEqual(hub.map(Math.abs), [0, 0]);
  near(tip[0], -0.5);
  near(tip[1], Math.sqrt(3) / 2);
  const [, bent] = linkPoints([0, 1], [0, 0.02], 0, 5);
  near(bent[0], -0.1);
  near(bent[1], 1);
  for (const angle of [-1.2, 0, 0.7]) near(angleAt(...linkPoints([1], [0], angle, 1)[0]), angle);
});

test("numbers are written with a true minus, and never as minus zero", () => {
  assert.deepEqual([figure(-1.25, 1), figure(-0.001, 2), figure(NaN, 1)], ["−1.3", "0.00", "–"]);
});

test("a signal is shown in volts or in its unit", () => {
  const units = new Units([{ name: "position_v", unit: "V", si_unit: "deg", si_per_unit: 35 / 3 }]);
  assert.equal(units.shown("position_v", 3, 1), "35.0°");
  units.si = false;
  assert.equal(units.shown("position_v", 3, 1), "3.0 V");
});

test("a signal of another arm has its own unit, and decimals that suit its range", () => {
  const units = new Units([
    { name: "cart_mm", unit: "mm", si_unit: "m", si_per_unit: 1e-3, low: -250, high: 250 },
    { name: "strain", unit: "ustrain", si_unit: "1", si_per_unit: 1e-6, low: null, high: null },
  ]);
  assert.equal(units.shown("cart_mm", 125, 1), "0.125 m");
  assert.equal(units.shown("strain", 25), "0.000025");
  assert.equal(units.listed(["cart_mm", "cart_mm"], true), "m");
  units.si = false;
  assert.equal(units.shown("cart_mm", 125, 1), "125.0 mm");
  assert.deepEqual([80, 2, 0.05, 0].map(decimalsOf), [1, 2, 4, 0]);
});

test("a hand that turns a joint past half a turn goes on", () => {
  assert.deepEqual([nextTo(-170, 170), nextTo(10, 0), nextTo(-10, 725)], [190, 10, 710]);
  const [x, y] = ray(90, 2);
  near(x, -2);
  near(y, 0, 1e-12);
});

test("ticks are round numbers inside the bounds", () => {
  assert.deepEqual(ticksOf(0, 60, false), [0, 10, 20, 30, 40, 50, 60]);
  assert.deepEqual(ticksOf(0.05, 120, true), [0.1, 1, 10, 100]);
});

test("a number field steps by a round part of its range", () => {
  assert.deepEqual([[0, 20], [0, 5], [-2, 2]].map(([low, high]) => Number(stepOf({ kind: "double", low, high }))), [0.1, 0.05, 0.02]);
});

test("figures of a first-order step are those of its equation", () => {
  const timesS = Array.from({ length: 5001 }, (_, k) => k / 1000);
  const found = stepFigures({
    size: 2,
    timesS,
    output: timesS.map((t) => 2 * (1 - Math.exp(-t))),
    swinging: timesS.map((t) => 0.3 * Math.sin(60 * Math.PI * t)),
  });
  near(found.settledS, Math.log(20), 2e-3);
  near(found.error, 2 * Math.exp(-5));
  near(found.swing, 0.3 / Math.SQRT2, 2e-3);
  assert.equal(found.overshoot, 0);
});

test("a step that has not settled says so", () => {
  const found = stepFigures({ size: 1, timesS: [0, 1, 2], output: [0, 1.2, 0.9], swinging: [0, 0, 0] });
  near(found.overshoot, 0.2);
  assert.equal(found.settledS, null);
});

/** Volume within faces by the divergence theorem; negative where they are seen from inside. */
function volume(faces) {
  const signed = (a, b, c) => cross(a, b).reduce((sum, each, k) => sum + each * c[k], 0) / 6;
  return faces.reduce((sum, [a, b, c, d]) => sum + signed(a, b, c) + signed(a, c, d), 0);
}

test("the faces of each kind of solid close it, outside out", () => {
  const disk = (corners) => (corners / 2) * Math.sin((2 * Math.PI) / corners);
  near(volume(facesOf("box", [0.1, 0.2, 0.3])), 8 * 0.1 * 0.2 * 0.3);
  near(volume(facesOf("cylinder", [0.5, 2, 0])), disk(16) * 0.25 * 4);
  // A ball of twelve corners and six rings is smaller than the round one by less than a fifth.
  const ball = (4 / 3) * Math.PI;
  const unit = volume(facesOf("sphere", [1, 0, 0]));
  assert.ok(unit < ball && unit > 0.8 * ball);
  near(volume(facesOf("ellipsoid", [1, 2, 3])), 6 * unit);
  near(volume(facesOf("capsule", [1, 4, 0])), unit + disk(12) * 8);
});

test("a body turned by 90 degrees about z takes its points along", () => {
  const half = Math.SQRT1_2;
  placed([1, 2, 3, half, 0, 0, half], [1, 0, 0.5]).forEach((each, k) => near(each, [1, 3, 3.5][k]));
});

test("from azimuth 0, x points away and y to the left, and from above a height comes near", () => {
  const seen = (elevation, point) => seenFrom(0, elevation, point);
  seen(Math.PI / 2, [1, 0, 0]).forEach((each, k) => near(each, [0, 1, 0][k]));
  seen(Math.PI / 2, [0, 1, 0]).forEach((each, k) => near(each, [-1, 0, 0][k]));
  seen(Math.PI / 2, [0, 0, 1]).forEach((each, k) => near(each, [0, 0, 1][k]));
  seen(0, [0, 0, 1]).forEach((each, k) => near(each, [0, 1, 0][k]));
  // A quarter round: what pointed away points to the right.
  seenFrom(Math.PI / 2, 0, [1, 0, 0]).forEach((each, k) => near(each, [1, 0, 0][k]));
});
