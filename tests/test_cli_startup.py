"""What a command imports: help loads no numbers, and swapping loads nothing that only enrolment needs."""

import subprocess
import sys
from pathlib import Path

from clips import cut
from models import model_file


def modules_after(statement: str, cwd: Path) -> set[str]:
    """Top-level modules in a new interpreter after a statement."""
    code = f"import sys\n{statement}\nprint(*{{name.split('.')[0] for name in sys.modules}}, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True, check=True)
    return set(done.stderr.split())


def test_help_imports_no_heavy_library(tmp_path: Path) -> None:
    loaded = modules_after("from guise.app.cli.main import main; main(['swap', '--help'])", tmp_path)
    assert loaded.isdisjoint({"numpy", "cv2", "av", "scipy", "skimage", "onnxruntime", "moderngl"})


def test_swapping_imports_nothing_of_enrolment(tmp_path: Path) -> None:
    clip = cut("p01", tmp_path / "clip.mp4", 4)
    arguments = [
        "swap", str(clip), "--identity", str(model_file("p06")), "--source", str(model_file("p01")), "-o", "out.mp4",
        "-q", "--renderer", "cpu",
    ]  # fmt: skip
    loaded = modules_after(f"from guise.app.cli.main import main; assert main({arguments!r}) == 0", tmp_path)
    assert {"numpy", "cv2", "av"} <= loaded
    assert loaded.isdisjoint({"scipy", "skimage", "rich"})
