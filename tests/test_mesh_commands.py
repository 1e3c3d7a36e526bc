"""`guise analogy mesh`: what the commands write, what they refuse, and that nothing half-done is left behind."""

import errno
import json
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.similarity import Failed
from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.formats.files import MeshFile, read_frames, read_mesh, read_rig
from guise.analogy.formats.gltf_container import GL_ARRAY_BUFFER, GltfContainer
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


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, so that messages hold short names."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


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


def test_help_of_the_groups_is_no_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys)
    assert (code, err) == (0, "")
    for command in ("transfer", "rig", "sequence", "register", "landmarks", "preview"):
        assert command in out
    assert main(["analogy"]) == 0
    assert "mesh" in capsys.readouterr().out


@pytest.fixture(scope="module")
def smiling(tmp_path_factory: pytest.TempPathFactory, points: tuple[str, str]) -> Path:
    """A folder in which the mean head's expressions were carried over to the other."""
    folder = tmp_path_factory.mktemp("smiling")
    extra = ("--picture", str(folder / "out.png"), "--report", str(folder / "out.json"))
    call = (
        "transfer",
        HEAD,
        SMILE,
        SURPRISE,
        "--target",
        OTHER,
        "-o",
        str(folder / "out"),
        "--landmarks",
        *points,
    )
    assert main([*MESH, *call, *extra, "-q"]) == 0
    return folder


def test_transfer_writes_each_expression_in_the_targets_format_and_order(
    smiling: Path, points: tuple[str, str]
) -> None:
    assert sorted(path.name for path in smiling.rglob("*") if path.is_file()) == [
        "mean_smile.obj", "mean_surprise.obj", "out.json", "out.png",
    ]  # fmt: skip
    neutral, smile = vertices(OTHER), vertices(smiling / "out" / "mean_smile.obj")
    assert others(smiling / "out" / "mean_smile.obj") == others(OTHER)
    near = [int(np.linalg.norm(neutral - at, axis=1).argmin()) for at in corners(points)]
    way = (smile - neutral)[near]
    assert (way[:, 1] > 0.03).all()  # up, in decimetres
    assert way[0, 0] < -0.02 < 0.02 < way[1, 0]  # apart


def test_the_report_says_what_was_done_and_how_well(smiling: Path) -> None:
    report = json.loads((smiling / "out.json").read_text())
    assert (report["method"], report["kind"], report["picture"]) == (
        "tents",
        "expression",
        str(smiling / "out.png"),
    )
    assert report["correspondence"]["kind"] == "dense"
    assert report["correspondence"]["found"] > 0.95
    assert [Path(one["output"]).name for one in report["expressions"]] == [
        "mean_smile.obj",
        "mean_surprise.obj",
    ]
    furthest = np.linalg.norm(vertices(smiling / "out" / "mean_smile.obj") - vertices(OTHER), axis=1).max()
    assert report["expressions"][0]["furthest"] == pytest.approx(furthest, rel=1e-3)
    assert 0 < report["expressions"][0]["error"]["median"] < 0.3
    assert {"reading", "landmarks", "matching", "preparing", "carrying"} <= set(report["seconds"])
    assert set(report["versions"]) == {"guise", "solver"}


def test_a_head_of_the_same_faces_needs_no_face_to_be_found(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, "transfer", HEAD, SMILE, HEAD, "--target", HEAD, "-o", "out", "--json")
    assert code == 0
    report = json.loads(out)
    assert report["correspondence"] == {"kind": "vertex to vertex", "found": 1.0}
    way = np.linalg.norm(vertices(SMILE) - vertices(HEAD), axis=1).max()
    assert np.abs(vertices(here / "out" / "mean_smile.obj") - vertices(SMILE)).max() < 1e-3 * way
    assert np.abs(vertices(here / "out" / "mean.obj") - vertices(HEAD)).max() < 1e-5
    assert report["expressions"][1]["error"] is None


