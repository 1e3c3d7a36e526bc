"""HTML from Python, with everything escaped that is not HTML by its type."""

from __future__ import annotations

import base64
import hashlib
from html import escape
from typing import Any

VOID = frozenset({"meta", "link", "img", "br"})


class Html(str):
    """A piece of HTML: put into a page as it is."""

    __slots__ = ()


def tag(name: str, /, *children: object, **attributes: object) -> Html:
    """An element; children that are no Html are text, None is nothing.

    An underscore at the end of an attribute's name is dropped, others become hyphens; None leaves it out.

    >>> tag("p", "a < b", tag("b", 1), class_="no'te", data_of=2)
    '<p class="no&#x27;te" data-of="2">a &lt; b<b>1</b></p>'
    """
    said = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{_escaped(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    opened = f"<{name}{said}>"
    return Html(opened if name in VOID else f"{opened}{join(*children)}</{name}>")


def join(*children: object) -> Html:
    """Pieces one after the other; what is no Html is text, None is nothing."""
    pieces = (c if isinstance(c, Html) else _escaped(c) for c in children if c is not None)
    return Html("".join(pieces))


def printable(name: str) -> str:
    """A name from outside, such as of a file, with nothing hidden in it.

    >>> printable("a\\nb.mp4")
    'a\\\\nb.mp4'
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in name)


def visible(name: str) -> Html:
    """A name from outside, isolated from the text around it, which may run the other way."""
    return tag("bdi", printable(name))


def document(title: str, body: Html, style: str, script: str = "") -> str:
    """A page that asks for nothing from anywhere: only this style, this script and pictures in it are let in."""
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {_hash(script)}; "
        "base-uri 'none'; form-action 'none'"
    )
    head = join(
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="referrer", content="no-referrer"),
        tag("link", rel="icon", href="data:,"),
        tag("title", title),
        tag("style", Html(style)),
    )
    end = tag("script", Html(script)) if script else None
    return f"<!DOCTYPE html>\n{tag('html', tag('head', head), tag('body', body, end), lang='en')}\n"


def data_uri(data: bytes, kind: str) -> str:
    """A file inside of the page.   kind : its media type."""
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _hash(text: str) -> str:
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'"


def _escaped(value: Any) -> str:
    return escape(str(value), quote=True)
