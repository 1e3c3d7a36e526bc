"""Image files: reading, writing, and tags inside PNG, JPEG, TIFF and WebP.

RGB uint8, (h, w, 3), or at the stored bit depth; EXIF orientation is applied on reading and, like other metadata, not
written.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.media import ifd
from guise.app.media.errors import MediaError
from guise.app.media.orientation import AS_STORED, Orientation
from guise.app.media.reader import ProblemLog
from guise.common.files import natural_key

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})
_JPEG_SUFFIXES = frozenset({".jpg", ".jpeg"})
_TIFF_SUFFIXES = frozenset({".tif", ".tiff"})
_DEEP_SUFFIXES = _TIFF_SUFFIXES | {".png"}
_PROFILE_SUFFIXES = _DEEP_SUFFIXES | _JPEG_SUFFIXES | {".webp"}
_PLAIN = frozenset({0, 1, 2, 3, 6})  # photometric interpretations of TIFF that are grey or RGB, or become RGB
_JPEG_QUALITY = 95
_PROFILE_SEGMENT_BYTES = 65_519  # of a profile in one JPEG segment
_PNG_HEADER = 8 + 25  # signature and IHDR chunk

_XMP = (
    '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
    'xmlns:Iptc4xmpExt="http://iptc.org/std/Iptc4xmpExt/2008-02-29/" xmlns:dc="http://purl.org/dc/elements/1.1/" '
    "Iptc4xmpExt:DigitalSourceType={kind}><dc:description><rdf:Alt><rdf:li xml:lang='x-default'>{description}"
    '</rdf:li></rdf:Alt></dc:description></rdf:Description></rdf:RDF></x:xmpmeta><?xpacket end="r"?>'
)

Image = NDArray[np.uint8]
Deep = NDArray[np.uint8] | NDArray[np.uint16]

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
    """

    pixels: Deep
    alpha: Deep | None = None
    profile: bytes | None = None

    @property
    def bits(self) -> int:
        """Bits of a component."""
        return 8 * self.pixels.dtype.itemsize

    def rgb8(self) -> Image:
        """A copy as RGB (h, w, 3) uint8."""
        shallow = eight_bits(self.pixels)
        return np.repeat(shallow[..., None], 3, axis=2) if shallow.ndim == 2 else shallow.copy()


