"""MediaPipe's Face Landmarker over frames in a file, one timed pass for each line on stdin.

Run by the Python of the peers' environment (README.md), so it imports nothing of Guise.  The frames are (t, h, w, 3)
uint8 RGB in an .npy file; each pass prints the milliseconds of every frame and whether a face was found, as JSON.
"""

import json
import sys
import time

import mediapipe as mp
import numpy as np
from mediapipe.tasks import python as tasks
from mediapipe.tasks.python import vision

FRAME_MILLISECONDS = 33  # milliseconds from frame to frame


def main() -> None:
    """Arguments: the model bundle, the frames."""
    model, file = sys.argv[1:3]
    frames = np.load(file, mmap_mode="r")
    options = vision.FaceLandmarkerOptions(
        base_options=tasks.BaseOptions(model_asset_path=model),
        running_mode=vision.RunningMode.VIDEO,
        num_faces=1,
    )
    with vision.FaceLandmarker.create_from_options(options) as landmarker:
        clock = 0
        print("ready", flush=True)
        for _ in sys.stdin:
            times, found = [], 0
            for frame in frames:
                picture = mp.Image(image_format=mp.ImageFormat.SRGB, data=np.ascontiguousarray(frame))
                clock += FRAME_MILLISECONDS
                start = time.perf_counter()
                answer = landmarker.detect_for_video(picture, clock)
                times.append(1e3 * (time.perf_counter() - start))
                found += bool(answer.face_landmarks)
            print(json.dumps({"ms": times, "found": found}), flush=True)


if __name__ == "__main__":
    main()
