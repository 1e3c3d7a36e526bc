"""The options of a de-identification."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from guise.app.deidentify.reach import reach_of_both
from guise.app.swapping import FACE_HELP
from guise.common.errors import GuiseError
from guise.common.option import option

if TYPE_CHECKING:
    from guise.app.media import EncodeOptions
    from guise.app.media.time_range import TimeRange

Audio = Literal["keep", "drop", "mask", "disguise"]
Region = Literal["face", "head"]
Outside = Literal["keep", "cut"]
AuditExtent = Literal["sampled", "full"]
OwnGlasses = Literal["remove", "keep"]


class DeidentifyError(GuiseError):
    """A de-identification that is not possible; one sentence."""


def _encoding() -> EncodeOptions:
    from guise.app.media import EncodeOptions

    return EncodeOptions()


@dataclass(frozen=True)
class DeidentifyOptions:
    """How a file is de-identified; stored in the manifest, so that a resumed run is the same run.

    Parameters
    ----------
    donor : see `guise.app.swapping.donors.assign`; gallery : model files, or specs of fictional faces.
    alpha : share in [0, 1] of what the texture shows of the expression outside the donor's own space that is let
        through; all of it brings moustaches and frames of glasses with it.
    certificate, key : PEM files for a signed C2PA manifest, or None.
    encode : encoder, crf, preset, lossless.
    detector : as `guise.aam.landmarks.open_detector` takes it; None for the built-in one.
    """

    donor: str = option(
        "auto",
        "The faces that are shown. auto: a different fictional one for each person; same, average:K: one for all "
        "people of all files, fictional or the average of K; mean:K: a different average of K for each; or one of "
        f"your choice for all: {FACE_HELP}.",
        name="--identity",
        metavar="auto|same|average:K|mean:K|FACE",
    )
    gallery: tuple[Path, ...] = option(
        (), "A face to choose from, instead of all fictional ones; may be repeated.", metavar="FACE"
    )
    cover: str = option(
        "solid",
        "How a face that is not swapped is covered; emoji is a smiling face.",
        metavar="solid|mosaic|blur|emoji|image:FILE",
    )
    cover_strength: int = option(
        1,
        "How much mosaic and blur hide, 1 to 5: 1 leaves the mean colours of six cells across, 5 of two.",
        least=1,
        most=5,
    )
    alpha: float = option(
        0.3,
        "Strength of expressions that the identity never showed, 0 to 1.",
        least=0.0,
        most=1.0,
    )
    seed: int = option(0, "Seed for the choice of donors.")
    keyfile: Path | None = option(
        None,
        "Remember people in this file, so that each gets the same donor in other videos.",
        metavar="FILE",
    )
    audio: Audio = option(
        "keep", "Keep the sound, drop it, mask voices by lowering them, or disguise them as a whisper."
    )
    keep_metadata: bool = option(
        False, "Keep location, device, author, times, comments and other data streams."
    )
    label: bool = option(False, "Draw a label that says that the faces are synthetic.")
    certificate: Path | None = None
    key: Path | None = None
    encode: EncodeOptions = field(default_factory=_encoding)
    renderer: Literal["auto", "gl", "cpu"] = option("auto", "Which renderer draws the face.")
    audit: AuditExtent = option(
        "sampled", "Search some frames of the original and the output for faces that are left, or all."
    )
    detector: str | None = option(
        None,
        "Face detector of the audit; default: the built-in one.",
        name="--audit-detector",
        metavar="lbp|yunet:PATH|centerface:PATH",
    )
    region: Region = option(
        "face",
        "What a swap replaces: the face, or the head with hair, ears and outline. " + reach_of_both(),
    )
    own_glasses: OwnGlasses = option(
        "remove",
        "The person's own glasses: taken off, or kept before the drawn face. Kept ones help whoever looks for "
        "the person.",
    )
    start: str | None = option(
        None,
        "Where the part to work on begins: seconds, 1:30 or 1:02:30.",
        name="--from",
        metavar="TIME",
    )
    end: str | None = option(None, "Where it ends; default: with the video.", name="--to", metavar="TIME")
    outside: Outside = option(
        "cut", "What lies outside --from and --to: cut it off, or keep it as it is, with all its faces."
    )

    @property
    def read(self) -> TimeRange | None:
        """The part of a file that is read, as the rest is cut off; None for all."""
        return self._part() if self.outside == "cut" else None

    @property
    def drawn(self) -> TimeRange | None:
        """The part of what is read in which faces are hidden; None for all."""
        return self._part() if self.outside == "keep" else None

    def _part(self) -> TimeRange | None:
        from guise.app.media.time_range import TimeRange

        return TimeRange.between(self.start, self.end)

    def as_json(self) -> dict[str, Any]:
        """The options as JSON holds them."""
        return asdict(self, dict_factory=_plain)

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> DeidentifyOptions:
        """The options that `as_json` gave."""
        from guise.app.media import EncodeOptions

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
