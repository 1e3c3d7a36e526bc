"""The scripts in docs/examples run as a researcher would run them, and are short."""

import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from clips import cut
from made_up import SAMPLES

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
HEADS = SAMPLES / "heads"
MOST_LINES = 15
FRAMES = 26  # a person is enrolled from no fewer than 24


def output_of(script: str, *arguments: object, cwd: Path) -> str:
    command = [sys.executable, "-W", "error", EXAMPLES / script, *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_examples_are_short(path: Path) -> None:
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    assert 5 <= len(lines) <= MOST_LINES


def test_there_are_five() -> None:
    assert len(list(EXAMPLES.glob("*.py"))) == 5


def test_swap_frames(tmp_path: Path) -> None:
    video = cut("p01", tmp_path / "video.mp4", FRAMES)
    face = cut("p06", tmp_path / "face.mp4", FRAMES)
    output_of("swap_frames.py", face, video, "out.mp4", cwd=tmp_path)
    written = cv2.VideoCapture(str(tmp_path / "out.mp4"))
    assert int(written.get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES


def test_mouth_opening(tmp_path: Path) -> None:
    rows = output_of("mouth_opening.py", cut("p02", tmp_path / "a.mp4", 12), cwd=tmp_path).splitlines()
    assert rows[0] == "frame,face,opening"
    assert [row.split(",")[:2] for row in rows[1:]] == [[str(n), "0"] for n in range(12)]
    assert all(0 <= float(row.split(",")[2]) < 0.8 for row in rows[1:])


def test_deidentify_folder_and_compare_tools(tmp_path: Path) -> None:
    videos = tmp_path / "videos"
    videos.mkdir()
    clip = cut("p01", videos / "a.mp4", FRAMES)
    (tmp_path / "outputs").mkdir()
    said = output_of("deidentify_folder.py", "videos", "outputs", cwd=tmp_path)
    [output] = (tmp_path / "outputs").glob("*.mp4")
    assert all(line.startswith("videos/a.mp4: ") for line in said.splitlines())
    measured = output_of("compare_tools.py", clip, output, cwd=tmp_path)
    assert output.name in measured
    assert "mouth" in measured


def test_animate_head(tmp_path: Path) -> None:
    target = tmp_path / "other.obj"
    target.write_bytes((HEADS / "other.obj").read_bytes())
    arguments = HEADS / "mean.obj", HEADS / "mean_smile.obj", target
    assert "other_expressions" in output_of("animate_head.py", *arguments, cwd=tmp_path)
    assert (tmp_path / "other_expressions" / "mean_smile.obj").is_file()
