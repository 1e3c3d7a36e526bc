"""Face-box detectors: the LBP cascade that scikit-image ships, and YuNet and CenterFace through OpenCV.

Boxes are ``x0 y0 x1 y1`` float32 pixels of the given image, pixel centres at integers, largest first.
Images are RGB (h, w, 3) or grey (h, w), uint8. A detector is not for several threads at once.

Their time hardly depends on the picture's size: the picture is scaled down so that the smallest face
that is asked for has the smallest size that the detector can see.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.face import BoxFit, LandmarkError, iou
from guise.common.arrays import F32, F64, U8


@dataclass(frozen=True)
class DetectorSettings:
    """Settings of the detectors."""

    lbp_window_pixels: int = 24  # the side of the cascade's window
    lbp_size_step: float = 1.15  # from one size of face to the next
    lbp_fine_size_step: float = 1.05
    lbp_score_scale: float = (
        1.2  # of the last stage's sum: real faces have about 0.9 (1 in 100) to 4, others under 0.5
    )
    yunet_face_pixels: int = 16  # the smallest face that YuNet sees reliably
    centerface_face_pixels: int = 16  # and CenterFace
    max_distinct_iou: float = 0.3  # of boxes, above which they are one face


SETTINGS = DetectorSettings()
# The landmark box of the iBUG 68 points from a box: medians over the sample clips and real ones.
_LBP_FIT = BoxFit(0.84, (0.0, 0.18))
_YUNET_FIT = BoxFit(0.76, (0.0, 0.145))
_CENTERFACE_FIT = BoxFit(0.78, (0.0, 0.138))
_CENTERFACE_BLOCK, _CENTERFACE_STRIDE = (
    32,
    4,
)  # pixels: its pictures are multiples of the one, its cells have the other
_CENTERFACE_MAPS = (1, 2, 2, 10)  # channels of what it gives: centres, sizes, offsets, five points
_SHIPPED_TAG, _CORRECT_TAG = "featuhreParams", "featureParams"


@dataclass(eq=False)
class LbpDetector:
    """Frontal faces by the cascade of local binary patterns that comes with scikit-image.

    The cascade's file has a misspelt tag, with which OpenCV loads nothing; the tag is corrected in memory.

    Parameters
    ----------
    smallest : float
        Smallest face to find: a share of the picture's height up to 1, or pixels above 1 (24 at least).
    min_score : float
        In [0, 1]; boxes below are dropped.
    fit : BoxFit
        Landmark box of the iBUG 68 points from a box.
    thorough : bool
        Whether a picture in which nothing was found is searched once more in finer steps of size, which takes
        about three times as long.

    Examples
    --------
    >>> LbpDetector().detect(np.zeros((120, 160, 3), np.uint8)).shape
    (0, 4)
    """

    smallest: float = 1 / 12
    min_score: float = 0.35
    fit: BoxFit = _LBP_FIT
    thorough: bool = True
    name: str = field(default="lbp", init=False)

    def __post_init__(self) -> None:
        """Check the options and load the cascade."""
        check_smallest(self.smallest)
        self._cascade = _lbp_cascade()

    def detect(self, image: U8) -> F32:
        """Boxes (n, 4)."""
        return self.detect_scored(image)[0]

    def detect_scored(self, image: U8) -> tuple[F32, F32]:
        """Boxes (n, 4) and scores (n,) in [0, 1]."""
        grey = _grey(image)
        small, scale = _scaled(grey, SETTINGS.lbp_window_pixels, smallest_pixels(self.smallest, grey))
        boxes, scores = self._search(small, scale, SETTINGS.lbp_size_step)
        if self.thorough and not len(boxes):
            return self._search(small, scale, SETTINGS.lbp_fine_size_step)
        return boxes, scores

    def _search(self, small: U8, scale: F64, step: float) -> tuple[F32, F32]:
        found, _, weights = self._cascade.detectMultiScale3(
            small,
            scaleFactor=step,
            minNeighbors=2,
            minSize=(SETTINGS.lbp_window_pixels, SETTINGS.lbp_window_pixels),
            outputRejectLevels=True,
        )
        if len(found) == 0:
            return no_boxes()
        scores = 1 - np.exp(
            -np.maximum(np.asarray(weights, dtype=np.float64).ravel(), 0) / SETTINGS.lbp_score_scale
        )
        return strongest(_corners(np.asarray(found), scale), scores, self.min_score)


def _model_file(kind: str, model: str | Path) -> Path:
    """The path of a network that the user brings, which must be there."""
    path = Path(model)
    if not path.is_file():
        raise LandmarkError(f"{kind} model expected at {path}, got no such file; give the path of the .onnx")
    return path


@dataclass(eq=False)
class YunetDetector:
    """Faces by the YuNet network, a file that the user brings, run by OpenCV's FaceDetectorYN.

    Parameters
    ----------
    model : path
        The ``.onnx`` file.
    smallest : float
        Smallest face to find: a share of the picture's height up to 1, or pixels above 1.
    min_score : float
        In [0, 1]; boxes below are dropped.
    fit : BoxFit
        Landmark box of the iBUG 68 points from a box.
    """

    model: str | Path
    smallest: float = 1 / 12
    min_score: float = 0.6
    fit: BoxFit = _YUNET_FIT
    name: str = field(default="yunet", init=False)

    def __post_init__(self) -> None:
        """Check the options and load the network."""
        check_smallest(self.smallest)
        path = _model_file("YuNet", self.model)
        self._network = _yunet(path, self.min_score)

    def detect(self, image: U8) -> F32:
        """Boxes (n, 4)."""
        return self.detect_scored(image)[0]

    def detect_scored(self, image: U8) -> tuple[F32, F32]:
        """Boxes (n, 4) and scores (n,) in [0, 1]."""
        bgr = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR if image.ndim == 2 else cv2.COLOR_RGB2BGR)
        small, scale = _scaled(bgr, SETTINGS.yunet_face_pixels, smallest_pixels(self.smallest, image))
        self._network.setInputSize((small.shape[1], small.shape[0]))
        found = self._network.detect(small)[1]
        if found is None or len(found) == 0:
            return no_boxes()
        return strongest(_corners(found[:, :4], scale), np.asarray(found[:, -1], float), self.min_score)


@dataclass(eq=False)
class CenterfaceDetector:
    """Faces by the CenterFace network (Xu et al. 2019), a file that the user brings, run by OpenCV.

    Parameters
    ----------
    model : path
        The ``.onnx`` file.
    smallest : float
        Smallest face to find: a share of the picture's height up to 1, or pixels above 1.
    min_score : float
        In [0, 1]; boxes below are dropped.
    fit : BoxFit
        Landmark box of the iBUG 68 points from a box.
    """

    model: str | Path
    smallest: float = 1 / 12
    min_score: float = 0.5
    fit: BoxFit = _CENTERFACE_FIT
    name: str = field(default="centerface", init=False)

    def __post_init__(self) -> None:
        """Check the options and load the network."""
        check_smallest(self.smallest)
        path = _model_file("CenterFace", self.model)
        try:
            self._network = cv2.dnn.readNetFromONNX(str(path))
            self._names = self._network.getUnconnectedOutLayersNames()
            maps = self._maps(np.zeros((_CENTERFACE_BLOCK, _CENTERFACE_BLOCK, 3), np.uint8))
            channels = tuple(one.shape[1] for one in maps)
        except (cv2.error, IndexError):
            channels = ()
        if channels != _CENTERFACE_MAPS:
            raise LandmarkError(f"CenterFace model {path} expected centerface.onnx, got another file")

    def detect(self, image: U8) -> F32:
        """Boxes (n, 4)."""
        return self.detect_scored(image)[0]

    def detect_scored(self, image: U8) -> tuple[F32, F32]:
        """Boxes (n, 4) and scores (n,) in [0, 1]."""
        rgb = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image
        small, scale = _scaled(rgb, SETTINGS.centerface_face_pixels, smallest_pixels(self.smallest, image))
        below, beside = (-side % _CENTERFACE_BLOCK for side in small.shape[:2])
        heat, sizes, offsets, _ = self._maps(
            cv2.copyMakeBorder(small, 0, below, 0, beside, cv2.BORDER_CONSTANT)
        )
        rows, columns = np.nonzero(heat[0, 0] >= self.min_score)
        if len(rows) == 0:
            return no_boxes()
        off, size = offsets[0, :, rows, columns], np.exp(sizes[0, :, rows, columns])
        centres = np.stack([rows, columns], axis=1) + off + 0.5
        boxes = np.concatenate([centres - size / 2, size], axis=1)[:, [1, 0, 3, 2]] * _CENTERFACE_STRIDE
        return strongest(_corners(boxes, scale), heat[0, 0, rows, columns], self.min_score)

    def _maps(self, rgb: Any) -> Any:
        """What the network gives for a picture (h, w, 3) of whole blocks."""
        self._network.setInput(cv2.dnn.blobFromImage(rgb))
        return self._network.forward(self._names)


def _lbp_cascade() -> cv2.CascadeClassifier:
    from skimage.data import lbp_frontal_face_cascade_filename

    name: str = lbp_frontal_face_cascade_filename()  # type: ignore[no-untyped-call]
    text = Path(name).read_text(encoding="utf-8")
    text = text.replace(_SHIPPED_TAG, _CORRECT_TAG)
    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    cascade = cv2.CascadeClassifier()
    if not cascade.read(storage.getFirstTopLevelNode()) or cascade.empty():
        raise LandmarkError(
            "scikit-image's LBP face cascade could not be read by OpenCV; reinstall scikit-image"
        )
    return cascade


def _yunet(path: Path, min_score: float) -> cv2.FaceDetectorYN:
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # it warns about unused targets
    try:
        network = cv2.FaceDetectorYN.create(str(path), "", (64, 64), min_score, 0.3, 500)
        network.detect(np.zeros((64, 64, 3), np.uint8))
    except cv2.error as error:
        raise LandmarkError(
            f"YuNet model {path} expected OpenCV zoo's face_detection_yunet, got another file"
        ) from error
    finally:
        logging.setLogLevel(level)
    return network


def check_smallest(smallest: float) -> None:
    if not smallest > 0:
        raise LandmarkError(f"smallest face must be a share of the height or pixels above 0, got {smallest}")


def smallest_pixels(smallest: float, image: NDArray[Any]) -> float:
    return smallest * image.shape[0] if smallest <= 1 else smallest


def _grey(image: U8) -> U8:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)


def _scaled(image: Any, seen: float, smallest: float) -> tuple[Any, F64]:
    """U8 scaled so that a face of ``smallest`` pixels gets ``seen`` (never larger); its scale (x, y)."""
    height, width = image.shape[:2]
    factor = min(1.0, seen / max(smallest, 1.0))
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    if size == (width, height):
        return image, np.ones(2)
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.array(
        [size[0] / width, size[1] / height]
    )


def _corners(boxes: NDArray[Any], scale: F64) -> F64:
    """Corners in the full picture of boxes x, y, w, h (n, 4) in the scaled one; pixel centres at integers."""
    boxes = np.asarray(boxes, dtype=np.float64)
    corners = np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)
    return np.asarray(corners / np.tile(scale, 2) - 0.5)


def strongest(boxes: NDArray[Any], scores: NDArray[Any], min_score: float) -> tuple[F32, F32]:
    """Drop weak boxes, and boxes mostly over or inside a stronger one; largest first."""
    order = strongest_indices(boxes, scores, min_score)
    return boxes[order].astype(np.float32), np.clip(scores[order], 0, 1).astype(np.float32)


def strongest_indices(boxes: NDArray[Any], scores: NDArray[Any], min_score: float) -> NDArray[np.intp]:
    """Which boxes :func:`strongest` keeps, in its order."""
    kept: list[int] = []
    for i in np.argsort(-scores, kind="stable"):
        if scores[i] >= min_score and not any(is_same(boxes[i], boxes[j]) for j in kept):
            kept.append(int(i))
    areas = np.prod(boxes[kept, 2:] - boxes[kept, :2], axis=1)
    return np.array(kept, dtype=np.intp)[np.argsort(-areas, kind="stable")]


def is_same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Whether two boxes (4,) are taken for one face's."""
    centre_a, centre_b = (a[:2] + a[2:]) / 2, (b[:2] + b[2:]) / 2
    smaller = min(a[2] - a[0], b[2] - b[0])
    return iou(a, b) > SETTINGS.max_distinct_iou or bool(np.abs(centre_a - centre_b).max() < smaller / 2)


def no_boxes() -> tuple[F32, F32]:
    return np.zeros((0, 4), np.float32), np.zeros(0, np.float32)
