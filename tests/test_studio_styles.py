"""The studio's style sheet has what its pages ask for, as no compiler in the browser adds it."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import nicegui

from guise.app import studio

PAGES = Path(studio.__file__).parent
SHEETS = [*PAGES.glob("static/*.css"), *Path(nicegui.__file__).parent.glob("static/*.css")]


def test_every_class_of_the_pages_has_a_rule() -> None:
    rules = "".join(re.sub(r"\\(.)", r"\1", sheet.read_text()) for sheet in SHEETS)
    used = {name for path in PAGES.glob("*.py") for name in classes(path.read_text())}
    assert len(used) > 50
    missing = {name for name in used if not re.search(rf"\.{re.escape(name)}(?![\w-])", rules)}
    assert missing == set(), "app/studio/static/studio.css lacks them"


def test_a_class_is_found_wherever_it_is_written() -> None:
    source = "a.classes('x y').classes(remove='z' if b else '')\nclasses = 'v' if c else 'w'\n"
    assert set(classes(source)) == {"x", "y", "z", "v", "w"}


def classes(source: str) -> Iterator[str]:
    """Names of classes in calls of `classes` and what is assigned to a variable of that name."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "classes":
            values = [*node.args, *(keyword.value for keyword in node.keywords)]
        elif isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "classes":
            values = [node.value]
        else:
            continue
        for inner in (inner for value in values for inner in _strings(value)):
            yield from inner.split()


def _strings(value: ast.expr) -> Iterator[str]:
    """Text that an expression can be, without what it is compared to or looked up by."""
    if isinstance(value, ast.Constant) and isinstance(value.value, str):
        yield value.value
    elif isinstance(value, ast.IfExp):
        yield from (*_strings(value.body), *_strings(value.orelse))
    elif isinstance(value, ast.JoinedStr | ast.BinOp):
        parts = value.values if isinstance(value, ast.JoinedStr) else [value.left, value.right]
        for part in parts:
            yield from _strings(part)
