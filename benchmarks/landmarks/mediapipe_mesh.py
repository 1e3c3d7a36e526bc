"""Which vertices of MediaPipe's 478-point mesh are the points of face81.

The landmarks beside the real clips are MediaPipe's answers as face81.  Run anew on frames of those clips, each point
of face81 falls on one vertex: the one of the smallest mean distance, derived by

    python -m benchmarks.landmarks.mediapipe_mesh --peers-python PEERS/bin/python

which prints the list and how far the points are from their vertices, and says whether FACE81 below is that list.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.landmarks.peers import MISSING, Peer
from benchmarks.landmarks.setting import skipped

NAME, TITLE = "landmarks.mediapipe_mesh", "MediaPipe's mesh as face81"
CLIPS = ("studio_d3", "address_o2", "phone_d13")
FRAMES = 40  # of each: the mesh is followed from the first frame on, as it was then

FACE81 = (
    127, 234, 93, 58, 172, 136, 149, 148, 152, 377, 378, 365, 397, 288, 323, 454, 356,  # jaw
    71, 63, 105, 66, 107, 336, 296, 334, 293, 301,  # brows
    168, 197, 5, 4, 75, 97, 2, 326, 305,  # nose
    33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380,  # eyes
    61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181,  # outer lips
    78, 82, 13, 312, 308, 317, 14, 87,  # inner lips
    162, 21, 54, 103, 67, 109, 10, 338, 297, 332, 284, 251, 389,  # forehead
)  # fmt: skip


def face81(mesh: F64) -> F64:
    """Points (..., 81, 2) of meshes (..., 478, 2)."""
    return np.asarray(mesh[..., list(FACE81), :])


def measure(options: argparse.Namespace) -> Report:
    """Mean distances between the given points and all vertices."""
    if options.peers_python is None:
        return skipped(NAME, TITLE, MISSING.format("MediaPipe"))
    distances = []
    for name in CLIPS:
        clip = common.real_clip(options.shared, name)
        model = options.shared / "models" / "face_landmarker.task"
        with Peer(options.peers_python, "video", model) as peer:
            for frame, points in zip(common.frames(clip), clip.points[:FRAMES], strict=False):
                for mesh in peer.meshes(frame.rgb()):
                    distances.append(np.linalg.norm(points[:, None] - mesh, axis=2))
    mean = np.mean(distances, axis=0)
    nearest = mean.argmin(1).tolist()
    same = sum(a == b for a, b in zip(nearest, FACE81, strict=True))
    rows = [(i, v, float(mean[i, v])) for i, v in enumerate(nearest)]
    report = Report(NAME, TITLE)
    report.criteria = [
        Criterion("points whose nearest vertex is the listed one", same, ">=", len(FACE81)),
        Criterion(
            "largest mean distance of a point from its vertex", float(mean.min(1).max()), "<=", 0.5, "px"
        ),
    ]
    report.tables = [Table(f"{len(distances)} frames", ("point", "vertex", "mean distance, px"), rows)]
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
