// Traces: one plot for each kind of signal over one time axis, with zoom, pause and hover.

import { byId, element, write } from "./dom.js";
import { decimated, withHoles } from "./samples.js";

const HEIGHT_PX = 116;
const FOOT_PX = 22;
const LEAST_SPAN_S = 0.05;
// A plot that took long is drawn less often, so that the arm keeps its frames.
const REST_FACTOR = 3;
// A busy machine drops some samples on their way here; a curve goes on over so few.
const HOLE_PERIODS = 10;
// Range of an axis whose signal rests: noise is not blown up to full height. Volts of the thesis's
// arm; of another one a part of the range of its signals.
const LEAST_RANGE_V = { position: 0.5, strain: 1, speed: 0.2, command: 1 };
const LEAST_PART = 1 / 40;
const COLOURS = ["accent", "second", "third", "fourth", "fifth", "sixth"];

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const label = (name) => name.replace(/_v$/, "").replaceAll("_", " ").replace(/^reference/, "set-point");
const titled = (group) => group[0].toUpperCase() + group.slice(1);

/** The plots, and the span of time that they show. */
export class Traces {
  #panels = [];
  #view = { live: true, spanS: 10, endS: 0 };
  #cursorS = null;
  #restUntil = 0;
  #drawnEnd = -1;

