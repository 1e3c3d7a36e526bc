"""The rooms that draw stay as simple as they are: budgets of `benchmarks/structure.py`, and that it can see."""

import ast
import sys
from pathlib import Path

import pytest
from models import model_file

sys.path.append(str(Path(__file__).parents[1]))  # the benchmarks are part of the checkout, not of the package

from benchmarks import structure
from benchmarks.structure import BUDGETS, Number
from guise.aam.model import Identity
from guise.app.drawing.donor import Donor
from guise.common.kernels import COMPILED

CODE = """
from dataclasses import dataclass
from guise.common.tuned import derived, tuned

LOOSE = 0.7
SIDE = derived(128, "pixels", "the network's input")
NONE = 0
NAMES = CHOICES[7]
EMPTY = np.zeros((0, 5))

@dataclass(frozen=True)
class Limits:
    share: float = tuned(0.25, "share", "structure")
    made_up: float = tuned(0.4, "share", "no_such_benchmark")
    ends: tuple[float, float] = (0.1, tuned(0.3, "share", "structure"))
    turned: bool = True

def f(x=5):
    return 9 * x
"""


@pytest.fixture(scope="module")
def figures() -> dict[str, float]:
    people = (Identity.load(model_file(name)) for name in ("p01", "p06"))
    return structure.read_from_code() | structure.seen_in_a_run(*people)[0]


@pytest.mark.parametrize("name", BUDGETS)
@pytest.mark.slow
def test_a_budget_holds(name: str, figures: dict[str, float]) -> None:
    if name == "calls" and COMPILED is None:
        pytest.skip("the twins of the kernels make more calls")
    assert 0 <= figures[name] <= BUDGETS[name].held, BUDGETS[name].what


@pytest.mark.slow
def test_the_donor_is_followed(figures: dict[str, float]) -> None:
    assert figures["donor_rooms"] >= 5
    assert figures["donor_returns"] >= 1


@pytest.mark.slow
def test_neither_the_person_nor_the_grid_of_both_is_taken_for_the_donor() -> None:
    person, donor = (Identity.load(model_file(name)) for name in ("p01", "p06"))
    assert person.reference is donor.reference
    for visits in structure.donor_visits(person, Donor.of(donor)):
        assert "app/drawing/passes/texture.py" in visits.rooms
        assert "aam/parameters.py" not in visits.rooms  # which estimates the person's
        assert "aam/coarse_grid.py" not in visits.rooms  # which has the grid's places


def numbers_of(code: str, folder: Path) -> list[Number]:
    path = folder / "made_up.py"
    path.write_text(code, encoding="utf-8")
    return list(structure.numbers([path]))


def test_numbers_without_a_source_are_found(tmp_path: Path) -> None:
    found = numbers_of(CODE, tmp_path)
    assert [one.name for one in found if not one.source] == ["LOOSE", "Limits.made_up", "Limits.ends"]
    assert [(one.name, one.value, one.unit) for one in found if one.source] == [
        ("SIDE", "128", "pixels"),
        ("Limits.share", "0.25", "share"),
        ("Limits.ends", "0.3", "share"),
    ]
    assert sum(one.count for one in found) == 6


def made_rooms(root: Path, **modules: str) -> list[Path]:
    folder = root / "app" / "drawing" / "passes"
    folder.mkdir(parents=True)
    for name, code in modules.items():
        (folder / f"{name}.py").write_text(code, encoding="utf-8")
    return structure.modules_of_rooms(root)


def test_the_longest_chain_counts_every_kind_of_import(tmp_path: Path) -> None:
    package = "guise.app.drawing.passes"
    paths = made_rooms(
        tmp_path,
        low="",
        middle=f"from {package} import low",
        high=f"def f():\n    import {package}.middle",
        aside=f"from {package}.low import x",
        __init__=f"from {package}.high import f",
    )
    assert [path.stem for path in paths] == ["aside", "high", "low", "middle"]
    assert structure.longest_chain(structure.imports_within(paths, tmp_path)) == 3


def test_branches_on_a_look_are_seen(tmp_path: Path) -> None:
    made_rooms(
        tmp_path,
        asks="a = 1 if look.kind == 'live' else 2\nif self._disguise is not None:\n    pass\nif x is SWAP: pass",
        asks_not="if look.eyes == 'source' or mouth:\n    disguise = 3",
    )
    assert structure.branches_on_a_look(tmp_path) == 3


def test_fields_are_those_of_the_body_and_of_self() -> None:
    code = "class A:\n x: int\n def f(self):\n  self.y, other.z = 1, 2\n  self.y += 1\n  print(self.w)"
    (node,) = (part for part in ast.parse(code).body if isinstance(part, ast.ClassDef))
    assert structure.fields_of(node) == {"x", "y"}
    assert not structure.is_table(node)


def test_brows_are_no_browsers() -> None:
    words = ("brow_cover", "BrowLift", "lid_brow", "Browser", "browsing", "JobRow", "arrow")
    assert [bool(structure.BROW.search(word)) for word in words] == [True] * 3 + [False] * 4
