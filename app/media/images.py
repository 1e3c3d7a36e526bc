"""Image files as they are read.

RGB uint8, (h, w, 3), or at the stored bit depth; the orientation is applied and, like other metadata, not kept apart.
What a file is, its content tells (`file_kind.py`); how it is written, its suffix (`image_writing.py`).
"""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import av
import av.error
import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.media import ifd
from guise.app.media.boxes import find
from guise.app.media.colour import gbr_matrix
from guise.app.media.errors import MediaError
from guise.app.media.file_kind import IMAGE_SUFFIXES, format_of, has_image_name, kind_of
from guise.app.media.heif import read_heif
from guise.app.media.orientation import AS_STORED, Orientation
from guise.app.media.rendition import Rendition, is_hdr, rendition_of
from guise.common.files import natural_key

__all__ = [
    "IMAGE_SUFFIXES",
    "DeepImage",
    "has_image_name",
    "list_images",
    "read_deep",
]

# Photometric interpretations of TIFF that are grey or RGB, or become RGB when OpenCV reads them
_PLAIN = frozenset({None, 0, 1, 2, 3, 6})
CMYK = 5  # that becomes RGB when Pillow reads it
_DNG_VERSION, _SUB_DIRECTORIES = 0xC612, 0x014A
_GAIN_MAPS = (b"ns.adobe.com/hdr-gain-map", b"aux:hdrgainmap", b"urn:iso:std:iso:ts:21496")
_PNG_HEAD = 4096  # bytes in which its colours are told


_GBR, _RGB = [1, 2, 0], [2, 0, 1]  # from RGB, and back

Image = NDArray[np.uint8]
Deep = NDArray[np.uint8] | NDArray[np.uint16]
Note = Callable[[str], None]


def _ignored(sentence: str) -> None:
    """Nobody listens."""


# EXIF orientation -> from the stored to the shown picture.
_ORIENTATIONS = {
    2: Orientation(flip_x=True),
    3: Orientation(flip_x=True, flip_y=True),
    4: Orientation(flip_y=True),
    5: Orientation(transpose=True),
    6: Orientation(transpose=True, flip_x=True),
    7: Orientation(transpose=True, flip_x=True, flip_y=True),
    8: Orientation(transpose=True, flip_y=True),
}


@dataclass(frozen=True, eq=False)
class DeepImage:
    """A picture at its stored bit depth, as shown.

    pixels : (h, w) grey or (h, w, 3) RGB, uint8 or uint16.   alpha : (h, w) of the same type, or None.
    profile : the bytes of its ICC profile, or None.
    depth : bits of a component as stored, if more than 8 and fewer than 16.
    code_points : its primaries and transfer as H.273 numbers them, or None.
    gain_map : whether its file also has what makes HDR of it, which is not written.
    """

    pixels: Deep
    alpha: Deep | None = None
    profile: bytes | None = None
    depth: int | None = None
    code_points: tuple[int, int] | None = None
    gain_map: bool = False

    @property
    def bits(self) -> int:
        """Bits of a component."""
        return 8 * self.pixels.dtype.itemsize

    @property
    def look(self) -> Rendition | None:
        """How HDR is shown with 8 bits, and back; None where it is not HDR."""
        primaries, transfer = self.code_points or (1, 1)
        hdr = self.pixels.ndim == 3 and self.bits == 16 and is_hdr(transfer)
        return rendition_of(gbr_matrix(), transfer, primaries) if hdr else None

    def rgb8(self) -> Image:
        """A copy as RGB (h, w, 3) uint8; of HDR what SDR would show."""
        if (look := self.look) is not None:
            gbr = look.shown(self.pixels[..., _GBR].astype(np.float32) / np.float32(257))
            return np.asarray(np.rint(np.clip(gbr, 0, 255))[..., _RGB], np.uint8)
        shallow = eight_bits(self.pixels)
        return np.repeat(shallow[..., None], 3, axis=2) if shallow.ndim == 2 else shallow.copy()


def list_images(folder: Path, note: Note = _ignored) -> list[Path]:
    """The image files of a folder in natural order, hidden ones left out; `note` hears what else is left out."""
    files = sorted((f for f in folder.iterdir() if f.is_file()), key=lambda file: natural_key(file.name))
    kinds = {file: kind_of(file) for file in files if not file.name.startswith(".")}
    others = [file.name for file, kind in kinds.items() if kind != "image"]
    if others and len(others) < len(kinds):
        more = f" and {len(others) - 3} more" if len(others) > 3 else ""
        note(f"Skipped {', '.join(others[:3])}{more}, which are not single images.")
    return [file for file, kind in kinds.items() if kind == "image"]


