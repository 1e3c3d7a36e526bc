"""`guise analogy mesh transfer`, `rig` and `sequence`: what they write, and that nothing half-done is left behind."""
# ruff: noqa: F811 (fixtures)

import errno
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mesh_work import (  # noqa: F401
    HEAD,
    HEADS,
    MESH,
    OTHER,
    RIG,
    SMILE,
    SURPRISE,
    changed,
    coarse,
    corners,
    frames,
    moved,
    others,
    points,
    run,
    vertices,
)

from guise.analogy.formats.files import MeshFile, read_frames, read_mesh, read_rig
from guise.analogy.formats.gltf_container import GL_ARRAY_BUFFER, GltfContainer
from guise.app.cli.main import main

pytestmark = pytest.mark.slow


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


@pytest.mark.parametrize("method", ["tents", "deformable", "gradients", "cloning"])
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
    own = ["v -0.25 6.64 1.52", "v -0.22 6.64 1.52", "v -0.25 6.67 1.52", "v -0.25 6.64 1.55"]
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


@pytest.mark.parametrize(
    ("scale", "given", "noted"), [(12, (), True), (12, ("--unit", "cm"), False), (0.01, (), True)]
)
def test_a_head_of_another_unit_is_scaled_or_said(
    here: Path, points: tuple[str, str], capsys: pytest.CaptureFixture[str], scale: float, given: tuple[str, ...],
    noted: bool,
) -> None:  # fmt: skip
    """A head 29 m tall, as one is that was modelled in centimetres, gets a note unless its unit is given."""
    target = moved(HEAD, here / "target.obj", lambda at: at * scale)
    code, _, err = run(capsys, "rig", RIG, "--target", target, "-o", "out.glb", *given)
    assert code == 0
    assert ("m tall" in err) == noted
    size = np.ptp(read_rig(here / "out.glb").file.mesh.vertices, axis=0).max()
    assert size == pytest.approx(2.6164 * scale * (0.01 if given else 1), rel=1e-4)


@pytest.mark.parametrize("command", ["transfer", "rig", "register", "landmarks", "preview"])
def test_every_command_turns_a_mirrored_head_with_one_note(
    here: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    target = moved(OTHER, here / "mirror.obj", lambda at: at * (-1, 1, 1))
    calls = {
        "transfer": (HEAD, SMILE, "--target", target, "-o", "out"),
        "rig": (RIG, "--target", target, "-o", "out.glb"),
        "register": (HEAD, target, "-o", "out.obj"),
        "landmarks": (target, "-o", "out.json"),
        "preview": (target, "-o", "out.png"),
    }
    code, _, err = run(capsys, command, *calls[command])
    assert code == 0
    assert err.count("is inside out") == 1
