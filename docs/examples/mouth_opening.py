"""How far the mouth of everybody in a video is open, as CSV.  VIDEO"""

import sys

import numpy as np

import guise
from guise.aam.landmarks import interocular

print("frame,face,opening")
for index, faces in enumerate(guise.landmarks(sys.argv[1])):
    for number, face in enumerate(faces):
        gap = np.linalg.norm(face.points[62] - face.points[66])
        print(f"{index},{number},{gap / interocular(face.points):.3f}")
