"""Chain from an experiment to gains, as the work of jobs: record, identify, tune."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any

from flexarm_control.laws.registry import LAWS
from flexarm_control.loop_setup import TOPIC
from flexarm_core.errors import FlexarmError
from flexarm_daq.experiments.catalogue import experiment
from flexarm_live.graph.jobs import computed

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping, Sequence

    from flexarm_live.graph.jobs import Report, Work
    from flexarm_live.graph.loop_nodes import LoopNodes
    from flexarm_live.graph.store import Store
    from flexarm_live.serving.laboratory import Answer

_POLL_S = 0.2
_ASK_S = 1.0
_STALLED_S = 30.0
_SEED = 1
_NOMINAL = "nominal:"


class Chain:
    """Work of the jobs of one laboratory."""

    def __init__(self, store: Store, loop: LoopNodes) -> None:
        self._store = store
        self._loop = loop

    def experiment(
        self, name: str, record: Callable[[bool], Awaitable[Answer]], newest: Callable[[], int]
    ) -> Work:
        """Return the work of a recorded experiment in a closed loop.

        Parameters
        ----------
        name : str
            Name in the catalogue.
        record : callable
            Starts and ends a record.
        newest : callable
            Returns the number of the newest sample.
        """
        entry = experiment(name)
        if not entry.closed_loop:
            raise FlexarmError(
                f"{entry.name} has no controller: ./flexarm experiment {entry.name} runs it"
            )
        during = entry.commander_parameters(_SEED)
        rig = {"rate_hz": float(entry.rate_hz), "payload_kg": float(entry.payload_kg)}

        async def work(report: Report) -> Mapping[str, Any]:
            daq, controller = (self._loop.parameters[each] for each in ("daq", "controller"))
            before = {key: controller.values[key] for key in during}
            rig_before = {key: daq.values[key] for key in rig}
            await self._loop.deactivate("daq")
            try:
                await controller.set(during)
                await self._loop.activate("controller")
                bag = (await record(True)).data  # noqa: FBT003 - a field of a request
                try:
                    await self._loop.restart_sampling(rig, samples=entry.samples)
                    await self._sampled(entry.samples, newest, report)
                finally:
                    await asyncio.shield(record(False))  # noqa: FBT003 - a field of a request
            finally:
                await asyncio.shield(self._back(before | {"reference": TOPIC}, rig_before))
            return bag or {}

        return work

    async def _back(self, before: Mapping[str, Any], rig: Mapping[str, Any]) -> None:
        """Take the laboratory back to where it was before the experiment."""
        await self._loop.deactivate("daq")
        await self._loop.parameters["controller"].set(before)
        await self._loop.restart_sampling(rig)

    async def _sampled(self, samples: int, newest: Callable[[], int], report: Report) -> None:
        """Wait until all samples are taken and the node has stopped by itself."""
        seen, seen_s = 0, time.monotonic()
        asked_s = seen_s
        while True:
            await asyncio.sleep(_POLL_S)
            now_s = time.monotonic()
            if (number := newest()) != seen:
                seen, seen_s = number, now_s
            report("sampling", min(1.0, seen / samples))
            if now_s - seen_s > _STALLED_S:
                raise FlexarmError(f"no new sample came in {_STALLED_S:.0f} s after {seen}")
            if now_s - asked_s < _ASK_S:
                continue
            asked_s = now_s
            if not await self._loop.is_active("daq"):
                if newest() < samples:
                    raise FlexarmError(f"the run ended after {newest()} of {samples} samples")
                return

    def identification(
        self,
        bag: str,
        order: int = 0,
        method: str = "auto",
        reduced_order: int = 0,
        known_modes_hz: tuple[float, ...] | list[float] = (),
    ) -> Work:
        """Return the work of an identification of a record, with its files."""
        path = self._store.bag(bag)
        request: dict[str, Any] = {"method": method, "order": order or None}
        words = ["./flexarm", "identify", str(path), "--method", method]
        if order:
            words += ["--order", str(order)]
        if reduced_order or known_modes_hz:
            reduction = "mrmc" if known_modes_hz else "mrm"
            request |= {
                "reduction": reduction,
                "reduced_order": reduced_order or None,
                "update": "b",
                "known_modes_hz": list(known_modes_hz),
            }
            words += ["--reduction", reduction, "--update", "b"]
            words += ["--reduced-order", str(reduced_order)] if reduced_order else []
            for mode_hz in known_modes_hz:
                words += ["--known-mode", f"{mode_hz:g}"]

        async def work(report: Report) -> Mapping[str, Any]:
            folder = self._store.model_folder(bag)
            asked = {"bag": str(path), "folder": str(folder), "request": request}
            found = await computed("flexarm_live.work.identification", asked, report)
            return {
                **found,
                "bag": bag,
                "report": f"/report/{bag}",
                "models": self._store.models(),
                "command": " ".join(words),
            }

        return work

    def tuning(self, law: str, models: list[str], margins: Mapping[str, float]) -> Work:
        """Return the work of a tuning on models by their names."""
        files = [
            each if each.startswith(_NOMINAL) else str(self._store.model_file(each))
            for each in models
        ]
        values = self._loop.parameters["controller"].values
        before = {name: value for name, value in values.items() if name.startswith(f"{law}.")}
        command = tune_line(law, files, margins)

        async def work(report: Report) -> Mapping[str, Any]:
            asked = {"law": law, "models": files, "margins": dict(margins), "before": before}
            found = await computed("flexarm_live.work.tuning", asked, report)
            return {**found, "command": command}

        return work


def tune_line(law: str, files: Sequence[str], margins: Mapping[str, float]) -> str:
    """Return the command line of a tuning, whose options have their margins without the unit."""
    words = ["./flexarm", "tune", "--law", LAWS[law].tuning, *files]
    for name, value in margins.items():
        words += [f"--{name.rpartition('_')[0].replace('_', '-')}", f"{value:g}"]
    return " ".join(words)
