// State of the laboratory: badge with its reason, and how well the loop keeps its time.

import { byId, drawn, element, write } from "./dom.js";
import { figure } from "./numbers.js";

/** Show the state of the drive, the reason for it and its tone: none, "warning" or "failure". */
export function showBadge(name, reason, tone) {
  byId("badge").dataset.state = name;
  byId("badge").dataset.tone = tone;
  write(byId("badge_name"), name);
  write(byId("badge_reason"), reason || (name === "DRIVING" ? "the controller drives the arm" : ""));
}

/** Fill the loop's figures and histogram from a state message. */
export function showLoop(state, lost) {
  const percentiles = (times) =>
    times ? `${figure(times.p50, 2)} / ${figure(times.p99, 2)} / ${figure(times.max, 2)} ms` : "–";
  const figures = {
    "Lateness, p50 / p99 / max": percentiles(state.late_ms),
    "Reply time, p50 / p99 / max": percentiles(state.reply_ms),
    "Real-time factor": figure(state.factor, 2),
    "Samples missed": figure(state.missed, 0),
    "Samples unanswered": figure(state.unanswered, 0),
    "Samples lost by this page": `${lost}`,
  };
  byId("loop").replaceChildren(
    ...Object.entries(figures).map(([name, value]) =>
      element("div", {}, element("dt", {}, name), element("dd", {}, value)),
    ),
  );
  byId("histogram").hidden = state.histogram === undefined;
  if (state.histogram !== undefined) showHistogram(state.histogram);
}

const ROW = { height: 44, foot: 15 };

function showHistogram({ edges_ms: edges, late, reply }) {
  const host = byId("histogram");
  const { height, foot } = ROW;
  const width = host.clientWidth;
  // Counts differ by decades: their logarithms are drawn.
  const bars = (counts, name, top) => {
    const most = Math.log1p(Math.max(1, ...counts));
    const step = width / counts.length;
    return [
      ...counts.map((count, k) => {
        const tall = (Math.log1p(count) / most) * (height - 12);
        const [x, y] = [k * step + 0.5, top + height - tall];
        return drawn("rect", { class: `bar ${name}`, x, y, width: step - 1, height: tall });
      }),
      drawn("line", { class: "axis", x1: 0, x2: width, y1: top + height, y2: top + height }),
      drawn("text", { x: width, y: top + 10, "text-anchor": "end" }, name),
    ];
  };
  const ends = [edges[0], edges[Math.floor(edges.length / 2)], edges.at(-1)];
  const y = 2 * height + foot;
  const labels = ends.map((edge, k) =>
    drawn("text", { x: (k * width) / 2, y, "text-anchor": ["start", "middle", "end"][k] }, `${Number(edge.toPrecision(2))} ms`),
  );
  const picture = drawn("svg", { width, height: y + 4, "aria-hidden": "true" });
  picture.append(...bars(late, "late", 0), ...bars(reply, "reply", height), ...labels);
  host.replaceChildren(picture);
}
