"""The demonstration makes what it names."""

import json
from pathlib import Path

import cv2
import pytest
from clips import pictures, tags

from guise.app.cli.main import main


@pytest.mark.timeout(300)
def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "demo"
    assert main(["demo", "-o", str(folder), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    names = ["contact_sheet.png", "p01.guise", "p06.guise", "side_by_side.mp4", "swapped.mp4"]
    assert sorted(file.name for file in folder.iterdir()) == names
    assert report["swap"]["swapped"] == report["swap"]["frames"] == 180
    beside, swapped = pictures(Path(report["side_by_side"])), pictures(Path(report["video"]))
    assert len(beside) == len(swapped) == 180
    assert beside[0].shape[1] == 2 * swapped[0].shape[1]
    assert cv2.imread(report["contact_sheet"]).shape[1] > 1500
    for video in ("side_by_side.mp4", "swapped.mp4"):
        assert tags(folder / video)["comment"].startswith("Synthetic face")
    assert main(["demo", "-o", str(folder), "-q"]) == 2
    assert "exists: use --force to replace it" in capsys.readouterr().err
