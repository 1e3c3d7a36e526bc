"""The wheel has one name, holds what the program needs, needs what it declares, and works beside a foreign app."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from clips import cut, pictures, tags
from made_up import SAMPLES

from guise.aam.landmarks.schemes import CHIN, OUTER_EYE_CORNERS
from guise.common.kernels import COMPILED

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
FOLDERS = {
    "guise": "",
    "aam": "aam",
    "analogy": "analogy",
    "app": "app",
    "common": "common",
    "render": "render",
}
MOST_BYTES = 21e6
IMAGE = "/opt/guise"  # where the image has the environment
DISTRIBUTIONS = {
    "PIL": "pillow",
    "c2pa": "c2pa-python",
    "cv2": "opencv-contrib-python-headless",
    "moderngl_window": "moderngl-window",
    "pythonosc": "python-osc",
    "skimage": "scikit-image",
}
OWN_PROJECT = """
import sys
from pathlib import Path

import app
import render
import guise

assert app.NAME == render.NAME == "the project's own"
assert Path(sys.prefix) in Path(guise.__file__).parents, guise.__file__

import cv2

clip = Path(guise.__file__).parent / "samples" / "p01" / "talk2.mp4"
taken, picture = cv2.VideoCapture(str(clip)).read()
assert taken
[face] = guise.landmarks(picture[..., ::-1].copy())
assert face.points.shape == (81, 2)
with guise.Swapper("out/p06.guise", source="out/p01.guise") as swapper:
    swapped = swapper(picture[..., ::-1].copy())
    assert swapper.outcome == "swapped"
assert swapped.shape == picture.shape and (swapped != picture[..., ::-1]).any()
assert not {"pytest", "hypothesis", "aam", "analogy", "common"} & set(sys.modules)
print("fine")
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a copy of the source."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [
        sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--disable-pip-version-check", "-w", folder,
    ]  # fmt: skip
    built = subprocess.run(
        [*command, copy_of_tree(folder / "tree")], capture_output=True, text=True, check=False
    )
    skip_without_index(built)
    assert built.returncode == 0, built.stderr
    [file] = folder.glob("*.whl")
    return file


@pytest.fixture(scope="module")
def contents(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """A project with an app.py and a render/ of its own, and an environment of its own, made as the README says.

    The libraries that Guise needs are those of the environment that the tests run in.
    """
    folder = tmp_path_factory.mktemp("project")
    (folder / "render").mkdir()
    for file in ("app.py", "render/__init__.py"):
        (folder / file).write_text('NAME = "the project\'s own"\n', encoding="utf-8")
    (folder / "own.py").write_text(OWN_PROJECT, encoding="utf-8")
    tree, environment = copy_of_tree(folder / "tree"), with_libraries(externally_managed(folder / "python"))
    *lines, last = readme_lines()
    assert last == ".venv/bin/guise demo"
    for line in lines:
        in_shell(line, tree, environment)
    (folder / "env").symlink_to(tree / ".venv")
    return folder, environment


def readme_lines() -> list[str]:
    """What the README says to run with Python alone."""
    text = (ROOT / "README.md").read_text(encoding="utf-8").split("## Use\n")[0]
    return re.findall(r"^```sh\n(.*?)^```", text, re.M | re.S)[-1].splitlines()


def externally_managed(folder: Path) -> Path:
    """A Python that takes no packages, as that of Debian: this one, in a prefix of its own with the marker file."""
    stdlib = Path(sysconfig.get_path("stdlib"))
    lib = folder / "lib" / stdlib.name
    if lib.is_dir():
        return folder / "bin"
    lib.mkdir(parents=True)
    for path in stdlib.iterdir():
        if path.name != "site-packages":
            (lib / path.name).symlink_to(path)
    (lib / "site-packages").mkdir()
    (lib / "EXTERNALLY-MANAGED").unlink(missing_ok=True)
    (lib / "EXTERNALLY-MANAGED").write_text("[externally-managed]\nError=ask the system\n", encoding="utf-8")
    (folder / "bin").mkdir()
    for name in ("python", "python3"):
        shutil.copy(Path(sys._base_executable).resolve(), folder / "bin" / name)  # type: ignore[attr-defined]
    return folder / "bin"


def with_libraries(path: Path) -> dict[str, str]:
    """Environment variables: programs of a folder first, and the libraries of the tests for every Python."""
    return {
        **os.environ, "PATH": f"{path}:{os.environ['PATH']}", "PYTHONDONTWRITEBYTECODE": "1", "PIP_QUIET": "1",
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path.endswith("-packages")),
    }  # fmt: skip


