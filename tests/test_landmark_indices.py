"""Landmark indices have one owner, aam/landmarks/schemes.py: no bare slice or list of them stands elsewhere."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from guise.aam.landmarks import schemes

ROOT = Path(__file__).parents[1]
PACKAGES = ("aam", "analogy", "app", "common", "guise", "render", "benchmarks", "training")
OWNER = ROOT / "aam" / "landmarks" / "schemes.py"

GROUPS = {
    name: tuple(group.tolist())
    for name, group in vars(schemes).items()
    if name[0] != "_" and isinstance(group, np.ndarray) and group.dtype == np.intp
}
SPANS = {(g[0], g[-1] + 1) for g in GROUPS.values() if len(g) > 4 and g == tuple(range(g[0], g[-1] + 1))}
SPANS |= {(0, schemes.COUNT), (schemes.COUNT, schemes.COUNT)}
EDGES = {edge for span in SPANS for edge in span}
# Single points; the first of the jaw are too small to tell them from other numbers.
POINTS = {number for name, number in vars(schemes).items() if name.isupper() and isinstance(number, int)}
POINTS -= {*range(8), schemes.COUNT}
LANDMARKS = re.compile(r"points|shapes?|landmarks|truth|mesh|face", re.IGNORECASE)


def bare_indices(source: str, single: bool = True) -> list[str]:
    """Landmark indices written as numbers in a module's text, as "line: code".

    Found are slices and ranges that are a group or several that adjoin, and lists that are a group; on arrays that are
    named like landmarks also other lists of points and, if `single`, single points.
    """
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Slice) and _is_span(node.lower, node.upper, node.step):
            found.add((node.lineno, ast.unparse(node)))
        elif isinstance(node, ast.Call) and _called(node) in {"range", "slice", "arange"}:
            if len(node.args) == 2 and (_number(node.args[0]), _number(node.args[1])) in SPANS:
                found.add((node.lineno, ast.unparse(node)))
        elif isinstance(node, ast.List | ast.Tuple) and _numbers(node) in GROUPS.values():
            if min(_numbers(node)) > 16:  # below are too many pairs of numbers that mean something else
                found.add((node.lineno, ast.unparse(node)))
        elif isinstance(node, ast.Subscript) and LANDMARKS.search(_named(node.value)):
            found |= {(part.lineno, ast.unparse(node)) for part in _points_of(node.slice, single)}
    return [f"{line}: {code}" for line, code in sorted(found)]


def _is_span(lower: ast.expr | None, upper: ast.expr | None, step: ast.expr | None) -> bool:
    first = 0 if lower is None else _number(lower)
    last = schemes.COUNT if upper is None else _number(upper)
    if step is not None or first is None or last is None or (lower is None and upper is None):
        return False
    return (first, last) in SPANS or (
        lower is not None and upper is not None and first > 0 and {first, last} <= EDGES
    )


def _points_of(index: ast.expr, single: bool) -> Iterator[ast.expr]:
    parts = index.elts if isinstance(index, ast.Tuple) else [index]
    for part in parts:
        numbers = _numbers(part)
        if len(numbers) > 1 and min(numbers) >= 0 and 7 < max(numbers) < schemes.COUNT:
            yield part
        if single and _number(part) in POINTS:
            yield part


def _numbers(node: ast.expr) -> tuple[int, ...]:
    """The numbers of a literal list; nothing for anything else."""
    if not isinstance(node, ast.List | ast.Tuple):
        return ()
    numbers = [_number(e) for e in node.elts]
    return tuple(n for n in numbers if n is not None) if None not in numbers else ()


def _number(node: ast.expr) -> int | None:
    return node.value if isinstance(node, ast.Constant) and type(node.value) is int else None


def _named(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _called(node: ast.Call) -> str:
    return _named(node.func)


@pytest.mark.parametrize("package", PACKAGES)
@pytest.mark.slow
def test_no_module_writes_landmark_indices_as_numbers(package: str) -> None:
    paths = (path for path in sorted((ROOT / package).rglob("*.py")) if path != OWNER)
    assert [
        f"{path.relative_to(ROOT)}:{bare}"
        for path in paths
        for bare in bare_indices(path.read_text(encoding="utf-8"))
    ] == []


@pytest.mark.slow
def test_no_test_writes_groups_of_landmarks_as_numbers() -> None:
    """Single numbers are often frames there."""
    found = {
        path.name: bare_indices(path.read_text(encoding="utf-8"), single=False)
        for path in sorted((ROOT / "tests").rglob("*.py"))
    }
    assert {name: bare for name, bare in found.items() if bare} == {}


@pytest.mark.parametrize(
    "code",
    [
        "eye = anything[36:42]", "jaw = anything[:17]", "forehead = anything[:, 68:]", "inner = a[i, 17:68].min(0)",
        "rest = np.r_[0:17, 27:81]", "parts = (slice(42, 48),)", "LIPS = np.arange(48, 68)", "x = [*range(17, 27)]",
        "extra = held[81:]", "p = truth[45] - truth[36]", "p = shapes[:, 62]", "x = frame.points[30, 0]",
        "points[[0, 16, 68, 80]] = 1", "lids = anything[:, [37, 38, 43, 44]]", "brow(p, (36, 39))",
        "w = shape[[36, 45]]", "near = truth[[8, 9, 10]]",
    ],
)  # fmt: skip
def test_numbers_that_are_landmarks_are_found(code: str) -> None:
    assert len(bare_indices(f"import numpy as np\n\n{code}\n")) >= 1
    assert all(bare.startswith("3: ") for bare in bare_indices(f"import numpy as np\n\n{code}\n"))


@pytest.mark.parametrize(
    "code",
    [
        "eye = points[LEFT_EYE]", "x = points[:, 0]", "text = text[:57]", "frames = truth[60:100]", "copy = points[:]",
        "head = rows[2:4]", "faces[:, [0, 1, 2]]", "for i in range(0, 60): pass", "size = (640, 480)", "points[i, 1]",
        "corner = points[JAW[0], 0]", "first = faces[0]", "size = shape[2:]", "x = anything[27]",
    ],
)  # fmt: skip
def test_other_numbers_are_not(code: str) -> None:
    assert bare_indices(code) == []


def test_groups_are_of_the_scheme_and_cannot_be_changed() -> None:
    for name, group in GROUPS.items():
        assert len(set(group)) == len(group), name
        assert set(group) <= set(range(schemes.COUNT)), name
        with pytest.raises(ValueError, match="read-only"):
            vars(schemes)[name][0] = 0
