"""Size of the weights that the package holds, and the time to the first face in a fresh process.

The time is from the first line of a new Python process on: import, opening the landmarker, and finding the faces of a
720p frame; starting Python itself is reported separately.  One thread; the first process, which may read from a cold
disk, is discarded.  The target applies to processor time, which other load on the machine hardly changes; wall time is
reported beside it.
"""

from __future__ import annotations

from benchmarks.threads import one_thread

if __name__ == "__main__":
    one_thread("benchmarks.landmarks.footprint")

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import guise.aam as aam
from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.landmarks import setting

NAME, TITLE = "landmarks.footprint", "Size and start-up of the landmarker"
CLIP = "room_s18"
RUNS = 7
WEIGHTS = (".onnx", ".npz", ".safetensors", ".tflite")
ROOT = Path(__file__).parents[2]
CHILD = """
import time
marks = [(time.perf_counter(), time.process_time())]
mark = lambda: marks.append((time.perf_counter(), time.process_time()))
import json, sys
import numpy as np
from guise.aam.landmarks import open_landmarker
mark()
landmarker = open_landmarker(sys.argv[1])
mark()
faces = landmarker.detect(np.load(sys.argv[2]))
mark()
print(json.dumps([marks, len(faces)]))
"""


def weights(folder: Path) -> list[tuple[str, int]]:
    """Files of weights below a folder, and their bytes."""
    files = (file for file in sorted(folder.rglob("*")) if file.suffix in WEIGHTS)
    return [(str(file.relative_to(folder)), file.stat().st_size) for file in files]


def started(spec: str, frame: Path) -> tuple[F64, float, int]:
    """Seconds (3, 2) of import, opening and first search on the clock and of the processor, of the process, faces."""
    begin = time.perf_counter()
    command = [sys.executable, "-c", CHILD, spec, str(frame)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    whole = time.perf_counter() - begin
    marks, faces = json.loads(done.stdout)
    return np.diff(marks, axis=0), whole, int(faces)


def measure(options: argparse.Namespace) -> Report:
    """Size, then start-up."""
    report = Report(NAME, TITLE)
    files = weights(Path(aam.__file__).parent)
    size = sum(count for _, count in files) / 1e6
    report.criteria.append(Criterion("all weights in the package", size, "<=", 8.0, "MB"))
    report.tables.append(Table("Weights", ("file", "bytes"), files))
    if not (options.shared / "data" / "real" / f"{CLIP}.mp4").is_file():
        report.notes.append(f"Skipped: start-up, {CLIP} is not in {options.shared / 'data' / 'real'}.")
        return report
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "frame.npy"
        np.save(file, next(common.frames(common.real_clip(options.shared, CLIP))).rgb())
        runs = [started(options.landmarker, file) for _ in range(3 if options.quick else RUNS)][1:]
    if not runs[0][2]:
        report.notes.append("No face was found in the frame: the time is not that of a first face.")
    seconds = np.array([run[0] for run in runs])  # (runs, 3, 2)
    steps = np.concatenate([seconds, seconds.sum(1, keepdims=True)], axis=1)
    clock, processor = np.moveaxis(np.median(steps, axis=0), 1, 0)
    report.criteria.append(Criterion("import and first face, one core", float(processor[-1]), "<=", 1.0, "s"))
    names = ("import", "open", "first search", "all three")
    rows = [(n, float(p), float(c)) for n, p, c in zip(names, processor, clock, strict=True)]
    rows.append(
        ("the process with starting Python", float("nan"), float(np.median([run[1] for run in runs])))
    )
    columns = ("what", "processor, median, s", "clock, median, s")
    report.tables.append(Table(f"Start-up, {len(runs)} processes", columns, rows))
    return report


if __name__ == "__main__":
    common.run(measure, setting.arguments(__doc__))
