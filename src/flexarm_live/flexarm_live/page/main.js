// The page: joins the link to the views, and draws once a frame.

import { ArmView } from "./arm.js";
import { Bodies } from "./bodies.js";
import { Chain, Jobs } from "./chain.js";
import { byId, write } from "./dom.js";
import { Parameters } from "./gains.js";
import { Hold, LawMenu, Waveform, setpointsOf, showPower, wireStop } from "./hands.js";
import { Link } from "./link.js";
import { LinksView } from "./links.js";
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
  `${scheme}://${location.host}/drop${query ? `${query}&` : "?"}`,
);

const bodies = new Bodies();

/** The laboratory as the page shows it; null before its greeting. */
let room = null;

function furnish(hello) {
  const names = hello.channels.map(({ name }) => name);
  const units = new Units(hello.channels);
  const ring = new Ring(names, Math.ceil(KEPT_S * hello.rate_hz), hello.rate_hz);
  const setpoints = setpointsOf(hello, link, units);
  const parameters = new Parameters(hello, link);
  const jobs = new Jobs(link);
  const step = new StepStage(hello, ring, units, setpoints, parameters);
  const tune = new TuneStage(hello, link, jobs, parameters, step);
  const model = new ModelStage(units, (wish) => chain.identify(wish), (models) => chain.compare(models));
  const chain = new Chain(hello, link, jobs, {
    identified: (data) => model.show(data),
    written: (data) => {
      model.offerReport(data);
      tune.offer(data.models, [data.bag]);
    },
    found: (models) => tune.offer(models),
  });
  const isThesis = hello.arm !== undefined;
  for (const part of document.querySelectorAll("[data-of]")) part.hidden = (part.dataset.of === "thesis") !== isThesis;
  const arm = isThesis ? new ArmView(hello, units, setpoints[0]) : new LinksView(hello, units, setpoints);
  if (!isThesis) {
    write(byId("arm_title"), hello.rig.name);
    write(byId("recording"), "The record has set-points, control law and gains with their changes.");
  }
  const views = { arm, traces: new Traces(hello, ring, units) };
  byId("stop").disabled = !hello.hand;
  write(byId("rate"), `${hello.rate_hz} Hz`);
  wireUnits(units, hello.rig);
  const wave = new Waveform(hello, link, units);
  const law = new LawMenu(hello, link);
  const hold = new Hold(link);
  room = { hello, ring, units, setpoints, parameters, chain, wave, law, hold, state: null, ...views };
}

/** Let the controls be used while the server is there; the stop always says what became of it. */
function enable(isReachable) {
  const isUsable = isReachable && room !== null && room.hello.hand;
  for (const id of ["hands", "rig", "chain", "release", "activate", "deactivate"]) byId(id).disabled = !isUsable;
  for (const setpoint of room?.setpoints ?? []) setpoint.disabled = !isUsable;
}

function lose(reason) {
  enable(false);
  showBadge("UNKNOWN", reason, "warning");
}

function wireUnits(units, { joints, inputs, outputs, tracked }) {
  const used = [...joints.map(({ angle }) => angle), ...inputs.map(({ name }) => name)];
  const every = [...outputs, ...inputs].map(({ name }) => name);
  const words = (names) => [true, false].map((si) => units.listed(names, si));
  const [si, own] = words(used)[0] === words(used)[1] ? words(every) : words(used);
  write(byId("units_si"), si);
  write(byId("units_v"), own);
  byId("units_si").parentElement.hidden = si === own;
  const choose = (si) => {
    units.si = si;
    byId("units_si").setAttribute("aria-pressed", `${si}`);
    byId("units_v").setAttribute("aria-pressed", `${!si}`);
    for (const node of tracked.length > 0 ? document.querySelectorAll("[data-unit]") : []) write(node, units.unit(node.dataset.unit || tracked[0].name));
  };
  byId("units_si").onclick = () => choose(true);
  byId("units_v").onclick = () => choose(false);
  choose(true);
}

link.addEventListener("hello", ({ detail }) => {
  bodies.build(detail.solids);
  if (room === null) {
    furnish(detail);
    return;
  }
  // After a break the same laboratory keeps its traces; another one begins anew.
  const kind = ({ channels, rig, hand }) => JSON.stringify([channels, rig, hand]);
  if (kind(detail) !== kind(room.hello)) location.reload();
  for (const [node, parameters] of Object.entries(detail.nodes)) {
    const values = Object.fromEntries(parameters.map(({ name, value }) => [name, value]));
    room.parameters.follow({ node, values });
  }
});
link.addEventListener("bodies", ({ detail }) => bodies.build(detail.solids));
link.addEventListener("poses", ({ detail }) => bodies.move(detail.poses));
link.addEventListener("samples", ({ detail }) => room?.ring.push(decode(detail)));
link.addEventListener("parameters", ({ detail }) => room?.parameters.follow(detail));
link.addEventListener("state", ({ detail: state }) => {
  if (room === null) return;
  room.state = state;
  enable(true);
  showBadge(state.badge, state.reason, state.tone);
  showPower(state);
  showLoop(state, room.ring.lost);
  for (const setpoint of room.setpoints) setpoint.follow(state, room.ring);
  for (const part of [room.hold, room.wave, room.chain]) part.follow(state);
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
    const { arm, ring, state } = room;
    // Without a server nothing is new, and a drawing takes a third of a core.
    const of = [ring.end, ring.time(ring.end - 1), state?.payload_kg, arm.enlarged].join();
    if (of !== drawnOf) arm.draw(ring, state?.payload_kg);
    drawnOf = of;
    if (nowMs >= figuresDueMs) {
      figuresDueMs = nowMs + FIGURES_EVERY_MS;
      arm.showFigures(ring);
    }
    room.traces.draw(nowMs);
    bodies.draw();
  }
  requestAnimationFrame(frame);
}
requestAnimationFrame(frame);
