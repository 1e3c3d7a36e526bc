"""How well the rooms that draw are built: files, chains of imports, classes, tuned numbers, calls a frame.

The rooms are `app/swapping` and `app/drawing`.  All but three figures are read from the code:

files, chain    modules of the rooms that define something, and how many of them one import leads through at most.
fields          of the largest class: what is set on self, and fields of dataclasses, but not of tables of numbers.
tuned numbers   literals other than 0, 1, -1, 2 and sizes of new arrays in constants of modules and in defaults of
                dataclasses.  One has a source inside `tuned` (an existing benchmark or training script) or `derived` of
                `guise.common.tuned`.
brows           files of app, aam and render that are named after brows or define a class that is.
branches        conditions in `app/drawing/passes`, in both rooms before that folder is there, that ask for a look.
names           that more than one class of the packages has.

What a donor visits is seen in a run: engines are made of a `Donor` for a swap and for a disguise, and a room (file) is
visited when one of its functions is given the donor, a part of it, what another visited function made of it, or an
object that holds one of these in a field, a list or a dict.  The reference frame is none of it, as the person's grid is
the same object.  A return is a move into a room visited before, each pair of rooms counted once, as loops go the same
way again.  The engine with more of them counts.

Calls a frame are the events 'call' and 'c_call' of sys.setprofile and threading.setprofile while `guise.Swapper` puts
p06 on p01 in frames 31 to 60 of talk2, renderer "cpu"; both are enrolled from their sample clips.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any

import numpy as np

import guise
from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.solid_shape import SolidFit
from guise.app.drawing.donor import Donor
from guise.app.media import open_input

ROOT = Path(__file__).parents[1]
ROOMS = ("app/swapping", "app/drawing")
PACKAGES = ("aam", "analogy", "app", "common", "guise", "render")
SAMPLES = ROOT / "sample_videos"
PLAIN = (0, 1, -1, 2)  # numbers that are not tuned
NEW_ARRAYS = "np.eye", "np.ones", "np.zeros"
LOOK = re.compile(r"disguise|puppet|\bpaper|\.kind\b|\b(?:SWAP|LIVE|PAPER)\b", re.IGNORECASE)
BROW = re.compile(r"(?:Brow|\bbrow|_brow)(?!s[ei])")
COUNTED_FRAMES = range(31, 61)


@dataclass(frozen=True)
class Budget:
    """What is allowed: `held` is what a test holds, `target` where it shall go."""

    what: str
    held: float
    target: float


BUDGETS = {
    "files": Budget("files of the rooms", 30, 30),
    "chain": Budget("longest chain of imports within them", 5, 5),
    "donor_rooms": Budget("rooms that a donor visits", 15, 15),
    "donor_returns": Budget("returns of the donor", 15, 15),
    "fields": Budget("fields of the largest class", 13, 12),
    "numbers": Budget("tuned numbers", 250, 250),
    "unsourced": Budget("tuned numbers without a source", 0, 0),
    "brows": Budget("files of brows in app, aam and render", 3, 4),
    "branches": Budget("branches on a look in a pass", 0, 0),
    "lines": Budget("lines of app and benchmarks", 61_100, 46_000),
    "calls": Budget("calls a frame", 1_120, 300),
    "names": Budget("names that several classes have", 0, 0),
}


# -- read from the code ---------------------------------------------------------------------------------------


def files_of(*folders: str, root: Path = ROOT) -> list[Path]:
    """Python files below folders, in order."""
    return sorted(path for folder in folders for path in (root / folder).rglob("*.py"))


@cache
def tree_of(path: Path) -> ast.Module:
    """A file's syntax."""
    return ast.parse(path.read_text(encoding="utf-8"))


def modules_of_rooms(root: Path = ROOT) -> list[Path]:
    """Those that define something: an __init__ that hands on names is none."""
    defines = (ast.ClassDef, ast.FunctionDef)
    return [
        path
        for path in files_of(*ROOMS, root=root)
        if path.name != "__init__.py" or any(isinstance(node, defines) for node in tree_of(path).body)
    ]


def imports_within(modules: list[Path], root: Path = ROOT) -> dict[Path, set[Path]]:
    """What each of the modules imports of the others, anywhere in it."""
    names = {
        ".".join(("guise", *path.relative_to(root).with_suffix("").parts)).removesuffix(".__init__"): path
        for path in modules
    }
    found: dict[Path, set[Path]] = {path: set() for path in modules}
    for path in modules:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ImportFrom) and node.module:
                wanted = [node.module, *(f"{node.module}.{name.name}" for name in node.names)]
            elif isinstance(node, ast.Import):
                wanted = [name.name for name in node.names]
            else:
                continue
            found[path] |= {names[name] for name in wanted if name in names} - {path}
    return found


