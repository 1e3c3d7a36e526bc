"""The options of a de-identification."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from guise.app.media import EncodeOptions
from guise.app.swapping.cover import CoverStyle
from guise.common.errors import GuiseError
from guise.render.compositor import Renderer

Audio = Literal["keep", "drop", "mask", "disguise"]
Region = Literal["face", "head"]
AuditExtent = Literal["sampled", "full"]


class DeidentifyError(GuiseError):
    """A de-identification that is not possible; one sentence."""


@dataclass(frozen=True)
class DeidentifyOptions:
    """How a file is de-identified; stored in the manifest, so that a resumed run is the same run.

    Parameters
    ----------
    donor : "auto", "same", "average:K", "mean:K", or NAME.guise; see `guise.app.swapping.donors.assign`.
    gallery : the user's own donors, NAME.guise files, instead of those that ship with the package.
    cover : how a face that is not swapped is covered.
    alpha : share in [0, 1] of what the texture shows of the expression outside the donor's own space that is let
        through; all of it brings moustaches and frames of glasses with it.
    seed : of the choice of donors.
    keyfile : where people and their donors are remembered, or None.
    audio : other than "keep" changes the sound.
    keep_metadata : keep the input's metadata, chapters, data streams and attachments.
    label : draw a visible label.
    certificate, key : PEM files for a signed C2PA manifest, or None.
    encode : encoder, crf, preset, lossless.
    renderer : which renderer draws.
    audit : "sampled" searches some frames of the original and the result for faces, "full" all.
    region : what a swap replaces: the face, or the head with hair, ears and outline.
    detector : of the audit, as `guise.aam.landmarks.open_detector` takes it; None for the built-in one.
    """

    donor: str = "auto"
    gallery: tuple[Path, ...] = ()
    cover: CoverStyle = "solid"
    alpha: float = 0.3
    seed: int = 0
    keyfile: Path | None = None
    audio: Audio = "keep"
    keep_metadata: bool = False
    label: bool = False
    certificate: Path | None = None
    key: Path | None = None
    encode: EncodeOptions = field(default_factory=EncodeOptions)
    renderer: Renderer = "auto"
    audit: AuditExtent = "sampled"
    detector: str | None = None
    region: Region = "face"

    def as_json(self) -> dict[str, Any]:
        """The options as JSON holds them."""
        return asdict(self, dict_factory=_plain)

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> DeidentifyOptions:
        """The options that `as_json` gave."""
        paths = {k: values[k] and Path(values[k]) for k in ("keyfile", "certificate", "key")}
        return cls(
            **values | paths
            | {"gallery": tuple(map(Path, values["gallery"])), "encode": EncodeOptions(**values["encode"])}
        )  # fmt: skip


def _plain(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    return {k: _text(v) for k, v in pairs}


def _text(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    return [_text(v) for v in value] if isinstance(value, tuple) else value
