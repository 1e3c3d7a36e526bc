"""The wheel holds what the program needs, and needs only what it declares."""

import ast
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("aam", "analogy", "app", "render")
DISTRIBUTIONS = {
    "PIL": "pillow",
    "c2pa": "c2pa-python",
    "cv2": "opencv-contrib-python-headless",
    "moderngl_window": "moderngl-window",
    "skimage": "scikit-image",
    "sksparse": "scikit-sparse",
}
SMOKE = """
import sys
from pathlib import Path

wheel = Path(sys.argv[1])
import aam, analogy, app, render
assert all(wheel in Path(m.__file__).parents for m in (aam, analogy, app, render)), aam.__file__

import numpy as np
from guise.aam.landmarks import LbpDetector, to_face81
from guise.aam.reference import ReferenceFrame
from guise.app.cli.main import main
from render import make_compositor, probe_gl

frame = ReferenceFrame.canonical(32)
assert to_face81(frame.points[:68].astype(np.float32), "ibug68").shape == (81, 2)
assert LbpDetector().detect(np.zeros((120, 160, 3), np.uint8)).shape == (0, 4)
for renderer in ("cpu", "gl") if probe_gl() else ("cpu",):
    alpha = np.ones(frame.size, np.float32)
    make_compositor(renderer, frame.triangles, frame.points.astype(np.float32), alpha).close()
assert main(["--version"]) == 0
assert not {"pytest", "hypothesis"} & set(sys.modules)
print("fine")
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an unpacked wheel, built from a copy of what git tracks."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "-q",
        "--no-deps",
        "--disable-pip-version-check",
        "-w",
        folder,
    ]
    built = subprocess.run(
        [*command, copy_of_tree(folder / "tree")], capture_output=True, text=True, check=False
    )
    if built.returncode and re.search(
        "ConnectionError|NewConnection|No matching distribution|resolve", built.stderr
    ):
        pytest.skip("building a wheel needs setuptools from the package index, which cannot be reached")
    assert built.returncode == 0, built.stderr
    [file] = folder.glob("*.whl")
    with zipfile.ZipFile(file) as archive:
        archive.extractall(folder / "installed")
    return folder / "installed"


def copy_of_tree(to: Path) -> Path:
    """The source without what is not part of it (caches, build folders)."""
    import shutil

    to.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, to)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, to / package, ignore=shutil.ignore_patterns("__pycache__"))
    return to


def test_every_file_of_the_packages_is_in_the_wheel(wheel: Path) -> None:
    ours = {
        path.relative_to(ROOT)
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and path.suffix != ".pyc" and not path.name.startswith(".")
    }
    missing = {str(path) for path in ours if not (wheel / path).is_file()}
    assert missing == set()
    assert {Path("aam/data/face81.json"), Path("render/shaders/warp.vert.glsl"), Path("aam/py.typed")} <= ours


def test_nothing_else_is_in_the_wheel(wheel: Path) -> None:
    top = {path.name for path in wheel.iterdir() if not path.name.endswith(".dist-info")}
    assert top == set(PACKAGES)


def test_the_wheel_works_away_from_its_source(wheel: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(wheel)}
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", SMOKE, wheel],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines()[-1] == "fine"


def test_every_third_party_import_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split(r"[\[<>=!~ ]", d)[0].lower() for d in project["dependencies"]}
    for name, extra in project.get("optional-dependencies", {}).items():
        declared |= {re.split(r"[\[<>=!~ ]", d)[0].lower() for d in extra} if name != "dev" else set()
    imported = {
        name for package in PACKAGES for path in (ROOT / package).rglob("*.py") for name in top_levels(path)
    }
    foreign = imported - sys.stdlib_module_names - set(PACKAGES)
    assert {DISTRIBUTIONS.get(name, name) for name in foreign} <= declared


def test_every_dependency_has_a_range() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    everything = [
        *project["dependencies"],
        *(
            d
            for extra in project["optional-dependencies"].values()
            for d in extra
            if not d.startswith("guise-video[")
        ),
    ]
    assert [d for d in everything if not (">=" in d and ",<" in d)] == []


def test_help_is_quick_because_heavy_libraries_wait() -> None:
    """Nothing that takes long to load is imported until a command needs it."""
    heavy = "{'cv2', 'av', 'scipy', 'skimage', 'onnxruntime'}"
    code = f"import sys; import guise.app.cli.main; print(sorted({heavy} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def top_levels(path: Path) -> set[str]:
    """Top-level names of what a module imports absolutely."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {name.name.split(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            found.add(node.module.split(".")[0])
    return found - {"__future__"}
