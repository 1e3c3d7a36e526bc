"""From clips to a swapped video by commands alone, each in its own process."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clips import cut, pictures
from made_up import SAMPLES

from guise.aam.landmarks.schemes import CHIN, OUTER_EYE_CORNERS


def guise(folder: Path, *arguments: str) -> dict[str, Any]:
    """The JSON object that a command prints."""
    command = [sys.executable, "-W", "error", "-m", "guise", *arguments, "--json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report: dict[str, Any] = json.loads(done.stdout)
    return report


@pytest.mark.timeout(300)
def test_two_clips_become_a_swapped_video(tmp_path: Path) -> None:
    """The swap of a person with themselves changes little, with another person more, and loses nobody."""
    for person in ("p01", "p06"):
        clip = str(SAMPLES / person / "talk.mp4")
        made = guise(
            tmp_path, "enroll", clip, "-o", f"{person}.guise", "--frames", "60", "--resolution", "96"
        )
        assert made["held_out_error"] < 2.0
    video = cut("p01", tmp_path / "clip.mp4", 24)
    changes = []
    for face in ("p01", "p06"):
        out = f"as_{face}.mkv"
        options = ["--identity", f"{face}.guise", "--source", "p01.guise", "-o", out, "--lossless"]
        report = guise(tmp_path, "swap", str(video), *options)
        assert (report["frames"], report["swapped"]) == (24, 24)
        changes.append(_change(video, tmp_path / out))
    assert changes[0] < 5
    assert changes[1] > max(2 * changes[0], 7)


def _change(before: Path, after: Path) -> float:
    """Mean absolute difference of grey levels between the eyes and the chin."""
    truth = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"]
    differences = []
    for points, one, two in zip(truth, pictures(before), pictures(after), strict=False):
        (x0, y0), (x1, _) = points[OUTER_EYE_CORNERS].astype(int)
        face = np.s_[y0 - 10 : int(points[CHIN, 1]) - 8, x0:x1]
        differences.append(np.abs(one[face].astype(float) - two[face]).mean())
    return float(np.mean(differences))
