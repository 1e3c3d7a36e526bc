"""A face recogniser that the user brings: an ONNX model and the TOML card that describes it.

The card says everything that is needed to feed the model::

    name = "mobilefacenet"        # optional, for reports; the card's file name without it
    model = "mobilefacenet.onnx"  # path, relative to the card
    sha256 = "64184e22..."        # optional; checked when there

    [input]
    size = [112, 112]             # width, height in pixels
    colour = "rgb"                # rgb or bgr; default rgb
    layout = "nchw"               # nchw or nhwc; default nchw
    mean = 127.5                  # value = (byte - mean) * scale, byte in 0..255;
    scale = 0.00784313725490196   # one number or one per channel; default: mean 0, scale 1/255

    [template]                    # where five points of the face lie in the input, pixels:
    points = [[38.29, 51.70], [73.53, 51.50], [56.03, 71.74], [41.55, 92.37], [70.73, 92.20]]

The five points are the middles of the eyes (the left one in the picture first), the tip of the nose and the corners of
the mouth. The model's first output is the embedding; two faces are compared by the cosine of theirs.

Images RGB uint8 (h, w, 3); pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.onnx import open_session
from guise.aam.landmarks.schemes import LEFT_EYE, MOUTH_CORNERS, NOSE_TIP, RIGHT_EYE
from guise.aam.similarity import Failed, align
from guise.common.arrays import F32, F64
from guise.common.errors import GuiseError

Image = NDArray[np.uint8]

_KEYS = {
    "": {"name", "model", "sha256", "licence", "source", "input", "template"},
    "input": {"size", "colour", "layout", "mean", "scale"},
    "template": {"points"},
}
_MOST_SIZE = 1024  # pixels


class RecogniserError(GuiseError):
    """A recogniser or its card that cannot be used; one sentence."""


@dataclass(frozen=True, eq=False)
class RecogniserCard:
    """What a card says; see the module's text.

    Parameters
    ----------
    size : width and height of the input, pixels.   mean, scale : (1,) or (3,).   template : (5, 2) pixels of the input.
    """

    path: Path
    name: str
    model: Path
    sha256: str
    size: tuple[int, int]
    colour: str
    layout: str
    mean: F32
    scale: F32
    template: F64


def read_recogniser_card(path: Path) -> RecogniserCard:
    """The card in a TOML file; RecogniserError, in one sentence, for anything wrong in it."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise RecogniserError(f"recogniser card expected at {path}, got no such file") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RecogniserError(f"recogniser card {path} must be a readable TOML file, got: {error}") from error
    return _Values(path, table).card()


