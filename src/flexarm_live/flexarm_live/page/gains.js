// Gains and other parameters of the nodes, with bounds and units from the nodes' descriptions.

import { attempt, byId, element, fillMenu } from "./dom.js";
import { figure, stepOf } from "./numbers.js";

const USUAL_PAYLOADS_KG = [0, 0.1, 0.2, 0.3, 0.4];

const rounded = (value) => (typeof value === "number" ? Number(value.toPrecision(6)) : value);

/** All parameters, their controls, and the messages between them. */
export class Parameters {
  #controls = new Map();
  law = "";

  constructor(hello, link) {
    this.hello = hello;
    this.link = link;
    this.nodes = hello.nodes;
    this.#wireRig();
  }

  /** Value of the controller's parameter. */
  value(name, node = "controller") {
    return this.nodes[node].find((parameter) => parameter.name === name)?.value;
  }

  /** Gains of the law in a line. */
  gainsText() {
    return this.nodes.controller
      .filter(({ name, kind }) => kind === "double" && name.startsWith(`${this.law}.`))
      .map(({ name, value }) => `${name.split(".").at(-1)} ${rounded(value)}`)
      .join(", ");
  }

  /** Take over changed values, wherever they were set. */
  follow({ node, values }) {
    for (const parameter of this.nodes[node] ?? []) {
      if (!(parameter.name in values)) continue;
      parameter.value = values[parameter.name];
      const control = this.#controls.get(`${node}/${parameter.name}`);
      if (control !== undefined && control !== document.activeElement) show(control, parameter);
    }
  }

  followPayload(kg) {
    const field = byId("payload");
    if (kg !== null && field !== document.activeElement) field.value = rounded(kg);
    for (const button of byId("payloads").children) {
      button.setAttribute("aria-pressed", `${Math.abs(Number(button.value) - kg) < 1e-6}`);
    }
  }

  /** Show the gains of a law, and below the loop what else acts at once. */
  showLaw(law) {
    this.law = law;
    this.#controls.clear();
    const isGain = ({ name }) => name.startsWith(`${law}.`);
    this.#fill("gains", "controller", (parameter) => isGain(parameter) && !parameter.read_only);
    const others = ({ live, read_only: fixed, name }) =>
      live && !fixed && !name.includes(".") && name !== "law" && name !== "payload_kg";
    this.#fill("parameters", "daq", others);
    byId("parameters").append(...this.#rows("controller", others));
  }

  #fill(id, node, isShown) {
    byId(id).replaceChildren(...this.#rows(node, isShown));
  }

  #rows(node, isShown) {
    return this.nodes[node]
      .filter((parameter) => parameter.kind !== "array" && isShown(parameter))
      .map((parameter) => this.#row(node, parameter));
  }

  #row(node, parameter) {
    const { name, unit, description, low, high, kind, live } = parameter;
    const id = `${node}_${name}`.replaceAll(".", "_");
    const control = controlOf(parameter, id);
    this.#controls.set(`${node}/${name}`, control);
    control.addEventListener("change", () =>
      attempt(
        () => this.link.request("set", { node, name, value: read(control, kind) }),
        () => show(control, parameter),
      ),
    );
    show(control, parameter);
    const bounded = Number.isFinite(low) && Number.isFinite(high);
    const range = bounded ? `${figure(low, decimals(low))} to ${figure(high, decimals(high))}` : "";
    const hint = [description, live ? "" : "acts in the next run"].filter(Boolean).join("; ");
    return element(
      "tr",
      { title: description },
      element("th", { scope: "row" }, element("label", { for: id }, name.split(".").at(-1)), element("small", {}, hint)),
      element("td", {}, control, element("small", {}, `${range} ${unit ?? ""}`)),
    );
  }

  #wireRig() {
    byId("simulated").hidden = !this.hello.simulated;
    const limit = this.nodes.daq.find(({ name }) => name === "payload_kg")?.high ?? 0.4;
    const field = byId("payload");
    field.max = limit;
    const ask = (kg) => attempt(() => this.link.request("payload", { kg }));
    field.onchange = () => ask(Number(field.value));
    byId("payloads").replaceChildren(
      ...USUAL_PAYLOADS_KG.filter((kg) => kg <= limit).map((kg) =>
        element("button", { value: kg, onclick: () => ask(kg) }, `${Math.round(1000 * kg)} g`),
      ),
    );
    const faults = this.hello.faults ?? [];
    byId("faults").hidden = faults.length === 0;
    fillMenu(byId("fault"), faults.map(({ name, description }) => [name, description || name]));
    byId("fail").onclick = () => attempt(() => this.link.request("fault", { name: byId("fault").value }));
  }
}

const decimals = (value) => (Number.isInteger(value) ? 0 : 2);

function controlOf(parameter, id) {
  const { kind, low, high, choices } = parameter;
  const options = kind === "bool" ? ["true", "false"] : choices;
  if (options?.length > 0) {
    const menu = element("select", { id });
    fillMenu(menu, options.map((option) => [option, option]));
    return menu;
  }
  if (kind === "string") return element("input", { id, type: "text", spellcheck: "false" });
  const field = element("input", { id, type: "number", step: stepOf(parameter) });
  if (Number.isFinite(low)) field.min = low;
  if (Number.isFinite(high)) field.max = high;
  return field;
}

function show(control, { value }) {
  control.value = `${rounded(value)}`;
}

function read(control, kind) {
  if (kind === "bool") return control.value === "true";
  return kind === "string" ? control.value : Number(control.value);
}
