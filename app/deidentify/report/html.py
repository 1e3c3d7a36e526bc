"""HTML pages from the templates beside this module; whatever is put into one is escaped.

A page is one file that requests nothing from anywhere: its style and script are in it, and its policy admits no others.
"""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from guise.app.deidentify.report.report import clock
from guise.common.text import printable

TEMPLATES = Path(__file__).parent / "templates"


def render_page(template: str, *, script: str = "", **values: Any) -> str:
    """A page of a template that extends page.html.

    script : name of a file in the templates' folder, or "".   values : what the template shows.
    """
    code = (TEMPLATES / script).read_text(encoding="utf-8") if script else ""
    style = (TEMPLATES / "page.css").read_text(encoding="utf-8")
    return _environment().get_template(template).render(**values, style=style, script=code)


def render_fragment(template: str, **values: Any) -> str:
    """A piece of HTML or SVG of a template, for a page of another program."""
    return _environment().get_template(template).render(**values)


def data_uri(data: bytes, kind: str) -> str:
    """A file as a URI that holds it.   kind : its media type."""
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {
        "clock": lambda seconds: clock(float(seconds)),
        "csp_hash": _csp_hash,
        "printable": printable,
        "thousands": "{:,}".format,
    }
    return environment


def _csp_hash(text: str) -> str:
    """The source expression that admits exactly this text to a page (Content Security Policy Level 3, 2.3.1)."""
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'"
