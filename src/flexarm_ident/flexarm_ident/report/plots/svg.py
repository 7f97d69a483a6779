"""Figures as SVG that a page can hold inside."""

from __future__ import annotations

import hashlib
import html
import io
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def inline_svg(figure: Figure, description: str) -> str:
    """Return a figure as an SVG element that can stand in a page beside others.

    The same figure gives the same text: there is no date in it.

    Parameters
    ----------
    figure : Figure
        Figure, drawn with DejaVu Sans.
    description : str
        What it shows, for those who cannot see it.

    Returns
    -------
    str
        The element, as wide as the page lets it be.
    """
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", buffer.getvalue(), flags=re.DOTALL)
    text = text[text.index("<svg") :].strip()
    # The first font sets the layout; the others are as wide or narrower.
    text = text.replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, Arial, sans-serif")
    text = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text)
    # Names of one figure must not meet those of another in the same page.
    prefix = "f" + hashlib.sha256(text.encode()).hexdigest()[:8]
    used = set(re.findall(r'(?:url\(|href=")#([^")]+)', text))
    text = re.sub(
        r' id="([^"]+)"',
        lambda found: f' id="{prefix}{found[1]}"' if found[1] in used else "",
        text,
    )
    text = re.sub(r'(url\(|href=")#', rf"\g<1>#{prefix}", text)
    label = html.escape(description, quote=True)
    return re.sub(
        r'^<svg [^>]*?(viewBox="[^"]*")[^>]*>',
        lambda found: (
            '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
            f'{found[1]} role="img" aria-label="{label}">'
        ),
        text,
    )
