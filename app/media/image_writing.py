"""Image files as they are written: forms by suffix, what each of them keeps, and tags inside them."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.media import ifd
from guise.app.media.boxes import box, boxes, find
from guise.app.media.errors import MediaError
from guise.app.media.heif import HeifPicture
from guise.app.media.images import DeepImage, Image, eight_bits

# Suffix -> what is written; the same where there is one form of it.
_FORMS = {
    ".jpg": "jpeg", ".jpeg": "jpeg", ".jpe": "jpeg", ".jfif": "jpeg", ".mpo": "jpeg", ".png": "png", ".tif": "tiff",
    ".tiff": "tiff", ".webp": "webp", ".bmp": "bmp", ".dib": "bmp", ".heic": "heic", ".heif": "heic", ".hif": "heic",
    ".avif": "avif", ".jp2": "jp2", ".jpx": "jp2", ".j2k": "j2k",
}  # fmt: skip
PAGES = frozenset({".tif", ".tiff", ".mpo"})  # of files that hold several pictures
_CODERS = {"jpeg": ".jpg", "tiff": ".tif", "j2k": ".jp2"}  # OpenCV's, where its suffix is not the form's name
_DEPTHS = {
    "png": 16,
    "tiff": 16,
    "jp2": 16,
    "j2k": 16,
    "heic": 10,
    "avif": 10,
}  # most bits, where more than 8
_TELLING = frozenset({"png", "heic", "avif"})  # that say which primaries and transfer they have
_WITHOUT_PROFILE = frozenset({"bmp", "j2k"})
_LOSSY = frozenset({"jpeg", "heic", "avif"})
_SETTINGS = {
    "jpeg": (cv2.IMWRITE_JPEG_QUALITY, 95),
    "webp": (cv2.IMWRITE_WEBP_QUALITY, 101),  # above 100 is lossless, as 1000 is of JPEG 2000
    "jp2": (cv2.IMWRITE_JPEG2000_COMPRESSION_X1000, 1000),
    "j2k": (cv2.IMWRITE_JPEG2000_COMPRESSION_X1000, 1000),
}
_PROFILE_SEGMENT_BYTES = 65_519  # of a profile in one JPEG segment
_PNG_HEADER = 8 + 25  # signature and IHDR chunk
XMP_BOX = bytes.fromhex("be7acfcb97a942e89c71999491e3afac")  # the identifier of a box with XMP (XMP, part 3)
_XMP = (
    '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
    'xmlns:Iptc4xmpExt="http://iptc.org/std/Iptc4xmpExt/2008-02-29/" xmlns:dc="http://purl.org/dc/elements/1.1/" '
    "Iptc4xmpExt:DigitalSourceType={kind}><dc:description><rdf:Alt><rdf:li xml:lang='x-default'>{description}"
    '</rdf:li></rdf:Alt></dc:description></rdf:Description></rdf:RDF></x:xmpmeta><?xpacket end="r"?>'
)


def can_write(suffix: str) -> bool:
    """Whether a picture with this suffix can be written."""
    return suffix.lower() in _FORMS


def lost_in(suffix: str, image: DeepImage) -> list[str]:
    """What a file with this suffix loses of a picture, in words."""
    form = _FORMS.get(suffix.lower(), "")
    lost = ["transparency"] if image.alpha is not None and form == "jpeg" else []
    depth = image.depth or image.bits
    lost += [f"{depth} bits per component"] if depth > _DEPTHS.get(form, 8) else []
    lost += ["HDR"] if image.look is not None and form not in _TELLING else []
    return lost + (["colour profile"] if image.profile and form in _WITHOUT_PROFILE else [])


def encode_image(rgb: Image, alpha: Image | None, suffix: str, tags: Mapping[str, str]) -> bytes:
    """The bytes of an image file.  JPEG has no alpha."""
    return encode_deep(DeepImage(rgb, alpha), suffix, tags)


def encode_deep(image: DeepImage, suffix: str, tags: Mapping[str, str]) -> bytes:
    """The bytes of an image file, with everything that its format can keep (see `lost_in`)."""
    form = _FORMS[suffix.lower()]
    if image.look is not None and form not in _TELLING:
        image = replace(image, pixels=image.rgb8(), depth=None, code_points=None)
    image = image if form in _DEPTHS else _shallow(image)
    if form in ("heic", "avif"):
        return _heif(image, form, tags)
    picture = _stored(image, form)
    settings = list(_SETTINGS.get(form, ()))
    blocks: dict[int, bytes] = {}
    if image.profile and form in ("png", "webp"):
        blocks[cv2.IMAGE_METADATA_ICCP] = image.profile
    if form == "webp" and tags:
        blocks[cv2.IMAGE_METADATA_XMP] = xmp(tags)
    metadata = [np.frombuffer(block, np.uint8) for block in blocks.values()]
    done, data = cv2.imencodeWithMetadata(
        _CODERS.get(form, f".{form}"), picture, list(blocks), metadata, settings
    )
    if not done:
        raise MediaError(
            f"An image of {picture.shape[1]} x {picture.shape[0]} cannot be written as {suffix}: use .png."
        )
    return _with_metadata(data.tobytes(), form, image, tags)


def encode_pages(images: Sequence[DeepImage], suffix: str, tags: Mapping[str, str]) -> bytes:
    """The bytes of a TIFF file of these pages, or of an MPO file of these views, whose first ones have the tags."""
    first, form = images[0], _FORMS[suffix.lower()]
    if form == "tiff":
        done, data = cv2.imencodemulti(".tif", [_stored(image, form) for image in images])
        assert done
        return _with_metadata(data.tobytes(), form, first, tags)
    from PIL import Image

    pages = [Image.fromarray(image.rgb8()) for image in images]
    held = io.BytesIO()
    settings = {
        "quality": _SETTINGS["jpeg"][1],
        "icc_profile": first.profile,
        "xmp": xmp(tags) if tags else None,
    }
    pages[0].save(held, "MPO", save_all=True, append_images=pages[1:], **settings)
    return held.getvalue()


def _with_metadata(data: bytes, form: str, image: DeepImage, tags: Mapping[str, str]) -> bytes:
    """The file with its profile and the tags, as far as OpenCV has not put them there."""
    if form == "tiff":
        extra = {ifd.PROFILE: image.profile or b"", ifd.XMP: xmp(tags) if tags else b""}
        return ifd.with_values(data, {tag: value for tag, value in extra.items() if value})
    if form in ("jp2", "j2k"):
        return _jp2_with(data, image.profile, tags) if form == "jp2" else find(data, b"jp2c") or b""
    whole = with_tags(data, form, tags)
    if form == "png" and image.code_points not in (None, (1, 13)):
        told = bytes([*(image.code_points or ()), 0, 1])  # cICP: RGB, full range (PNG 3, 11.3.2.6)
        whole = with_chunk(whole, b"cICP" + told)
    return _jpeg_with(whole, _jpeg_profile(image.profile or b"")) if form == "jpeg" else whole


def _jp2_with(data: bytes, profile: bytes | None, tags: Mapping[str, str]) -> bytes:
    """A JPEG 2000 file with a profile instead of its own colour space, and the tags as XMP."""
    parts = []
    for name, body in boxes(data):
        if name == b"jp2h" and profile:
            inner = (
                (kind, b"\2\0\0" + profile if kind == b"colr" else content) for kind, content in boxes(body)
            )
            body = b"".join(box(kind, content) for kind, content in inner)
        parts.append(box(name, body))
    return b"".join([*parts, box(b"uuid", XMP_BOX, xmp(tags)) if tags else b""])


def _heif(image: DeepImage, form: str, tags: Mapping[str, str]) -> bytes:
    from guise.app.media.heif_writer import write_heif

    bits = image.depth or image.bits
    picture = HeifPicture(image.pixels, image.alpha, bits, image.profile, image.code_points)
    return write_heif(picture, form, xmp(tags) if tags else b"")


def _shallow(image: DeepImage) -> DeepImage:
    """The picture with 8 bits per component."""
    alpha = None if image.alpha is None else eight_bits(image.alpha)
    return replace(image, pixels=eight_bits(image.pixels), alpha=alpha, depth=None)


def _stored(image: DeepImage, form: str) -> NDArray[Any]:
    """The picture as OpenCV stores it: grey, BGR or BGRA."""
    grey = image.pixels.ndim == 2
    if image.alpha is None or form == "jpeg":
        return np.ascontiguousarray(image.pixels if grey else image.pixels[..., ::-1])
    channels = [image.pixels] * 3 if grey else [image.pixels[..., i] for i in (2, 1, 0)]
    return np.stack([*channels, image.alpha], axis=2)


def lossy_form(suffix: str) -> str:
    """The name of the format that this suffix writes, if writing it changes pixels, or ""."""
    form = _FORMS.get(suffix.lower(), "")
    return form.upper() if form in _LOSSY else ""


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


def with_tags(data: bytes, form: str, tags: Mapping[str, str]) -> bytes:
    """The file with the tags, as PNG iTXt chunks, or JPEG comments and XMP; other formats stay as they are."""
    if not tags:
        return data
    if form == "png":
        chunks = b"".join(_png_text(key, value) for key, value in tags.items())
        chunks += _png_text("XML:com.adobe.xmp", xmp(tags).decode())
        return data[:_PNG_HEADER] + chunks + data[_PNG_HEADER:]
    if form == "jpeg":
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
    return _png_chunk(b"iTXt" + key.encode("latin-1", "replace")[:79] + b"\0\0\0\0\0" + value.encode())


def with_chunk(data: bytes, body: bytes) -> bytes:
    """A PNG file with one more chunk, after its header."""
    return data[:_PNG_HEADER] + _png_chunk(body) + data[_PNG_HEADER:]


def _png_chunk(body: bytes) -> bytes:
    """A chunk of a name and what it holds."""
    return struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))


def _jpeg_segment(mark: int, body: bytes) -> bytes:
    """One segment of a JPEG file; its length field holds at most 65,533 bytes of body."""
    body = body[:65533]
    return bytes([0xFF, mark]) + struct.pack(">H", len(body) + 2) + body
