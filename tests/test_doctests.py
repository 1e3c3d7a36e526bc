"""The examples in docstrings run."""

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("aam", "analogy", "app", "common", "guise", "render")


def with_examples() -> list[str]:
    """Dotted names of the modules whose docstrings hold examples."""
    paths = (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py")))
    found = [path for path in paths if ">>>" in path.read_text(encoding="utf-8")]
    names = (".".join(("guise", *path.relative_to(ROOT).with_suffix("").parts)) for path in found)
    return [name.removesuffix(".__init__").replace("guise.guise", "guise") for name in names]


@pytest.mark.parametrize("name", with_examples())
def test_examples_in_docstrings_run(name: str) -> None:
    failed, tried = doctest.testmod(importlib.import_module(name), optionflags=doctest.ELLIPSIS)
    assert tried > 0
    assert failed == 0


def test_there_are_examples() -> None:
    assert len(with_examples()) > 20
