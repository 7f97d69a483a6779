"""Screen of a running arm as pieces of text: state, loop, and traces of its history."""

from __future__ import annotations

import math
from collections import deque
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple

from flexarm_core.labels import label_and_unit

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

_COLUMNS_A_CHARACTER = 2
"""Of the Braille dots of a sparkline."""
_LEVELS = 4
_BLANK = 0x2800
# The bits of a character, by its column and from the top.
_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
KEYS = "space STOP   r release   arrows set-point 1 deg, Shift 5, PgUp PgDn 10   q quit"
_HEAD_ROWS = 4
_FOOT_ROWS = 2
_TITLE_WIDTH = 11
_LABEL_WIDTH = 26
_SCALE_WIDTH = 8
_LEAST_SPAN_V = 0.1
"""Sensor noise shall not fill a trace."""
COLUMN_S = 0.1
_MOST_COLUMNS = 1000
_CLOCK_S = 1e-6
"""Stamps are sums of rounded periods."""


class Piece(NamedTuple):
    """Text at a place of the screen, in the style of a badge's tone or word, strong or weak."""

    row: int
    column: int
    text: str
    style: str = ""


class Units:
    """Units of the channels, as the server gives them.

    Parameters
    ----------
    hello : mapping
        What the server says of the arm.

    Attributes
    ----------
    traces : dict of str to str
        Title of each output and command.
    beside : dict of str to (str, str)
        Set-point or compensation that belongs to one of them, with its title.
    set_points : list of mapping
        Name, joint and travel of each set-point; the keys move the first.
    """

    def __init__(self, hello: Mapping[str, Any]) -> None:
        self._channels = {channel["name"]: channel for channel in hello["channels"]}
        rig = hello["rig"]
        inputs = [each["name"] for each in rig["inputs"]]
        signals = [*(each["name"] for each in rig["outputs"]), *inputs]
        self.traces = {name: _title(name) for name in signals}
        self.set_points: list[Mapping[str, Any]] = rig["tracked"]
        self.beside = {each["output"]: (each["name"], "set-point") for each in self.set_points}
        compensations = list(self._channels)[len(signals) :]
        self.beside |= {
            name: (compensation, "of it comp.")
            for name, compensation in zip(inputs, compensations, strict=False)
        }

    def per_v(self, name: str) -> float:
        """Return how much of the unit that is shown one own unit of a channel is."""
        return float(self._channels[name]["si_per_unit"])

    def is_angle(self, name: str) -> bool:
        """Return whether a channel is shown in degrees."""
        return bool(self._channels[name]["si_unit"] == "deg")

    def shown(self, name: str, volts: float) -> str:
        """Return a value with its unit."""
        return f"{number(volts * self.per_v(name), '+.2f')} {self._channels[name]['si_unit']}"


def _title(name: str) -> str:
    return label_and_unit(name)[0].replace(" strain", "")[:_TITLE_WIDTH]


def number(value: float | None, form: str) -> str:
    """Return a figure; a dash for one that is none."""
    return "-" if value is None or math.isnan(value) else format(value, form)


def loop_words(state: Mapping[str, Any]) -> str:
    """Return law, payload and how well the loop keeps its time, for one line."""
    words = [f"law {state.get('law') or '-'}"]
    if state.get("payload_kg") is not None:
        words.append(f"payload {state['payload_kg']:g} kg")
    words += [
        f"{number(state.get('rate_hz'), 'g')} Hz",
        f"factor {number(state.get('factor'), '.2f')}",
        f"missed {number(state.get('missed'), '.0f')}",
        f"unanswered {number(state.get('unanswered'), '.0f')}",
    ]
    return "  ".join(words)


def plain_line(state: Mapping[str, Any], history: History, units: Units) -> str:
    """Return state and newest sample for one line of a file."""
    names = {**units.traces, **{each["name"]: "set-point" for each in units.set_points}}
    newest = [
        f"{title} {units.shown(name, history.newest[name])}"
        for name, title in names.items()
        if name in history.newest
    ]
    badge = f"{state.get('badge', '')} {state.get('reason', '')}".strip()
    return "; ".join([badge, *newest, loop_words(state)])


def screen(
    state: Mapping[str, Any], history: History, units: Units, note: str, size: tuple[int, int]
) -> Iterator[Piece]:
    """Yield the pieces of a screen of so many rows and columns, each within its row."""
    rows, columns = size
    for piece in (
        *_head(state),
        *_traces(history, units, rows - _HEAD_ROWS - _FOOT_ROWS, columns),
        Piece(rows - 2, 0, note, "strong"),
        Piece(rows - 1, 0, KEYS, "weak"),
    ):
        # The last place of a screen cannot be written.
        text = piece.text[: max(0, columns - 1 - piece.column)]
        if text and 0 <= piece.row < rows:
            yield piece._replace(text=text)


def _head(state: Mapping[str, Any]) -> Iterator[Piece]:
    badge = f" {state.get('badge') or '-'} "
    yield Piece(0, 0, badge, state.get("tone") or state.get("badge", ""))
    yield Piece(0, len(badge) + 1, state.get("reason") or "")
    yield Piece(1, 0, loop_words(state))
    times = [f"{kind} {_percentiles(state.get(f'{kind}_ms') or {})}" for kind in ("late", "reply")]
    if state.get("recording"):
        times.append(f"recording {state['recording']}")
    yield Piece(2, 0, "  ".join(times))


