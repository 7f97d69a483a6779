"""One run of the whole graph by its schedule."""

from __future__ import annotations

import hashlib
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.schedules import bag_content
from bench.schedules.daq import Daq
from bench.schedules.oracle import Violation
from bench.schedules.processes import Commander, Law, Waveform
from bench.schedules.recorder import Recorder
from bench.schedules.schedule import LENGTH_S, QUIET_S
from bench.schedules.world import Link, World
from flexarm_control.laws.registry import LAWS
from flexarm_daq.loop.safety import DriveState

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.schedules.processes import Process
    from bench.schedules.schedule import Event, Schedule

_SHM = Path("/dev/shm")  # noqa: S108 - folders in it are made by `tempfile`
# How often a user looks after the graph, and how long it takes to activate a node again.
_LOOK_S: Final = 0.25
_ACTIVATE_S: Final = 0.1
# `bag check` takes as long as the run itself: the bags of one seed in so many are examined.
_EXAMINED: Final = 4


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run.

    Attributes
    ----------
    seed : int
        Seed of its schedule.
    violation : str
        The invariant that did not hold, with its instant; empty when all did.
    digest : str
        Digest of every sample, every command of the drive and every file.
    samples : int
        Samples taken.
    cpu_s : float
        Time of the processor, s.
    """

    seed: int
    violation: str
    digest: str
    samples: int
    cpu_s: float


class Simulation:
    """Graph of a schedule: loop, controller or experiment, a rival of it, and recorder.

    `away_s` is the time after which a loop that has ended is activated again.
    """

    def __init__(self, schedule: Schedule, folder: Path) -> None:
        self.world = world = World()
        self.digest = hashlib.sha256()
        self.away_s = _LOOK_S
        self._schedule = schedule
        self.recorder = Recorder(world, folder)
        self._links: dict[str, Link] = {}
        self.commanders: dict[str, Commander] = {}
        self._started: list[str] = []
        readers = [
            self._link(f"daq>{name}", self._receiver(name)) for name in ("controller", "rival")
        ]
        self.daq = Daq(
            world,
            schedule,
            readers,
            self._link("daq>recorder", self.recorder.receive),
            self.digest.update,
        )
        for name in ("controller", "rival"):
            self._link(f"{name}>daq", self.daq.receive)
            self._link(f"{name}>recorder", self.recorder.receive)

    def run(self) -> None:
        """Run to the end.

        Raises
        ------
        Violation
            When an invariant does not hold.
        """
        world, daq = self.world, self.daq
        self.recorder.start()
        self.command("controller", self._schedule.commander)
        for event in self._schedule.events:
            if event.kind == "sensor":
                daq.break_rig(event)
            else:
                world.at(event.at_s, ACTS[event.kind], self, event)
        world.at(_LOOK_S, self._look_after)
        world.at(LENGTH_S, self._end)
        while world.now_s < LENGTH_S:
            if daq.wanted:
                daq.run()
                daq.wanted = False
                world.at(world.now_s + self.away_s, self._activate)
                self.away_s = _LOOK_S
            else:
                world.advance(min(LENGTH_S, world.now_s + _ACTIVATE_S))
        self.recorder.close()
        world.advance(LENGTH_S + 10.0)
        for ledger in self.recorder.ledgers:
            every_bit = self._schedule.seed % _EXAMINED == 0
            self.digest.update(bag_content.check(ledger, every_bit=every_bit))

    def _link(self, name: str, deliver: Callable[..., None]) -> Link:
        self._links[name] = Link(self.world, f"{self._schedule.seed} {name}", deliver)
        return self._links[name]

    def _receiver(self, name: str) -> Callable[..., None]:
        def receive(state: object) -> None:
            if name in self.commanders:
                self.commanders[name].receive(state)  # type: ignore[arg-type]

        return receive

    def command(self, sender: str, work: str, count: int = 0) -> Commander:
        """Start a commander."""
        self._started.append(sender)
        made = self.commanders[sender] = Commander(
            self.world,
            f"{sender} {len(self._started)}",
            Law(work) if work in LAWS else Waveform(work, self._schedule.seed),
            (self._links[f"{sender}>daq"], self._links[f"{sender}>recorder"]),
            count,
        )
        made.declare(self._send)
        return made

    def _send(self, message: object) -> None:
        self.recorder.latched = message  # type: ignore[assignment]
        self._links["controller>recorder"].send(message)

    def process(self, name: str) -> Process | None:
        """Return a process by its name; None when it is not there."""
        if name == "daq":
            return self.daq
        return self.recorder if name == "recorder" else self.commanders.get(name)

    def link(self, name: str) -> Link:
        """Return a link by its name."""
        return self._links[name]

    def _activate(self) -> None:
        self.daq.wanted = True

    def _look_after(self) -> None:
        """Deactivate a loop that holds the drive; it is activated again."""
        loop = self.daq.loop
        if loop is not None and loop.safety.state is DriveState.HELD:
            self.daq.deactivate()
        self.world.at(self.world.now_s + _LOOK_S, self._look_after)

    def _end(self) -> None:
        """Deactivate the loop, which must be driving."""
        loop = self.daq.loop
        if loop is None:
            raise Violation("the faults are over and the loop is not active")
        if loop.safety.state is DriveState.HELD:
            raise Violation(f"the faults are over and the drive is held: {loop.safety.reason}")
        if loop.commander.answered < loop.sequence - self._schedule.max_age_periods:
            raise Violation(
                f"the faults are over and the newest answer in time is that to sample "
                f"{loop.commander.answered} of {loop.sequence}"
            )
        self.daq.deactivate()


def _fail_link(graph: Simulation, event: Event) -> None:
    graph.link(event.target).fail(event)


def _stall(graph: Simulation, event: Event) -> None:
    process = graph.process(event.target)
    if process is not None:
        process.stall(event.length_s)


def _kill(graph: Simulation, event: Event) -> None:
    world = graph.world
    if event.target == "recorder":
        world.at(world.now_s + event.length_s, _restart_recorder, graph)
        graph.recorder.kill(event.value)
    elif event.target == "daq":
        graph.away_s = max(_LOOK_S, event.length_s)
        # Raised into the loop, from where it waits.
        graph.daq.kill()
    else:
        killed = graph.commanders.pop(event.target, None)
        if killed is not None:
            killed.alive = False
            if event.target == "controller":
                world.at(
                    world.now_s + event.length_s, graph.command, "controller", killed.work.name
                )


def _restart_recorder(graph: Simulation) -> None:
    if not graph.recorder.alive:
        graph.recorder.start()


def _deactivate(graph: Simulation, event: Event) -> None:
    graph.away_s = max(_LOOK_S, event.length_s)
    graph.daq.deactivate()


def _stop(graph: Simulation, _: Event) -> None:
    graph.daq.emergency_stop()


def _limit(graph: Simulation, event: Event) -> None:
    graph.daq.change_limits(replace(graph.daq.limits, **{event.target: event.value}))


def _change_law(graph: Simulation, event: Event) -> None:
    controller = graph.commanders.get("controller")
    if controller is not None and isinstance(controller.work, Law):
        controller.work.replace(event.target)


def _rival(graph: Simulation, event: Event) -> None:
    if "rival" not in graph.commanders:
        graph.command("rival", event.target, max(0, int(event.value)))
        graph.world.at(graph.world.now_s + event.length_s, graph.commanders.pop, "rival", None)


def _record(graph: Simulation, event: Event) -> None:
    graph.recorder.close()
    graph.world.at(graph.world.now_s + event.length_s, graph.recorder.open)


def _end_with_backlog(graph: Simulation, event: Event) -> None:
    """Ask for the end of a bag while the recorder stands still, before it reads what has come."""
    recorder, world = graph.recorder, graph.world
    recorder.stall(event.length_s)
    recorder.portion_s = event.value
    world.at(recorder.stalled_until_s, recorder.close)
    world.at(LENGTH_S - QUIET_S, recorder.open)


def _repeat(graph: Simulation, event: Event) -> None:
    commander = graph.commanders.get(event.target)
    if commander is not None:
        commander.repeat(event.value, event.length_s)


def _fill_disk(graph: Simulation, event: Event) -> None:
    graph.recorder.disk.free = event.value
    graph.world.at(graph.world.now_s + event.length_s, _empty_disk, graph)


def _empty_disk(graph: Simulation) -> None:
    graph.recorder.disk.free = float("inf")
    graph.recorder.open()


def _set_wall_clock(graph: Simulation, event: Event) -> None:
    graph.world.wall_ahead_ns += round(event.value * 1e9)
    graph.recorder.notice_wall_clock()


ACTS: Final = {
    "delay": _fail_link,
    "reorder": _fail_link,
    "duplicate": _fail_link,
    "drop": _fail_link,
    "stall": _stall,
    "kill": _kill,
    "deactivate": _deactivate,
    "emergency": _stop,
    "limit": _limit,
    "law": _change_law,
    "rival": _rival,
    "record": _record,
    "backlog": _end_with_backlog,
    "repeat": _repeat,
    "disk": _fill_disk,
    "wall": _set_wall_clock,
}
"""What each kind of event does; a sensor fault is in the rig from its activation on."""


def run(schedule: Schedule) -> Outcome:
    """Run a schedule; an error that nobody expects is a violation too."""
    begun_s = time.process_time()
    violation = ""
    parent = _SHM if _SHM.is_dir() else None
    with tempfile.TemporaryDirectory(dir=parent) as folder:
        graph = Simulation(schedule, Path(folder))
        try:
            graph.run()
        except Violation as found:
            violation = str(found)
        except Exception as error:  # noqa: BLE001 - a crash is what is looked for
            violation = f"{type(error).__name__}: {error}"
    if violation:
        violation = f"at {graph.world.now_s:.4f} s: {violation}"
    return Outcome(
        schedule.seed,
        violation,
        graph.digest.hexdigest(),
        graph.daq.samples,
        time.process_time() - begun_s,
    )