def read_deep(path: Path, note: Note = _ignored) -> DeepImage:
    """An image with its stored bit depth, alpha and profile; `note` hears of damage.  Raises MediaError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MediaError(f"{path} cannot be read ({error.strerror}): give an image file.") from error
    form = format_of(data)
    if form == "raw" or (form == "tiff" and _is_raw(data)):
        raise MediaError(
            f"{path} is a camera's raw picture: develop it, and give the JPEG, TIFF or PNG file."
        )
    image = _from_heif(path, data) if form == "heif" else _from_other(path, data, form, note)
    return replace(image, gain_map=any(mark in data for mark in _GAIN_MAPS))


def _from_other(path: Path, data: bytes, form: str, note: Note) -> DeepImage:
    image = None if form == "tiff" and _has_plain_alpha(data) else _by_opencv(path, data)
    if image is None:
        image = _by_pillow(path, data, note)
    elif form == "jpeg" and _is_damaged(data):
        note(f"{path.name} is damaged: parts of it may be wrong.")
    if form == "png" and (at := data.find(b"\0\0\0\4cICP", 0, _PNG_HEAD)) > 0:
        image = replace(image, code_points=(data[at + 8], data[at + 9]))
    return image


def _is_damaged(data: bytes) -> bool:
    """Whether a JPEG file holds what no coder writes: FFmpeg says so, OpenCV patches it up."""
    context: Any = av.CodecContext.create("mjpeg", "r")
    context.options, context.thread_count = {"err_detect": "explode"}, 1
    try:
        return any(
            picture.is_corrupt for picture in [*context.decode(av.Packet(data)), *context.decode(None)]
        )
    except av.error.InvalidDataError:
        return True
    except av.error.FFmpegError:  # a form of JPEG that it does not know
        return False


def _is_raw(data: bytes) -> bool:
    """Whether a TIFF file is a camera's raw picture, whose first directory is a preview."""
    reduced = (ifd.read_number(data, ifd.SUBFILE_TYPE) or 0) & 1
    found = ifd.read_values(data)
    return _DNG_VERSION in found or bool(reduced and _SUB_DIRECTORIES in found)


def _from_heif(path: Path, data: bytes) -> DeepImage:
    try:
        found = read_heif(data)
    except MediaError as error:
        raise MediaError(f"{path} {error}") from error
    depth = found.bits if 8 < found.bits < 16 else None
    profile = found.profile
    return DeepImage(found.pixels, found.alpha, fitting(profile, found.pixels), depth, found.code_points)