def _percentiles(times_ms: Mapping[str, float | None]) -> str:
    shown = (number(times_ms.get(name), ".2f") for name in ("p50", "p99", "max"))
    return f"{' / '.join(shown)} ms"


def _traces(history: History, units: Units, rows: int, columns: int) -> Iterator[Piece]:
    height = rows // len(units.traces)
    width = columns - _LABEL_WIDTH - _SCALE_WIDTH
    if height < 1 or width < 1:
        yield Piece(_HEAD_ROWS, 0, "the window is too small for traces")
        return
    for place, (name, title) in enumerate(units.traces.items()):
        top = _HEAD_ROWS + place * height
        labels = [(name, title), *([units.beside[name]] if name in units.beside else [])]
        for row, (each, words) in enumerate(labels[:height]):
            value = units.shown(each, history.newest.get(each, math.nan))
            yield Piece(
                top + row, 0, f"{words:{_TITLE_WIDTH}s} {value:>13s}", "" if row else "strong"
            )
        bands = history.bands(name, _COLUMNS_A_CHARACTER * width)
        scale = span(bands, _LEAST_SPAN_V)
        for row, line in enumerate(sparkline(bands, scale, height)):
            yield Piece(top + row, _LABEL_WIDTH + width - len(line), line, name)
        ends = {0: scale.high, height - 1: scale.low} if height > 1 else {}
        for row, volts in ends.items():
            end = f" {volts * units.per_v(name):+.2f}"
            yield Piece(top + row, _LABEL_WIDTH + width, end, "weak")


def span(bands: Sequence[Band], least: float) -> Band:
    """Return the range of bands, at least so wide about its middle; around 0 without any."""
    known = [band for band in bands if not math.isnan(band.low)]
    low = min((band.low for band in known), default=0.0)
    high = max((band.high for band in known), default=0.0)
    lacking = max(0.0, least - (high - low)) / 2.0
    return Band(low - lacking, high + lacking)


def sparkline(bands: Sequence[Band], scale: Band, rows: int) -> list[str]:
    """Return lines of text, the upper one first, with every level dotted that a band passes.

    Parameters
    ----------
    bands : sequence of Band
        Two a character, oldest first.
    scale : Band
        Values of the lowest and of the highest level.
    rows : int
        How many lines.
    """
    top = _LEVELS * rows - 1

    def depth(value: float) -> int:
        """Return the level of a value, counted from the top."""
        part = (value - scale.low) / (scale.high - scale.low)
        return round(top * (1.0 - min(1.0, max(0.0, part))))

    width = -(-len(bands) // _COLUMNS_A_CHARACTER)
    cells = [[_BLANK] * width for _ in range(rows)]
    for column, band in enumerate(bands):
        if math.isnan(band.low):
            continue
        place, side = divmod(column, _COLUMNS_A_CHARACTER)
        for level in range(depth(band.high), depth(band.low) + 1):
            cells[level // _LEVELS][place] |= _DOTS[side][level % _LEVELS]
    return ["".join(map(chr, row)) for row in cells]


class Band(NamedTuple):
    """Smallest and largest value of a channel; NaN where there is none."""

    low: float
    high: float


NO_BAND = Band(math.nan, math.nan)


class History:
    """Bands of the channels, oldest first; a vibration keeps its width however it is sampled.

    Attributes
    ----------
    newest : dict of str to float
        Values of the newest sample.
    """

    def __init__(self) -> None:
        self.newest: dict[str, float] = {}
        self._number: int | None = None
        self._columns: deque[dict[str, Band]] = deque(maxlen=_MOST_COLUMNS)

    def add(self, times_s: Sequence[float], values: Mapping[str, Sequence[float | None]]) -> None:
        """Add samples in the order of their instants; a clock that goes back begins anew."""
        for row, time_s in enumerate(times_s):
            sample = {
                name: math.nan if (value := column[row]) is None else value
                for name, column in values.items()
            }
            self._move_to(math.floor((time_s + _CLOCK_S) / COLUMN_S))
            column = self._columns[-1]
            for name, value in sample.items():
                column[name] = _wider(column.get(name, NO_BAND), value)
            self.newest = sample

    def bands(self, name: str, most: int) -> list[Band]:
        """Return the newest bands of a channel."""
        columns = islice(self._columns, max(0, len(self._columns) - most), None)
        return [column.get(name, NO_BAND) for column in columns]

    def _move_to(self, number: int) -> None:
        """Make the column of a number the last one, after empty ones where samples are missing."""
        before = self._number
        if before is None or number < before:
            self._columns.clear()
            before = number - 1
        self._columns.extend({} for _ in range(min(number - before, _MOST_COLUMNS)))
        self._number = number


def _wider(band: Band, value: float) -> Band:
    if math.isnan(value):
        return band
    if math.isnan(band.low):
        return Band(value, value)
    return Band(min(band.low, value), max(band.high, value))