def looks_like_image(path: Path) -> bool:
    """Whether the suffix is that of a still image."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def list_images(folder: Path) -> list[Path]:
    """The image files of a folder in natural order, hidden ones left out."""
    files = [file for file in folder.iterdir() if looks_like_image(file) and not file.name.startswith(".")]
    return sorted((file for file in files if file.is_file()), key=lambda file: natural_key(file.name))


def read_image(path: Path, problems: ProblemLog) -> tuple[Image, Image | None] | None:
    """An image as RGB (h, w, 3) and its alpha (h, w) or None; None when it cannot be read."""
    try:
        image = read_deep(path)
    except MediaError:
        return None
    if image.bits != 8:
        problems.note(f"{path.name} was converted from {image.bits} to 8 bits per component.")
    return image.rgb8(), None if image.alpha is None else eight_bits(image.alpha)


def read_deep(path: Path) -> DeepImage:
    """An image with its stored bit depth, alpha and profile.  Raises MediaError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MediaError(f"{path} cannot be read ({error.strerror}): give an image file.") from error
    buffer = np.frombuffer(data or b"\0", np.uint8)
    try:
        raw, kinds, blocks = cv2.imdecodeWithMetadata(buffer, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:  # larger than OpenCV takes, or damaged in a way that it does not expect
        raise MediaError(
            f"{path} is not an image that can be read, or too large: give one of less than 32768 x 32768 pixels."
        ) from error
    if raw is None:
        raise MediaError(f"{path} is not an image that can be read: give a PNG, JPEG, TIFF or WebP file.")
    photometric = ifd.read_short(data, ifd.PHOTOMETRIC)
    if raw.dtype not in (np.uint8, np.uint16) or photometric not in _PLAIN | {None}:
        raise MediaError(
            f"{path} is neither grey nor RGB of 8 or 16 bits per component: convert it to that first."
        )
    stored = {int(kind): np.asarray(block).tobytes() for kind, block in zip(kinds, blocks, strict=True)}
    profile = stored.get(cv2.IMAGE_METADATA_ICCP) or ifd.read_values(data).get(ifd.PROFILE)
    return _shown(np.asarray(raw), stored.get(cv2.IMAGE_METADATA_EXIF, b""), profile)


def _shown(raw: NDArray[Any], exif: bytes, profile: bytes | None) -> DeepImage:
    """A decoded picture in OpenCV's channel order, turned by its EXIF orientation (OpenCV turns TIFF files itself)."""
    turn = _ORIENTATIONS.get(ifd.read_short(exif, ifd.ORIENTATION) or 1, AS_STORED)
    shown = turn.view(raw)
    space = b"GRAY" if shown.ndim == 2 else b"RGB "  # of the profile; one for CMYK no longer applies
    profile = profile if profile and profile[16:20] == space else None
    if shown.ndim == 2:
        return DeepImage(np.ascontiguousarray(shown), None, profile)
    alpha = np.ascontiguousarray(shown[..., 3]) if shown.shape[2] == 4 else None
    return DeepImage(np.ascontiguousarray(shown[..., 2::-1]), alpha, profile)


def eight_bits(values: Deep) -> Image:
    """Components of 8 or 16 bits as 8 bits, rounded."""
    if values.dtype == np.uint8:
        return np.asarray(values, np.uint8)
    return np.asarray((values.astype(np.uint32) + 128) // 257, np.uint8)


def lost_in(suffix: str, image: DeepImage) -> list[str]:
    """What a file with this suffix loses of a picture, in words."""
    suffix = suffix.lower()
    lost = ["transparency"] if image.alpha is not None and suffix in _JPEG_SUFFIXES else []
    lost += ["16 bits per component"] if image.bits == 16 and suffix not in _DEEP_SUFFIXES else []
    return lost + (["colour profile"] if image.profile and suffix not in _PROFILE_SUFFIXES else [])


def encode_image(rgb: Image, alpha: Image | None, suffix: str, tags: Mapping[str, str]) -> bytes:
    """The bytes of an image file.  JPEG has no alpha."""
    return encode_deep(DeepImage(rgb, alpha), suffix, tags)


def encode_deep(image: DeepImage, suffix: str, tags: Mapping[str, str]) -> bytes:
    """The bytes of an image file, with everything that its format can keep (see `lost_in`)."""
    suffix = suffix.lower()
    picture = _stored(image if suffix in _DEEP_SUFFIXES else _shallow(image), suffix)
    settings = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY] if suffix in _JPEG_SUFFIXES else []
    blocks: dict[int, bytes] = {}
    if image.profile and suffix in (".png", ".webp"):
        blocks[cv2.IMAGE_METADATA_ICCP] = image.profile
    if suffix == ".webp":
        settings = [cv2.IMWRITE_WEBP_QUALITY, 101]  # above 100 is lossless
        if tags:
            blocks[cv2.IMAGE_METADATA_XMP] = xmp(tags)
    metadata = [np.frombuffer(block, np.uint8) for block in blocks.values()]
    done, data = cv2.imencodeWithMetadata(suffix, picture, list(blocks), metadata, settings)
    if not done:
        raise MediaError(
            f"An image of {picture.shape[1]} x {picture.shape[0]} cannot be written as {suffix}: use .png."
        )
    if suffix in _TIFF_SUFFIXES:
        extra = {ifd.PROFILE: image.profile or b"", ifd.XMP: xmp(tags) if tags else b""}
        return ifd.with_values(data.tobytes(), {tag: value for tag, value in extra.items() if value})
    whole = _with_tags(data.tobytes(), suffix, tags)
    return _jpeg_with(whole, _jpeg_profile(image.profile or b"")) if suffix in _JPEG_SUFFIXES else whole


def _shallow(image: DeepImage) -> DeepImage:
    """The picture with 8 bits per component."""
    alpha = None if image.alpha is None else eight_bits(image.alpha)
    return DeepImage(eight_bits(image.pixels), alpha, image.profile)


def _stored(image: DeepImage, suffix: str) -> NDArray[Any]:
    """The picture as OpenCV stores it: grey, BGR or BGRA."""
    grey = image.pixels.ndim == 2
    if image.alpha is None or suffix in _JPEG_SUFFIXES:
        return np.ascontiguousarray(image.pixels if grey else image.pixels[..., ::-1])
    channels = [image.pixels] * 3 if grey else [image.pixels[..., i] for i in (2, 1, 0)]
    return np.stack([*channels, image.alpha], axis=2)


def is_lossy(suffix: str) -> bool:
    """Whether writing with this suffix changes pixels."""
    return suffix.lower() in _JPEG_SUFFIXES


def xmp(tags: Mapping[str, str]) -> bytes:
    """The tags as an XMP packet: IPTC's digital source type, and all others as one description.

    >>> b"digitalsourcetype/x" in xmp({"digital_source_type": "http://cv.iptc.org/newscodes/digitalsourcetype/x"})
    True
    """
    others = "; ".join(value for key, value in tags.items() if key != "digital_source_type")
    kind = f'"{_escaped(tags.get("digital_source_type", ""))}"'
    return _XMP.format(kind=kind, description=_escaped(others)).encode()


def _escaped(text: str) -> str:
    """As XML holds it; `html` and `xml.sax` take longer to import than the rest of this module."""
    for character, name in (("&", "amp"), ("<", "lt"), (">", "gt"), ('"', "quot")):
        text = text.replace(character, f"&{name};")
    return text


def _with_tags(data: bytes, suffix: str, tags: Mapping[str, str]) -> bytes:
    """The file with the tags, as PNG iTXt chunks, or JPEG comments and XMP; other formats stay as they are."""
    if not tags:
        return data
    if suffix == ".png":
        chunks = b"".join(_png_text(key, value) for key, value in tags.items())
        chunks += _png_text("XML:com.adobe.xmp", xmp(tags).decode())
        return data[:_PNG_HEADER] + chunks + data[_PNG_HEADER:]
    if suffix in _JPEG_SUFFIXES:
        segments = b"".join(_jpeg_segment(0xFE, f"{key}: {value}".encode()) for key, value in tags.items())
        segments += _jpeg_segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0" + xmp(tags))
        return _jpeg_with(data, segments)
    return data


def _jpeg_with(data: bytes, segments: bytes) -> bytes:
    """A JPEG file with more segments, after the JFIF segment, which must come first."""
    end = 4 + int.from_bytes(data[4:6], "big")
    return data[:end] + segments + data[end:]


def _jpeg_profile(profile: bytes) -> bytes:
    """A profile as numbered segments (ICC.1, annex B.4), as it may be longer than one."""
    pieces = [profile[i : i + _PROFILE_SEGMENT_BYTES] for i in range(0, len(profile), _PROFILE_SEGMENT_BYTES)]
    return b"".join(
        _jpeg_segment(0xE2, b"ICC_PROFILE\0" + bytes([number, len(pieces)]) + piece)
        for number, piece in enumerate(pieces, start=1)
    )


def _png_text(key: str, value: str) -> bytes:
    """One iTXt chunk: a keyword of at most 79 Latin-1 bytes, then UTF-8 text (PNG 3, 11.3.3.4)."""
    body = b"iTXt" + key.encode("latin-1", "replace")[:79] + b"\0\0\0\0\0" + value.encode()
    return struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))


def _jpeg_segment(mark: int, body: bytes) -> bytes:
    """One segment of a JPEG file; its length field holds at most 65,533 bytes of body."""
    body = body[:65533]
    return bytes([0xFF, mark]) + struct.pack(">H", len(body) + 2) + body
