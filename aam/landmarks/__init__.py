"""Landmark sources: annotation files, ONNX models described by a card, face-box detectors.

A landmarker finds faces with 81 points each (:class:`Face`); :func:`open_landmarker` opens one by a short
text, :func:`load_annotations` reads points from files, :func:`track_video` follows one face through a clip.
Pixels, x right, y down, pixel centres at integers; images RGB uint8 (h, w, 3).
"""

from guise.aam.landmarks.annotations import Annotations, load_annotations, save_annotations
from guise.aam.landmarks.boxes import CenterfaceDetector, LbpDetector, YunetDetector
from guise.aam.landmarks.card import LandmarkCard, read_card
from guise.aam.landmarks.face import BoxDetector, BoxFit, Face, Landmarker, LandmarkError, iou, tight_box
from guise.aam.landmarks.landmark_filter import LandmarkFilter
from guise.aam.landmarks.onnx import OnnxLandmarker
from guise.aam.landmarks.registry import (
    detector_usages,
    landmarker_usages,
    open_detector,
    open_landmarker,
    register_detector,
    register_landmarker,
)
from guise.aam.landmarks.schemes import (
    COUNT,
    FOREHEAD,
    GROUPS,
    INNER_LIPS,
    JAW,
    LEFT_BROW,
    LEFT_EYE,
    MIRROR,
    NOSE,
    OUTER_EYE_CORNERS,
    OUTER_LIPS,
    RIGHT_BROW,
    RIGHT_EYE,
    Scheme,
    interocular,
    mirror,
    register_scheme,
    scheme_named,
    to_face81,
)
from guise.aam.landmarks.tracking import FaceTracker, track_video

__all__ = [
    "COUNT",
    "FOREHEAD",
    "GROUPS",
    "INNER_LIPS",
    "JAW",
    "LEFT_BROW",
    "LEFT_EYE",
    "MIRROR",
    "NOSE",
    "OUTER_EYE_CORNERS",
    "OUTER_LIPS",
    "RIGHT_BROW",
    "RIGHT_EYE",
    "Annotations",
    "BoxDetector",
    "BoxFit",
    "CenterfaceDetector",
    "Face",
    "FaceTracker",
    "LandmarkCard",
    "LandmarkError",
    "LandmarkFilter",
    "Landmarker",
    "LbpDetector",
    "OnnxLandmarker",
    "Scheme",
    "YunetDetector",
    "detector_usages",
    "interocular",
    "iou",
    "landmarker_usages",
    "load_annotations",
    "mirror",
    "open_detector",
    "open_landmarker",
    "read_card",
    "register_detector",
    "register_landmarker",
    "register_scheme",
    "save_annotations",
    "scheme_named",
    "tight_box",
    "to_face81",
    "track_video",
]
