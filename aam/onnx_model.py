"""ONNX models run by onnxruntime on the CPU: those of the package, and those that the user brings with a card.

Images RGB uint8 (h, w, 3).
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.model_card import ModelCard
from guise.aam.onnx_weights import without_tiny_weights
from guise.common.arrays import U8
from guise.common.text import first_line

DATA = Path(__file__).parent / "data"


class ShippedNetwork:
    """A network that ships with the package, made ready in a thread of its own while its owner goes on.

    Its weights are none that `without_tiny_weights` would change.

    Parameters
    ----------
    name : of the file in aam/data.
    threads : of onnxruntime within one call.
    keeps : whether the memory of its layers is kept from call to call: those of large pictures would take new pages.
    """

    def __init__(self, name: str, threads: int = 1, *, keeps: bool = False) -> None:
        self._session: Any = None
        self._error: BaseException | None = None
        self._path, self._threads, self._keeps = DATA / name, threads, keeps
        self._thread = threading.Thread(target=self._open, name=f"open {name}")
        self._thread.start()

    def run(self, outputs: Sequence[str] | None, inputs: Mapping[str, NDArray[Any]]) -> Any:
        """The named outputs, all by default, for inputs by name."""
        if self._session is None:
            self._thread.join()
            if self._error is not None:
                raise self._error
        return self._session.run(outputs, inputs)

    def _open(self) -> None:
        try:
            self._session = _session(str(self._path), self._threads, self._keeps)
        except BaseException as error:
            self._error = error


def open_session(model: bytes, threads: int = 1) -> Any:
    """An onnxruntime session on the CPU for a model's bytes; its subnormal weights, which are slow, become 0."""
    return _session(without_tiny_weights(model), threads)


def _session(model: bytes | str, threads: int, keeps: bool = False) -> Any:
    """A session for a model's bytes or path."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.enable_cpu_mem_arena = keeps  # in each session, and twice of what is needed
    options.enable_mem_pattern = not keeps  # where all layers get one block
    options.log_severity_level = 4
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


class OnnxModel:
    """A model that is fed with pictures as its card says.

    Parameters
    ----------
    card : ModelCard
    output : str, optional
        Name of the output that is read; the first one by default.
    threads : int
        Of onnxruntime within one call; one by default, as the models are small.

    Raises
    ------
    GuiseError
        The card's own, when the model is missing, isn't an ONNX file, or differs from what the card says.
    """

    def __init__(self, card: ModelCard, output: str | None = None, threads: int = 1) -> None:
        self._card = card
        self._session = self._opened(threads)
        self._input = self._checked_input()
        self._outputs = [self._checked_output(output)]
        self._mean, self._scale = np.array(card.mean, np.float32), np.array(card.scale, np.float32)

    def __call__(self, picture: U8) -> NDArray[Any]:
        """What the model gives for a picture RGB (height, width, 3) of the input's size."""
        card = self._card
        blob = ((_coloured(picture, card.colour).astype(np.float32) - self._mean) * self._scale)[None]
        if card.layout == "nchw":
            blob = np.ascontiguousarray(blob.transpose(0, 3, 1, 2))
        try:
            return np.asarray(self._session.run(self._outputs, {self._input: blob})[0])
        except Exception as error:  # onnxruntime raises many kinds
            raise self._error(
                f"model {card.model} expected input {blob.shape} as its card says, {first_line(error)}"
            ) from error

    def _opened(self, threads: int) -> Any:
        card = self._card
        if not card.model.is_file():
            raise self._error(f"card {card.path} expected its model at {card.model}, got no such file")
        content = card.model.read_bytes()
        found = hashlib.sha256(content).hexdigest()
        if card.sha256 is not None and card.sha256 != found:
            raise self._error(
                f"model {card.model} expected sha256 {card.sha256}, got {found}; is it another version?"
            )
        try:
            return open_session(content, threads)
        except Exception as error:  # onnxruntime raises many kinds
            raise self._error(f"model {card.model} must be an ONNX file, got: {first_line(error)}") from error

    def _checked_input(self) -> str:
        card, inputs = self._card, self._session.get_inputs()
        if len(inputs) != 1:
            raise self._error(f"model {card.model} must have one input, got {len(inputs)}")
        (width, height), shape = card.size, inputs[0].shape
        wanted = (1, card.channels, height, width)
        if card.layout == "nhwc":
            wanted = (1, height, width, card.channels)
        fits = len(shape) == 4 and all(
            not isinstance(a, int) or a == b for a, b in zip(shape, wanted, strict=True)
        )
        if not fits or inputs[0].type != "tensor(float)":
            got = f"{inputs[0].type} {shape}"
            raise self._error(f"card {card.path} describes float input {wanted}, got a model with {got}")
        return str(inputs[0].name)

    def _checked_output(self, name: str | None) -> str:
        names = [output.name for output in self._session.get_outputs()]
        if name is not None and name not in names:
            raise self._error(
                f"card {self._card.path}: output.name must be one of {', '.join(names)}, got {name}"
            )
        return str(name or names[0])

    def _error(self, text: str) -> Exception:
        return self._card.error(f"{self._card.kind} {text}")


def _coloured(picture: U8, colour: str) -> NDArray[Any]:
    if colour == "gray":
        return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)[..., None]
    return picture[..., ::-1] if colour == "bgr" else picture
