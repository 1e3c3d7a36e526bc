"""`guise analogy mesh register`, `landmarks` and `preview`: what they write."""
# ruff: noqa: F811 (fixtures)

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_work import HEAD, OTHER, SMILE, changed, coarse, moved, others, points, run, vertices  # noqa: F401

from guise.analogy.feature_points import FEATURE_POINT_NAMES

pytestmark = pytest.mark.slow


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
    assert after < 0.85 * before  # what is good was detected, and not exact either


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


def test_an_error_is_drawn_in_the_bands_of_the_paper(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import cv2

    way = vertices(SMILE) - vertices(HEAD)
    for name, more in (("off.obj", 1.003), ("far.obj", 1.1)):
        moved(SMILE, here / name, lambda at, more=more: vertices(HEAD) + more * way)  # type: ignore[misc]
    shown = {}
    for made in (SMILE, "off.obj", "far.obj"):
        call = ("preview", HEAD, made, "--truth", SMILE, "-o", "bands.png", "--force", "--json")
        code, out, _ = run(capsys, *call)
        shown[made] = json.loads(out)["error"]["below"], cv2.imread("bands.png")[40:480, 720:].mean((0, 1))
        assert code == 0
    assert [below > 0.9 for below, _ in shown.values()] == [True, False, False]
    assert [int(colour.argmax()) for _, colour in shown.values()] == [1, 0, 0]  # green, blue, and dark violet
    assert shown["far.obj"][1].mean() < shown["off.obj"][1].mean()


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