def longest_chain(graph: dict[Path, set[Path]]) -> int:
    """Modules on the longest way along imports; CycleError where there is a circle."""
    floors: dict[Path, int] = {}
    for path in TopologicalSorter(graph).static_order():
        floors[path] = 1 + max((floors[used] for used in graph[path]), default=0)
    return max(floors.values(), default=0)


def classes(paths: list[Path]) -> Iterator[tuple[Path, ast.ClassDef]]:
    """Every class of files, nested ones too."""
    for path in paths:
        yield from ((path, node) for node in ast.walk(tree_of(path)) if isinstance(node, ast.ClassDef))


def is_table(node: ast.ClassDef) -> bool:
    """Whether a class is a table of numbers: all that it states has one as default."""
    stated = [part.value for part in node.body if isinstance(part, ast.AnnAssign)]
    return bool(stated) and all(
        value is not None
        and any(isinstance(n, ast.Constant) and isinstance(n.value, int | float) for n in ast.walk(value))
        for value in stated
    )


def fields_of(node: ast.ClassDef) -> set[str]:
    """Names that a class annotates in its body or sets on self."""
    found = {
        part.target.id
        for part in node.body
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name)
    }
    for part in ast.walk(node):
        if isinstance(part, ast.Attribute) and isinstance(part.ctx, ast.Store):
            found |= {part.attr} if isinstance(part.value, ast.Name) and part.value.id == "self" else set()
    return found


def conditions(tree: ast.AST) -> Iterator[ast.expr]:
    """What is asked in if, while, conditional expressions, comprehensions and match."""
    for node in ast.walk(tree):
        if isinstance(node, ast.If | ast.IfExp | ast.While):
            yield node.test
        elif isinstance(node, ast.comprehension):
            yield from node.ifs
        elif isinstance(node, ast.Match):
            yield node.subject


def branches_on_a_look(root: Path = ROOT) -> int:
    """Conditions in passes that ask for a look."""
    passes = files_of("app/drawing/passes", root=root) or files_of(*ROOMS, root=root)
    return sum(
        bool(LOOK.search(ast.unparse(asked))) for path in passes for asked in conditions(tree_of(path))
    )


def brow_files() -> list[Path]:
    """Files that are named after brows or define a class that is."""
    paths = files_of("app", "aam", "render")
    named = {path for path, node in classes(paths) if BROW.search(node.name)}
    return sorted(named | {path for path in paths if BROW.search(path.stem)})


def shared_names() -> list[str]:
    """Names that several public classes have."""
    counts = Counter(node.name for _, node in classes(files_of(*PACKAGES)) if not node.name.startswith("_"))
    return sorted(name for name, count in counts.items() if count > 1)


# -- tuned numbers --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Number:
    """A constant or a field with tuned numbers: where, its value as it is written, unit, and source if it names one."""

    room: str
    name: str
    value: str
    unit: str
    source: str
    count: int


def literals(node: ast.AST) -> Iterator[float]:
    """Numbers written in an expression, but for those that are never tuned, indices, and the sizes of new arrays."""
    if isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value not in PLAIN:
        yield node.value
    elif not isinstance(node, ast.Subscript) and not (
        isinstance(node, ast.Call) and ast.unparse(node.func) in NEW_ARRAYS
    ):
        for part in ast.iter_child_nodes(node):
            yield from literals(part)


def has_script(name: str) -> bool:
    """Whether a benchmark or a training script has a name, as "picture.truth" or "training.finish_face"."""
    place = name.replace(".", "/") + ".py"
    return (ROOT / "benchmarks" / place).is_file() or (
        name.startswith("training.") and (ROOT / place).is_file()
    )


def sourced(call: ast.Call) -> tuple[str, str] | None:
    """Unit and source of a call of `tuned` or `derived`; None of any other, or where the benchmark isn't there."""
    how = call.func.id if isinstance(call.func, ast.Name) else ""
    if how not in ("tuned", "derived") or len(call.args) != 3:
        return None
    unit, source = (str(arg.value) if isinstance(arg, ast.Constant) else "" for arg in call.args[1:])
    if not source or (how == "tuned" and not has_script(source)):
        return None
    return unit, f"`{source}`" if how == "tuned" else source


def numbers_in(room: str, name: str, value: ast.expr) -> Iterator[Number]:
    """The tuned numbers of one constant or field: those of each source, and those without one."""
    found = [
        (call, told)
        for call in ast.walk(value)
        if isinstance(call, ast.Call) and (told := sourced(call)) is not None
    ]
    bare = sum(1 for _ in literals(value))
    for call, (unit, source) in found:
        count = sum(1 for _ in literals(call.args[0]))
        bare -= count
        yield Number(room, name, ast.unparse(call.args[0]), unit, source, count)
    if bare:
        yield Number(room, name, ast.unparse(value), "", "", bare)