class _Values:
    """A card's values, checked; every failure names the file and the key."""

    def __init__(self, path: Path, table: dict[str, Any]) -> None:
        self._path, self._table = path, table
        for section, known in _KEYS.items():
            unknown = sorted(set(self._section(section)) - known)
            if unknown:
                raise self._fault(section or "the top level", f"of {', '.join(sorted(known))}", unknown)

    def card(self) -> RecogniserCard:
        """The checked card."""
        return RecogniserCard(
            path=self._path,
            name=self._text("name", self._path.stem),
            model=self._path.parent / self._text("model", ""),
            sha256=self._text("sha256", "").lower() if "sha256" in self._table else "",
            size=self._size(),
            colour=self._choice("colour", ("rgb", "bgr")),
            layout=self._choice("layout", ("nchw", "nhwc")),
            mean=self._numbers("mean", 0.0),
            scale=self._numbers("scale", 1 / 255),
            template=self._template(),
        )

    def _section(self, name: str) -> dict[str, Any]:
        value = self._table.get(name, {}) if name else self._table
        if not isinstance(value, dict):
            raise self._fault(name, "a table", value)
        return value

    def _text(self, key: str, default: str) -> str:
        value = self._table.get(key, default)
        if not isinstance(value, str) or not value:
            raise self._fault(key, "a text", value or None)
        return value

    def _choice(self, key: str, choices: tuple[str, ...]) -> str:
        value = self._section("input").get(key, choices[0])
        if value not in choices:
            raise self._fault(f"input.{key}", f"one of {', '.join(choices)}", value)
        return str(value)

    def _numbers(self, key: str, default: float) -> F32:
        value = self._section("input").get(key, default)
        values = value if isinstance(value, list) else [value]
        if len(values) not in {1, 3} or not all(map(_is_number, values)):
            raise self._fault(f"input.{key}", "one number or 3", value)
        return np.array(values, np.float32)

    def _size(self) -> tuple[int, int]:
        value = self._section("input").get("size")
        if not isinstance(value, list) or len(value) != 2 or not all(map(_is_side, value)):
            raise self._fault("input.size", "[width, height] in pixels", value)
        return value[0], value[1]

    def _template(self) -> F64:
        value = self._section("template").get("points")
        rows = value if isinstance(value, list) else []
        right = len(rows) == 5 and all(isinstance(r, list) and len(r) == 2 for r in rows)
        if not right or not all(_is_number(v) for row in rows for v in row):
            raise self._fault("template.points", "five points [x, y] in pixels", value)
        return np.array(rows, np.float64)

    def _fault(self, key: str, expected: str, got: Any) -> RecogniserError:
        shown = "nothing" if got is None else repr(got)
        return RecogniserError(f"recogniser card {self._path}: {key} must be {expected}, got {shown}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _is_side(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= _MOST_SIZE


class Recogniser:
    """Embeddings of faces whose landmarks are known.

    Parameters
    ----------
    card : path or RecogniserCard.

    Raises
    ------
    RecogniserError
        When the model is not there, is no ONNX file, or is not what the card says.
    """

    def __init__(self, card: Path | RecogniserCard) -> None:
        self.card = card if isinstance(card, RecogniserCard) else read_recogniser_card(card)
        self._session = _session(self.card)
        self._input = self._session.get_inputs()[0].name
        self.dimension = len(self._embedding(np.zeros((*self.card.size[::-1], 3), np.uint8)))

    @property
    def name(self) -> str:
        """For reports."""
        return self.card.name

    def __call__(self, rgb: Image, points: NDArray[Any]) -> F32 | None:
        """The embedding (d,), of length one, of the face with landmarks (81, 2) in a picture (h, w, 3).

        None when the points have no extent, or the model says nothing about the face.
        """
        move = align(five_points(points), self.card.template)
        if isinstance(move, Failed):
            return None
        vector = self._embedding(self._aligned(rgb, np.column_stack([move.linear, move.translation])))
        length = float(np.linalg.norm(vector))
        return vector / np.float32(length) if np.isfinite(length) and length > 0 else None

    def _aligned(self, rgb: Image, matrix: F64) -> Image:
        """The face in the model's input, (height, width, 3); beyond the picture it is black."""
        how = cv2.INTER_AREA if np.linalg.norm(matrix[:, 0]) < 0.5 else cv2.INTER_LINEAR
        return np.asarray(cv2.warpAffine(rgb, matrix, self.card.size, flags=how), np.uint8)

    def _embedding(self, face: Image) -> F32:
        picture = face[..., ::-1] if self.card.colour == "bgr" else face
        blob = ((picture.astype(np.float32) - self.card.mean) * self.card.scale)[None]
        if self.card.layout == "nchw":
            blob = np.ascontiguousarray(blob.transpose(0, 3, 1, 2))
        try:
            output = self._session.run(None, {self._input: blob})[0]
        except Exception as error:  # onnxruntime raises many kinds
            raise RecogniserError(
                f"recogniser model {self.card.model} expected input {blob.shape} as its card says, "
                f"{str(error).splitlines()[0]}"
            ) from error
        return np.asarray(output, np.float32).ravel()


def five_points(points: NDArray[Any]) -> F64:
    """(5, 2) middles of the eyes, tip of the nose, corners of the mouth, of landmarks (81, 2)."""
    shape = np.asarray(points, np.float64)
    return np.stack(
        [shape[RIGHT_EYE].mean(0), shape[LEFT_EYE].mean(0), shape[NOSE_TIP], *shape[MOUTH_CORNERS]]
    )


def _session(card: RecogniserCard) -> Any:
    if not card.model.is_file():
        raise RecogniserError(
            f"recogniser card {card.path} expected its model at {card.model}, got no such file"
        )
    content = card.model.read_bytes()
    found = hashlib.sha256(content).hexdigest()
    if card.sha256 and card.sha256 != found:
        raise RecogniserError(
            f"recogniser model {card.model} expected sha256 {card.sha256}, got {found}; is it another version?"
        )
    try:
        session = open_session(content)
    except Exception as error:  # onnxruntime raises many kinds
        raise RecogniserError(
            f"recogniser model {card.model} must be an ONNX file, got: {str(error).splitlines()[0]}"
        ) from error
    if len(session.get_inputs()) != 1:
        raise RecogniserError(
            f"recogniser model {card.model} must have one input, got {len(session.get_inputs())}"
        )
    return session
