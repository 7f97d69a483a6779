"""Script of the reports, and the policy that lets a browser run it and nothing else."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib.resources import files


@cache
def script() -> str:
    """Return the script that stands in each page."""
    return (files("flexarm_ident.report") / "templates" / "report.js").read_text("utf-8")


@cache
def content_policy() -> str:
    """Return the content security policy of a page: it loads nothing, and runs only its script."""
    digest = base64.b64encode(hashlib.sha256(script().encode()).digest()).decode("ascii")
    return (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
