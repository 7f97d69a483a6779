"""Bridge between the graph and the server: what a page asks for becomes calls of the nodes."""

from __future__ import annotations

import asyncio
import math
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from std_srvs.srv import SetBool, Trigger

from flexarm_control.loop_setup import TOPIC
from flexarm_core.channels import is_thesis_arm
from flexarm_core.clock import slowness
from flexarm_core.errors import FlexarmError, nearest
from flexarm_live.graph.about import about_arm
from flexarm_live.graph.chain import Chain, Jobs, record_line
from flexarm_live.graph.loop_nodes import LoopNodes
from flexarm_live.graph.node_parameters import Calls, NodeParameters, SilentNodeError
from flexarm_live.graph.samples import SampleReader, ShownBodies
from flexarm_live.graph.situation import EXPERIMENT, Situation
from flexarm_live.graph.store import Store, signals_of
from flexarm_live.serving.laboratory import Answer
from flexarm_live.serving.requests import Needs
from flexarm_msgs.srv import SetReference
from flexarm_node.parameter_files import LOOP

if TYPE_CHECKING:
    from collections.abc import Coroutine, Mapping

    from rclpy.node import Node

    from flexarm_core.rig_description import RigDescription
    from flexarm_live.serving.laboratory import Outlet
    from flexarm_live.serving.requests import Request

_NODES = (*LOOP, "recorder", "ident")
_STOP_S = 5.0
_STOP_AGAIN_S = 0.2
"""A stop does no harm twice, and its answer may be lost while the nodes discover each other."""
# Less than a verb of another terminal waits.
_REFERENCE_S = _SILENT_NODE_S = 3.0
_NODES_OF: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("reference", "law", "waveform", "apply"), ("controller",)),
    **dict.fromkeys(("payload", "fault", "stop", "release"), ("daq",)),
    **dict.fromkeys(("activate", "deactivate"), LOOP),
    "record": ("recorder",),
    "get": _NODES,
}
"""Nodes that requests are for which name none."""
# A drive is taken to zero, and a run begun anew, however long that takes.
_WAITED_FOR = frozenset({"stop", "release", "deactivate", "fault"})
_RECORD_S = 30.0
_BEGIN_AT_REST = ("mujoco", "twin")
"""Drivers whose runs begin at rest, as those of the simulated arm."""


