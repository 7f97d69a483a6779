// The chain from a record to a tuned law: its stages, its jobs, and the first two stages.

import { announce, attempt, byId, element, fillMenu, write } from "./dom.js";
import { Signals, wireDrop } from "./drop.js";

const STAGES = ["record", "identify", "model", "tune", "step"];

/** Tabs of the stages; arrow keys move between them. */
export function showStage(name) {
  for (const stage of STAGES) {
    const isShown = stage === name;
    const tab = byId(`tab_${stage}`);
    tab.setAttribute("aria-selected", `${isShown}`);
    tab.tabIndex = isShown ? 0 : -1;
    byId(`stage_${stage}`).hidden = !isShown;
  }
}

function wireTabs() {
  for (const stage of STAGES) byId(`tab_${stage}`).onclick = () => showStage(stage);
  byId("stages").onkeydown = ({ key }) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
    if (step === undefined) return;
    const offered = STAGES.filter((stage) => !byId(`tab_${stage}`).hidden);
    const shown = offered.findIndex((stage) => byId(`tab_${stage}`).tabIndex === 0);
    const next = offered[(shown + step + offered.length) % offered.length];
    showStage(next);
    byId(`tab_${next}`).focus();
  };
  showStage("record");
}

/** Write the command line that does the same as a stage; an empty one is not shown. */
export function showCommand(stage, command) {
  const code = byId(`command_${stage}`);
  write(code, command);
  code.parentElement.hidden = command === "";
  if (code.nextElementSibling === null) {
    const copy = () => navigator.clipboard.writeText(code.textContent).then(() => announce("Copied."));
    code.after(element("button", { class: "quiet", onclick: () => attempt(copy), "aria-label": "Copy the command" }, "Copy"));
  }
}

const asked = {};

/** Show the command line that the server has for a stage with these fields; none without fields. */
export async function askCommand(link, stage, verb, fields) {
  asked[stage] = fields;
  const { command } = fields === null ? { command: "" } : await link.request(`${verb}_line`, fields);
  if (asked[stage] === fields) showCommand(stage, command);
}

/** Long work: one at a time, with its stage, its part done and its way out. */
export class Jobs {
  #running = null;
  #asked = 0;

  constructor(link) {
    this.link = link;
    byId("cancel").onclick = () => attempt(() => this.#cancel(this.#running));
  }

  /**
   * Run a job and show its progress; the promise is its data. `found` gets what is found before
   * its end; such a job gives way to another one of its kind, and the promise is undefined then.
   */
  async run(verb, fields, found = null) {
    if (this.#running !== null) {
      if (this.#running.verb !== verb || found === null) {
        throw new Error(`${verb}: another job runs; cancel it first`);
      }
      this.#asked += 1;
      const asked = this.#asked;
      await this.#replace();
      // Of several clicks in that time the last one counts.
      if (asked !== this.#asked) return undefined;
    }
    const running = { verb, id: null, isReplaced: false };
    this.#running = running;
    byId("running").hidden = false;
    write(byId("running_stage"), verb);
    byId("running_part").removeAttribute("value");
    byId("cancel").disabled = true;
    const work = this.link.job(verb, fields, {
      began: (id) => {
        running.id = id;
        byId("cancel").disabled = false;
        if (running.isReplaced) this.#giveUp(running);
      },
      news: (message) => {
        if (running.isReplaced) return;
        this.#show(message);
        if (!message.done && Object.keys(message.data ?? {}).length > 0) found?.(message.data);
      },
    });
    running.ended = work.then(() => {}, () => {});
    try {
      return await work;
    } catch (refusal) {
      if (running.isReplaced) return undefined;
      throw refusal;
    } finally {
      if (this.#running === running) {
        this.#running = null;
        byId("running").hidden = true;
      }
    }
  }

  #cancel(running) {
    return this.link.request("cancel", { job: running.id });
  }

  async #replace() {
    const running = this.#running;
    if (!running.isReplaced) {
      running.isReplaced = true;
      if (running.id !== null) this.#giveUp(running);
    }
    await running.ended;
  }

