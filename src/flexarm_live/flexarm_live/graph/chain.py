"""Jobs of a page, reported and cancelled, and the chain of their work: record, identify, tune."""

from __future__ import annotations

import asyncio
import shlex
import time
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexarm_control.laws.registry import LAWS
from flexarm_control.loop_setup import TOPIC
from flexarm_core.channels import is_thesis_arm
from flexarm_core.clock import Patience
from flexarm_core.computation import Computation
from flexarm_core.errors import FlexarmError, nearest, one_line
from flexarm_daq.experiments.catalogue import experiment, on_rig
from flexarm_live.graph.situation import EXPERIMENT
from flexarm_live.graph.store import COMPARISON_FILE

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping, Sequence

    from flexarm_core.computation import Report
    from flexarm_core.rig_description import RigDescription
    from flexarm_daq.experiments.catalogue import Experiment
    from flexarm_live.graph.loop_nodes import LoopNodes
    from flexarm_live.graph.store import Store
    from flexarm_live.serving.laboratory import Answer

    Send = Callable[[Mapping[str, Any]], None]
    Work = Callable[[Report], Awaitable[Mapping[str, Any]]]

_COMMAND = "./flexarm"
_POLL_S = 0.2
_ASK_S = 1.0
_STALLED_S = 30.0
_SEED = 1
_NOMINAL = "nominal:"


class Jobs:
    """Jobs of a laboratory.

    Parameters
    ----------
    send : callable
        Gets each message to the pages.
    """

    def __init__(self, send: Send) -> None:
        self._send = send
        self._numbers = count(1)
        self._at_work: dict[int, tuple[str, asyncio.Task[None]]] = {}
        self._cancelled: set[int] = set()

    @property
    def at_work(self) -> list[int]:
        """Numbers of the jobs that have not ended."""
        return list(self._at_work)

    def require_none(self, kind: str) -> None:
        """Raise a `FlexarmError` while a job of a kind is at work."""
        number = self._number_of(kind)
        if number is not None:
            raise FlexarmError(f"job {number}, {kind}, is at work: cancel it or wait")

    def has(self, kind: str) -> bool:
        """Return whether a job of a kind is at work."""
        return self._number_of(kind) is not None

    def start(self, kind: str, work: Work, *, left: str = "nothing was written") -> int:
        """Start work and return its number; a `FlexarmError` while one of its kind is at work.

        What is `left` of it is reported when it is cancelled.
        """
        self.require_none(kind)
        number = next(self._numbers)
        task = asyncio.create_task(self._run(number, kind, work, left))
        self._at_work[number] = (kind, task)
        task.add_done_callback(lambda _: self._forget(number))
        return number

    def cancel(self, number: int) -> str:
        """Cancel a job and return its kind; a `FlexarmError` when there is none of the number.

        A second time changes nothing: it would break off what the job does to end well.
        """
        if number not in self._at_work:
            raise FlexarmError(f"no job {number} is at work")
        kind, task = self._at_work[number]
        if number not in self._cancelled:
            self._cancelled.add(number)
            task.cancel()
        return kind

    def _number_of(self, kind: str) -> int | None:
        """Return the number of the job of a kind that is at work; None without one."""
        return next((number for number, (own, _) in self._at_work.items() if own == kind), None)

    def _forget(self, number: int) -> None:
        del self._at_work[number]
        self._cancelled.discard(number)

    async def _run(self, number: int, kind: str, work: Work, left: str) -> None:
        def say(stage: str, fraction: float | None, **more: Any) -> None:  # noqa: ANN401 - of JSON
            news: dict[str, Any] = {
                "fraction": fraction,
                "done": False,
                "ok": False,
                "message": "",
                "data": {},
            }
            self._send({"type": "job", "job": kind, "id": number, "stage": stage, **news, **more})

        def report(
            stage: str, fraction: float | None, found: Mapping[str, Any] | None = None, /
        ) -> None:
            say(stage, fraction, data=found or {})

        say("starting", 0.0)
        try:
            data = await work(report)
        except asyncio.CancelledError:
            say("cancelled", None, done=True, message=f"cancelled: {left}")
        except FlexarmError as error:
            say("failed", None, done=True, message=one_line(error))
        except Exception as error:
            say("failed", None, done=True, message=f"internal error: {one_line(error)}")
            raise
        else:
            say("done", 1.0, done=True, ok=True, data=data)


