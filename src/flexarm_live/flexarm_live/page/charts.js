// Charts of results: curves, dots and marks over two axes, drawn again when their room changes.

import { drawn } from "./dom.js";
import { figure, ticksOf } from "./numbers.js";

const PAD = { left: 46, right: 10, top: 20, bottom: 30 };
const TALL_PX = 300;
const LOW_PX = 180;
const drawings = new WeakMap();

const observer = new ResizeObserver((entries) => {
  for (const { target } of entries) render(target);
});

/**
 * Draw a chart into its host.
 *
 * `x`, `y`: {label, low, high, log}; bounds that are missing are those of the curves.
 * `curves`: [{x, y, kind}]; `dots`: [{x, y, kind}] with arrays; `marks`: [{x | y, kind, text, at, onpick}]
 * across the plot, or at x between the two of `between`; `onpick(x, y)`: a press in the plot.
 */
export function chart(host, drawing) {
  drawings.set(host, drawing);
  observer.observe(host);
  render(host);
}

function render(host) {
  const drawing = drawings.get(host);
  const width = host.clientWidth;
  if (drawing === undefined || width === 0) return;
  const height = host.classList.contains("tall") ? TALL_PX : LOW_PX;
  const toX = scale(span(drawing, "x"), [PAD.left, width - PAD.right]);
  const toY = scale(span(drawing, "y"), [height - PAD.bottom, PAD.top]);
  const picture = drawn("svg", { width, height, role: "img", "aria-label": drawing.label });
  picture.append(
    ...gridOf(toX, toY, width, height, drawing),
    ...(drawing.curves ?? []).map(({ x, y, kind }) =>
      drawn("path", { class: `curve ${kind}`, d: curve(x, y, toX, toY) }),
    ),
    ...(drawing.dots ?? []).map(({ x, y, kind }) =>
      drawn("path", { class: `dots ${kind}`, d: x.map((each, k) => `M${toX(each).toFixed(1)},${toY(y[k]).toFixed(1)}h0`).join("") }),
    ),
    ...(drawing.marks ?? []).flatMap((mark) => markOf(mark, toX, toY, width, height)),
  );
  if (drawing.onpick) {
    picture.classList.add("pickable");
    picture.onclick = ({ offsetX, offsetY }) => drawing.onpick(toX.back(offsetX), toY.back(offsetY));
  }
  host.replaceChildren(picture);
}

function span({ curves = [], dots = [], ...axes }, name) {
  const { low, high, log } = axes[name];
  if (low !== undefined && high !== undefined) return { low, high, log };
  let [least, most] = [Infinity, -Infinity];
  for (const value of [...curves, ...dots].flatMap((each) => each[name])) {
    if (value < least) least = value;
    if (value > most) most = value;
  }
  if (!(least < most)) [least, most] = [Math.min(least, 0) || -1, Math.max(most, 0) || 1];
  const room = name === "y" ? 0.06 * (most - least) : 0;
  return { low: low ?? least - room, high: high ?? most + room, log };
}

function scale({ low, high, log }, [from, to]) {
  const bend = log ? Math.log10 : (value) => value;
  const [start, stop] = [bend(low), bend(high)];
  const place = (value) => from + ((bend(value) - start) / (stop - start)) * (to - from);
  place.back = (at) => {
    const straight = start + ((at - from) / (to - from)) * (stop - start);
    return log ? 10 ** straight : straight;
  };
  return Object.assign(place, { low, high, log });
}

function curve(x, y, toX, toY) {
  let pen = "M";
  return x
    .map((each, k) => {
      if (!Number.isFinite(y[k])) {
        pen = "M";
        return "";
      }
      const point = `${pen}${toX(each).toFixed(1)},${toY(y[k]).toFixed(1)}`;
      pen = "L";
      return point;
    })
    .join("");
}

function gridOf(toX, toY, width, height, { x, y }) {
  const foot = height - PAD.bottom;
  const across = ticksOf(toX.low, toX.high, toX.log).flatMap((tick) => [
    drawn("line", { class: "grid", x1: toX(tick), x2: toX(tick), y1: PAD.top, y2: foot }),
    drawn("text", { x: toX(tick), y: foot + 13, "text-anchor": "middle" }, tickText(tick, toX)),
  ]);
  const up = ticksOf(toY.low, toY.high, toY.log, 4).flatMap((tick) => [
    drawn("line", { class: "grid", x1: PAD.left, x2: width - PAD.right, y1: toY(tick), y2: toY(tick) }),
    drawn("text", { x: PAD.left - 5, y: toY(tick) + 3.5, "text-anchor": "end" }, tickText(tick, toY)),
  ]);
  return [
    ...across,
    ...up,
    drawn("text", { class: "label", x: width - PAD.right, y: height - 3, "text-anchor": "end" }, x.label),
    drawn("text", { class: "label", x: 2, y: 10 }, y.label),
  ];
}

function markOf({ x, y, between, kind, text, at = "end", onpick }, toX, toY, width, height) {
  const [head, foot] = between?.map(toY) ?? [PAD.top, height - PAD.bottom];
  const line =
    x === undefined
      ? { x1: PAD.left, x2: width - PAD.right, y1: toY(y), y2: toY(y) }
      : { x1: toX(x), x2: toX(x), y1: head, y2: foot };
  const side = at === "start" ? PAD.left + 3 : width - PAD.right;
  const place = x === undefined ? { x: side, y: toY(y) - 4, "text-anchor": at } : { x: toX(x), y: PAD.top - 5, "text-anchor": "middle" };
  const words = drawn("text", { class: `mark ${kind}`, ...place }, text ?? "");
  if (onpick) {
    words.classList.add("pickable");
    words.addEventListener("click", (event) => {
      event.stopPropagation();
      onpick();
    });
  }
  return [drawn("line", { class: `mark ${kind}`, ...line }), words];
}

function tickText(tick, { low, high, log }) {
  const finest = log ? tick : (high - low) / 8;
  return figure(tick, Math.max(0, -Math.floor(Math.log10(finest))));
}
