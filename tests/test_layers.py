"""Who may import whom: room by room, each heavy library only where it has its owner, and no cycles."""

import ast
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("aam", "analogy", "app", "common", "guise", "render")

_SCIENCE = {"aam", "analogy", "render", "common"}
_PARTS = {"app.media", "app.people", "app.enrolment", "app.drawing", "app.swapping"}
_WORK = {"app.live", "app.rig", "app.measure", "app.photos", "app.meshes", "app.landmarks", "app.deidentify"}
_DEIDENTIFY = {"app.deidentify", "app.deidentify.report", "app.deidentify.run", "app.deidentify.stages"}
# A room -> the rooms that it may import.  Imports flow downwards (docs/architecture.md).
ROOMS = {
    "common": set(),
    "render": {"common"},
    "aam": {"common"},
    "analogy": {"aam", "render", "common"},
    "app.media": {"common"},
    "app.people": {"aam", "render", "common", "app.media"},
    "app.enrolment": {"aam", "common", "app.media", "app.people"},
    "app.drawing": {"aam", "render", "common", "app.media"},
    "app.swapping": {"aam", "render", "common", "app.media", "app.people", "app.enrolment", "app.drawing"},
    "app.landmarks": {"aam", "common", "app.media"},
    "app.measure": {"aam", "common", "app.media", "app.people", "app.swapping"},
    "app.photos": {"aam", "analogy", "common", "app.media", "app.enrolment", "app.people", "app.swapping"},
    "app.meshes": {"aam", "analogy", "render", "common", "app.media"},
    "app.live": _SCIENCE - {"analogy"} | _PARTS,
    "app.rig": {"aam", "analogy", "common", "app.media", "app.people", "app.meshes", "app.live"},
    "app.deidentify": {"render", "common", "app.media", "app.drawing", "app.swapping"},
    "app.deidentify.stages": {
        "aam",
        "render",
        "common",
        "app.media",
        "app.people",
        "app.drawing",
        "app.swapping",
        "app.deidentify",
    },
    "app.deidentify.report": {"common", "app.media", "app.swapping", "app.deidentify"},
    "app.deidentify.run": _SCIENCE - {"analogy"} | _PARTS | _DEIDENTIFY - {"app.deidentify.run"},
    "app.tools": _SCIENCE - {"analogy"} | _PARTS,
    "app.studio": _SCIENCE | _PARTS | _WORK | _DEIDENTIFY,
    "app.cli": _SCIENCE | _PARTS | _WORK | _DEIDENTIFY | {"app.studio", "app.tools"},
    "guise": _SCIENCE | _PARTS | _WORK | _DEIDENTIFY | {"app.cli", "app.tools"},
}
MOST_ROOMS_IN_APP, MOST_ARROWS_IN_APP = 22, 95
# A foreign library -> the rooms and modules that may import it.
OWNERS = {
    "onnxruntime": {"aam/onnx_model.py"},
    "skimage": {"aam/landmarks/boxes.py"},
    "safetensors": {"aam/model.py"},
    "pymetis": {"analogy/solver.py"},
    "moderngl": {"render"},
    "av": {"app/media"},
    "PIL": {"app/media", "guise/api/pictures.py"},
    "c2pa": {"app/media/provenance.py"},
    "cryptography": {"app/media/provenance.py"},
    "jinja2": {"app/deidentify/report/html.py"},
    "matplotlib": {"app/measure/plot.py"},
    "distributed": {"app/deidentify/run/cluster.py"},
    "fsspec": {"app/deidentify/run/remote.py"},
    "platformdirs": {"common/presets.py", "app/people/kept.py", "app/cli/studio.py"},
    "glfw": {"app/live/window.py"},
    "moderngl_window": {"app/live/window.py"},
    "pyvirtualcam": {"app/live/virtualcam.py"},
    "sounddevice": {"app/live/sound.py"},
    "threadpoolctl": {"common/threads.py"},
    "nicegui": {"app/studio"},
    "fastapi": {"app/studio/server.py"},
    "starlette": {"app/studio"},
    "uvicorn": {"app/studio/server.py"},
    "typer": {"app/cli"},
    "rich": {"app/cli"},
    "scipy": {"aam", "analogy", "app"},
    "cv2": {"aam", "analogy", "app", "common", "render"},
    "numpy": {"aam", "analogy", "app", "common", "render", "guise"},
    "pandas": {"guise/api/points.py"},
}


def modules(root: Path = ROOT) -> list[Path]:
    return sorted(path for package in PACKAGES for path in (root / package).rglob("*.py"))


@cache
def imports(path: Path, root: Path = ROOT) -> list[tuple[str, int]]:
    """Full names of what a module imports anywhere in it, with the line; of `from x import y` also x.y."""
    package, found = path.relative_to(root).parent.parts, []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(name.name, node.lineno) for name in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ("guise", *package[: len(package) - node.level + 1]) if node.level else ()
            module = ".".join([*base, *((node.module,) if node.module else ())])
            found += [(f"{module}.{name.name}", node.lineno) for name in node.names]
    return found


def room_of(name: str) -> str:
    """The room of a dotted name below `guise`: as `guise.app.live.run` is in app.live."""
    parts = name.split(".")[1:]
    rooms = [".".join(parts[:k]) for k in range(len(parts), 0, -1)]
    return next((room for room in rooms if room in ROOMS), "guise")