def is_dataclass_node(node: ast.ClassDef) -> bool:
    """Whether a class is decorated as a dataclass."""
    return any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list)


def numbers(paths: list[Path]) -> Iterator[Number]:
    """All tuned numbers of files."""
    for path in paths:
        tables = [node for node in tree_of(path).body if isinstance(node, ast.ClassDef)]
        for holder in [tree_of(path), *(node for node in tables if is_dataclass_node(node))]:
            prefix = f"{holder.name}." if isinstance(holder, ast.ClassDef) else ""
            for node in holder.body:
                if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
                    target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
                    room = str(path.relative_to(ROOT) if path.is_relative_to(ROOT) else path)
                    yield from numbers_in(room, prefix + ast.unparse(target), node.value)


def number_tables(found: list[Number]) -> list[Table]:
    """A table for each room with what has a source, and one of what has none."""
    told = [
        Table(
            f"Tuned numbers of {room}",
            ("module", "name", "value", "unit", "source"),
            [
                (one.room.removeprefix(f"{room}/"), one.name, one.value, one.unit, one.source)
                for one in found
                if one.source and one.room.startswith(f"{room}/")
            ],
        )
        for room in ROOMS
    ]
    bare = [(one.room, one.name, one.value) for one in found if not one.source]
    return [*told, Table("Without a source", ("module", "name", "value"), bare)]


# -- seen in a run --------------------------------------------------------------------------------------------


class Visits:
    """Follows a donor through calls: the rooms it comes to, in order."""

    def __init__(self, donor: Donor) -> None:
        self._name = donor.enrolled.name
        self._donor: dict[
            int, object
        ] = {}  # it, its parts and what was made of it, kept so that no id comes again
        self._learn(donor)
        self.rooms: list[str] = []

    def __call__(self, frame: FrameType, event: str, result: Any) -> None:
        """Profile function, see sys.setprofile."""
        file = Path(frame.f_code.co_filename)
        if event not in ("call", "return") or not file.is_relative_to(ROOT) or ".venv" in file.parts:
            return
        sys.setprofile(None)
        code, given = frame.f_code, frame.f_locals
        arguments = [
            given.get(name) for name in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        ]
        if any(self._holds(value) for value in arguments):
            if event == "call":
                self._enter(str(file.relative_to(ROOT)))
            else:
                for made in (*arguments[:1], result) if code.co_name == "__init__" else (result,):
                    self._learn(made)
        sys.setprofile(self)

    def _enter(self, room: str) -> None:
        if not self.rooms or self.rooms[-1] != room:
            self.rooms.append(room)

    @property
    def returns(self) -> int:
        """Moves into a room visited before, each pair of rooms once."""
        moves = zip(self.rooms, self.rooms[1:], strict=False)
        return len({(a, b) for k, (a, b) in enumerate(moves) if b in self.rooms[: k + 1]})

    def _holds(self, value: object, inside: bool = True) -> bool:
        if id(value) in self._donor:
            return True
        if isinstance(value, Identity):
            return value.name == self._name
        if isinstance(value, list | tuple | dict):
            parts: Any = value.values() if isinstance(value, dict) else value
        elif _is_ours(value):
            parts = getattr(value, "__dict__", {}).values()
        else:
            return False
        return inside and any(self._holds(part, False) for part in parts)

    def _learn(self, value: object) -> None:
        """Remember an array or an object of ours, and the parts of a face."""
        if isinstance(value, ReferenceFrame):
            return  # a donor shares it with the person
        if isinstance(value, list | tuple):
            for part in value:
                self._learn(part)
        elif _is_ours(value) or (isinstance(value, np.ndarray) and value.size > 3):
            self._donor[id(value)] = value
            if (
                isinstance(value, Donor | Identity | SolidFit)
                or type(value).__module__ == "guise.aam.appearance"
            ):
                for one in fields(value) if is_dataclass(value) else ():
                    self._learn(getattr(value, one.name))


def _is_ours(value: object) -> bool:
    return isinstance(value, SimpleNamespace) or type(value).__module__.startswith("guise.")


def engine_makers(person: Identity, donor: Donor) -> list[Callable[[], Any]]:
    """What makes an engine that shows the donor on the person, for a swap and for a disguise."""
    from guise.aam.landmarks import open_landmarker
    from guise.app.drawing.engine import Engine
    from guise.app.drawing.look import DISGUISE, SWAP

    finder, looks = open_landmarker("builtin"), [replace(look, renderer="cpu") for look in (SWAP, DISGUISE)]
    return [lambda look=look: Engine(person, donor, finder, look) for look in looks]


