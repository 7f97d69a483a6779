// The page: joins the link to the views, and draws once a frame.

import { ArmView } from "./arm.js";
import { Chain, Jobs } from "./chain.js";
import { byId, write } from "./dom.js";
import { Parameters } from "./gains.js";
import { LawMenu, Setpoint, Waveform, showPower, wireStop } from "./hands.js";
import { Link } from "./link.js";
import { ModelStage } from "./model.js";
import { Ring, decode } from "./samples.js";
import { showBadge, showLoop } from "./status.js";
import { Traces } from "./traces.js";
import { StepStage, TuneStage } from "./tuning.js";
import { Units } from "./units.js";

const KEPT_S = 300;
const FIGURES_EVERY_MS = 100;

const token = new URLSearchParams(location.hash.slice(1)).get("token");
const scheme = location.protocol === "https:" ? "wss" : "ws";
const query = token === null ? "" : `?token=${encodeURIComponent(token)}`;
const link = new Link(
  `${scheme}://${location.host}/live${query}`,
  token === null ? null : `${scheme}://${location.host}/stop${query}`,
);

/** The laboratory as the page shows it; null before its greeting. */
let room = null;

function furnish(hello) {
  const names = hello.channels.map(({ name }) => name);
  const units = new Units(hello.channels);
  const ring = new Ring(names, Math.ceil(KEPT_S * hello.rate_hz), hello.rate_hz);
  const setpoint = new Setpoint(hello, link, units);
  const parameters = new Parameters(hello, link);
  const jobs = new Jobs(link);
  const step = new StepStage(hello, ring, units, setpoint, parameters);
  const tune = new TuneStage(hello, link, jobs, parameters, step);
  const model = new ModelStage((wish) => chain.identify(wish));
  const chain = new Chain(hello, link, jobs, {
    identified: (data) => model.show(data),
    written: ({ models, bag, report }) => {
      model.offerReport(report);
      tune.offer(models, [bag]);
    },
    found: (models) => tune.offer(models),
  });
  const views = { arm: new ArmView(hello, setpoint), traces: new Traces(hello, ring, units) };
  byId("stop").disabled = !hello.hand;
  write(byId("rate"), `${hello.rate_hz} Hz`);
  wireUnits(units);
  const wave = new Waveform(hello, link, units);
  const law = new LawMenu(hello, link);
  room = { hello, ring, units, setpoint, parameters, chain, wave, law, state: null, ...views };
}

/** Let the controls be used while the server is there; the stop always says what became of it. */
function enable(isReachable) {
  const isUsable = isReachable && room !== null && room.hello.hand;
  for (const id of ["hands", "rig", "chain", "release", "activate", "deactivate"]) byId(id).disabled = !isUsable;
  if (room !== null) room.setpoint.disabled = !isUsable;
}

function lose(reason) {
  enable(false);
  showBadge("STALE", reason);
}

function wireUnits(units) {
  const choose = (si) => {
    units.si = si;
    byId("units_si").setAttribute("aria-pressed", `${si}`);
    byId("units_v").setAttribute("aria-pressed", `${!si}`);
    for (const node of document.querySelectorAll("[data-unit]")) write(node, units.unit(node.dataset.unit));
  };
  byId("units_si").onclick = () => choose(true);
  byId("units_v").onclick = () => choose(false);
  choose(true);
}

link.addEventListener("hello", ({ detail }) => {
  if (room === null) {
    furnish(detail);
    return;
  }
  // After a break the same laboratory keeps its traces; another one begins anew.
  const kind = ({ channels, hand }) => JSON.stringify([channels, hand]);
  if (kind(detail) !== kind(room.hello)) location.reload();
  for (const [node, parameters] of Object.entries(detail.nodes)) {
    const values = Object.fromEntries(parameters.map(({ name, value }) => [name, value]));
    room.parameters.follow({ node, values });
  }
});
link.addEventListener("samples", ({ detail }) => room?.ring.push(decode(detail)));
link.addEventListener("parameters", ({ detail }) => room?.parameters.follow(detail));
link.addEventListener("state", ({ detail: state }) => {
  if (room === null) return;
  room.state = state;
  enable(true);
  showBadge(state.badge, state.reason);
  showPower(state);
  showLoop(state, room.ring.lost);
  for (const part of [room.setpoint, room.wave, room.chain]) part.follow(state);
  room.parameters.followPayload(state.payload_kg);
  if (room.law.follow(state)) room.parameters.showLaw(state.law);
});
link.addEventListener("silent", () => lose("the server is silent"));
link.addEventListener("closed", ({ detail }) => lose(detail || "no connection to the server; trying again"));
wireStop(link, () => room === null || room.hello.hand);

addEventListener("keydown", (event) => {
  if (room === null || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.closest("input, select, textarea")) return;
  const { traces, units } = room;
  const act = {
    p: () => traces.pause(),
    u: () => byId(units.si ? "units_v" : "units_si").click(),
    "+": () => traces.zoom(0.5),
    "-": () => traces.zoom(2),
  }[event.key];
  act?.();
});

let figuresDueMs = 0;
let drawnOf = "";

function frame(nowMs) {
  if (room !== null && room.ring.end > 0) {
    const { ring, units, state } = room;
    const sample = {
      timeS: ring.time(ring.end - 1),
      positionV: ring.newest("position_v"),
      baseV: ring.newest("base_strain_v"),
      middleV: ring.newest("middle_strain_v"),
      referenceV: ring.newest("reference_v"),
      payloadKg: state?.payload_kg,
    };
    // Without a server nothing is new, and a drawing takes a third of a core.
    const of = [ring.end, sample.timeS, sample.payloadKg, room.arm.enlarged].join();
    if (of !== drawnOf) room.arm.draw(sample);
    drawnOf = of;
    if (nowMs >= figuresDueMs) {
      figuresDueMs = nowMs + FIGURES_EVERY_MS;
      room.arm.tellFigures(sample, units);
    }
    room.traces.draw(nowMs);
  }
  requestAnimationFrame(frame);
}
requestAnimationFrame(frame);
