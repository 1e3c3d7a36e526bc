"""Who may import whom: app -> {aam, render, analogy}, and each heavy library only where it has its owner."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OURS = {"aam", "analogy", "app", "render"}
MAY_IMPORT = {
    "aam": {"aam", "numpy", "scipy", "cv2", "skimage", "onnxruntime", "safetensors"},
    "analogy": {"analogy", "aam", "render", "numpy", "scipy", "cv2", "sksparse"},
    "render": {"render", "numpy", "cv2", "moderngl"},
    "app": OURS
    | {
        "numpy",
        "scipy",
        "cv2",
        "PIL",
        "av",
        "typer",
        "rich",
        "matplotlib",
        "distributed",
        "fsspec",
        "c2pa",
        "cryptography",
        "glfw",
        "moderngl_window",
        "platformdirs",
        "pyvirtualcam",
        "sounddevice",
        "fastapi",
        "nicegui",
        "aiortc",
        "starlette",
        "uvicorn",
    },
}
# A heavy or optional library -> the modules (files or folders) that may import it.
OWNERS = {
    "onnxruntime": {"aam/landmarks/onnx.py"},
    "skimage": {"aam/landmarks/boxes.py"},
    "safetensors": {"aam/model.py"},
    "sksparse": {"analogy/solver.py"},
    "moderngl": {"render"},
    "av": {"app/media"},
    "PIL": {"app/media/profiles.py"},
    "c2pa": {"app/media/provenance.py"},
    "cryptography": {"app/media/provenance.py"},
    "matplotlib": {"app/measure/plot.py"},
    "distributed": {"app/deidentify/cluster.py"},
    "fsspec": {"app/deidentify/remote.py"},
    "platformdirs": {"app/live/models.py", "app/cli_studio.py"},
    "glfw": {"app/live/window.py"},
    "moderngl_window": {"app/live/window.py"},
    "pyvirtualcam": {"app/live/virtualcam.py"},
    "sounddevice": {"app/live/sound.py"},
    "nicegui": {"app/studio"},
    "aiortc": {"app/studio/rtc.py"},
    "fastapi": {"app/studio/server.py"},
    "starlette": {"app/studio"},
    "uvicorn": {"app/studio/server.py"},
}


def modules(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def imports(path: Path, root: Path = ROOT) -> Iterator[tuple[str, int]]:
    """Full names of what a module imports anywhere in it, with the line."""
    package = path.relative_to(root).parent.parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((name.name, node.lineno) for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            yield ".".join([*base, *((node.module,) if node.module else ())]), node.lineno


def wrong_imports(path: Path, allowed: set[str], root: Path = ROOT) -> list[str]:
    return [
        f"{path.relative_to(root)}:{line} imports {name}"
        for name, line in imports(path, root)
        if name.split(".")[0] not in allowed | sys.stdlib_module_names | {"__future__"}
    ]


@pytest.mark.parametrize("package", sorted(OURS))
def test_packages_import_only_what_is_below_them(package: str) -> None:
    files = modules(package)
    assert len(files) >= 3
    assert [wrong for path in files for wrong in wrong_imports(path, MAY_IMPORT[package])] == []


@pytest.mark.parametrize("library", sorted(OWNERS))
def test_a_heavy_library_has_one_owner(library: str) -> None:
    users = {
        path.relative_to(ROOT)
        for package in OURS
        for path in modules(package)
        if any(name.split(".")[0] == library for name, _ in imports(path))
    }
    assert users, f"nothing imports {library}: drop it from the dependencies and from this list"
    owners = [Path(owner) for owner in OWNERS[library]]
    assert [str(u) for u in users if not any(u == o or o in u.parents for o in owners)] == []


def test_the_rule_sees_wrong_imports(tmp_path: Path) -> None:
    """The test itself can fail: nested, relative and renamed imports are all seen."""
    path = tmp_path / "aam" / "landmarks" / "made_up.py"
    path.parent.mkdir(parents=True)
    lines = [
        "import json",
        "from ..similarity import align",
        "from app import cli",
        "def f():",
        " import av",
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
    assert {name for name, _ in imports(path, tmp_path)} == {"json", "aam.similarity", "app", "av"}
    assert set(wrong_imports(path, MAY_IMPORT["aam"], tmp_path)) == {
        "aam/landmarks/made_up.py:3 imports app",
        "aam/landmarks/made_up.py:5 imports av",
    }
