"""Swap the face in pictures that come from anywhere: here OpenCV reads them.  CLIP_OF_FACE VIDEO OUT.mp4"""

import sys

import cv2

import guise

face, video, output = sys.argv[1:]
frames = cv2.VideoCapture(video)
size = (int(frames.get(cv2.CAP_PROP_FRAME_WIDTH)), int(frames.get(cv2.CAP_PROP_FRAME_HEIGHT)))
writer = cv2.VideoWriter(output, cv2.VideoWriter.fourcc(*"mp4v"), frames.get(cv2.CAP_PROP_FPS), size)
with guise.Swapper(guise.enroll(face), source=video) as swapper:
    while (taken := frames.read())[0]:
        writer.write(swapper(taken[1][..., ::-1])[..., ::-1])
writer.release()