class Chain:
    """Work of the jobs of one laboratory."""

    def __init__(
        self, store: Store, loop: LoopNodes, held: Callable[[], str], rig: RigDescription
    ) -> None:
        self._rig = rig
        self._store = store
        self._loop = loop
        self._held = held
        self._identifying = Computation("flexarm_live.work.identification")
        self._tuning = Computation("flexarm_live.work.tuning")

    def experiment(
        self, name: str, record: Callable[[bool], Awaitable[Answer]], newest: Callable[[], int]
    ) -> Work:
        """Return the work of a recorded experiment.

        In open loop the node `experiment` commands in the controller's place. A stop ends the
        experiment, and the drive stays held until it is released. Another arm than the thesis's has
        those in open loop, at its own rate.

        Parameters
        ----------
        name : str
            Name in the catalogue.
        record : callable
            Starts and ends a record.
        newest : callable
            Returns the number of the newest sample.
        """
        entry = on_rig(experiment(name), self._rig)
        if entry.closed_loop and not is_thesis_arm(self._rig):
            raise FlexarmError(
                f"{entry.name} needs gains of {self._rig.name}, which `flexarm experiment "
                f"{entry.name} --rig` finds: choose one in open loop here"
            )
        rig: dict[str, float] = {}
        if is_thesis_arm(self._rig):
            rig = {"rate_hz": float(entry.rate_hz), "payload_kg": float(entry.payload_kg)}

        async def work(report: Report) -> Mapping[str, Any]:
            if reason := self._held():
                raise FlexarmError(f"{reason}: release it before an experiment")
            daq = self._loop.parameters["daq"]
            rig_before = {key: daq.values[key] for key in rig}
            before = self._controller_before(entry)
            report("preparing", None)
            if not entry.closed_loop:
                # Before the arm is let go of: the node may not be there.
                await self._loop.experiment.load()
            await self._loop.deactivate("daq")
            try:
                await self._give_command(entry)
                bag = (await record(True)).data  # noqa: FBT003 - a field of a request
                try:
                    await self._loop.restart_sampling(rig, samples=entry.samples)
                    await self._sampled(entry.samples, newest, report)
                finally:
                    await asyncio.shield(record(False))  # noqa: FBT003 - a field of a request
            finally:
                await asyncio.shield(self._back(entry, before, rig_before))
            return bag or {}

        return work

    def _controller_before(self, entry: Experiment) -> dict[str, Any]:
        """Return the controller's parameters as they shall be after an experiment."""
        values = self._loop.parameters["controller"].values
        changed = entry.commander_parameters(_SEED) if entry.closed_loop else {}
        return {key: values[key] for key in changed} | {"reference": TOPIC}

    async def _give_command(self, entry: Experiment) -> None:
        """Let the node command that an experiment needs."""
        wanted = entry.commander_parameters(_SEED)
        if entry.closed_loop:
            await self._loop.parameters["controller"].set(wanted)
            await self._loop.activate("controller")
            return
        await self._loop.experiment.set(wanted)
        await self._loop.release("controller")
        await self._loop.activate(EXPERIMENT)

    async def _back(
        self, entry: Experiment, before: Mapping[str, Any], rig: Mapping[str, Any]
    ) -> None:
        """Take the laboratory back to where it was before the experiment.

        A drive that was stopped stays so: the rig's parameters wait for its release.
        """
        stopped = bool(self._held())
        if not stopped:
            await self._loop.deactivate("daq")
        if not entry.closed_loop:
            await self._loop.release(EXPERIMENT)
        await self._loop.parameters["controller"].set(before)
        await self._loop.activate("controller")
        if stopped:
            self._loop.postpone({"samples": 0, **rig})
        else:
            await self._loop.restart_sampling(rig)

    async def _sampled(self, samples: int, newest: Callable[[], int], report: Report) -> None:
        """Wait until all samples are taken and the node has stopped by itself."""
        seen, patience, asked_s = 0, Patience(_STALLED_S), time.monotonic()
        while True:
            await asyncio.sleep(_POLL_S)
            now_s = time.monotonic()
            if (number := newest()) != seen:
                seen, patience = number, Patience(_STALLED_S)
            report("sampling", min(1.0, seen / samples))
            if reason := self._held():
                raise FlexarmError(f"{reason}; the record is kept")
            if patience.is_over:
                raise FlexarmError(f"no new sample came in {patience.waited_s:.0f} s after {seen}")
            if now_s - asked_s < _ASK_S:
                continue
            asked_s = now_s
            if not await self._loop.is_active("daq"):
                if newest() < samples:
                    raise FlexarmError(f"the run ended after {newest()} of {samples} samples")
                return

    def identification(self, bag: str, **asked: Any) -> Work:  # noqa: ANN401 - checked fields
        """Return the work of an identification of a record, with its files."""
        path, folder = self._store.bag(bag), self._store.model_folder(bag)
        command = self.identification_line(bag, **asked)
        signals = _taken_signals(asked)
        request = _identify_request(**asked)

        async def work(report: Report) -> Mapping[str, Any]:
            about = {"bag": bag, "report": f"/report/{bag}", "command": command}
            job = {"bag": str(path), "folder": str(folder), "request": request, "about": about}
            job["signals"] = signals
            found = await computed(self._identifying, job, report)
            return {**found, "models": self._store.models()}

        return work

    def identification_line(self, bag: str, **asked: Any) -> str:  # noqa: ANN401 - checked fields
        """Return the command line of an identification."""
        path, folder = self._store.bag(bag), self._store.model_folder(bag)
        signals = _taken_signals(asked)
        return identify_line(path, folder, _identify_request(**asked), signals)

    def comparison(self, bag: str, models: list[str], **asked: Any) -> Work:  # noqa: ANN401
        """Return the work of a comparison of a record's model with others, all on that record."""
        path, page = self._store.bag(bag), self._store.model_folder(bag) / COMPARISON_FILE
        others = [self._store.model_file(name).parent for name in models]
        signals = _taken_signals(asked)
        request = _identify_request(**asked)
        job = {"bag": str(path), "request": request, "signals": signals}
        job |= {"others": [str(each) for each in others], "page": str(page)}
        command = compare_line([path, *others], page, request, signals)

        async def work(report: Report) -> Mapping[str, Any]:
            await computed(self._identifying, job, report)
            return {"comparison": f"/report/{bag}/comparison", "command": command}

        return work

    def tuning(self, law: str, models: list[str], margins: Mapping[str, float]) -> Work:
        """Return the work of a tuning on models by their names."""
        files = self._model_files(models)
        values = self._loop.parameters["controller"].values
        before = {name: value for name, value in values.items() if name.startswith(f"{law}.")}
        command = self.tuning_line(law, models, margins)

        async def work(report: Report) -> Mapping[str, Any]:
            asked = {"law": law, "models": files, "margins": dict(margins), "before": before}
            found = await computed(self._tuning, asked, report)
            return {**found, "command": command}

        return work

    def tuning_line(self, law: str, models: list[str], margins: Mapping[str, float]) -> str:
        """Return the command line of a tuning; a `FlexarmError` for a law that has none."""
        if law not in LAWS or not LAWS[law].tuning:
            raise FlexarmError(f"law {law!r} is not tunable{nearest(law, LAWS)}")
        return tune_line(law, self._model_files(models), margins)

    def _model_files(self, models: list[str]) -> list[str]:
        """Return what a tuning calls the models that a page names."""
        return [
            each if each.startswith(_NOMINAL) else shown(self._store.model_file(each))
            for each in models
        ]