def wrong_imports(path: Path, root: Path = ROOT) -> list[str]:
    room = room_of(".".join(("guise", *path.relative_to(root).with_suffix("").parts)))
    place = path.relative_to(root)
    found = []
    for name, line in imports(path, root):
        top = name.split(".")[0]
        if top == "guise":
            fine = room_of(name) in ROOMS[room] | {room}
        elif top in sys.stdlib_module_names:
            fine = True
        else:
            fine = any(place == Path(owner) or Path(owner) in place.parents for owner in OWNERS.get(top, ()))
        if not fine:
            found.append(f"{place}:{line} imports {name}")
    return sorted(set(found))


def module_graph() -> dict[str, set[str]]:
    """Every module of ours with those that it imports at all, lazily too."""
    names = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in modules()}
    names = {"guise." + name.removesuffix(".__init__"): path for name, path in names.items()}
    names = {name.replace("guise.guise", "guise"): path for name, path in names.items()}
    graph: dict[str, set[str]] = {}
    for name, path in names.items():
        wanted = {found for found, _ in imports(path) if found.startswith("guise")}
        parents = {found.rsplit(".", 1)[0] for found in wanted - names.keys()}
        graph[name] = (wanted | parents) & names.keys() - {name}
    return graph


@pytest.mark.slow
def test_rooms_import_only_what_is_below_them() -> None:
    assert [wrong for path in modules() for wrong in wrong_imports(path)] == []


def test_the_allowed_imports_have_no_cycle() -> None:
    order = list(TopologicalSorter(ROOMS).static_order())
    assert order[0] == "common"
    assert set(order) == set(ROOMS)


def test_every_folder_of_the_app_is_a_room() -> None:
    folders = {f"app.{path.name}" for path in (ROOT / "app").iterdir() if (path / "__init__.py").is_file()}
    assert folders == {room for room in ROOMS if room.count(".") == 1}
    assert [path.name for path in (ROOT / "app").glob("*.py")] == ["__init__.py"]
    assert len([room for room in ROOMS if room.startswith("app.")]) <= MOST_ROOMS_IN_APP


@pytest.mark.slow
def test_arrows_between_rooms_of_the_app_are_few() -> None:
    arrows = {
        (room_of(user), room_of(used))
        for user, wanted in module_graph().items()
        for used in wanted
        if user.startswith("guise.app.") and used.startswith("guise.app.")
    }
    assert 20 < len({(a, b) for a, b in arrows if a != b}) <= MOST_ARROWS_IN_APP


@pytest.mark.slow
def test_no_module_imports_itself_by_a_detour() -> None:
    try:
        order = list(TopologicalSorter(module_graph()).static_order())
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]), pytrace=False)
    assert len(order) > 200


def test_no_training_module_imports_itself_by_a_detour() -> None:
    graph = {
        f"training.{path.stem}": {found.rpartition(".")[0] for found, _ in imports(path)}
        for path in (ROOT / "training").glob("*.py")
    }
    order = [name for name in TopologicalSorter(graph).static_order() if name in graph]
    assert len(order) == len(graph) > 40


def reached(start: set[str], graph: dict[str, set[str]]) -> set[str]:
    """Modules that are imported under one of these names or, by a detour, by one that is."""
    found, ahead = set[str](), [name for full in start for name in (full, full.rpartition(".")[0])]
    while ahead:
        name = ahead.pop()
        if name in graph and name not in found:
            found.add(name)
            ahead += graph[name]
    return found


@pytest.mark.slow
def test_every_module_is_reached_from_a_test() -> None:
    """By an import, or by a command, which the command line finds by its name."""
    graph = module_graph()
    start = {name for path in (ROOT / "tests").glob("*.py") for name, _ in imports(path)}
    commands = {name for name in graph if name.startswith("guise.app.cli.")}
    packages = {name.rpartition(".")[0] for name in graph}
    assert sorted(graph.keys() - packages - {"guise.__main__"} - reached(start | commands, graph)) == []
    assert "guise.app.live.window" not in reached({"guise.aam.model"}, graph)  # what nothing reaches is seen


@pytest.mark.parametrize("library", sorted(OWNERS))
def test_every_owned_library_is_used(library: str) -> None:
    users = [path for path in modules() if any(name.split(".")[0] == library for name, _ in imports(path))]
    assert users, f"nothing imports {library}: drop it from the dependencies and from this list"


def test_the_rule_sees_wrong_imports(tmp_path: Path) -> None:
    """The test itself can fail: nested, relative and renamed imports are all seen."""
    path = tmp_path / "aam" / "landmarks" / "made_up.py"
    path.parent.mkdir(parents=True)
    lines = [
        "import json",
        "from ..similarity import align",
        "from guise.app import cli",
        "from guise import app as application",
        "def f():",
        " import av",
        "import aam",
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
    assert {name for name, _ in imports(path, tmp_path)} >= {"json", "guise.aam.similarity.align", "av"}
    assert wrong_imports(path, tmp_path) == [
        "aam/landmarks/made_up.py:3 imports guise.app.cli",
        "aam/landmarks/made_up.py:4 imports guise.app",
        "aam/landmarks/made_up.py:6 imports av",
        "aam/landmarks/made_up.py:7 imports aam",
    ]


def test_live_never_imports_deidentify(tmp_path: Path) -> None:
    path = tmp_path / "app" / "live" / "made_up.py"
    path.parent.mkdir(parents=True)
    path.write_text("from guise.app.deidentify.options import DeidentifyOptions", encoding="utf-8")
    assert wrong_imports(path, tmp_path) == [
        "app/live/made_up.py:1 imports guise.app.deidentify.options.DeidentifyOptions"
    ]
