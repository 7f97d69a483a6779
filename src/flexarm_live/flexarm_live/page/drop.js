// A record of the user's own: dropped or chosen, sent in pieces, and its signals named.

import { announce, attempt, byId, element, fillMenu, fillTable } from "./dom.js";

// The server takes messages of up to 64 kB.
const PIECE_BYTES = 60000;
const MOST_WAITING_BYTES = 4e6;
const ROLES = ["", "input", "output", "time"].map((role) => [role, role || "not used"]);

/** Wire the drop on the page and the file button; `taken` gets the name of the last record. */
export function wireDrop(link, taken) {
  const take = (files) => attempt(() => sendAll(link, files, taken));
  // Elsewhere a browser would leave the page of a moving arm for the file.
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    // The entries are gone after the first wait.
    const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry()).filter(Boolean);
    attempt(async () => take((await Promise.all(entries.map(filesOf))).flat()));
  });
  byId("choose").onclick = () => byId("file").click();
  byId("file").onchange = ({ target }) => {
    take([...target.files].map((file) => ({ name: file.name, file })));
    target.value = "";
  };
}

async function filesOf(entry) {
  const file = (each) => new Promise((resolve, reject) => each.file(resolve, reject));
  if (entry.isFile) return [{ name: entry.name, file: await file(entry) }];
  // A reader gives at most a hundred entries at a time, and none at the end.
  const reader = entry.createReader();
  const inside = [];
  let more;
  do {
    more = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    inside.push(...more);
  } while (more.length);
  const files = inside.filter((each) => each.isFile);
  return Promise.all(files.map(async (each) => ({ name: `${entry.name}/${each.name}`, file: await file(each) })));
}

async function sendAll(link, files, taken) {
  let bag;
  for (const { name, file } of files) bag = await send(link, name, file);
  if (bag === undefined) return;
  announce(`${bag} is here: name its signals, then identify`);
  await taken(bag);
}

/** Send a file; the promise is the name of its record, or an Error with the reason. */
async function send(link, name, file) {
  const socket = link.dropSocket(name);
  const reply = new Promise((resolve, reject) => {
    socket.onmessage = ({ data }) => {
      const { ok, message, data: found } = JSON.parse(data);
      if (ok) resolve(found.bag);
      else reject(new Error(message));
    };
    socket.onclose = () => reject(new Error(`${name}: the connection to the server broke`));
  });
  // A refusal may come while pieces are on their way.
  reply.catch(() => {});
  await Promise.race([reply, new Promise((resolve) => (socket.onopen = resolve))]);
  for (let at = 0; at < file.size && socket.readyState === WebSocket.OPEN; at += PIECE_BYTES) {
    socket.send(await file.slice(at, at + PIECE_BYTES).arrayBuffer());
    while (socket.bufferedAmount > MOST_WAITING_BYTES && socket.readyState === WebSocket.OPEN) {
      await new Promise((resolve) => setTimeout(resolve, 20));
    }
    announce(`${name}: ${Math.round((100 * at) / file.size)} %`);
  }
  if (socket.readyState === WebSocket.OPEN) socket.send("end");
  return reply;
}

/** Table of a record's signals with their roles and units; empty for a record that has its own. */
export class Signals {
  #bag = "";
  #rows = [];
  #endings = {};

  constructor(link, changed) {
    Object.assign(this, { link, changed });
    byId("rate_wanted").onchange = changed;
  }

  /** Look at the next record anew: a file of the same name may have other columns. */
  forget() {
    this.#bag = "";
  }

  /** Show the signals of another record. */
  async show(bag) {
    if (bag === this.#bag) return;
    this.#bag = bag;
    this.#fill([]);
    if (bag === "") return;
    const { signals, endings, has_clock: hasClock } = await this.link.request("signals", { bag });
    if (bag !== this.#bag) return;
    this.#endings = endings;
    byId("rate_row").hidden = hasClock;
    byId("rate_wanted").value = "";
    this.#fill(signals, hasClock);
  }

  /** Whether an input and an output are chosen, or the record has its own. */
  get areNamed() {
    const { inputs, outputs } = this.fields;
    return inputs === undefined || (inputs.length > 0 && outputs.length > 0);
  }

  /** Fields of a request; none for a record that has its own. */
  get fields() {
    if (this.#rows.length === 0) return {};
    const of = (role) => this.#rows.filter((row) => row.role.value === role);
    const rate = byId("rate_wanted").value;
    const times = [...of("time").map(({ name }) => name), ...(rate === "" ? [] : [`${rate}Hz`])];
    const named = (role) => of(role).map((row) => this.#named(row));
    return { inputs: named("input"), outputs: named("output"), times };
  }

  #fill(signals, hasClock) {
    const menu = (label, pairs, chosen) => {
      const made = element("select", { "aria-label": label, onchange: this.changed });
      fillMenu(made, pairs, chosen);
      return made;
    };
    const roles = ROLES.filter(([role]) => role !== "time" || !hasClock);
    const units = [["", "unit"], ...Object.keys(this.#endings).map((unit) => [unit, unit])];
    this.#rows = signals.map(({ name, unit, role }) => ({
      name,
      stated: unit,
      role: menu(`Role of ${name}`, roles, role),
      unit: menu(`Unit of ${name}`, units, unit),
    }));
    fillTable(byId("columns_rows"), this.#rows.map(({ name, role, unit }) => [name, role, unit]));
    byId("columns").hidden = signals.length === 0;
  }

  // A name says its unit at its end.
  #named({ name, stated, unit }) {
    if (unit.value === stated) return name;
    const stem = name.replace(/\s*[[(][^\])]*[\])]$/, (end) => (/\d/.test(end) ? end : "")).replace(/^\//, "");
    return `${stem.replace(/[^\p{L}\p{N}]+/gu, "_").replace(/_$/, "")}${this.#endings[unit.value] ?? ""}=${name}`;
  }
}