def in_shell(line: str, folder: Path, environment: dict[str, str]) -> None:
    """Run a line as it stands; the test is skipped where it needs the package index and there is none."""
    done = subprocess.run(["sh", "-c", line], cwd=folder, env=environment, capture_output=True, text=True)
    skip_without_index(done)
    assert done.returncode == 0, (line, done.stderr)


def skip_without_index(done: subprocess.CompletedProcess[str]) -> None:
    if done.returncode and re.search(
        "ConnectionError|NewConnection|No matching distribution|resolve", done.stderr
    ):
        pytest.skip("building a wheel needs setuptools from the package index, which cannot be reached")


def copy_of_tree(to: Path) -> Path:
    """The source without what is not part of it (caches, build folders)."""
    to.mkdir()
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, to)
    for folder in (*FOLDERS, "sample_videos"):
        shutil.copytree(ROOT / folder, to / folder, ignore=shutil.ignore_patterns("__pycache__"))
    (to / "docs").mkdir()
    shutil.copy(ROOT / "docs" / "guise.1", to / "docs")
    return to


@pytest.mark.slow
def test_the_systems_python_refuses_and_the_lines_of_the_readme_do_not_need_it(
    project: tuple[Path, dict[str, str]],
) -> None:
    folder, environment = project
    run = partial(subprocess.run, cwd=folder / "tree", env=environment, capture_output=True, text=True)
    refused = run([folder / "python" / "bin" / "python3", "-m", "pip", "install", "."])
    assert (refused.returncode, "externally-managed-environment" in refused.stderr) == (1, True)
    done = run([folder / "env" / "bin" / "guise", "--version"])
    assert done.stdout == f"guise {PROJECT['project']['version']}\n"
    manual = (folder / "env" / "share" / "man" / "man1" / "guise.1").read_text(encoding="utf-8")
    assert manual == (ROOT / "docs" / "guise.1").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_lines_of_the_dockerfile_install_guise(tmp_path: Path) -> None:
    """Its first stage is run in a folder, with the environment in the place that the second one copies."""
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    build, final = [stage.splitlines() for stage in re.split(r"(?m)^FROM ", text)[1:]]
    assert [stage[0].split()[0] for stage in (build, final)] == ["python:3.12", "python:3.12-slim"]
    assert f"COPY --from=build {IMAGE} {IMAGE}" in final
    assert f"ENV PATH={IMAGE}/bin:$PATH HOME=/home/guise" in final
    assert 'ENTRYPOINT ["guise"]' in final
    source, made = tmp_path / "source", tmp_path / "opt"
    source.mkdir()
    for instruction in build[1:]:
        word, _, rest = instruction.partition(" ")
        if word == "COPY":
            *names, to = rest.split()
            in_shell(f"mkdir -p {source / to if len(names) > 1 else (source / to).parent}", ROOT, {})
            in_shell(f"cp -r {' '.join(names)} {source / to}", ROOT, {})
        elif word == "RUN":
            in_shell(
                rest.replace(IMAGE, str(made)), source, with_libraries(externally_managed(tmp_path / "py"))
            )
        else:
            assert (word, rest) in [("WORKDIR", "/source"), ("", "")]
    done = subprocess.run([made / "bin" / "guise", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"guise {PROJECT['project']['version']}\n"


@pytest.mark.slow
def test_every_file_of_the_packages_is_in_the_wheel(contents: set[str]) -> None:
    ours = {
        (Path("guise", place) / path.relative_to(ROOT / folder)).as_posix()
        for folder, place in FOLDERS.items()
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and path.suffix != ".pyc" and not path.name.startswith(".")
    }
    sources = {name for name in ours if name.startswith("guise/render/native/")}
    assert ours - contents == sources
    assert {"guise/aam/data/face81.json", "guise/render/shaders/warp.vert.glsl", "guise/py.typed"} <= ours


@pytest.mark.slow
def test_the_wheel_installs_one_name(contents: set[str]) -> None:
    top = {name.split("/")[0] for name in contents}
    assert {name for name in top if not name.endswith((".dist-info", ".data"))} == {"guise"}
    [manual] = [name for name in contents if ".data/" in name]
    assert manual.endswith(".data/data/share/man/man1/guise.1")


@pytest.mark.slow
def test_nothing_but_code_data_and_the_samples_that_commands_use_is_in_the_wheel(contents: set[str]) -> None:
    samples = {name for name in contents if name.startswith("guise/samples/")}
    assert {Path(name).parent.name for name in samples} == {"samples", "p01", "p06", "heads"}
    assert not [name for name in contents if re.search(r"/(tests|benchmarks|training)/", name)]


@pytest.mark.slow
def test_the_wheel_holds_kernels_for_every_python_from_the_oldest_on(wheel: Path, contents: set[str]) -> None:
    if COMPILED is None:
        pytest.skip("no C++ compiler is here")
    assert "-cp311-abi3-" in wheel.name
    assert [name for name in contents if name.startswith("guise/common/_kernels.")]


@pytest.mark.slow
def test_the_wheel_is_small(wheel: Path) -> None:
    assert wheel.stat().st_size <= MOST_BYTES


@pytest.mark.slow
def test_the_page_says_how_large_the_wheel_is(wheel: Path) -> None:
    text = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    [told] = re.findall(r"wheel of Guise itself is about (\d+) MB", text)
    assert abs(int(told) - wheel.stat().st_size / 1e6) < 1.0


@pytest.mark.timeout(300)
@pytest.mark.slow
def test_the_demo_runs_from_the_wheel_and_makes_what_it_names(project: tuple[Path, dict[str, str]]) -> None:
    folder, environment = project
    command = [folder / "env" / "bin" / "guise", "demo", "-o", "out"]
    run = partial(subprocess.run, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    done = run([*command, "--json"])
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    names = ["contact_sheet.png", "p01.guise", "p06.guise", "side_by_side.mp4", "swapped.mp4"]
    assert sorted(file.name for file in (folder / "out").iterdir()) == names
    assert report["swap"]["swapped"] == report["swap"]["frames"] == 180
    assert all(enrolment["held_out_error"] < 2 for enrolment in report["enrolments"])
    beside, swapped = pictures(folder / report["side_by_side"]), pictures(folder / report["video"])
    assert len(beside) == len(swapped) == 180
    assert beside[0].shape[1] == 2 * swapped[0].shape[1]
    assert cv2.imread(folder / report["contact_sheet"]).shape[1] > 1500
    for video in ("side_by_side.mp4", "swapped.mp4"):
        assert tags(folder / "out" / video)["comment"].startswith("Synthetic face")
    again = run([*command, "-q"])
    assert again.returncode == 2
    assert "exists: use --force to replace it" in again.stderr


@pytest.fixture
def enrolled(project: tuple[Path, dict[str, str]]) -> tuple[Path, dict[str, str]]:
    """The project with the people of the demonstration."""
    if not (project[0] / "out" / "p06.guise").is_file():
        pytest.fail("the demonstration did not leave its models")
    return project


@pytest.mark.slow
def test_a_persons_own_face_changes_them_little_and_anothers_more(
    enrolled: tuple[Path, dict[str, str]],
) -> None:
    folder, environment = enrolled
    video, changes = cut("p01", folder / "clip.mp4", 24), []
    for face in ("p01", "p06"):
        command = [
            folder / "env" / "bin" / "python", "-W", "error", "-m", "guise", "swap", video, "--identity",
            f"out/{face}.guise", "--source", "out/p01.guise", "-o", f"as_{face}.mkv", "--lossless", "--json",
        ]  # fmt: skip
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["swapped"] == 24
        changes.append(change(video, folder / f"as_{face}.mkv"))
    assert changes[0] < 5
    assert changes[1] > max(2 * changes[0], 7)


def change(before: Path, after: Path) -> float:
    """Mean absolute difference of grey levels between the eyes and the chin."""
    truth = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"]
    differences = []
    for points, one, two in zip(truth, pictures(before), pictures(after), strict=False):
        (x0, y0), (x1, _) = points[OUTER_EYE_CORNERS].astype(int)
        face = np.s_[y0 - 10 : int(points[CHIN, 1]) - 8, x0:x1]
        differences.append(np.abs(one[face].astype(float) - two[face]).mean())
    return float(np.mean(differences))


@pytest.mark.slow
def test_the_api_works_beside_a_foreign_app_and_render(enrolled: tuple[Path, dict[str, str]]) -> None:
    folder, environment = enrolled
    done = subprocess.run(
        [folder / "env" / "bin" / "python", "-W", "error", "own.py"],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "fine"


@pytest.mark.slow
def test_every_third_party_import_is_declared() -> None:
    declared = {requirement(d) for d in PROJECT["project"]["dependencies"]}
    for name, extra in PROJECT["project"]["optional-dependencies"].items():
        declared |= {requirement(d) for d in extra} if name != "dev" else set()
    imported = {
        name for folder in FOLDERS for path in (ROOT / folder).rglob("*.py") for name in top_levels(path)
    }
    foreign = imported - sys.stdlib_module_names - {"guise"}
    assert {DISTRIBUTIONS.get(name, name) for name in foreign} <= declared


def test_every_library_that_a_test_waits_for_is_declared() -> None:
    """A test of a library that nothing declares would be skipped everywhere, and nobody would see it."""
    declared = {
        requirement(d) for extra in PROJECT["project"]["optional-dependencies"].values() for d in extra
    }
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "tests").glob("*.py")]
    awaited = {name for text in texts for name in re.findall(r'importorskip\("(\w+)', text)}
    names = {DISTRIBUTIONS.get(name, name).replace("_", "-").lower() for name in awaited}
    assert names
    elsewhere = {"aiohttp", "bpy"}  # comes with fsspec[http]; 1.3 GB, in an environment of its own
    assert names <= declared | elsewhere


def test_every_dependency_has_a_range() -> None:
    extras = PROJECT["project"]["optional-dependencies"].values()
    everything = [*PROJECT["project"]["dependencies"], *(d for extra in extras for d in extra)]
    foreign = [d for d in everything if not d.startswith("guise-video[")]
    assert len(foreign) > 20
    assert [d for d in foreign if not (">=" in d and ",<" in d)] == []


def test_every_package_is_listed() -> None:
    """The build takes packages from a list, as they lie in folders of other names."""
    folders = {
        path.parent.relative_to(ROOT) for folder in FOLDERS for path in (ROOT / folder).rglob("__init__.py")
    }
    names = {".".join(("guise", *folder.parts)).replace("guise.guise", "guise") for folder in folders}
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == names | {"guise.samples"}


def test_help_is_quick_because_heavy_libraries_wait() -> None:
    """Nothing that takes long to load is imported until a command needs it."""
    heavy = "{'cv2', 'av', 'scipy', 'skimage', 'onnxruntime'}"
    code = f"import sys; import guise.app.cli.main; print(sorted({heavy} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_importing_guise_loads_nothing_else() -> None:
    code = "import sys; before = set(sys.modules); import guise; print(*set(sys.modules) - before)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in run.stdout.split()}
    assert "guise" in loaded
    assert loaded <= {"guise", *sys.stdlib_module_names}


def requirement(text: str) -> str:
    return re.split(r"[\[<>=!~ ]", text)[0].lower()


def top_levels(path: Path) -> set[str]:
    """Top-level names of what a module imports absolutely."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {name.name.split(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            found.add(node.module.split(".")[0])
    return found - {"__future__"}
