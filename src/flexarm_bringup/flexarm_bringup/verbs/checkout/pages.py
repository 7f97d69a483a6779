"""Commands and outputs that the pages show, and what of them a run does not print any more.

A block of code with `$ COMMAND` lines is run as it stands; the lines below a command are its
output, where the page may leave lines out. Comments of Markdown before a block say the rest:

- `output of: COMMAND`: the whole block is the output of a command,
- `file: NAME`: the block is a file, for the commands after it,
- `together until: WORDS`: its commands run side by side until the last one prints a line with the
  words, and get Ctrl-C then,
- `not run: REASON`: the block is left alone.

`drawn by: COMMAND` before a picture draws it anew: the name of a file is added to the command.
`folder: PATH` anywhere gives the page's commands the files of a folder of the checkout.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_BLOCK = re.compile(
    r"^<!-- drawn by: (?P<drawn>.+?) -->\n+!\[[^\]]*\]\((?P<picture>[^)]+)\)"
    r"|(?:^<!-- (?P<mark>output of|file|together until|not run)(?:: (?P<said>[^\n]*?))? -->\n+)?"
    r"(?:^(?P<fence> *```)(?P<language>[^\n`]*)\n(?P<fenced>.*?)^ *```$"
    r"|(?P<indented>(?:^ {4,}\S[^\n]*\n(?:^ *\n(?= {4}))*)+))",
    re.MULTILINE | re.DOTALL,
)
_FOLDER = re.compile(r"^<!-- folder: (.+) -->$", re.MULTILINE)
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)")
_PLACE = re.compile(r"-?\d+(?:\.\d+)?")
_IDENTITY = re.compile(r"[mp][0-9a-f]{10}")
_POINT = 1.0
_GAP = "..."
_LAST_DIGITS = 2
_RELATIVE = 0.01
# Counts are the same on every processor, but for a few messages of a run in real time.
_RELATIVE_OF_COUNTS = 0.001


@dataclass(frozen=True)
class Step:
    """What a page asks for: a file to write, or commands to run and what it shows of them.

    Attributes
    ----------
    line : int
        Line of the page where it begins, from 1.
    commands : tuple of str
        Commands for a shell, which run side by side; none: a file is written.
    shown : tuple of str
        Lines of the output, of one command only.
    file, text : str
        Name and content of a file.
    picture : str
        Path, seen from the page, of a picture that the command draws.
    until : str
        Words in the output of the last command, after which all of them are interrupted.
    """

    line: int
    commands: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()
    file: str = ""
    text: str = ""
    picture: str = ""
    until: str = ""


def folders(page: str) -> list[str]:
    """Return the folders of the checkout whose files a page works on."""
    return _FOLDER.findall(page)


def steps(page: str) -> Iterator[Step]:
    """Yield what a page runs and writes, in its order."""
    for block in _BLOCK.finditer(page):
        mark, said = block["mark"], block["said"] or ""
        line, text = _content(page, block)
        if block["drawn"]:
            yield Step(line, (block["drawn"],), picture=block["picture"])
        elif mark == "file":
            yield Step(line, file=said, text=text)
        elif mark == "together until":
            yield Step(line, tuple(command for _, command in typed(text)), until=said)
        elif mark == "output of":
            yield Step(line, (said,), tuple(text.splitlines()))
        elif mark is None and not block["language"]:
            yield from _described(text, line)


def typed(block: str) -> list[tuple[int, str]]:
    """Return the commands that a block is made of, without remarks, and the line of each from 0."""
    found: list[tuple[int, str]] = []
    goes_on = False
    for number, line in enumerate(block.splitlines()):
        words = re.split(r" {2,}# ", line.strip().removeprefix("$ "))[0].rstrip()
        if goes_on:
            start, before = found[-1]
            found[-1] = (start, f"{before.removesuffix(chr(92)).rstrip()} {words}")
        elif words:
            found.append((number, words))
        goes_on = words.endswith("\\")
    return found


def plain_blocks(page: str) -> Iterator[tuple[int, str]]:
    """Yield the commands without a prompt of a page, and the line of each from 1."""
    for block in _BLOCK.finditer(page):
        first, text = _content(page, block)
        shell = block["mark"] in (None, "together until") and not block["language"]
        if shell and not re.search(r"^ *\$ ", text, re.MULTILINE):
            for number, command in typed(text):
                yield first + number, command


def _content(page: str, block: re.Match[str]) -> tuple[int, str]:
    """Return the line on which the content of a block begins, from 1, and the content."""
    part = next(part for part in ("indented", "fenced", "drawn") if block[part] is not None)
    return page.count("\n", 0, block.start(part)) + 1, "" if part == "drawn" else block[part]


def _described(text: str, line: int) -> Iterator[Step]:
    """Yield the commands with a prompt of a block, each with the lines below it."""
    lines = text.splitlines()
    starts = [number for number, each in enumerate(lines) if each.lstrip().startswith("$ ")]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=False):
        last = start
        while lines[last].endswith("\\"):
            last += 1
        ((_, command),) = typed("\n".join(lines[start : last + 1]))
        yield Step(line + start, (command,), tuple(lines[last + 1 : end]))


def differences(shown: tuple[str, ...], printed: str) -> list[str]:
    """Return the shown lines that are not in an output, in their order, and what is there instead.

    A line may be wrapped elsewhere. `...` stands for anything that is left out; lines may be left
    out without it. Numbers agree within two of their last digit, or 1 %: processors round
    differently. Whole numbers agree within two, or 0.1 %.
    """
    output = " ".join(printed.split())
    place, missing = 0, []
    for line in shown:
        words = line.split()
        while words and words[-1] == _GAP:
            words.pop()
        if not words:
            continue
        near = ""
        for found in _pattern(words).finditer(output, place):
            if _agree(words, found[0]):
                place = found.end()
                break
            near = near or found[0]
        else:
            missing.append(line.strip() + (f"\n    now: {near}" if near else ""))
    return missing


def _pattern(words: list[str]) -> re.Pattern[str]:
    """Return what the words look like with any numbers."""
    parts = [
        r".*?" if word == _GAP else _NUMBER.pattern.join(map(re.escape, _NUMBER.split(word)))
        for word in words
    ]
    return re.compile(r"(?<!\S)" + " ".join(parts).replace(" .*? ", " .*? ?") + r"(?!\S)")


def _agree(words: list[str], printed: str) -> bool:
    wanted, there = _NUMBER.findall(" ".join(words)), _NUMBER.findall(printed)
    if _GAP in words:
        head = len(_NUMBER.findall(" ".join(words[: words.index(_GAP)])))
        tail = len(wanted) - head
        there = there[:head] + there[len(there) - tail :]
    return len(wanted) == len(there) and all(map(_close, wanted, there))


def _close(shown: str, printed: str) -> bool:
    mantissa, _, power = shown.partition("e")
    last_digit = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    is_count = shown.lstrip("+-").isdigit() and printed.lstrip("+-").isdigit()
    relative = _RELATIVE_OF_COUNTS if is_count else _RELATIVE
    return abs(float(printed) - float(shown)) <= 1e-9 + max(
        _LAST_DIGITS * last_digit, relative * abs(float(shown))
    )


def drawn_alike(first: str, second: str) -> bool:
    """Return whether two pictures in SVG have the same parts, at places less than a point apart."""
    words = [_PLACE.split(_IDENTITY.sub("", svg)) for svg in (first, second)]
    places = [
        [float(each) for each in _PLACE.findall(_IDENTITY.sub("", svg))] for svg in (first, second)
    ]
    return words[0] == words[1] and all(
        abs(one - other) < _POINT for one, other in zip(*places, strict=True)
    )