async def computed(
    computation: Computation, request: Mapping[str, Any], report: Report
) -> Mapping[str, Any]:
    """Return the result of a computation; it is cancelled with the task that waits for it."""
    loop = asyncio.get_running_loop()

    def tell(stage: str, fraction: float | None, found: Mapping[str, Any] | None = None, /) -> None:
        loop.call_soon_threadsafe(report, stage, fraction, found)

    computation.begin(request)
    answer = asyncio.ensure_future(asyncio.to_thread(computation.answer, tell))
    try:
        return await asyncio.shield(answer)
    except asyncio.CancelledError:
        computation.cancel()
        await asyncio.wait({answer})
        answer.exception()
        raise


def _taken_signals(asked: dict[str, Any]) -> dict[str, list[str]]:
    """Take the signals that a page names of a record out of the fields of its request."""
    return {name: asked.pop(name, []) for name in ("inputs", "outputs", "times")}


def _identify_request(
    order: int = 0,
    method: str = "auto",
    reduced_order: int = 0,
    known_modes_hz: Sequence[float] = (),
) -> dict[str, Any]:
    """Return the fields of a `Request` that a page asks for; None leaves one open."""
    request: dict[str, Any] = {"method": method, "order": order or None}
    if not (reduced_order or known_modes_hz):
        return request
    return request | {
        "reduction": "mrmc" if known_modes_hz else "mrm",
        "reduced_order": reduced_order or None,
        "update": "b",
        "known_modes_hz": list(known_modes_hz),
    }


