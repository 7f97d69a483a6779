// The identified model: verdict, order and modes over the spectrum, fit against the record.

import { Toggles, attempt, byId, element, fillTable, write } from "./dom.js";
import { chart } from "./charts.js";
import { showCommand } from "./chain.js";
import { figure } from "./numbers.js";

const SAME_MODE = 0.02;
const KINDS = {
  physical: "physical",
  split: "possibly a split pole",
  noise: "possibly spurious",
  rare: "at few orders",
  damped: "strongly damped",
};
const title = (output) => output.replace(/_v$/, "").replaceAll("_", " ");

/**
 * Stage Model; `identify(wish)` is asked for another order or other modes, `compare(models)` for a
 * page of the model that is shown beside others.
 */
export class ModelStage {
  #known = [];
  #order = 0;

  constructor(units, identify, compare) {
    this.units = units;
    this.others = new Toggles(byId("others"), () => this.#offerComparison());
    byId("compare").onclick = () => attempt(() => this.#compare(compare));
    this.again = (wish) => attempt(() => identify(wish));
    byId("order").onchange = ({ target }) => this.#wish(Number(target.value));
  }

  /** Show the result of an identification. */
  show(data) {
    this.data = data;
    this.#order = data.order;
    byId("order").value = data.order;
    byId("verdict").dataset.verdict = data.verdict;
    const words = data.verdict_line.replace(`${data.verdict}: `, "");
    byId("verdict").replaceChildren(element("b", {}, data.verdict), ` ${words}`);
    byId("warnings").replaceChildren(...data.warnings.map((words) => element("li", {}, words)));
    this.#showModes();
    this.#showStabilisation();
    const outputs = [...data.outputs.map(title), "mean"];
    fillTable(byId("dmv"), data.dmv.map((error, k) => [outputs[k], `${figure(100 * (1 - error), 1)} %`]));
    // It is of the model before, until the one of this model is written.
    byId("report").hidden = byId("beside").hidden = true;
    showCommand("model", data.command);
    this.#showFits();
  }

  /** Offer the report of the model that is shown, and the other models for a comparison. */
  offerReport({ report, bag, models }) {
    byId("report").href = report;
    byId("report").hidden = false;
    const others = models.filter((model) => model !== bag);
    byId("beside").hidden = others.length === 0;
    this.others.offer(others);
    this.#offerComparison();
  }

  #offerComparison() {
    byId("compare").disabled = this.others.chosen.length === 0;
    byId("comparison").hidden = true;
  }

  async #compare(compare) {
    const { comparison, command } = await compare(this.others.chosen);
    byId("comparison").href = comparison;
    byId("comparison").hidden = false;
    showCommand("model", command);
  }

  #wish(order) {
    this.again({ order, known_modes_hz: this.#known });
  }

  #keeps(hz) {
    return this.#known.some((known) => Math.abs(known - hz) < SAME_MODE * hz);
  }

  #toggle(hz) {
    const kept = this.#keeps(hz);
    this.#known = this.#known.filter((known) => Math.abs(known - hz) >= SAME_MODE * hz);
    if (!kept) this.#known.push(hz);
    this.#wish(this.#order);
  }

  #showModes() {
    fillTable(
      byId("modes"),
      this.data.modes.map(({ frequency_hz: hz, damping, kind }) => [
        element(
          "button",
          { "aria-pressed": `${this.#keeps(hz)}`, onclick: () => this.#toggle(hz) },
          `${figure(hz, 2)} Hz`,
        ),
        `${figure(100 * damping, 1)} %`,
        KINDS[kind],
      ]),
    );
  }

  #showStabilisation() {
    const { stabilisation, spectrum, modes, order } = this.data;
    const highest = Math.max(...stabilisation.orders);
    const hz = spectrum.hz.at(-1) ?? Math.max(...stabilisation.points.map((point) => point[1]));
    const pick = (_, at) => {
      const nearest = stabilisation.orders.reduce((best, each) => (Math.abs(each - at) < Math.abs(best - at) ? each : best));
      this.#wish(nearest);
    };
    const points = (stable) => stabilisation.points.filter((point) => point[2] === stable && point[1] <= hz);
    const dots = (kind, stable) => ({ kind, x: points(stable).map((p) => p[1]), y: points(stable).map((p) => p[0]) });
    chart(byId("stabilisation"), {
      label: `Stabilisation diagram; order ${order} is chosen, up to ${highest}`,
      x: { label: "Hz", low: 0, high: hz },
      y: { label: "order", low: 0, high: highest + 1 },
      curves: spectrum.db.map((db) => ({ kind: "spectrum", x: spectrum.hz, y: squeezed(db, highest) })),
      dots: [dots("unstable", false), dots("stable", true)],
      marks: [
        { y: order, kind: "chosen", text: `order ${order}` },
        ...modes
          .filter(({ kind, frequency_hz: at }) => ["physical", "split"].includes(kind) && at > 0.02 * hz && at < hz)
          .map(({ frequency_hz: at }) => ({
            x: at,
            kind: this.#keeps(at) ? "kept" : "mode",
            text: figure(at, 1),
            onpick: () => this.#toggle(at),
          })),
      ],
      onpick: pick,
    });
  }

  #showFits() {
    const { outputs, fit } = this.data;
    const tiles = outputs.map((output, k) => {
      const host = element("div", { class: "chart" });
      const drawing = {
        label: `${title(output)}: measured and simulated`,
        x: { label: "s" },
        y: { label: [title(output), this.units.ownUnit(output)].filter(Boolean).join(", ") },
        curves: [
          { kind: "former", x: fit.t_s, y: fit.measured[k] },
          { kind: "now", x: fit.t_s, y: fit.simulated[k] },
        ],
      };
      return [host, drawing];
    });
    byId("fits").replaceChildren(...tiles.map(([host]) => host));
    for (const [host, drawing] of tiles) chart(host, drawing);
    write(byId("fits").previousElementSibling, "Fit against the record: measured, and simulated in the accent's colour");
  }
}

/** A spectrum in dB over the height of the diagram. */
function squeezed(db, height) {
  const finite = db.filter(Number.isFinite);
  const [least, most] = [Math.min(...finite), Math.max(...finite)];
  return db.map((value) => ((value - least) / (most - least || 1)) * height);
}
