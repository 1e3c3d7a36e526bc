"""For the tests of `guise analogy mesh`: the sample heads, changed copies of them, and the commands.

`from mesh_work import coarse, points  # noqa: F401` gives a test module the fixtures.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from made_up import SAMPLES

from guise.app.cli.main import main

HEADS = SAMPLES / "heads"
HEAD, SMILE, SURPRISE, OTHER, RIG = (
    str(HEADS / name) for name in ("mean.obj", "mean_smile.obj", "mean_surprise.obj", "other.obj", "mean.glb")
)
MESH = ("analogy", "mesh")


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    code = main([*MESH, *arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


def vertices(path: Path | str) -> np.ndarray:
    lines = Path(path).read_text().splitlines()
    return np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)


def others(path: Path | str) -> list[str]:
    """The lines of an OBJ file that are no vertices."""
    return [line for line in Path(path).read_text().splitlines() if not line.startswith("v ")]


def changed(source: str, target: Path, change: Callable[[list[str]], list[str]]) -> str:
    """A copy of a file with other lines."""
    target.write_text("\n".join(change(Path(source).read_text().splitlines())) + "\n")
    return str(target)


def moved(source: str, target: Path, change: Callable[[np.ndarray], np.ndarray]) -> str:
    """A copy of an OBJ file with other vertices."""
    rows = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in change(vertices(source))]
    target.write_text("\n".join([*rows, *others(source)]) + "\n")
    return str(target)


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    """Pictures are drawn with one sample a pixel, which is quicker."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("guise.render.shaded._SAMPLES", 1)
        yield


@pytest.fixture(scope="module")
def points(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Files of feature points of both heads, found once."""
    folder = tmp_path_factory.mktemp("points")
    made = []
    for head in (HEAD, OTHER):
        made.append(str(folder / f"{Path(head).stem}.json"))
        assert main([*MESH, "landmarks", head, "-o", made[-1], "-q"]) == 0
    return made[0], made[1]


def corners(points: tuple[str, str], which: int = 1) -> np.ndarray:
    found = json.loads(Path(points[which]).read_text())
    return np.array([found["mouth_corner_right"], found["mouth_corner_left"]])


def frames(folder: Path, count: int = 4) -> str:
    """A folder in which the mean head smiles more and more; frame 10 comes last."""
    folder.mkdir()
    start, end = vertices(HEAD), vertices(SMILE)
    for k in range(count):
        name = folder / f"f{k if k < count - 1 else 10}.obj"
        moved(HEAD, name, lambda at, k=k: at + (end - start) * k / (count - 1))  # type: ignore[misc]
    return str(folder)