  #giveUp(running) {
    // It may have ended in the meantime.
    this.#cancel(running).catch(() => {});
  }

  #show({ job, stage, fraction }) {
    write(byId("running_stage"), stage ? `${job}: ${stage}` : job);
    if (typeof fraction === "number") byId("running_part").value = fraction;
    else byId("running_part").removeAttribute("value");
  }
}

const listed = (signals) => signals.map(({ name, unit }) => `${name} (${unit})`).join(", ");

/** Stages Record and Identify. */
export class Chain {
  #recording = null;
  #identified = {};

  constructor(hello, link, jobs, { identified, written, found }) {
    Object.assign(this, { hello, link, jobs, identified, written, found });
    wireTabs();
    this.#wireRecord();
    const { inputs, outputs } = hello.rig;
    write(byId("signals"), `From ${listed(inputs)} to ${listed(outputs)}.`);
    this.signals = new Signals(link, () => this.#showIdentify());
    for (const id of ["bag", "method", "order_wanted"]) byId(id).onchange = () => this.#showIdentify();
    wireDrop(link, async (bag) => {
      this.signals.forget();
      await this.refreshBags(bag);
      showStage("identify");
      byId("drop").scrollIntoView({ block: "center" });
    });
    byId("identify").onclick = () => attempt(() => this.identify({}));
    this.refreshBags();
  }

  follow({ recording }) {
    if (recording === this.#recording) return;
    this.#recording = recording;
    const button = byId("record");
    button.setAttribute("aria-pressed", `${recording !== null}`);
    write(button, recording === null ? "Record" : "Stop recording");
    if (recording === null) this.refreshBags();
    else write(byId("recording"), `Recording ${recording}`);
  }

  /** Fill the menu of records, with the newest one chosen. */
  async refreshBags(chosen) {
    const { bags, models } = (await attempt(() => this.link.request("bags"))) ?? { bags: [], models: [] };
    this.found(models);
    fillMenu(byId("bag"), bags.map((bag) => [bag, bag]), chosen ?? byId("bag").value);
    this.#showIdentify();
  }

  /** Identify the chosen record; `wish` has the order and modes that were clicked. */
  async identify(wish) {
    const fields = { ...this.#wanted, ...wish };
    if (fields.bag === "") throw new Error("identify: there is no record; make one in the stage Record");
    if (!this.signals.areNamed) throw new Error("identify: choose an input and an output among the signals");
    const data = await this.jobs.run("identify", fields, (model) => {
      this.#identified = fields;
      showCommand("identify", model.command);
      this.identified(model);
      showStage("model");
    });
    if (data !== undefined) this.written(data);
  }

  /** Compare the identified model with others on its record. */
  compare(models) {
    return this.jobs.run("compare", { ...this.#identified, models });
  }

  #wireRecord() {
    const { experiments } = this.hello;
    fillMenu(byId("experiment"), experiments.map(({ name }) => [name, name]));
    const showExperiment = () => {
      const { name, description } = experiments.find((each) => each.name === byId("experiment").value) ?? {};
      write(byId("experiment_words"), description ?? "");
      // In a terminal it has a laboratory of its own, that of the thesis's arm.
      showCommand("record", this.hello.arm === undefined ? "" : `./flexarm experiment ${name ?? ""}`);
    };
    byId("experiment").onchange = showExperiment;
    showExperiment();
    byId("run_experiment").onclick = () =>
      attempt(async () => {
        const { bag } = await this.jobs.run("experiment", { name: byId("experiment").value });
        await this.#take(bag);
      });
    byId("record").onclick = () =>
      attempt(async () => {
        const isOn = this.#recording === null;
        const { bag, command } = await this.link.request("record", { on: isOn });
        showCommand("record", command);
        if (!isOn) await this.#take(bag);
      });
  }

  async #take(bag) {
    await this.refreshBags(bag);
    write(byId("recording"), `Recorded ${bag}`);
    showStage("identify");
  }

  get #wanted() {
    return { bag: byId("bag").value, method: byId("method").value, order: Number(byId("order_wanted").value), ...this.signals.fields };
  }

  #showIdentify() {
    attempt(async () => {
      await this.signals.show(byId("bag").value);
      const wanted = this.#wanted;
      const isWhole = wanted.bag !== "" && this.signals.areNamed;
      await askCommand(this.link, "identify", "identify", isWhole ? wanted : null);
    });
  }
}
