"""Records of bags that flexarm did not write: any numbers of any topics as inputs and outputs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.clock import NS
from flexarm_core.errors import BagError, DataError
from flexarm_core.labels import counted, named_twice
from flexarm_ident.reading.fields import parse_field, values_of, wrong_path, wrong_topic
from flexarm_ident.reading.grid import CUT, JITTER_TOLERANCE, ON_TIME, Run
from flexarm_ident.reading.grid import notices as sampling_notices
from flexarm_ident.reading.offsets import on_their_rows
from flexarm_ident.reading.tracks import Evened, advances, drift, evened, lost_messages, track
from flexarm_ident.reading.wraps import found_wraps, unwrapped, wrap_notices
from flexarm_ident.records.data_warning import LOST_SAMPLES, PARTIAL_RECORD, SAMPLING, Grade
from flexarm_ident.records.iodata import IoData

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flexarm_bags.reader import Bag, Grouped
    from flexarm_core.arrays import BoolArray
    from flexarm_ident.reading.fields import Field
    from flexarm_ident.reading.offsets import CommonRows, Offset
    from flexarm_ident.reading.tracks import Drift, Track
    from flexarm_ident.reading.wraps import Wrap
    from flexarm_ident.records.data_warning import DataWarning

    Integers = NDArray[np.int64]
    Messages = Mapping[str, Grouped]

HEADER, RECEIVE = "header", "receive"
CLOCKS = (HEADER, RECEIVE)
_DELAYED = "delays on the way to the recorder count as the rig's"
_SECONDS, _NANOSECONDS = "header.stamp.sec", "header.stamp.nanosec"
# A signal whose steps are longer, in periods, is slow.
_SLOW = 1.5
# Relative difference of two clocks' rates that is worth a word.
_RATES_DIFFER = 1e-3
# An input that lacks more of its messages than this part is one that is sent when it changes.
_ON_CHANGE = 0.2


@dataclass(frozen=True)
class Selection:
    """Choice of a bag's signals.

    Attributes
    ----------
    inputs, outputs : tuple of Field
        Channels of the record, one or more each.
    clock : {None, 'header', 'receive'}
        Instants of the messages: stamps of their headers, or those of receiving, which the
        recorder writes. None: headers, where every topic has stamps that advance.
    interpolated : bool
        Inputs were measured and run on lines between their messages. Else they are commands, each
        in force until the next.
    output_only : bool
        There is no input.
    """

    inputs: tuple[Field, ...]
    outputs: tuple[Field, ...]
    clock: str | None = None
    interpolated: bool = False
    output_only: bool = False

    def __post_init__(self) -> None:
        for role, fields in (("input", self.inputs), ("output", self.outputs)):
            if not fields and not (self.output_only and role == "input"):
                raise BagError(
                    f"no {role} was named: a record needs inputs and outputs; modes alone need no "
                    "input: identify --output-only"
                )
        if twice := named_twice(field.name for field in (*self.inputs, *self.outputs)):
            raise BagError(f"{twice}: name channels as NAME=TOPIC.FIELD, or take one of them")
        both = {str(field) for field in self.inputs} & {str(field) for field in self.outputs}
        if both:
            raise BagError(f"{both.pop()} is an input and an output: take it as one of them")
        if self.clock not in (None, *CLOCKS):
            raise BagError(f"clock must be one of {', '.join(CLOCKS)}: {self.clock!r}")


def selection(
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    clock: str | None = None,
    interpolated: bool = False,
    output_only: bool = False,
) -> Selection:
    """Return the choice of signals that are named by ``TOPIC.FIELD`` or ``NAME=TOPIC.FIELD``.

    Raises
    ------
    BagError
        If a text has another form, there is no input or no output, or a name comes twice.
    """
    return Selection(
        tuple(map(parse_field, inputs)),
        tuple(map(parse_field, outputs)),
        clock,
        interpolated=interpolated,
        output_only=output_only,
    )


def selected(bag: Bag, chosen: Selection, wrap: float | None = None) -> IoData:
    """Return the record of chosen signals; arguments and errors as in `read.read_channels`."""
    fields = (*chosen.inputs, *chosen.outputs)
    for field in fields:
        if field.topic not in bag.types:
            raise wrong_topic(bag, field)
    messages = {topic: bag.grouped(topic) for topic in {each.topic: None for each in fields}}
    clock, said = _clock(bag, messages, chosen.clock)
    sent = evened if clock == RECEIVE else Evened
    driven, measured = (
        [_track(bag, field, messages[field.topic], clock) for field in role]
        for role in (chosen.inputs, chosen.outputs)
    )
    turned = [_turned(each, wrap) for each in measured]
    said += wrap_notices([each.name for each in chosen.outputs], [found for _, found in turned])
    commands = [sent(each) for each in driven]
    sampled = [sent(each) for each, _ in turned]
    found, offsets = on_their_rows(commands, sampled, interpolated=chosen.interpolated)
    said += [*_jitter((*commands, *sampled)), *map(_early, offsets)]
    inputs, outputs = ([each.sent for each in role] for role in (commands, sampled))
    read_off = [*inputs, *outputs] if chosen.interpolated else outputs
    said += [*_restarted((*inputs, *outputs)), *_lost(inputs), *_findings(found, read_off)]
    return IoData(
        found.u,
        found.y,
        dt_s=found.grid.period_s,
        inputs=tuple(field.name for field in chosen.inputs),
        outputs=tuple(field.name for field in chosen.outputs),
        source=str(bag.path),
        notices=tuple(said),
        input_held=_unknown(found, inputs),
    )


def _clock(bag: Bag, messages: Messages, asked: str | None) -> tuple[str, list[DataWarning]]:
    """Return the clock, and a word where it is not that of the headers or they drift."""
    stamps = {topic: _stamps_ns(found) for topic, found in messages.items()}
    advancing = {
        topic: each for topic, each in stamps.items() if each is not None and advances(each)
    }
    lacking = [f"{topic} ({bag.types[topic]})" for topic in messages if topic not in advancing]
    if asked == HEADER and lacking:
        raise BagError(
            f"{bag.path}: {lacking[0]} has no header stamps that advance: take the clock {RECEIVE}"
        )
    if asked == RECEIVE:
        return RECEIVE, []
    if lacking:
        text = (
            f"instants are those of receiving, as {lacking[0]} has no header stamps that advance: "
            f"{_DELAYED}"
        )
        return RECEIVE, [SAMPLING(text, grade=Grade.INFORMATION)]
    drifts = {topic: drift(each, messages[topic].log_times_ns) for topic, each in advancing.items()}
    return _of_drifting(drifts, min(map(_step_s, advancing.values())), asked)


def _of_drifting(
    drifts: Mapping[str, Drift], step_s: float, asked: str | None
) -> tuple[str, list[DataWarning]]:
    """Return the clock of topics with header stamps: receiving, where theirs drift apart."""
    slow, fast = (end(drifts, key=lambda each: drifts[each].gain_s) for end in (min, max))
    apart_s = drifts[fast].gain_s - drifts[slow].gain_s
    if apart_s > max(ON_TIME * step_s, drifts[fast].chance_s + drifts[slow].chance_s):
        instead = (
            f"their samples do not belong together; take --clock {RECEIVE}"
            if asked
            else f"instants are those of receiving, and {_DELAYED}"
        )
        text = f"the header clocks of {slow} and {fast} drift {1e3 * apart_s:.3g} ms apart: "
        grade = Grade.CAUTION if asked else Grade.INFORMATION
        return asked or RECEIVE, [SAMPLING(text + instead, {"apart_s": apart_s}, grade=grade)]
    gain_s, chance_s, record_s = drifts[fast]
    if abs(gain_s) <= max(_RATES_DIFFER * record_s, chance_s):
        return HEADER, []
    percent = 100.0 * gain_s / record_s
    text = (
        f"the header clock of {fast} is {abs(percent):.3g} % {'faster' if gain_s > 0 else 'slower'}"
        f" than the recorder's: frequencies are by the header's; --clock {RECEIVE} takes the other"
    )
    return HEADER, [SAMPLING(text, {"percent": percent}, grade=Grade.INFORMATION)]


def _step_s(times_ns: Integers) -> float:
    return float(np.ptp(times_ns)) / len(times_ns) / NS


def _stamps_ns(found: Grouped) -> Integers | None:
    seconds, nanoseconds = (values_of(found, path) for path in (_SECONDS, _NANOSECONDS))
    if seconds is None or nanoseconds is None:
        return None
    return np.asarray(seconds.astype(np.int64) * NS + nanoseconds.astype(np.int64))


def _track(bag: Bag, field: Field, found: Grouped, clock: str) -> Track:
    values = values_of(found, field.path)
    if values is None:
        raise wrong_path(bag, field)
    stamps_ns = _stamps_ns(found) if clock == HEADER else None
    times_ns = found.log_times_ns if stamps_ns is None else stamps_ns
    try:
        return track(str(field), times_ns, values)
    except DataError as error:
        raise BagError(f"{bag.path}: {error}") from error


def _turned(signal: Track, turn: float | None) -> tuple[Track, Wrap]:
    """Return an output with its turns counted, and its wrap."""
    rows = [(np.zeros((len(signal.values), 1)), signal.values[:, np.newaxis])]
    wraps = found_wraps(rows, turn)
    ((_, values),) = unwrapped(rows, wraps)
    return replace(signal, values=values[:, 0]), wraps[0]


def _jitter(signals: Sequence[Evened]) -> Iterator[DataWarning]:
    """Yield a word on the most uneven arrivals, where they matter."""
    worst = max(signals, key=lambda each: each.jitter_s)
    jitter_s, period_s = worst.jitter_s, worst.sent.period_s
    if jitter_s <= JITTER_TOLERANCE * period_s:
        return
    text = (
        f"{worst.sent.label} arrived {1e3 * jitter_s:.3f} ms RMS off even instants, "
        f"{jitter_s / period_s:.2f} of its periods: it counts as sent evenly"
    )
    figures = {"deviation_s": jitter_s}
    yield SAMPLING(text, figures, grade=Grade.INFORMATION)


def _early(offset: Offset) -> DataWarning:
    text = (
        f"{offset.label} was received {1e3 * offset.early_s:.2f} ms before the outputs' instants, "
        "no more than delays differ, and these refute that it acts before: it counts from them on"
    )
    figures = {"early_s": offset.early_s}
    return SAMPLING(text, figures, grade=Grade.INFORMATION)


def _restarted(signals: Sequence[Track]) -> Iterator[DataWarning]:
    for signal in signals:
        if signal.restarts:
            text = (
                f"the clock of {signal.label} begins anew at {counted(signal.restarts, 'place')}: "
                f"used the longest run, {len(signal.values)} messages"
            )
            yield PARTIAL_RECORD(text, {"places": float(signal.restarts)})


def _lost_of(signal: Track) -> int:
    """Return the number of messages that an input lacks; one that is sent when it changes, none."""
    lost = lost_messages(signal.times_ns)
    return lost if lost < _ON_CHANGE * len(signal.values) else 0


def _unknown(found: CommonRows, inputs: Sequence[Track]) -> BoolArray | None:
    """Return the rows, (rows,), in which the messages of an input are lost; None without any."""
    gaps = [found.in_gap(number) for number, signal in enumerate(inputs) if _lost_of(signal)]
    unknown = np.any(gaps, axis=0) if gaps else np.zeros(len(found.rows), dtype=np.bool_)
    return unknown if unknown.any() else None


def _lost(inputs: Sequence[Track]) -> Iterator[DataWarning]:
    """Yield the inputs that lack messages, or have some without a number."""
    for signal in inputs:
        if signal.unknown:
            sent = len(signal.values) + signal.unknown
            text = (
                f"{signal.unknown} of {sent} values of {signal.label} are not numbers: the value "
                "before counts until the next one, and the drive may have had another"
            )
            yield LOST_SAMPLES(text, {"values": float(signal.unknown)})
        if (lost := _lost_of(signal)) > signal.unknown:
            lost -= signal.unknown
            text = (
                f"{counted(lost, 'message')} of {signal.label} did not reach the recorder: what "
                "they did to the outputs counts as noise"
            )
            yield LOST_SAMPLES(text, {"lost": float(lost)})


def _findings(found: CommonRows, read_off: Sequence[Track]) -> Iterator[DataWarning]:
    """Yield what is worth knowing of the grid and of signals that are read off between samples."""
    grid, samples = found.grid, len(found.lead.values)
    yield from sampling_notices(Run(slice(0, samples), 0), grid, samples)
    slow = [signal for signal in read_off if signal.period_s > _SLOW * grid.period_s]
    if slow:
        rates = ", ".join(f"{signal.label} at {1.0 / signal.period_s:.4g} Hz" for signal in slow)
        text = (
            f"{rates} in a record of {1.0 / grid.period_s:.4g} Hz: read off between the samples; "
            "above half its own rate a signal has no information"
        )
        slowest_hz = 1.0 / max(signal.period_s for signal in slow)
        yield SAMPLING(text, {"slowest_hz": slowest_hz})
    cut = 1.0 - len(found.rows) / grid.rows
    if cut > CUT:
        used_s, all_s = (grid.period_s * rows for rows in (len(found.rows), grid.rows))
        text = f"{used_s:.1f} s of {all_s:.1f} s are used, those in which every channel was there"
        figures = {"used_s": used_s, "recorded_s": all_s}
        yield PARTIAL_RECORD(text, figures, grade=Grade.INFORMATION)