def record_line(bag: Path) -> str:
    """Return the command line of a record."""
    return shlex.join([_COMMAND, "record", shown(bag)])


def identify_line(
    bag: Path,
    folder: Path,
    request: Mapping[str, Any],
    signals: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> str:
    """Return the command line of an identification.

    Parameters
    ----------
    bag : Path
        Record.
    folder : Path
        Folder of the results.
    request : mapping
        Fields of a `Request`; those that are left open are not options.
    signals : mapping
        What the page names of the record: ``inputs``, ``outputs``, ``times``.
    """
    words = [_COMMAND, "identify", shown(bag), "-o", shown(folder)]
    return shlex.join(words + _options(request, signals))


def compare_line(
    places: Sequence[Path],
    page: Path,
    request: Mapping[str, Any],
    signals: Mapping[str, Sequence[str]],
) -> str:
    """Return the command line of a comparison of records and models; see `identify_line`."""
    words = [_COMMAND, "report", *map(shown, places), "-o", shown(page)]
    # A report reduces the model, unless told otherwise.
    return shlex.join(words + _options({"reduction": "none", **request}, signals))


def _options(request: Mapping[str, Any], signals: Mapping[str, Sequence[str]]) -> list[str]:
    words: list[str] = []
    for name, texts in signals.items():
        words += [word for text in texts for word in (f"--{name.removesuffix('s')}", text)]
    for name, value in request.items():
        if name == "known_modes_hz":
            words += [word for hz in value for word in ("--known-mode", f"{hz:g}")]
        elif value is not None:
            words += [f"--{name.replace('_', '-')}", f"{value}"]
    return words


def tune_line(law: str, models: Sequence[str], margins: Mapping[str, float]) -> str:
    """Return the command line of a tuning, whose options have their margins without the unit."""
    words = [_COMMAND, "tune", "--law", LAWS[law].tuning, *models]
    for name, value in margins.items():
        words += [f"--{name.rpartition('_')[0].replace('_', '-')}", f"{value:g}"]
    return shlex.join(words)


def shown(path: Path) -> str:
    """Return a path as a person would type it: from the working folder, when it is below it."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)
