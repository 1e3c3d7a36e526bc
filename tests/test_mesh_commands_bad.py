"""Mistakes in `guise analogy mesh`: one sentence, and nothing is left behind."""
# ruff: noqa: F811 (fixtures)

from collections.abc import Callable
from pathlib import Path

import pytest
from mesh_work import (  # noqa: F401
    HEAD,
    HEADS,
    MESH,
    OTHER,
    RIG,
    SMILE,
    changed,
    coarse,
    frames,
    points,
    run,
    vertices,
)

from guise.aam.similarity import Failed

pytestmark = pytest.mark.slow


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
    "a film as an avatar": (
        lambda at: ("sequence", HEAD, frames(at / "in"), "--target", HEAD, "-o", "x.vrm"), "must be a folder, or end in .glb",  # noqa: E501
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
    "a truth of nothing": (lambda at: ("preview", HEAD, "--truth", OTHER, "-o", "x.png"), "give the result"),
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
