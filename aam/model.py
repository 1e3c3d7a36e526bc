"""A person's model and its file, NAME.guise: safetensors with a JSON header and a format version.

Holds the appearance model, the tracker, one enrolment frame and what is known of the enrolment.  Never a pickle.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import SHAPE, AppearanceModel, Components
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.tracker import POSE, Quality, Tracker
from guise.common.arrays import F32, F64
from guise.common.errors import GuiseError
from guise.common.files import write_whole

FORMAT = "guise-identity"
VERSION = 1


class ModelError(GuiseError):
    """A model file that cannot be used; the message says what was expected, what was found and what to do."""


@dataclass(frozen=True, eq=False)
class RestFrame:
    """One enrolment frame: picture (h, w, 3) uint8 RGB and the landmarks (81, 2) in its pixels."""

    picture: NDArray[np.uint8]
    shape: F64


@dataclass(frozen=True, eq=False)
class Identity:
    """Everything Guise knows of a person.

    Parameters
    ----------
    name : str.
    appearance : AppearanceModel.
    tracker : Tracker.
    detail : (2 h, 2 w) float32, luma that the neutral face has beyond the texture grid's resolution.
    still : an enrolment frame with the face at rest.
    facts : JSON-like: frames used, held-out error, clips, seconds, version of Guise.
    """

    name: str
    appearance: AppearanceModel
    tracker: Tracker
    detail: F32
    rest_frame: RestFrame
    facts: dict[str, Any] = field(default_factory=dict)

    @property
    def reference(self) -> ReferenceFrame:
        """The reference frame that it shares with whatever it is mixed with."""
        return self.appearance.reference

    def save(self, path: str | os.PathLike[str]) -> int:
        """Write the file through `path`.part and return its size in bytes."""
        from safetensors.numpy import save

        header = {
            "format": FORMAT,
            "version": str(VERSION),
            "name": self.name,
            "reference": json.dumps(
                {"scheme": "face81", "resolution": self.reference.resolution, "id": self.reference.id}
            ),
            "facts": json.dumps(self.facts),
        }
        data = _ordered(save({k: np.ascontiguousarray(v) for k, v in self._tensors().items()}, header))
        write_whole(Path(path), data)
        return len(data)

    def _tensors(self) -> dict[str, NDArray[Any]]:
        look, track = self.appearance, self.tracker
        done, jpeg = cv2.imencode(".jpg", self.rest_frame.picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 96])
        if not done:
            raise ModelError("the enrolment frame cannot be encoded as JPEG")
        quality = track.quality
        return {
            **_packed("appearance", look.components),
            "neutral": look.neutral.astype(np.float32),
            "mask": look.mask.astype(np.uint8),
            "detail": np.clip(np.round(self.detail * 2), -127, 127).astype(np.int8),
            **_packed("tracker.shapes", track.shapes),
            **_packed("tracker.texture", track.texture),
            **{f"tracker.stage{i}": s.astype(np.float16) for i, s in enumerate(track.stages)},
            "tracker.pixels": track.pixels.astype(np.int32),
            "tracker.quality": np.array([quality.error, quality.good, quality.bad]),
            "tracker.box_to_shape": track.box_to_shape.astype(np.float64),
            "still.jpeg": jpeg.ravel(),
            "still.shape": self.rest_frame.shape.astype(np.float64),
        }

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Identity:
        """Read a model file.

        Raises
        ------
        ModelError
            When it is missing, truncated, not a Guise model, of another version or of another reference frame.
        """
        tensors, header = _read(Path(path))
        reference = _reference(path, header)
        try:
            _check_lengths(tensors, reference)
            return cls._assemble(tensors, header, reference)
        except (KeyError, ValueError, IndexError) as error:
            raise ModelError(f"{path} is damaged ({error}); enrol the person again") from error

    @classmethod
    def _assemble(
        cls, t: dict[str, NDArray[Any]], header: dict[str, str], reference: ReferenceFrame
    ) -> Identity:
        look = AppearanceModel(reference, _unpacked("appearance", t), t["neutral"], t["mask"].astype(bool))
        stages = tuple(
            t[f"tracker.stage{i}"].astype(np.float32)
            for i in range(sum(k.startswith("tracker.stage") for k in t))
        )
        tracker = Tracker(
            _unpacked("tracker.shapes", t),
            stages,
            _unpacked("tracker.texture", t),
            t["tracker.pixels"].astype(np.intp),
            Quality(*map(float, t["tracker.quality"])),
            t["tracker.box_to_shape"],
        )
        picture = cv2.imdecode(t["still.jpeg"], cv2.IMREAD_COLOR)
        if picture is None or t["still.shape"].shape != (POINTS, 2):
            raise ValueError("enrolment frame")
        still = RestFrame(np.ascontiguousarray(picture[..., ::-1]), t["still.shape"])
        detail = t["detail"].astype(np.float32) / np.float32(2)
        return cls(header["name"], look, tracker, detail, still, json.loads(header["facts"]))


def _ordered(data: bytes) -> bytes:
    """A safetensors file with its metadata in order, so that the same model is always the same bytes."""
    end = 8 + int.from_bytes(data[:8], "little")
    head = json.loads(data[8:end])
    head["__metadata__"] = dict(sorted(head["__metadata__"].items()))
    text = json.dumps(head, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + data[end:]


def _packed(prefix: str, components: Components) -> dict[str, NDArray[Any]]:
    return {
        f"{prefix}.mean": components.mean.astype(np.float32),
        f"{prefix}.basis": components.basis.astype(np.float16),
        f"{prefix}.deviations": components.deviations.astype(np.float32),
        f"{prefix}.variance": np.array([components.total_variance]),
    }


def _unpacked(prefix: str, t: dict[str, NDArray[Any]]) -> Components:
    basis = t[f"{prefix}.basis"].astype(np.float32)
    lower = np.linalg.cholesky((basis.T @ basis).astype(np.float64))
    orthonormal = np.ascontiguousarray(basis @ np.linalg.inv(lower).T.astype(np.float32))
    return Components(
        t[f"{prefix}.mean"], orthonormal, t[f"{prefix}.deviations"], float(t[f"{prefix}.variance"][0])
    )


def _read(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        raise ModelError(f"there is no model file {path}; make one with: guise enroll VIDEO -o {path}")
    try:
        with safe_open(path, "np") as file:
            header = dict(file.metadata() or {})
            _check_format(path, header)
            return {key: file.get_tensor(key) for key in file.keys()}, header  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise ModelError(f"{path} is not a Guise model or is truncated; enrol the person again") from error


def _check_lengths(t: dict[str, NDArray[Any]], reference: ReferenceFrame) -> None:
    """ValueError unless the tensors fit the reference frame and each other."""
    h, w = reference.size
    appearance, pixels = SHAPE + 3 * len(reference.pixels), len(t["tracker.pixels"])
    modes, corrections = len(t["appearance.deviations"]), POSE + len(t["tracker.shapes.deviations"])
    expected = {
        "neutral": (appearance,),
        "mask": (h, w),
        "detail": (2 * h, 2 * w),
        "appearance.mean": (appearance,),
        "appearance.basis": (appearance, modes),
        "tracker.shapes.mean": (SHAPE,),
        "tracker.shapes.basis": (SHAPE, corrections - POSE),
        "tracker.texture.mean": (pixels,),
        "tracker.texture.basis": (pixels, len(t["tracker.texture.deviations"])),
        "tracker.quality": (3,),
        "tracker.box_to_shape": (3,),
        **{name: (1 + pixels, corrections) for name in t if name.startswith("tracker.stage")},
    }
    for name, shape in expected.items():
        if t[name].shape != shape:
            raise ValueError(f"{name} is {t[name].shape}, not {shape}")


def _check_format(path: Path, header: dict[str, str]) -> None:
    if header.get("format") != FORMAT:
        raise ModelError(f"{path} is not a Guise model; make one with: guise enroll VIDEO -o NAME.guise")
    if header.get("version") != str(VERSION):
        raise ModelError(
            f"{path} has model format {header.get('version')}, this Guise reads format {VERSION}; "
            "enrol the person again"
        )


def _reference(path: str | os.PathLike[str], header: dict[str, str]) -> ReferenceFrame:
    try:
        wanted = json.loads(header["reference"])
        reference = ReferenceFrame.canonical(int(wanted["resolution"]))
    except (KeyError, ValueError, TypeError) as error:
        raise ModelError(f"{path} is damaged (no usable reference frame); enrol the person again") from error
    if reference.id != wanted.get("id"):
        raise ModelError(
            f"{path} was enrolled on reference frame {wanted.get('id')}, this Guise has {reference.id}; "
            "enrol the person again"
        )
    return reference