  constructor(hello, ring, units) {
    Object.assign(this, { hello, ring, units });
    this.host = byId("traces");
    units.addEventListener("change", () => this.#build());
    matchMedia("(prefers-color-scheme: dark)").onchange = () => this.#build();
    new ResizeObserver(() => this.#fit()).observe(this.host);
    byId("span").onchange = ({ target }) => this.#look({ live: true, spanS: Number(target.value) });
    byId("pause").onclick = () => this.pause();
    byId("zoom_in").onclick = () => this.zoom(0.5);
    byId("zoom_out").onclick = () => this.zoom(2);
    this.host.onkeydown = (event) => this.#key(event);
    this.#build();
  }

  get live() {
    return this.#view.live;
  }

  /** Stop the picture, or let it run again. */
  pause() {
    this.#look({ live: !this.live, endS: this.#newestS() });
  }

  zoom(factor) {
    const oldestS = this.ring.end ? this.#newestS() - this.ring.time(this.ring.begin) : Infinity;
    const spanS = Math.max(LEAST_SPAN_S, Math.min(this.#view.spanS * factor, Math.max(oldestS, 10), 300));
    const middleS = this.#view.endS - this.#view.spanS / 2;
    this.#look({ spanS, endS: this.live ? this.#newestS() : middleS + spanS / 2 });
  }

  /** Draw what is new; called once a frame. */
  draw(nowMs) {
    if (!this.live || nowMs < this.#restUntil || this.ring.end === this.#drawnEnd) return;
    this.#drawnEnd = this.ring.end;
    this.#view.endS = this.#newestS();
    const startMs = performance.now();
    this.#render();
    // The plots draw behind this, in microtasks of their own.
    queueMicrotask(() => (this.#restUntil = nowMs + REST_FACTOR * (performance.now() - startMs)));
  }

  #newestS() {
    return this.ring.end ? this.ring.time(this.ring.end - 1) : 0;
  }

  #look(change) {
    Object.assign(this.#view, change);
    write(byId("pause"), this.live ? "Pause" : "Live");
    this.#render();
  }

  #render() {
    const { spanS, endS } = this.#view;
    // One look at the samples for all plots, which are equally wide.
    const every = this.#panels.flatMap(({ names }) => names);
    const { width } = this.#panels[0].plot;
    const drawn = decimated(this.ring, every, endS - spanS, endS, width);
    const [times, ...columns] = withHoles(drawn, HOLE_PERIODS / this.ring.rateHz);
    const shown = columns.map((column, k) => {
      const factor = this.units.factor(every[k]);
      return column.map((volts) => (Number.isFinite(volts) ? volts * factor : null));
    });
    for (const { plot, names } of this.#panels) {
      plot.setData([times, ...shown.splice(0, names.length)], false);
      plot.setScale("x", { min: endS - spanS, max: endS });
    }
    this.#showValues();
  }

  #build() {
    for (const { plot } of this.#panels) plot.destroy();
    this.#panels = [];
    const groups = [...new Set(this.hello.channels.map(({ group }) => group))].filter((group) => group !== "sequence");
    const figures = groups.map((group) => this.#panel(group, group === groups.at(-1)));
    this.host.replaceChildren(...figures);
    this.#fit();
    this.#render();
  }

  #channels(group) {
    return this.hello.channels.filter((channel) => channel.group === group).map(({ name }) => name);
  }

  #panel(group, last) {
    const names = this.#channels(group);
    const readings = names.map(() => element("output", {}, "–"));
    const curves = this.#curves(names);
    const keys = names.map((name, k) => {
      const { hue, isShared } = curves[k];
      const key = element("span", { class: `key${isShared ? " goal" : ""}` }, `${label(name)} `, readings[k]);
      key.style.setProperty("--key", `var(--${hue})`);
      return key;
    });
    const caption = element(
      "figcaption",
      {},
      element("b", {}, titled(group)),
      ...keys,
    );
    const figure = element("figure", {}, caption);
    const plot = new uPlot(this.#options(group, names, curves, last), [[]], figure);
    this.#panels.push({ plot, names, readings, last });
    return figure;
  }

  /** Colour of each curve, and whether it is a set-point; among several it has that of its output. */
  #curves(names) {
    const outputOf = new Map(this.hello.rig.tracked.map(({ name, output }) => [name, output]));
    const measured = names.filter((name) => !outputOf.has(name));
    return names.map((name, k) => {
      const isShared = outputOf.has(name) && measured.length > 1;
      const place = isShared ? measured.indexOf(outputOf.get(name)) : k;
      return { hue: COLOURS[place % COLOURS.length], isGoal: outputOf.has(name), isShared };
    });
  }

  /** Least range of the axis of a plot, in the units that are shown. */
  #least(group, names) {
    const { low, high } = this.units.channels.get(names[0]);
    const isKnown = Number.isFinite(low) && Number.isFinite(high);
    const least = isKnown ? LEAST_PART * (high - low) : low === undefined ? LEAST_RANGE_V[group] : 0;
    return least * Math.abs(this.units.factor(names[0]));
  }

  #options(group, names, curves, last) {
    const least = this.#least(group, names);
    const axis = { stroke: colour("muted"), font: "11px system-ui", grid: { stroke: colour("line"), width: 1 } };
    axis.ticks = { show: false };
    return {
      width: 300,
      height: this.#height(last),
      legend: { show: false },
      padding: [6, 6, 0, 0],
      cursor: { sync: { key: "time" }, y: false, points: { size: 6 }, drag: { x: true, y: false, setScale: false } },
      select: { show: true },
      scales: {
        x: { time: false, auto: false },
        y: { range: (_, low, high) => roomy(low, high, least) },
      },
      axes: [
        { ...axis, size: last ? FOOT_PX : 4, gap: 3, values: last ? (_, at) => seconds(at, this.ring.originS) : (_, at) => at.map(() => "") },
        { ...axis, size: 46, gap: 4, space: 26, label: undefined },
      ],
      series: [
        {},
        ...curves.map(({ hue, isGoal }) => ({
          stroke: colour(hue),
          // A wider line takes seven times as long where no graphics card draws it.
          width: 1,
          dash: isGoal ? [5, 4] : undefined,
          points: { show: false },
        })),
      ],
      hooks: {
        setCursor: [(plot) => this.#hover(plot)],
        setSelect: [(plot) => this.#select(plot)],
        ready: [(plot) => (plot.over.ondblclick = () => this.#look({ live: true, spanS: 10 }))],
      },
    };
  }

  #height(last) {
    return HEIGHT_PX + (last ? FOOT_PX : 4);
  }

  #fit() {
    const width = this.host.clientWidth;
    if (width === 0) return;
    for (const { plot, last } of this.#panels) plot.setSize({ width, height: this.#height(last) });
  }

  #hover(plot) {
    const { left } = plot.cursor;
    this.#cursorS = left >= 0 ? plot.posToVal(left, "x") : null;
    this.#showValues();
  }

  #select(plot) {
    const { left, width } = plot.select;
    if (width < 4) return;
    const [fromS, toS] = [left, left + width].map((at) => plot.posToVal(at, "x"));
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.#look({ live: false, spanS: Math.max(LEAST_SPAN_S, toS - fromS), endS: toS });
  }

  #showValues() {
    const { ring } = this;
    if (ring.end === 0) return;
    const at = this.#cursorS === null ? ring.end - 1 : Math.min(ring.indexAt(this.#cursorS), ring.end - 1);
    write(byId("at"), this.#cursorS === null ? "" : `t = ${(ring.time(at) - ring.originS).toFixed(3)} s`);
    for (const { names, readings } of this.#panels) {
      names.forEach((name, k) => write(readings[k], this.units.shown(name, ring.value(name, at))));
    }
  }

  // Without a mouse: arrows move the cursor, with Shift the span; plus and minus zoom.
  #key(event) {
    const direction = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (direction === undefined) return;
    event.preventDefault();
    const { spanS, endS } = this.#view;
    if (event.shiftKey) {
      this.#look({ live: false, endS: endS + (direction * spanS) / 4 });
      return;
    }
    const { plot } = this.#panels[0];
    const wanted = (plot.cursor.left >= 0 ? plot.cursor.left : plot.over.clientWidth) + 4 * direction;
    plot.setCursor({ left: Math.max(0, Math.min(wanted, plot.over.clientWidth - 1)), top: 10 });
  }
}

/** Range of an axis around a signal: a tenth of room on either side, and never less than `least`. */
function roomy(low, high, least) {
  if (low === null || high === null) return [-(least || 1), least || 1];
  const middle = (low + high) / 2;
  const half = Math.max((high - low) * 0.6, least / 2) || Math.abs(middle) / 2 || 1;
  return [middle - half, middle + half];
}

// Nothing was sampled before the begin of the run.
const seconds = (splits, originS) =>
  splits.map((split) => (split < originS ? "" : `${Number((split - originS).toFixed(3))} s`));