class Bridge:
    """Laboratory of one arm; all methods run in the thread of the server's event loop.

    Parameters
    ----------
    node : Node
        Node for the clients; an executor spins it in another thread.
    folder : Path
        Folder of the records and models.
    rig : RigDescription
        The arm.
    frame : str
        Frame of its samples.

    Attributes
    ----------
    outlet : Outlet
        What sends messages to the pages; set before the server starts.
    samples : SampleReader
        Reader of the samples; its caller hands it the messages.
    situation : Situation
        What the nodes report.
    loop : LoopNodes
        The nodes of the loop.
    """

    outlet: Outlet

    def __init__(self, node: Node, folder: Path, rig: RigDescription, frame: str) -> None:
        self._calls = Calls(node)
        self._rig = rig
        self.samples = SampleReader(rig, frame)
        self.situation = Situation()
        self.loop = LoopNodes(node, self._calls, self.situation, self.samples.codec)
        self._others = {
            name: NodeParameters(self._calls, name) for name in _NODES if name not in LOOP
        }
        self._bodies = ShownBodies(node, lambda: self.outlet)
        self._store = Store(folder)
        self._jobs = Jobs(self._send)
        self._chain = Chain(
            self._store, self.loop, lambda: self.situation.held(time.monotonic()), rig
        )
        self._commands = 0
        self._recording: str | None = None
        self._waveform: Mapping[str, Any] = {"kind": "none"}
        # Discovered before they are needed.
        self._calls.client(Trigger, "emergency_stop")
        self._calls.client(SetReference, "set_reference")
        self._calls.client(SetBool, "recorder/record")

    async def hello(self) -> dict[str, Any]:
        """Return what does not change: channels, laws, experiments, parameters."""
        for parameters in self.loop.parameters.values():
            await parameters.load()
        nodes = {name: each.shown() for name, each in self.loop.parameters.items()}
        simulated = self.loop.simulated
        return {
            "rate_hz": self.loop.parameters["daq"].values.get("rate_hz"),
            "simulated": simulated,
            "nodes": nodes,
            "solids": self._bodies.solids,
            **about_arm(self._rig, simulated=simulated),
        }

    def reports(self) -> dict[str, dict[str, Any]]:
        """Return message and figures of each node that reports."""
        return self.situation.reports(time.monotonic())

    def state(self) -> dict[str, Any]:
        """Return the state of now."""
        daq, controller = (self.loop.parameters[name].values for name in LOOP)
        has_experiment = self._jobs.has(EXPERIMENT)
        found = self.situation.state(time.monotonic())
        if has_experiment and found["badge"] == "DRIVING":
            found["reason"] = "an experiment drives the arm"
        return {
            **found,
            "has_experiment": has_experiment,
            "law": controller.get("law"),
            "references": self.samples.references,
            "payload_kg": daq.get("payload_kg") if self.loop.simulated else None,
            "fault": daq.get("fault"),
            "recording": self._recording or self.situation.recording(),
            "waveform": self._waveform,
            "jobs": self._jobs.at_work,
        }

    async def carry_out(self, request: Request) -> Answer:
        """Carry out a request; a `FlexarmError` refuses it with a reason.

        An experiment has the arm for itself until it ends or is cancelled, but for a stop.
        """
        moves_arm = request.needs is Needs.HOLD or request.verb == "record"
        if moves_arm:
            self._jobs.require_none(EXPERIMENT)
        if request.verb == EXPERIMENT and self._commands:
            raise FlexarmError("a command to the arm is being carried out: wait for its end")
        self._commands += moves_arm
        try:
            answer = await self._answered(request)
        finally:
            self._commands -= moves_arm
        if request.needs in (Needs.TOKEN, Needs.HOLD):
            self.outlet.send_state()
        return answer

    async def _answered(self, request: Request) -> Answer:
        """Answer a request; one to a node that is silent is given up early, with the reason."""
        work: Coroutine[Any, Any, Answer] = getattr(self, f"_on_{request.verb}")(**request.fields)
        is_waited_for = request.verb in _WAITED_FOR or not self._silence(request)
        patience_s = None if is_waited_for else _SILENT_NODE_S * slowness()
        try:
            return await asyncio.wait_for(work, patience_s)
        except (asyncio.TimeoutError, SilentNodeError) as error:
            # A node that has ended stays known to the graph for a while.
            if silence := self._silence(request):
                raise FlexarmError(silence) from error
            if isinstance(error, SilentNodeError):
                raise
            raise SilentNodeError("the node did not answer in time: try again") from error

    def _silence(self, request: Request) -> str:
        """Return which node that a request is for is silent, and since when; else nothing."""
        named = request.fields.get("node")
        for node in (named,) if named else _NODES_OF.get(request.verb, ()):
            if silence := self.situation.silence(node, time.monotonic()):
                return f"the {node} does not answer: {silence}"
        return ""

    def report(self, name: str) -> bytes | None:
        """Return the report of an identified model, or its comparison; see `Store.report`."""
        return self._store.report(name)

    def place_for(self, name: str) -> Path:
        """Return where a dropped file goes; a `FlexarmError` refuses its name with a reason."""
        return self._store.place_for(name)

    async def _on_stop(self) -> Answer:
        answer = await self._calls.call(
            Trigger, "emergency_stop", Trigger.Request(), _STOP_S, again_s=_STOP_AGAIN_S
        )
        self.situation.stopped(time.monotonic())
        return Answer(answer.message)

    async def _on_release(self) -> Answer:
        """Begin a new run with the set-points where the arm is: it shall not jump."""
        await self._end_waveform()
        here = self._starting_references()
        await self.loop.deactivate("daq")
        for name, value in here.items():
            await self._on_reference(value, name)
        await self.loop.restart_sampling()
        words = ", ".join(f"{value:.3g} {self._unit(name)}" for name, value in here.items())
        return Answer("sampling again" + (f", the set-point is {words}" if words else ""))

    def _starting_references(self) -> dict[str, float]:
        """Return where a new run begins, by the tracked outputs, within the travel of each."""
        measured = dict(zip(self._rig.output_names, self.samples.outputs, strict=True))
        # A run of a simulated arm begins at rest in the middle.
        if self.loop.simulated or self._rig.driver in _BEGIN_AT_REST:
            measured = dict.fromkeys(measured, 0.0)
        return {
            each.output: min(max(measured[each.output], each.low), each.high)
            for each in self._rig.tracks
        }

    async def _on_activate(self, node: str = "") -> Answer:
        # The controller first: the DAQ node waits for it.
        for name in [node] if node else reversed(LOOP):
            await self.loop.activate(name)
        return Answer(f"{node or ' and '.join(LOOP)} active")

    async def _on_deactivate(self, node: str = "") -> Answer:
        for name in [node] if node else LOOP:
            await self.loop.deactivate(name)
        return Answer(f"{node or ' and '.join(LOOP)} not active: the drive is at zero")

    async def _on_reference(self, value: float, joint: str = "") -> Answer:
        request = SetReference.Request(reference_v=float(value), joint=joint)
        answer = await self._calls.call(SetReference, "set_reference", request, _REFERENCE_S)
        if not answer.success:
            raise FlexarmError(answer.message)
        beyond = await self._beyond_bound(answer.reference_v)
        note = ", ".join(filter(None, (answer.message, beyond)))
        words = [f"set-point {answer.reference_v:.3f} {self._unit(joint)}", note]
        data = {"value": answer.reference_v, "note": note}
        return Answer(": ".join(filter(None, words)), data)

    def _unit(self, joint: str) -> str:
        """Return the unit of a joint or output by its name; of the first set-point for none."""
        tracks = self._rig.tracks
        return next(each.unit for each in tracks if joint in ("", each.name, each.output))

    async def _beyond_bound(self, reference_v: float) -> str:
        """Return that the drive is cut before the arm gets there; empty where it is not."""
        if not is_thesis_arm(self._rig):
            return ""
        parameters = self.loop.parameters["daq"]
        with suppress(FlexarmError):  # the set-point is in force all the same
            await parameters.load()
        bound_v = parameters.values.get("position_bound_v", math.inf)
        if abs(reference_v) <= bound_v:
            return ""
        return f"beyond the bound of {bound_v:g} V (daq position_bound_v), where the drive is cut"

    async def _end_waveform(self) -> None:
        await self.loop.parameters["controller"].set({"reference": TOPIC})
        self._waveform = {"kind": "none"}

    async def _on_waveform(self, kind: str, **values: float) -> Answer:
        if kind == "none":
            await self._end_waveform()
            return Answer("the set-point stays where it is")
        wanted: dict[str, Any] = {f"{kind}.{name}": value for name, value in values.items()}
        await self.loop.parameters["controller"].set(wanted | {"reference": kind})
        self._waveform = {"kind": kind, **values}
        return Answer(f"{kind} wave")

    async def _on_set(self, node: str, name: str, value: Any) -> Answer:  # noqa: ANN401 - of JSON
        parameters = self._parameters(node)
        await parameters.load()
        before = parameters.values.get(name)
        await parameters.set({name: value})
        return Answer(f"{node} {name}: {before} -> {value}", {"before": before})

    async def _on_law(self, name: str) -> Answer:
        await self.loop.parameters["controller"].set({"law": name})
        return Answer(f"law {name}")

    async def _on_payload(self, kg: float) -> Answer:
        self._require_simulated("payload")
        await self.loop.parameters["daq"].set({"payload_kg": float(kg)})
        return Answer(f"payload {kg:g} kg")

    async def _on_fault(self, name: str) -> Answer:
        self._require_simulated("fault")
        await self.loop.restart_sampling({"fault": name})
        return Answer(f"fault {name}: the run began anew")

    async def _on_record(self, on: bool) -> Answer:  # noqa: FBT001 - a field of the request
        bag = self._store.new_bag("live") if on else Path(self._recording or "")
        if on:
            await self._others["recorder"].set({"bag": str(bag)})
        request = SetBool.Request(data=on)
        answer = await self._calls.call(SetBool, "recorder/record", request, _RECORD_S)
        if not (answer.success or (on and answer.message == f"already recording to {bag}")):
            raise FlexarmError(answer.message)
        self._recording = str(bag) if on else None
        data = {"bag": bag.name, "folder": str(bag), "command": record_line(bag)}
        return Answer(answer.message, data)

    async def _on_task(self, text: str) -> Answer:
        self.situation.task = text
        self.outlet.send_state()
        return Answer()

    async def _on_samples(self, after: int) -> Answer:
        return Answer(data=self.samples.after(after))

    async def _on_bags(self) -> Answer:
        return Answer(data={"bags": self._store.bags(), "models": self._store.models()})

    async def _on_signals(self, bag: str) -> Answer:
        # A log of hours has its first rows read all the same, and a bag its index.
        return Answer(data=await asyncio.to_thread(signals_of, self._store.bag(bag)))

    async def _on_get(self, node: str = "") -> Answer:
        names = [node] if node else [each for each in _NODES if self._parameters(each).are_there]
        for name in names:
            # A node that was killed and started anew has its own.
            await self._parameters(name).look_again()
        shown = {name: self._parameters(name).shown() for name in names}
        return Answer(data={"params": shown[node]} if node else {"nodes": shown})

    async def _on_experiment(self, name: str) -> Answer:
        work = self._chain.experiment(name, self._on_record, lambda: self.samples.newest)
        number = self._jobs.start(EXPERIMENT, work, left="what was recorded is kept")
        return Answer(f"experiment {name} runs", {"job": number})

    async def _on_identify(self, **asked: Any) -> Answer:  # noqa: ANN401 - checked fields
        number = self._jobs.start("identify", self._chain.identification(**asked))
        return Answer(f"identifying {asked['bag']}", {"job": number})

    async def _on_compare(self, **asked: Any) -> Answer:  # noqa: ANN401 - checked fields
        # The process that identifies does one thing at a time.
        number = self._jobs.start("identify", self._chain.comparison(**asked))
        return Answer(f"comparing models on {asked['bag']}", {"job": number})

    async def _on_tune(self, law: str, models: list[str], **margins: float) -> Answer:
        if not is_thesis_arm(self._rig):
            raise FlexarmError(f"tune: {self._rig.name} is another arm than the thesis's")
        number = self._jobs.start("tune", self._chain.tuning(law, models, margins))
        return Answer(f"tuning {law}", {"job": number})

    async def _on_identify_line(self, **asked: Any) -> Answer:  # noqa: ANN401 - checked fields
        return Answer(data={"command": self._chain.identification_line(**asked)})

    async def _on_tune_line(self, law: str, models: list[str], **margins: float) -> Answer:
        return Answer(data={"command": self._chain.tuning_line(law, models, margins)})

    async def _on_cancel(self, job: int) -> Answer:
        return Answer(f"{self._jobs.cancel(job)} is being cancelled")

    async def _on_apply(self, gains: Mapping[str, Any], law: str = "") -> Answer:
        # All at once between two samples: the law takes over from the state of the former one.
        await self.loop.parameters["controller"].set({**gains, **({"law": law} if law else {})})
        return Answer("the new gains are in force")

    def _send(self, message: Mapping[str, Any]) -> None:
        self.outlet.send(message)

    def _parameters(self, node: str) -> NodeParameters:
        every = {**self.loop.parameters, **self._others}
        if node not in every:
            raise FlexarmError(f"no node {node!r}{nearest(node, every)}")
        return every[node]

    def _require_simulated(self, what: str) -> None:
        if not self.loop.simulated:
            raise FlexarmError(f"{what}: only the simulated arm's can be set")
