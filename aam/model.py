"""A person's model and its file, NAME.guise: safetensors with a JSON header and a format version.

Holds the appearance model, the tracker, one enrolment frame and facts about the enrolment.  Never a pickle.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import (
    SHAPE_ENTRIES,
    AppearanceModel,
    Components,
    appearance_vectors,
    sample_texture,
)
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.tracker import POSE_ENTRIES, Quality, Tracker
from guise.aam.view_textures import ViewTextures
from guise.common.arrays import F32, F64, U8
from guise.common.errors import GuiseError
from guise.common.files import write_whole
from guise.common.threads import one_thread

FORMAT = "guise-identity"
VERSION, COMPACT_VERSION = 1, 2
KNOWN_REST = "known_rest"  # fact: whether a user chose the frame in which the face is at rest
_VECTORS = ("appearance.mean", "neutral")  # appearance vectors that a compact file splits


class ModelError(GuiseError):
    """A model file that can't be used; the message says what was expected, what was found and what to do."""


@dataclass(frozen=True, eq=False)
class RestFrame:
    """An enrolment frame with the face at rest: picture (h, w, 3) RGB and the landmarks (81, 2) in its pixels."""

    picture: U8
    shape: F64


@dataclass(frozen=True, eq=False)
class Identity:
    """Everything Guise knows of a person.

    Parameters
    ----------
    name : str.
    appearance : AppearanceModel.
    tracker : Tracker.
    detail : (2 h, 2 w) float32, luma of the neutral face beyond the texture grid's resolution.
    rest_frame : see `RestFrame`.
    facts : JSON-like: frames used, held-out error, clips, seconds, version of Guise.
    views : ViewTextures, None where the clip shows the head from one side only.
    """

    name: str
    appearance: AppearanceModel
    tracker: Tracker
    detail: F32
    rest_frame: RestFrame
    facts: dict[str, Any] = field(default_factory=dict)
    views: ViewTextures | None = None

    @property
    def reference(self) -> ReferenceFrame:
        """The reference frame; models that are mixed share it."""
        return self.appearance.reference

    def __str__(self) -> str:
        """One line for a person to read."""
        clips = ", ".join(map(str, self.facts.get("clips", ()))) or "nothing that is known"
        return (
            f"{self.name}: {self.appearance.components.modes} modes, {self.reference.resolution} pixels across the "
            f"face, from {clips}"
        )

    def at_resolution(self, resolution: int) -> Identity:
        """The same person with textures of another resolution (pixels across the face), to mix with other models."""
        from guise.aam.resampling import resampled, resampled_detail

        if resolution == self.reference.resolution:
            return self
        reference = ReferenceFrame.canonical(resolution)
        return replace(
            self,
            appearance=resampled(self.appearance, reference),
            detail=resampled_detail(self.detail, self.reference, reference),
            views=None if self.views is None else self.views.at_resolution(self.reference, reference),
        )

    @property
    def knows_rest(self) -> bool:
        """Whether the neutral appearance is certainly without expression, as a user chose its frame."""
        return bool(self.facts.get(KNOWN_REST))

    @property
    def is_of_photo(self) -> bool:
        """Whether one photo is all that is known of them."""
        return self.facts.get("frames") == 1

    def resting(self, rgb: U8, shape: F64) -> Identity:
        """The same person with the neutral appearance of a picture (h, w, 3) with the face at a shape (81, 2)."""
        texture = sample_texture(rgb, shape, self.reference)
        neutral = appearance_vectors(shape[None], texture[None], self.reference)[0]
        appearance = replace(self.appearance, neutral=neutral)
        return replace(self, appearance=appearance, facts={**self.facts, KNOWN_REST: True})

    def for_display(self) -> Identity:
        """The same person as a donor: what shows the face, without what tracks it."""
        nothing = np.zeros(0, np.float32)
        tracker = replace(
            self.tracker,
            stages=(),
            texture=Components(nothing, np.zeros((0, 0), np.float32), nothing, 0.0),
            pixels=np.zeros(0, np.intp),
        )
        return replace(self, tracker=tracker)

    def save(self, path: str | os.PathLike[str], *, compact: bool = False) -> int:
        """Write the file through `path`.part and return its size in bytes.

        compact : textures with half precision and modes of texture with 8 bits, for donors.
        """
        from safetensors.numpy import save

        header = {
            "format": FORMAT,
            "version": str(COMPACT_VERSION if compact else VERSION),
            "name": self.name,
            "reference": json.dumps(
                {"scheme": "face81", "resolution": self.reference.resolution, "id": self.reference.id}
            ),
            "facts": json.dumps(self.facts),
        }
        tensors = self._tensors()
        if compact:
            tensors |= _compacted(tensors)
            tensors.pop("appearance.basis")
        data = _ordered(save({k: np.ascontiguousarray(v) for k, v in tensors.items()}, header))
        write_whole(Path(path), data)
        return len(data)

    def _tensors(self) -> dict[str, NDArray[Any]]:
        model, tracker = self.appearance, self.tracker
        done, jpeg = cv2.imencode(".jpg", self.rest_frame.picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 96])
        if not done:
            raise ModelError("the enrollment frame cannot be encoded as JPEG: enroll from another clip")
        quality = tracker.quality
        return {
            **_packed("appearance", model.components),
            "neutral": model.neutral.astype(np.float32),
            "mask": model.mask.astype(np.uint8),
            "detail": np.clip(np.round(self.detail * 2), -127, 127).astype(np.int8),
            **_packed("tracker.shapes", tracker.shapes),
            **_packed("tracker.texture", tracker.texture),
            **{f"tracker.stage{i}": s.astype(np.float16) for i, s in enumerate(tracker.stages)},
            "tracker.pixels": tracker.pixels.astype(np.int32),
            "tracker.quality": np.array([quality.error, quality.good, quality.bad]),
            "tracker.box_to_shape": tracker.box_to_shape.astype(np.float64),
            "still.jpeg": jpeg.ravel(),
            "still.shape": self.rest_frame.shape.astype(np.float64),
            **({} if self.views is None else self.views.packed()),
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
            tensors = _expanded(tensors, reference)
            _check_lengths(tensors, reference)
            with one_thread():
                return cls._assemble(tensors, header, reference)
        except (KeyError, ValueError, IndexError) as error:
            raise ModelError(f"{path} is damaged ({error}); enroll the person again") from error

    @classmethod
    def _assemble(
        cls, t: dict[str, NDArray[Any]], header: dict[str, str], reference: ReferenceFrame
    ) -> Identity:
        appearance = AppearanceModel(
            reference, _unpacked("appearance", t), t["neutral"], t["mask"].astype(bool)
        )
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
            raise ValueError("enrollment frame")
        rest_frame = RestFrame(np.ascontiguousarray(picture[..., ::-1]), t["still.shape"])
        detail, facts = t["detail"].astype(np.float32) / np.float32(2), json.loads(header["facts"])
        return cls(
            header["name"],
            appearance,
            tracker,
            detail,
            rest_frame,
            facts,
            ViewTextures.unpacked(t, reference),
        )


@dataclass(frozen=True)
class ModelHeader:
    """What a model file says about itself: the person's name, and the facts of `Identity`."""

    name: str
    facts: dict[str, Any]


def read_header(path: str | os.PathLike[str]) -> ModelHeader:
    """The header alone, which is quick.  ModelError when the file is missing or is no model."""
    header = _read(Path(path), header_only=True)[1]
    try:
        return ModelHeader(header["name"], dict(json.loads(header["facts"])))
    except (KeyError, ValueError, TypeError) as error:
        raise ModelError(f"{path} is damaged ({error}); enroll the person again") from error


def rename_model(path: str | os.PathLike[str], name: str) -> None:
    """Give the person in a model file another name; nothing else in it changes."""
    read_header(path)
    write_whole(Path(path), _ordered(Path(path).read_bytes(), name=name))


def _ordered(data: bytes, **changes: str) -> bytes:
    """A safetensors file with its metadata changed and sorted, so that the same model always gives the same bytes."""
    end = 8 + int.from_bytes(data[:8], "little")
    head = json.loads(data[8:end])
    head["__metadata__"] = dict(sorted((head["__metadata__"] | changes).items()))
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


def _compacted(t: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """What a compact file holds instead of "appearance.basis", and in place of the others.

    The texture's share of each mode is 8 bits with one scale a mode; shapes keep their precision.
    """
    basis = t["appearance.basis"].astype(np.float32)
    scale = np.maximum(np.abs(basis[SHAPE_ENTRIES:]).max(0), 1e-12) / 127
    return {
        "appearance.shape_basis": basis[:SHAPE_ENTRIES].astype(np.float16),
        "appearance.texture_basis": np.round(basis[SHAPE_ENTRIES:] / scale).astype(np.int8),
        "appearance.texture_scale": scale.astype(np.float32),
        **{f"{key}.shape": t[key][:SHAPE_ENTRIES] for key in _VECTORS},
        **{key: t[key][SHAPE_ENTRIES:].astype(np.float16) for key in _VECTORS},
        "mask": np.packbits(t["mask"].astype(bool)),
    }


def _expanded(t: dict[str, NDArray[Any]], reference: ReferenceFrame) -> dict[str, NDArray[Any]]:
    """The tensors of a compact file as `_tensors` has them; those of another file as they are."""
    if "appearance.texture_basis" not in t:
        return t
    h, w = reference.size
    texture = t["appearance.texture_basis"].astype(np.float32) * t["appearance.texture_scale"]
    return t | {
        "appearance.basis": np.concatenate([t["appearance.shape_basis"].astype(np.float32), texture]),
        **{key: np.concatenate([t[f"{key}.shape"], t[key].astype(np.float32)]) for key in _VECTORS},
        "mask": np.unpackbits(t["mask"], count=h * w).reshape(h, w),
    }


def _unpacked(prefix: str, t: dict[str, NDArray[Any]]) -> Components:
    basis = t[f"{prefix}.basis"].astype(np.float32)
    lower = np.linalg.cholesky((basis.T @ basis).astype(np.float64))
    orthonormal = np.ascontiguousarray(basis @ np.linalg.inv(lower).T.astype(np.float32))
    return Components(
        t[f"{prefix}.mean"], orthonormal, t[f"{prefix}.deviations"], float(t[f"{prefix}.variance"][0])
    )


def _read(path: Path, *, header_only: bool = False) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        raise ModelError(f"there is no model file {path}; make one with: guise enroll VIDEO -o {path}")
    try:
        with safe_open(path, "np") as file:
            header = dict(file.metadata() or {})
            _check_format(path, header)
            keys = [] if header_only else file.keys()
            return {key: file.get_tensor(key) for key in keys}, header
    except (SafetensorError, OSError) as error:
        raise ModelError(f"{path} is not a Guise model or is truncated; enroll the person again") from error


def _check_lengths(t: dict[str, NDArray[Any]], reference: ReferenceFrame) -> None:
    """ValueError unless the tensors fit the reference frame and each other."""
    h, w = reference.size
    appearance, pixels = SHAPE_ENTRIES + 3 * len(reference.pixels), len(t["tracker.pixels"])
    modes, corrections = len(t["appearance.deviations"]), POSE_ENTRIES + len(t["tracker.shapes.deviations"])
    expected = {
        "neutral": (appearance,),
        "mask": (h, w),
        "detail": (2 * h, 2 * w),
        "appearance.mean": (appearance,),
        "appearance.basis": (appearance, modes),
        "tracker.shapes.mean": (SHAPE_ENTRIES,),
        "tracker.shapes.basis": (SHAPE_ENTRIES, corrections - POSE_ENTRIES),
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
    if header.get("version") not in (str(VERSION), str(COMPACT_VERSION)):
        raise ModelError(
            f"{path} has model format {header.get('version')}, this Guise reads formats {VERSION} and "
            f"{COMPACT_VERSION}; "
            "enroll the person again"
        )


def _reference(path: str | os.PathLike[str], header: dict[str, str]) -> ReferenceFrame:
    try:
        wanted = json.loads(header["reference"])
        reference = ReferenceFrame.canonical(int(wanted["resolution"]))
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise ModelError(f"{path} is damaged (no usable reference frame); enroll the person again") from error
    if reference.id != wanted.get("id"):
        raise ModelError(
            f"{path} was enrolled on reference frame {wanted.get('id')}, this Guise has {reference.id}; "
            "enroll the person again"
        )
    return reference
