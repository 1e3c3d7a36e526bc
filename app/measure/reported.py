"""What a report of `guise deidentify` says about each face."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import tight_box
from guise.app.measure.faces import FaceTrack, MeasureError

NOT_REPORTED = "not in the report"  # of a face that the report does not mention


@dataclass(frozen=True, eq=False)
class ReportedFaces:
    """The rows of a report.

    Parameters
    ----------
    output : name of the file it is of.   done : names of what can be done.
    frames : (n,) ascending.   codes : (n,) index into done.   boxes : (n, 4) of the changed regions, pixels.
    donors : of the tracks that were swapped.
    """

    output: str
    done: tuple[str, ...]
    frames: NDArray[np.int64]
    codes: NDArray[np.int64]
    boxes: NDArray[np.float64]
    donors: tuple[str, ...]

    def states(self, face: FaceTrack) -> NDArray[np.str_]:
        """(n,) what was done with a face in each of its frames: of the regions that hold its middle the first one."""
        return np.array([self._state(f, p) for f, p in zip(face.frames.tolist(), face.points, strict=True)])

    def _state(self, frame: int, points: NDArray[Any]) -> str:
        start, stop = np.searchsorted(self.frames, [frame, frame + 1])
        box = tight_box(points)
        x, y = (box[:2] + box[2:]) / 2
        for row in range(start, stop):
            x0, y0, x1, y1 = self.boxes[row]
            if x0 <= x <= x1 and y0 <= y <= y1:
                return str(self.done[int(self.codes[row])])
        return NOT_REPORTED


def read_report(path: Path) -> ReportedFaces:
    """The report in a JSON file; MeasureError when it isn't one."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != "guise-report":
            raise KeyError("format")
        return _parsed(content)
    except FileNotFoundError as error:
        raise MeasureError(f"report expected at {path}, got no such file") from error
    except (OSError, ValueError, KeyError, TypeError, IndexError, OverflowError) as error:
        raise MeasureError(
            f"{path} must be a report that `guise deidentify` wrote, got something else"
        ) from error


def _parsed(content: dict[str, Any]) -> ReportedFaces:
    rows = [track["rows"] for track in content["tracks"]] + [content["bystanders"]["rows"]]
    columns = {
        key: np.concatenate([np.asarray(row[key], np.int64) for row in rows])
        for key in ("frame", "done", "x0", "y0", "x1", "y1")
    }
    order = np.argsort(columns["frame"], kind="stable")
    boxes = np.stack([columns[k] for k in ("x0", "y0", "x1", "y1")], axis=1).astype(np.float64)
    donors = {str(track["donor"]) for track in content["tracks"] if track["donor"]}
    return ReportedFaces(
        Path(str(content["output"])).name, tuple(content["done"]), columns["frame"][order],
        columns["done"][order], boxes[order], tuple(sorted(donors)),
    )  # fmt: skip
