"""Checks of the options before any work: paths are made absolute, and wrong values refused."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from guise.aam.landmarks import open_detector
from guise.app.deidentify.options import DeidentifyError, DeidentifyOptions
from guise.app.media.encoder import check_options
from guise.app.media.provenance import check_signing
from guise.app.swapping.cover import IMAGE_PREFIX, Covering
from guise.app.swapping.donors import (
    AVERAGE_PREFIX,
    MEAN_PREFIX,
    MODEL_SUFFIX,
    SAME,
    KeyFile,
    assign,
    face_spec,
    open_donor,
    parts,
)
from guise.render import GLMissing, RendererError, probe_gl


def checked(options: DeidentifyOptions, outputs: Iterable[Path]) -> DeidentifyOptions:
    """The same options with absolute paths, as workers run in another current folder.

    outputs : what is to be written.

    Raises
    ------
    MediaError, ModelError, RendererError, LandmarkError, DeidentifyError
        When something in them does not exist or can't be used; one sentence.
    """
    assert options.read is None or options.drawn is None  # both times can be read
    check_options(options.encode)
    if options.renderer == "gl" and isinstance(found := probe_gl(), GLMissing):
        raise RendererError(found.reason)
    named = tuple(Path(face_spec(str(face))) for face in options.gallery)
    options = replace(options, gallery=named, donor=_each_part(options.donor, face_spec))
    chosen = assign([0], options.donor, own=options.gallery, seed=options.seed, salt="")[0]
    for donor in {*parts(chosen), *map(str, options.gallery)}:
        open_donor(donor)
    options = replace(
        options, gallery=tuple(Path(_absolute(str(spec))) for spec in options.gallery),
        donor=_each_part(options.donor, _absolute), keyfile=_key_file(options.keyfile),
        certificate=_existing(options.certificate, "certificate"), key=_existing(options.key, "key"),
        detector=_detector(options.detector), cover=_cover(options),
    )  # fmt: skip
    if options.certificate and options.key:
        for output in {output.suffix: output for output in outputs}.values():
            check_signing(output, options.certificate, options.key)
    return options


def _each_part(donor: str, change: Callable[[str], str]) -> str:
    """A donor with each of its specs changed; "auto" and the like, which name nobody, stay as they are."""
    if donor in ("auto", SAME) or donor.startswith(AVERAGE_PREFIX) or parts(donor)[0].isdigit():
        return donor
    return MEAN_PREFIX * donor.startswith(MEAN_PREFIX) + "+".join(map(change, parts(donor)))


def _absolute(spec: str) -> str:
    """A spec with an absolute path."""
    return str(Path(spec).absolute()) if spec.endswith(MODEL_SUFFIX) else spec


def _cover(options: DeidentifyOptions) -> str:
    """What covers faces, with an absolute path in it."""
    try:
        Covering.of(options.cover, options.cover_strength)
    except ValueError as error:
        raise DeidentifyError(f"--cover {options.cover}: {error}") from None
    path = options.cover.removeprefix(IMAGE_PREFIX)
    return options.cover if path == options.cover else f"{IMAGE_PREFIX}{Path(path).absolute()}"


def _detector(spec: str | None) -> str | None:
    """The detector of the audit with an absolute path in it."""
    if spec is None:
        return None
    open_detector(spec)
    name, _, path = spec.partition(":")
    return f"{name}:{Path(path).absolute()}" if path else name


def _existing(path: Path | None, what: str) -> Path | None:
    if path is not None and not path.is_file():
        raise DeidentifyError(f"the {what} {path} does not exist: give a PEM file")
    return path and path.absolute()


def _key_file(path: Path | None) -> Path | None:
    if path is None:
        return None
    if not path.parent.is_dir():
        raise DeidentifyError(
            f"the key file {path} can't be written because the folder {path.parent} does not exist: create it"
        )
    if path.exists():
        KeyFile.open(path)
    return path.absolute()
