"""A look is a list of passes: what they are, what they know of, and what they show of the person."""

import ast
from collections.abc import Iterator
from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from types import MethodType

import pytest
from models import model_file

import guise.app.drawing.passes
from guise.aam.model import Identity
from guise.app.drawing.donor import Donor
from guise.app.drawing.look import DISGUISE, LOOKS, SWAP
from guise.app.drawing.passes.surface import OwnSkin
from guise.app.drawing.plan import Plan, Step

PASSES = "guise.app.drawing.passes"
MODULES = sorted(Path(guise.app.drawing.passes.__file__).parent.glob("[a-z]*.py"))


@pytest.fixture(scope="module", params=LOOKS.values(), ids=LOOKS)
def plan(request: pytest.FixtureRequest) -> Iterator[Plan]:
    person, other = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    made = Plan.of(person, Donor.of(other), replace(request.param, renderer="cpu"))
    yield made
    made.blend.close()


def steps_of(plan: Plan) -> tuple[Step, ...]:
    return (*plan.seeing, *plan.placing, *plan.drawing)


def test_every_look_has_a_plan_and_it_does_not_change(plan: Plan) -> None:
    assert plan.look.kind in LOOKS
    assert plan.drawing
    for name in ("look", "seeing", "placing", "drawing", "texture"):
        with pytest.raises(FrozenInstanceError):
            setattr(plan, name, None)


def test_its_steps_are_methods_of_passes_each_once(plan: Plan) -> None:
    steps = steps_of(plan)
    for step in steps:
        assert isinstance(step, MethodType)
        assert type(step.__self__).__module__.startswith(f"{PASSES}.")
    assert len(set(steps)) == len(steps)


def test_a_face_is_drawn_into_the_frame_and_written_last(plan: Plan) -> None:
    names = [step.__name__ for step in plan.drawing]
    assert names[-1] == "write"
    assert names.index("apply") < names.index("scatter") < names.index("composite") < names.index("write")
    assert plan.placing[-1].__name__ == "begin"


def test_the_outline_of_the_head_moves_only_if_that_is_wanted() -> None:
    person, other = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    for share in (0.0, 0.5):
        plan = Plan.of(person, Donor.of(other), replace(SWAP, renderer="cpu", outline=share))
        assert ("pull_jaw" in [step.__name__ for step in plan.placing]) == (share > 0)
        plan.blend.close()


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.stem)
def test_a_pass_knows_of_no_look_no_plan_and_no_other_pass(module: Path) -> None:
    tree = ast.parse(module.read_text(encoding="utf-8"))
    imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    imported |= {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    drawing = {name for name in imported if name and name.startswith("guise.app.drawing")}
    assert drawing <= {"guise.app.drawing.face", "guise.app.drawing.memory"}
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    names |= {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    names |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert not {name for name in names if name.lower() in {"disguise", "kind_of_look", "swap", "puppet"}}
    assert not names & {"look_of", "Look", "LOOKS", "SWAP", "LIVE", "DISGUISE", "PUPPET", "PAPER"}


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.stem)
def test_a_pass_changes_nothing_of_its_own_as_it_draws(module: Path) -> None:
    """What lasts is in the memory; a cache of what a pass is made of is filled by other methods."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    for method in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
        if [arg.arg for arg in method.args.args][:3] != ["self", "face", "memory"]:
            continue
        stored = [
            node
            for node in ast.walk(method)
            if isinstance(node, ast.Attribute)
            and isinstance(node.ctx, ast.Store)
            and isinstance(node.value, ast.Name)
            and node.value.id == "self"
        ]
        assert not stored, f"{module.name}:{method.name}"


def test_a_disguise_shows_nothing_of_the_persons_skin() -> None:
    person, other = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    for look in (SWAP, DISGUISE):
        plan = Plan.of(person, Donor.of(other), replace(look, renderer="cpu"))
        owners = {step.__self__.__class__ for step in steps_of(plan) if isinstance(step, MethodType)}
        plan.blend.close()
        assert (OwnSkin in owners) == (look is SWAP)