def test_without_a_folder_expressions_go_beside_the_target(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(HEAD, "head.obj")
    assert run(capsys, "transfer", HEAD, SMILE, "--target", "head.obj", "-q") == (0, "", "")
    assert sorted(path.name for path in here.iterdir()) == ["head.obj", "head_expressions"]
    assert [path.name for path in (here / "head_expressions").iterdir()] == ["mean_smile.obj"]


@pytest.mark.parametrize("method", ["tents", "gradients", "cloning"])
def test_every_method_gives_a_larger_head_of_the_same_faces_a_larger_smile(
    here: Path, capsys: pytest.CaptureFixture[str], method: str
) -> None:
    large = moved(HEAD, here / "large.obj", lambda at: 2 * at)
    code, _, err = run(capsys, "transfer", HEAD, SMILE, "--target", large, "-o", "out", "--method", method)
    assert (code, err) == (0, "")
    assert np.abs(vertices(here / "out" / "mean_smile.obj") - 2 * vertices(SMILE)).max() < 0.01


def test_a_cylinder_matches_heads_too(
    here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    call = ("transfer", HEAD, SMILE, "--target", OTHER, "-o", "out", "--landmarks", *points, "--json")
    code, out, _ = run(capsys, *call, "--correspondence", "cylinder")
    assert (code, json.loads(out)["correspondence"]["kind"]) == (0, "cylinder")
    neutral, smile = vertices(OTHER), vertices(here / "out" / "mean_smile.obj")
    near = [int(np.linalg.norm(neutral - at, axis=1).argmin()) for at in corners(points)]
    assert ((smile - neutral)[near, 1] > 0.02).all()


def test_heads_far_apart_are_aligned_and_it_is_said(
    here: Path, smiling: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    far = moved(OTHER, here / "far.obj", lambda at: 10 * at @ turn.T + 7)
    given = {
        name: (10 * turn @ at + 7).tolist() for name, at in json.loads(Path(points[1]).read_text()).items()
    }
    (here / "far.json").write_text(json.dumps(given))
    call = ("transfer", HEAD, SMILE, "--target", far, "-o", "out", "--landmarks", points[0], "far.json")
    code, _, err = run(capsys, *call)
    assert code == 0
    (degrees,) = re.findall(
        r"not roughly aligned \(the target is turned by (\d+) degrees and 9\.\d+ times", err
    )
    assert 85 <= int(degrees) <= 95
    straight = 10 * vertices(smiling / "out" / "mean_smile.obj") @ turn.T + 7
    assert np.abs(vertices(here / "out" / "mean_smile.obj") - straight).max() < 0.05  # of 28 across


def test_a_rig_keeps_the_names_and_gives_what_transfer_gives(
    here: Path, smiling: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = run(capsys, "rig", RIG, "--target", OTHER, "-o", "other.glb", "--landmarks", *points)
    assert (code, err) == (0, "")
    made, source = read_rig(here / "other.glb"), read_rig(Path(RIG))
    assert made.names == source.names == ("anger", "blink", "open", "pucker", "smile", "surprise")
    assert out.startswith("other.glb: 6 morph targets, ")
    smile = read_mesh(Path(OTHER)).read_expression(smiling / "out" / "mean_smile.obj")
    assert made.shapes.shape == (6, *smile.shape)
    assert np.abs(made.shapes[4] - smile).mean() < 1e-4  # the source's vertices are rounded
    assert np.isfinite(made.shapes).all()


def animated(path: Path, weights: np.ndarray) -> str:
    """A copy of the rig whose morph targets have weights (f, k), 30 a second."""
    held = GltfContainer.read(Path(RIG).read_bytes(), HEADS)
    times = np.arange(len(weights), dtype=np.float32)[:, None] / np.float32(30)
    values = weights.astype(np.float32).reshape(-1, 1)
    sampler = {
        "input": held.append_accessor(times, GL_ARRAY_BUFFER),
        "output": held.append_accessor(values, GL_ARRAY_BUFFER),
    }
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    held.json["animations"] = [{"samplers": [sampler], "channels": [channel]}]
    path.write_bytes(held.to_glb())
    return str(path)


def frames(folder: Path, count: int = 4) -> str:
    """A folder in which the mean head smiles more and more; frame 10 comes last."""
    folder.mkdir()
    start, end = vertices(HEAD), vertices(SMILE)
    for k in range(count):
        name = folder / f"f{k if k < count - 1 else 10}.obj"
        moved(HEAD, name, lambda at, k=k: at + (end - start) * k / (count - 1))  # type: ignore[misc]
    return str(folder)


def test_a_sequence_is_carried_over_frame_by_frame_and_resumed(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ("sequence", HEAD, frames(here / "in"), "--target", HEAD, "-o", "out")
    assert run(capsys, *call, "--json")[0] == 0
    assert sorted(path.name for path in (here / "out").iterdir()) == ["f0.obj", "f1.obj", "f10.obj", "f2.obj"]
    still, some, most = (vertices(here / "out" / name) for name in ("f0.obj", "f1.obj", "f10.obj"))
    assert np.abs(still - vertices(HEAD)).max() < 1e-6
    assert 0.2 < np.linalg.norm(some - still) / np.linalg.norm(most - still) < 0.45

    assert run(capsys, *call) == (
        2, "", "error: out holds 4 .obj files: use --resume to do only the rest, --force to replace them, or another "
        "folder with -o\n",
    )  # fmt: skip
    (here / "out" / "f2.obj").unlink()
    before = (here / "out" / "f1.obj").stat().st_mtime_ns
    code, out, _ = run(capsys, *call, "--resume", "--json")
    report = json.loads(out)
    assert (code, report["skipped"], len(report["expressions"])) == (0, 3, 1)
    assert (here / "out" / "f1.obj").stat().st_mtime_ns == before
    assert (here / "out" / "f2.obj").exists()


def test_an_interrupted_sequence_keeps_its_frames(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from guise.analogy.transfer import Transfer

    call, calls = Transfer.__call__, 0

    def interrupted(self: Transfer, expressive: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        if calls == 3:
            raise KeyboardInterrupt
        return call(self, expressive)

    monkeypatch.setattr(Transfer, "__call__", interrupted)
    said = run(capsys, "sequence", HEAD, frames(here / "in"), "--target", HEAD, "-o", "out")
    assert said == (130, "", "error: interrupted; 2 frames are kept in out: continue with --resume\n")
    assert sorted(path.name for path in (here / "out").iterdir()) == ["f0.obj", "f1.obj"]


def test_an_interrupted_transfer_says_what_is_written(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write = MeshFile.write

    def interrupted(self: MeshFile, path: Path, at: np.ndarray) -> None:
        if path.stem == "mean_surprise":
            raise KeyboardInterrupt
        write(self, path, at)

    monkeypatch.setattr(MeshFile, "write", interrupted)
    said = run(capsys, "transfer", HEAD, SMILE, SURPRISE, "--target", HEAD, "-o", "out")
    assert said == (130, "", "error: interrupted; 1 of 2 files are written\n")


@pytest.mark.parametrize("command", ["transfer", "rig", "sequence", "register"])
def test_a_full_disk_leaves_nothing_half_written(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    write = Path.write_bytes

    def full(self: Path, data: bytes) -> int:
        if here not in self.absolute().parents:
            return write(self, data)
        write(self, data[:100])
        raise OSError(errno.ENOSPC, "no space")

    shutil.copy(RIG, "mean.glb")
    (here / "in").mkdir()
    shutil.copy(SMILE, here / "in")
    calls = {
        "transfer": (HEAD, SMILE, "--target", HEAD, "-o", "out"),
        "rig": (RIG, "--target", "mean.glb", "-o", "out.glb"),
        "sequence": (HEAD, "in", "--target", HEAD, "-o", "out"),
        "register": (HEAD, HEAD, "-o", "out.obj"),
    }
    before = {path for path in here.rglob("*") if path.is_file()}
    monkeypatch.setattr(Path, "write_bytes", full)
    code, _, err = run(capsys, command, *calls[command])
    assert (code, err) == (2, "error: the disk is full: free some space, or write to another disk\n")
    assert {path for path in here.rglob("*") if path.is_file()} == before


def test_an_animated_rig_is_a_sequence(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    weights = np.zeros((3, 6))
    weights[1:, 4] = 0.5, 1.0
    film = animated(here / "film.glb", weights)
    shutil.copy(RIG, "mean.glb")
    assert run(capsys, "sequence", "mean.glb", film, "--target", "mean.glb", "-o", "keys", "-q") == (
        0,
        "",
        "",
    )
    assert sorted(path.name for path in (here / "keys").iterdir()) == ["0000.glb", "0001.glb", "0002.glb"]
    last, smile = read_mesh(here / "keys" / "0002.glb").mesh.vertices, read_rig(Path(RIG)).shapes[4]
    assert np.abs(last - smile).max() < 1e-3
    fast = ("sequence", "mean.glb", film, "--target", "mean.glb", "-o", "fast", "-q", "--fps", "120")
    assert run(capsys, *fast) == (0, "", "")
    assert len(list((here / "fast").iterdir())) == 9


def test_a_sequence_becomes_a_film_whose_frames_are_those_of_the_files(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = frames(here / "in", 6)
    call = ("sequence", HEAD, source, "--target", HEAD, "-q", "-o")
    assert run(capsys, *call, "files") == (0, "", "")
    assert run(capsys, *call, "film.glb", "--fps", "12") == (0, "", "")
    rest = read_mesh(here / "film.glb")
    shown = list(read_frames(here / "film.glb", rest))
    assert len(shown) == 6
    assert len(read_rig(here / "film.glb").names) < len(shown)
    size = np.ptp(rest.mesh.vertices, axis=0).max()
    for name, (_, vertices_there) in zip(("f0", "f1", "f2", "f3", "f4", "f10"), shown, strict=True):
        made = read_mesh(Path(HEAD)).read_expression(here / "files" / f"{name}.obj")
        assert np.linalg.norm(vertices_there - made, axis=1).max() < 2e-4 * size
    assert len(list(read_frames(here / "film.glb", rest, 24))) == 11  # 5 / 12 s


def test_register_writes_the_fitted_template_and_where_each_vertex_is_on_it(
    here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = run(
        capsys, "register", HEAD, OTHER, "-o", "fitted.obj", "--landmarks", *points, "--picture", "fitted.png"
    )
    assert (code, err) == (0, "")
    assert out.startswith("fitted.obj, fitted.npz: ")
    assert sorted(path.name for path in here.iterdir()) == ["fitted.npz", "fitted.obj", "fitted.png"]
    assert others(here / "fitted.obj") == others(HEAD)
    with np.load(here / "fitted.npz") as held:
        corners, weights, found = held["corners"], held["weights"], held["found"]
    fitted, target = vertices(here / "fitted.obj"), vertices(OTHER)
    assert corners.shape == weights.shape == (len(target), 3)
    assert weights.sum(1) == pytest.approx(1)
    placed = np.einsum("nk,nki->ni", weights, fitted[corners])
    far = np.linalg.norm(placed - target, axis=1)[found]
    assert found.mean() > 0.95
    assert np.percentile(far, 95) < 0.05  # decimetres


def test_landmarks_are_corrected_by_vertex_and_by_position(
    here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    nose = vertices(HEAD)[297]
    (here / "edit.json").write_text(json.dumps({"chin": 1692, "nose_tip": nose.tolist()}))
    code, out, err = run(
        capsys, "landmarks", HEAD, "-o", "mean.json", "--edit", "edit.json", "--picture", "mean.png"
    )
    assert (code, err) == (0, "")
    assert out.startswith("mean.json: 20 feature points")
    made, before = (json.loads(Path(path).read_text()) for path in ("mean.json", points[0]))
    assert tuple(made) == FEATURE_POINT_NAMES
    assert made["chin"] == pytest.approx(vertices(HEAD)[1692], abs=1e-4)
    assert made["nose_tip"] == pytest.approx(nose, abs=1e-4)
    assert {name for name in FEATURE_POINT_NAMES if made[name] != before[name]} == {"chin", "nose_tip"}


def test_rough_points_become_those_that_look_like_a_templates(
    here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    like = ("--template", HEAD, "--template-landmarks", points[0])
    good = json.loads(Path(points[1]).read_text())
    noise = np.random.default_rng(2).normal(0, 0.03, (20, 3))  # of an eye width of about 0.9
    rough = {name: (at + off).tolist() for (name, at), off in zip(good.items(), noise, strict=True)}
    (here / "rough.json").write_text(json.dumps(rough))
    assert run(capsys, "landmarks", OTHER, "-o", "out.json", "--edit", "rough.json", *like, "-q")[0] == 0
    made = json.loads((here / "out.json").read_text())
    before, after = (
        np.mean([np.linalg.norm(np.subtract(one[name], good[name])) for name in FEATURE_POINT_NAMES])
        for one in (rough, made)
    )
    assert after < 0.7 * before


def test_vertices_of_feature_points_are_those_of_the_file(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Unreferenced vertices that come first shift the numbers of the clean mesh, not of the file."""

    def shifted(lines: list[str]) -> list[str]:
        faces = [
            " ".join(["f", *(str(int(k) + 2) for k in line.split()[1:])]) for line in lines if line[0] == "f"
        ]
        return ["v 0 0 0", "v 1 1 1", *(line for line in lines if line[0] == "v"), *faces]

    head = changed(HEAD, here / "head.obj", shifted)
    (here / "edit.json").write_text('{"chin": 1694}')
    assert run(capsys, "landmarks", head, "-o", "out.json", "--edit", "edit.json", "-q")[0] == 0
    assert json.loads((here / "out.json").read_text())["chin"] == pytest.approx(
        vertices(HEAD)[1692], abs=1e-4
    )


def test_previews_are_pictures_and_videos(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import cv2

    shutil.copy(HEAD, "head.obj")
    assert run(capsys, "preview", "head.obj")[:2] == (0, "written: head_preview.png\n")
    code, out, _ = run(capsys, "preview", HEAD, SMILE, "-o", "smile.png", "--json")
    way = np.linalg.norm(vertices(SMILE) - vertices(HEAD), axis=1)
    distances = json.loads(out)["distances"]
    assert code == 0
    assert distances == pytest.approx(
        {"mean": way.mean(), "p95": np.percentile(way, 95), "largest": way.max()}, rel=1e-3
    )
    one, two = cv2.imread("head_preview.png"), cv2.imread("smile.png")
    assert one.shape != two.shape
    assert one.std() > 10
    assert two.std() > 10


def test_a_preview_turns(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from guise.app.media import open_input
    from guise.app.meshes import pictures

    monkeypatch.setattr(pictures, "STYLE", replace(pictures.STYLE, turn_frames=4))
    assert run(capsys, "preview", HEAD, "-o", "turn.mp4", "-q") == (0, "", "")
    with open_input(here / "turn.mp4") as film:
        shown = [frame.rgb() for frame in film]
    assert len(shown) == 4
    assert np.abs(shown[0].astype(int) - shown[1]).mean() > 2


def boxes(_: list[str]) -> list[str]:
    """A cube: a mesh without a face on it."""
    corner = [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    return [*corner, "f 1 2 4 3", "f 5 7 8 6", "f 1 5 6 2", "f 3 4 8 7", "f 1 3 7 5", "f 2 6 8 4"]


def with_nan(lines: list[str]) -> list[str]:
    return [lines[0], "v nan 0 0", *lines[2:]]


BAD: dict[str, tuple[Callable[[Path], tuple[str, ...]], str]] = {
    "missing source": (
        lambda at: ("transfer", "none.obj", SMILE, "--target", OTHER, "-o", "out"), "none.obj: the file does not exist",
    ),
    "missing target": (
        lambda at: ("transfer", HEAD, SMILE, "--target", "none.obj", "-o", "out"), "none.obj: the file does not exist",
    ),
    "missing expression": (
        lambda at: ("transfer", HEAD, "none.obj", "--target", OTHER, "-o", "out"), "none.obj: the file does not exist",
    ),
    "a folder": (lambda at: ("transfer", HEAD, SMILE, "--target", str(HEADS), "-o", "out"), "heads"),
    "not a mesh": (
        lambda at: ("transfer", HEAD, SMILE, "--target", str(Path(__file__)), "-o", "out"), "suffix must be .obj, .ply",
    ),
    "a picture called .obj": (
        lambda at: ("landmarks", changed(HEAD, at / "x.obj", lambda _: ["\x89PNG", "f 1 2 3"])), "x.obj",
    ),
    "a text called .glb": (
        lambda at: ("rig", changed(HEAD, at / "x.glb", lambda _: ["hello"]), "--target", OTHER, "-o", "r.glb"),
        "x.glb",
    ),
    "points alone": (
        lambda at: ("landmarks", changed(HEAD, at / "x.obj", lambda lines: [s for s in lines if s[0] == "v"])),
        "no faces",
    ),
    "an empty file": (lambda at: ("landmarks", changed(HEAD, at / "x.obj", lambda _: [])), "x.obj"),
    "not finite": (
        lambda at: ("transfer", HEAD, SMILE, "--target", changed(OTHER, at / "x.obj", with_nan), "-o", "out"),
        "x.obj: line 2",
    ),
    "an expression not finite": (
        lambda at: ("transfer", HEAD, SMILE, changed(SMILE, at / "x.obj", with_nan), "--target", OTHER, "-o", "out"),
        "x.obj",
    ),
    "another number of vertices": (
        lambda at: ("transfer", HEAD, SMILE, OTHER, "--target", OTHER, "-o", "out"), "has 4254 vertices, but its neutral",  # noqa: E501
    ),
    "an expression twice": (
        lambda at: ("transfer", HEAD, SMILE, SMILE, "--target", OTHER, "-o", "out"), "two outputs have that name",
    ),
    "over an input": (
        lambda at: ("transfer", HEAD, SMILE, "--target", OTHER, "-o", str(HEADS), "--force"), "is an input",
    ),
    "a file for a folder": (
        lambda at: ("transfer", HEAD, SMILE, "--target", OTHER, "-o", changed(HEAD, at / "out.obj", list)), "is a file",
    ),
    "no folder for the picture": (
        lambda at: ("transfer", HEAD, SMILE, "--target", OTHER, "-o", "out", "--picture", "none/x.png"), "no folder none",  # noqa: E501
    ),
    "a rig of another format": (lambda at: ("rig", RIG, "--target", OTHER, "-o", "x.obj"), "x.obj must end in .glb"),
    "no morph targets": (lambda at: ("rig", HEAD, "--target", OTHER, "-o", "x.glb"), "no morph targets"),
    "no animation": (lambda at: ("sequence", RIG, RIG, "--target", OTHER, "-o", "out"), "no animation"),
    "an empty sequence": (lambda at: ("sequence", HEAD, str(at), "--target", OTHER, "-o", "out"), "no OBJ or PLY"),
    "a sequence onto itself": (
        lambda at: ("sequence", HEAD, frames(at / "in"), "--target", OTHER, "-o", "in"), "contains the input frames",
    ),
    "no frames a second": (
        lambda at: ("sequence", HEAD, frames(at / "in"), "--target", HEAD, "--fps", "0", "-o", "out"), "--fps",
    ),
    "a film that goes on": (
        lambda at: ("sequence", HEAD, frames(at / "in"), "--target", HEAD, "-o", "x.glb", "--resume"), "--resume needs a folder",  # noqa: E501
    ),
    "no face to mark": (
        lambda at: ("landmarks", changed(HEAD, at / "box.obj", boxes)), "give all 20 points with --edit",
    ),
    "no such feature point": (
        lambda at: ("landmarks", HEAD, "--edit", changed(HEAD, at / "e.json", lambda _: ['{"ear": 1}']), "-o", "x.json"),  # noqa: E501
        "'ear' is not a feature point",
    ),
    "no such vertex": (
        lambda at: ("landmarks", HEAD, "--edit", changed(HEAD, at / "e.json", lambda _: ['{"chin": 99999}']), "-o", "x"),  # noqa: E501
        "a vertex from 0 to 4277",
    ),
    "missing landmarks": (
        lambda at: ("register", HEAD, OTHER, "--landmarks", "none.json", "auto", "-o", "x.obj"), "none.json",
    ),
    "a fitted template of another format": (
        lambda at: ("register", HEAD, OTHER, "-o", "x.ply"), ".obj",
    ),
    "a preview of two heads": (lambda at: ("preview", HEAD, OTHER, "-o", "x.png"), "vertices"),
    "a preview that is no picture": (lambda at: ("preview", HEAD, "-o", "x.xyz"), "x.xyz"),
}  # fmt: skip


@pytest.mark.parametrize("name", list(BAD))
def test_a_mistake_is_one_sentence_and_leaves_nothing(
    here: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    call, sentence = BAD[name]
    arguments = call(here)
    before = sorted(here.rglob("*"))
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert sentence in err
    assert sorted(here.rglob("*")) == before


def test_without_a_face_on_the_target_its_points_are_asked_for(
    here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "guise.app.meshes.points.find_feature_points", lambda _: Failed("no face was found: look again")
    )
    box = changed(OTHER, here / "box.obj", boxes)
    call = ("transfer", HEAD, SMILE, "--target", box, "-o", "out", "--landmarks", points[0], "auto")
    assert run(capsys, *call) == (
        2, "", f"error: {box}: no face was found; give its feature points with --landmarks, from a file that `guise "
        "analogy mesh landmarks MESH --edit FILE` writes\n",
    )  # fmt: skip
    assert not (here / "out").exists()


def test_an_output_is_replaced_only_when_asked(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call = ("transfer", HEAD, SMILE, "--target", HEAD, "-o", "out", "-q")
    assert run(capsys, *call)[0] == 0
    assert run(capsys, *call) == (
        2, "", "error: out/mean_smile.obj exists: use --force to replace it, or choose another name\n",
    )  # fmt: skip
    assert run(capsys, *call, "--force") == (0, "", "")


def doubled(lines: list[str]) -> list[str]:
    """A face twice, one without area, one on an edge of two others, and vertices in no face."""
    face = next(line for line in lines if line[0] == "f").split()[1:]
    return [
        *lines,
        "v 9 9 9",
        f"f {' '.join(face)}",
        f"f {face[0]} {face[1]} {face[1]}",
        f"f {face[0]} {face[1]} 2000",
    ]


def holed(lines: list[str]) -> list[str]:
    """Every twentieth face left out, which leaves open holes and some vertices in no face."""
    return [line for number, line in enumerate(lines) if line[0] != "f" or number % 20]


def with_eye(lines: list[str]) -> list[str]:
    """A part of its own before the right corner of the other head's mouth: a tetrahedron."""
    count = sum(line[0] == "v" for line in lines)
    own = ["v -0.25 6.66 1.52", "v -0.22 6.66 1.52", "v -0.25 6.69 1.52", "v -0.25 6.66 1.55"]
    faces = [
        " ".join(["f", *(str(count + k) for k in face)])
        for face in ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4))
    ]
    return [
        *(line for line in lines if line[0] != "f"),
        *own,
        *(line for line in lines if line[0] == "f"),
        *faces,
    ]


def flawed(lines: list[str]) -> list[str]:
    return with_eye(doubled(lines))


@pytest.mark.parametrize("change", [flawed, holed])
def test_a_target_with_flaws_gets_a_smile_as_well(
    here: Path, smiling: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str],
    change: Callable[[list[str]], list[str]],
) -> None:  # fmt: skip
    target = changed(OTHER, here / "flawed.obj", change)
    code, _, err = run(
        capsys, "transfer", HEAD, SMILE, "--target", target, "-o", "out", "--landmarks", *points
    )
    assert (code, err) == (0, "")
    made, whole = vertices(here / "out" / "mean_smile.obj"), vertices(smiling / "out" / "mean_smile.obj")
    assert others(here / "out" / "mean_smile.obj") == others(target)
    assert np.isfinite(made).all()
    way = np.linalg.norm(whole - vertices(OTHER), axis=1)
    off = np.linalg.norm(made[: len(whole)] - whole, axis=1)
    assert off.mean() < 0.2 * way.mean()


@pytest.mark.parametrize("change", [flawed, holed])
def test_a_source_with_flaws_gives_its_smile(
    here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str],
    change: Callable[[list[str]], list[str]],
) -> None:  # fmt: skip
    rest, smile = changed(HEAD, here / "rest.obj", change), changed(SMILE, here / "mean_smile.obj", change)
    given = ("--target", OTHER, "--landmarks", *points, "--correspondence", "cylinder")
    for source, expression, folder in ((rest, smile, "out"), (HEAD, SMILE, "whole")):
        assert run(capsys, "transfer", source, expression, *given, "-o", folder, "-q") == (0, "", "")
    made, whole = (vertices(here / folder / "mean_smile.obj") for folder in ("out", "whole"))
    way = np.linalg.norm(whole - vertices(OTHER), axis=1)
    assert np.linalg.norm(made - whole, axis=1).mean() < 0.2 * way.mean()


def test_rigid_parts_stay_when_asked(
    here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    target = changed(OTHER, here / "head.obj", with_eye)
    given = ("--landmarks", *points, "--correspondence", "cylinder")
    call = ("transfer", HEAD, SMILE, "--target", target, *given, "-q")
    assert run(capsys, *call, "-o", "kept", "--keep-rigid")[0] == 0
    assert run(capsys, *call, "-o", "free")[0] == 0
    kept, free = (vertices(here / folder / "mean_smile.obj")[-4:] for folder in ("kept", "free"))
    assert np.abs(kept - vertices(target)[-4:]).max() < 1e-3
    assert np.abs(free - vertices(target)[-4:]).max() > 5e-3
