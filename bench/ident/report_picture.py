"""Picture of a report: what stands at its top, in headless Chromium."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from flexarm_bringup.console.verb_group import FORCE
from flexarm_core.errors import FlexarmError
from flexarm_core.outputs import require_place

# The browser is that of the tests.
sys.path.insert(0, str(Path(__file__).parents[2] / "test"))

from support.browser import CHROMIUM, Browser

_WIDTH, _HEIGHT = 1200, 1000


@click.command()
@click.argument("report", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "-o",
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("out/report.png"),
    show_default=True,
    help="PNG file.",
)
@click.option(
    "--size",
    type=(click.IntRange(300), click.IntRange(300)),
    default=(_WIDTH, _HEIGHT),
    show_default=True,
    help="Width and height of the window, px.",
)
@FORCE
def main(*, report: Path, out: Path, size: tuple[int, int], force: bool) -> None:
    """Draw the top of a report as a window shows it."""
    if CHROMIUM is None:
        raise click.ClickException("no Chromium on PATH: the report is drawn in it")
    try:
        require_place([out], force=force)
    except FlexarmError as error:
        raise click.ClickException(str(error)) from error
    out.parent.mkdir(parents=True, exist_ok=True)
    with Browser() as browser:
        browser.call("Emulation.setScrollbarsHidden", hidden=True)
        browser.open(report.resolve().as_uri(), width=size[0], height=size[1])
        browser.photograph(out, whole=False)
    click.echo(f"picture in {out}")


if __name__ == "__main__":
    main()