def donor_visits(person: Identity, donor: Donor) -> list[Visits]:
    """Where a donor comes from the constructor of each engine."""
    assert person.name != donor.enrolled.name, "they are told apart by their names"
    found = []
    for make in engine_makers(person, donor):
        visits, before = Visits(donor), sys.getprofile()
        sys.setprofile(visits)
        try:
            engine = make()
        finally:
            sys.setprofile(before)
        engine.close()
        found.append(visits)
    return found


def sample_person(name: str, quick: bool) -> Identity:
    """A sample person, enrolled; from few frames if `quick`, which changes no figure by a hundredth."""
    few = {"frames": 24, "resolution": 80} if quick else {}
    return guise.enroll(SAMPLES / name / "talk.mp4", name=name, **few)


def calls_a_frame(person: Identity, donor: Identity) -> tuple[float, list[tuple[str, float]]]:
    """Calls a frame, and how many of them are of Python, of C, and from each file."""
    counts: Counter[tuple[str, str]] = Counter()
    counted = threading.Event()

    def count(frame: FrameType, event: str, _: object) -> None:
        if event in ("call", "c_call") and counted.is_set():
            file = Path(frame.f_code.co_filename)
            counts[event, "/".join(file.parts[-2:])] += 1

    clip = SAMPLES / "p01" / "talk2.mp4"
    threading.setprofile(count)  # of the swapper's own thread, too, which it starts
    with guise.Swapper(donor, person, renderer="cpu") as swapper, open_input(clip) as media:
        for number, frame in enumerate(media, 1):
            picture = frame.rgb()
            if number in COUNTED_FRAMES:
                counted.set()
                sys.setprofile(count)
            swapper(picture)
            sys.setprofile(None)
            counted.clear()
            if number == COUNTED_FRAMES[-1]:
                break
    threading.setprofile(None)
    share = {key: value / len(COUNTED_FRAMES) for key, value in counts.items()}
    parts: dict[str, float] = {}
    for (event, file), value in share.items():
        for part in ("Python" if event == "call" else "C", file):
            parts[part] = parts.get(part, 0.0) + value
    return sum(share.values()), sorted(parts.items(), key=lambda part: -part[1])


# -- the report -----------------------------------------------------------------------------------------------


def read_from_code() -> dict[str, float]:
    """The figures that need no run, by the names of `BUDGETS`."""
    modules = modules_of_rooms()
    found = list(numbers(modules))
    return {
        "files": len(modules),
        "chain": longest_chain(imports_within(modules)),
        "fields": max(len(fields_of(node)) for _, node in classes(modules) if not is_table(node)),
        "numbers": sum(one.count for one in found),
        "unsourced": sum(one.count for one in found if not one.source),
        "brows": len(brow_files()),
        "branches": branches_on_a_look(),
        "names": len(shared_names()),
        "lines": sum(len(path.read_text().splitlines()) for path in files_of("app", "benchmarks")),
    }


def seen_in_a_run(person: Identity, donor: Identity) -> tuple[dict[str, float], Table]:
    """The figures that need a run of one face over another, by the names of `BUDGETS`, and where calls are made."""
    visits = donor_visits(person, Donor.of(donor))
    calls, parts = calls_a_frame(person, donor)
    found = {
        "donor_rooms": max(len(set(one.rooms)) for one in visits),
        "donor_returns": max(one.returns for one in visits),
        "calls": calls,
    }
    return found, Table("Calls a frame", ("from", "calls"), parts[:14])


def measure(options: argparse.Namespace) -> Report:
    """All figures beside their targets."""
    found, calls = seen_in_a_run(*(sample_person(name, options.quick) for name in ("p01", "p06")))
    figures, modules = read_from_code() | found, modules_of_rooms()
    report = Report("structure", "The rooms that draw")
    report.criteria = [Criterion(b.what, figures[name], "<=", b.target) for name, b in BUDGETS.items()]
    held = [(len(fields_of(node)), node.name) for _, node in classes(modules) if not is_table(node)]
    report.tables += [Table("Largest classes", ("fields", "class"), sorted(held)[:-6:-1]), calls]
    report.notes.append("Several classes: " + ", ".join(shared_names()))
    if options.numbers:
        report.tables += number_tables(list(numbers(modules)))
    return report


def parser() -> argparse.ArgumentParser:
    """Options of the script."""
    made = common.arguments(__doc__)
    made.add_argument("--numbers", action="store_true", help="print the tuned numbers of each room")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
