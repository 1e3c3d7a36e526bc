"""Landmarkers and detectors from a short text, as given on a command line.

``NAME[:ARGUMENT][@DETECTOR]`` names a landmarker, ``NAME[:ARGUMENT]`` a detector::

    builtin                       the landmarker that ships with the package, faces by its own detector
    CARD.toml                     an ONNX model described by a card, faces by the LBP cascade
    CARD.toml@yunet:MODEL.onnx    the same, faces by YuNet
    onnx:CARD                     the same for a card whose name does not end in .toml
    builtin, lbp, yunet:MODEL.onnx, centerface:MODEL.onnx    detectors

Other kinds join through :func:`register_landmarker` and :func:`register_detector`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from guise.aam.landmarks.face import BoxDetector, Landmarker, LandmarkError

LandmarkerFactory = Callable[[str, BoxDetector | None], Landmarker]
DetectorFactory = Callable[[str], BoxDetector]

_LANDMARKERS: dict[str, tuple[str, LandmarkerFactory]] = {}
_DETECTORS: dict[str, tuple[str, DetectorFactory]] = {}


def register_landmarker(name: str, usage: str, factory: LandmarkerFactory) -> None:
    """Make ``name`` known to :func:`open_landmarker`.

    usage : shown in errors, such as ``'CARD.toml[@DETECTOR]'``.
    factory : called with the argument ('' without one) and the detector (None without one).
    """
    _LANDMARKERS[name] = (usage, factory)


def register_detector(name: str, usage: str, factory: DetectorFactory) -> None:
    """Make ``name`` known to :func:`open_detector`; its factory takes the argument, '' without one."""
    _DETECTORS[name] = (usage, factory)


def landmarker_usages() -> list[str]:
    """How each known landmarker is written."""
    return [usage for usage, _ in _LANDMARKERS.values()]


def detector_usages() -> list[str]:
    """How each known detector is written."""
    return [usage for usage, _ in _DETECTORS.values()]


def open_landmarker(spec: str | None) -> Landmarker:
    """The landmarker that a text names; None is the built-in one.

    Examples
    --------
    >>> open_landmarker("magic")
    Traceback (most recent call last):
    guise.aam.landmarks.face.LandmarkError: landmarker must be one of builtin[@DETECTOR], ...
    """
    spec = "builtin" if spec is None else spec
    own, _, detector_spec = spec.partition("@") if "@" not in spec else _split_detector(spec)
    name, _, argument = own.partition(":")
    if own.endswith(".toml") and name not in _LANDMARKERS:
        name, argument = "onnx", own
    if name not in _LANDMARKERS:
        raise LandmarkError(f"landmarker must be one of {', '.join(landmarker_usages())}; got {spec!r}")
    detector = open_detector(detector_spec) if detector_spec else None
    return _LANDMARKERS[name][1](argument, detector)


def open_detector(spec: str) -> BoxDetector:
    """The box detector that a text names.

    Examples
    --------
    >>> open_detector("lbp").name
    'lbp'
    """
    name, _, argument = spec.partition(":")
    if name not in _DETECTORS:
        raise LandmarkError(f"face detector must be one of {', '.join(detector_usages())}; got {spec!r}")
    return _DETECTORS[name][1](argument)


class DetectorPerThread:
    """A detector for each thread that asks for one: those of OpenCV keep the picture that they are searching.

    spec : as `open_detector` takes it; the first is opened at once, so that errors show.
    """

    def __init__(self, spec: str) -> None:
        self._spec, self._opened = spec, threading.local()
        self.own()

    def own(self) -> BoxDetector:
        """The detector of this thread."""
        if not hasattr(self._opened, "detector"):
            self._opened.detector = open_detector(self._spec)
        detector: BoxDetector = self._opened.detector
        return detector


def _split_detector(spec: str) -> tuple[str, str, str]:
    """Split at the last @ that begins a detector's name, as paths may hold an @ of their own."""
    own, at, detector = spec.rpartition("@")
    while own and detector.partition(":")[0] not in _DETECTORS and "@" in own:
        own, _, more = own.rpartition("@")
        detector = f"{more}@{detector}"
    if detector.endswith(".toml") and ":" not in detector:
        return spec, "", ""
    return own, at, detector


def _open_builtin(argument: str, detector: BoxDetector | None) -> Landmarker:
    from guise.aam.landmarks.builtin import BuiltinLandmarker

    if argument:
        raise LandmarkError(f"landmarker builtin takes no argument, got {argument!r}")
    return BuiltinLandmarker(detector)


def _open_onnx(argument: str, detector: BoxDetector | None) -> Landmarker:
    from guise.aam.landmarks.onnx import OnnxLandmarker

    return OnnxLandmarker(argument, detector)


def _open_builtin_detector(argument: str) -> BoxDetector:
    from guise.aam.landmarks.detector import FaceDetector

    if argument:
        raise LandmarkError(f"face detector builtin takes no argument, got {argument!r}")
    return FaceDetector()


def _open_lbp(argument: str) -> BoxDetector:
    from guise.aam.landmarks.boxes import LbpDetector

    if argument:
        raise LandmarkError(f"face detector lbp takes no argument, got {argument!r}")
    return LbpDetector()


def _open_yunet(argument: str) -> BoxDetector:
    from guise.aam.landmarks.boxes import YunetDetector

    if not argument:
        raise LandmarkError("face detector yunet needs its model, as in yunet:MODEL.onnx; got no path")
    return YunetDetector(argument)


def _open_centerface(argument: str) -> BoxDetector:
    from guise.aam.landmarks.boxes import CenterfaceDetector

    if not argument:
        raise LandmarkError(
            "face detector centerface needs its model, as in centerface:MODEL.onnx; got no path"
        )
    return CenterfaceDetector(argument)


register_landmarker("builtin", "builtin[@DETECTOR]", _open_builtin)
register_landmarker("onnx", "CARD.toml[@DETECTOR]", _open_onnx)
register_detector("builtin", "builtin", _open_builtin_detector)
register_detector("lbp", "lbp", _open_lbp)
register_detector("yunet", "yunet:MODEL.onnx", _open_yunet)
register_detector("centerface", "centerface:MODEL.onnx", _open_centerface)