def _by_opencv(path: Path, data: bytes) -> DeepImage | None:
    """The picture as OpenCV reads it, None where it does not."""
    cv2.utils.logging.setLogLevel(
        cv2.utils.logging.LOG_LEVEL_SILENT
    )  # it says on the terminal what is said here in a sentence
    buffer = np.frombuffer(data or b"\0", np.uint8)
    try:
        raw, kinds, blocks = cv2.imdecodeWithMetadata(buffer, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:  # larger than OpenCV takes, or damaged in a way that it does not expect
        raise MediaError(
            f"{path} is not an image that can be read, or too large: give one of less than 32768 x 32768 pixels."
        ) from error
    if raw is None:
        return None
    photometric = ifd.read_short(data, ifd.PHOTOMETRIC)
    if photometric == CMYK:
        return None
    require_plain(str(path), raw, photometric)
    stored = {int(kind): np.asarray(block).tobytes() for kind, block in zip(kinds, blocks, strict=True)}
    profile = (
        stored.get(cv2.IMAGE_METADATA_ICCP) or ifd.read_values(data).get(ifd.PROFILE) or _jp2_profile(data)
    )
    return shown(np.asarray(raw), stored.get(cv2.IMAGE_METADATA_EXIF, b""), profile)


def require_plain(name: str, raw: NDArray[Any], photometric: int | None) -> None:
    """Raise MediaError unless a picture as OpenCV reads it is grey or RGB."""
    if raw.dtype not in (np.uint8, np.uint16) or photometric not in _PLAIN:
        raise MediaError(
            f"{name} is neither grey nor RGB of 8 or 16 bits per component: convert it to that first."
        )


def _has_plain_alpha(data: bytes) -> bool:
    """Whether a TIFF file has 8 bits and alpha by which colours are not multiplied yet; OpenCV would do so."""
    found = ifd.read_values(data)
    return max(found.get(ifd.BITS) or b"\0") == 8 and 2 in found.get(ifd.EXTRA_SAMPLES, b"")


def _by_pillow(path: Path, data: bytes, note: Note) -> DeepImage:
    """The picture as Pillow reads it: formats that OpenCV does not know, and as much as there is of damaged files."""
    from PIL import ImageFile

    try:
        with contextlib.suppress(*reading_errors()):
            return _opened(data)
        strict, ImageFile.LOAD_TRUNCATED_IMAGES = ImageFile.LOAD_TRUNCATED_IMAGES, True
        try:
            image = _opened(data)
        finally:
            ImageFile.LOAD_TRUNCATED_IMAGES = strict
    except reading_errors() as error:
        raise MediaError(
            f"{path} is not an image that can be read: give a PNG, JPEG, HEIC, AVIF, TIFF or WebP file."
        ) from error
    note(f"{path.name} is damaged: what cannot be read of it is grey.")
    return image


def reading_errors() -> tuple[type[Exception], ...]:
    """What Pillow and OpenCV raise for files that they cannot read."""
    from PIL import Image

    kinds = (OSError, ValueError, SyntaxError, EOFError, RuntimeError, IndexError, struct.error)
    return (*kinds, cv2.error, Image.DecompressionBombError)


def _opened(data: bytes) -> DeepImage:
    """A picture as Pillow reads it, 8 bits per component."""
    from PIL import Image, ImageOps

    with Image.open(io.BytesIO(data)) as opened:
        picture = ImageOps.exif_transpose(opened)
        profile = opened.info.get("icc_profile")
        clear = picture.has_transparency_data
        grey = picture.mode in ("1", "L") and not clear
        pixels = np.asarray(picture.convert("L" if grey else "RGBA" if clear else "RGB"), np.uint8)
    alpha = np.ascontiguousarray(pixels[..., 3]) if clear else None
    colours: NDArray[np.uint8] = np.ascontiguousarray(pixels if grey else pixels[..., :3])
    return DeepImage(colours, alpha, fitting(profile, colours))


def _jp2_profile(data: bytes) -> bytes | None:
    """The profile of a JPEG 2000 file (ISO/IEC 15444-1, I.5.3.3)."""
    colours = find(data, b"jp2h", b"colr") if format_of(data[:12]) == "jp2" else None
    return colours[3:] if colours and colours[0] in (2, 3) else None


def fitting(profile: bytes | None, pixels: NDArray[Any]) -> bytes | None:
    """A profile if it is for as many components; one for CMYK no longer applies."""
    return profile if profile and profile[16:20] == (b"GRAY" if pixels.ndim == 2 else b"RGB ") else None


def shown(raw: NDArray[Any], exif: bytes, profile: bytes | None) -> DeepImage:
    """A decoded picture in OpenCV's channel order, turned by its EXIF orientation (OpenCV turns TIFF files itself)."""
    turn = _ORIENTATIONS.get(ifd.read_short(exif, ifd.ORIENTATION) or 1, AS_STORED)
    turned = turn.view(raw)
    profile = fitting(profile, turned)
    if turned.ndim == 2:
        return DeepImage(np.ascontiguousarray(turned), None, profile)
    alpha = np.ascontiguousarray(turned[..., 3]) if turned.shape[2] == 4 else None
    return DeepImage(np.ascontiguousarray(turned[..., 2::-1]), alpha, profile)


def changed(image: DeepImage, rgb: Image) -> DeepImage:
    """The picture with other pixels where `rgb` (h, w, 3) differs from its own 8 bits; all else stays bit-exact."""
    before = image.rgb8()
    if before.shape != rgb.shape:
        return DeepImage(rgb)
    other = (before != rgb).any(axis=2)
    if not other.any():
        return image
    pixels = image.pixels
    if pixels.ndim == 2:
        if (rgb[other] != rgb[other][:, :1]).any():
            colours: Any = np.repeat(pixels[..., None], 3, axis=2)
            return changed(replace(image, pixels=colours, profile=None), rgb)
        rgb = rgb[..., 0]
    values: Any = rgb if image.bits == 8 else rgb.astype(np.uint16) * np.uint16(257)
    if (look := image.look) is not None:
        gbr = look.stored(rgb[..., _GBR].astype(np.float32))
        values = np.rint(np.clip(gbr, 0, 255)[..., _RGB] * np.float32(257)).astype(np.uint16)
    mask = other if pixels.ndim == 2 else other[..., None]
    return replace(image, pixels=np.where(mask, values, pixels))


def eight_bits(values: Deep) -> Image:
    """Components of 8 or 16 bits as 8 bits, rounded."""
    if values.dtype == np.uint8:
        return np.asarray(values, np.uint8)
    return np.asarray((values.astype(np.uint32) + 128) // 257, np.uint8)
