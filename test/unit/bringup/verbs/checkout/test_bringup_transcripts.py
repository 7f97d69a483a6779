"""Commands of a page, run in a folder of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from docs.pages import outdated

if TYPE_CHECKING:
    from pathlib import Path

PAGE = """\
<!-- folder: own -->

    $ cat run.csv
    t,u
    1,{cell}

<!-- file: look.py -->
```python
print(7)
```

    $ python3 look.py; cat kept/old.txt
    7
    as it was
    $ echo flexarm: no such bag; false
    flexarm: no such bag
    $ {last}

<!-- together until: at zero -->

    sh -c 'trap "echo ended > kept.txt; exit" INT; echo > ready; while :; do sleep .05; done'
    sh -c 'until [ -e ready ]; do sleep .05; done; echo is at zero now; exec sleep 100'

Then:

    $ cat kept.txt
    ended

<!-- drawn by: sh -c 'echo "<svg>12</svg>" > "$0"' -->
![Curve](curve.svg)
"""


def a_checkout(folder: Path, **words: str) -> tuple[Path, Path]:
    for name, text in {
        "own/run.csv": "t,u\n1,2.5\n",
        "kept/old.txt": "as it was\n",
        "out/there.txt": "",
        "docs/curve.svg": words.pop("svg", "<svg>12.3</svg>\n"),
        "docs/page.md": PAGE.format(**{"cell": "2.5", "last": "ls", **words}),
    }.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, "utf-8")
    return folder, folder / "docs" / "page.md"


def test_page___as_its_commands_print___has_nothing_outdated(tmp_path: Path) -> None:
    assert list(outdated(*a_checkout(tmp_path))) == []
    assert not (tmp_path / "kept.txt").exists()


def test_page___changed_figure_failure_and_picture___are_reported_with_their_lines(
    tmp_path: Path,
) -> None:
    root, page = a_checkout(tmp_path, cell="3.5", last="echo so; false", svg="<svg>12.3 14</svg>\n")
    new = root / "out" / "figures" / "curve.svg"
    assert list(outdated(root, page)) == [
        "docs/page.md:3: cat run.csv: 1,3.5\n    now: 1,2.5",
        "docs/page.md:17: echo so; false: exit code 1\n    so",
        f"docs/page.md:29: another picture now: look at {new}, and copy it to docs/curve.svg",
    ]
    assert new.read_text("utf-8") == "<svg>12</svg>\n"
