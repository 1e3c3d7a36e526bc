"""Signed provenance: a C2PA manifest in a finished file, which states that it was made with Guise and how.

It neither names the input nor lists it as an ingredient: a manifest would show what the output hides.
Specification: https://spec.c2pa.org, actions and digital source types.
"""

from __future__ import annotations

import io
import json
import mimetypes
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from guise.app.media.errors import MediaError
from guise.app.media.image_writing import encode_image
from guise.app.media.images import list_images
from guise.app.media.synthetic import DIGITAL_SOURCE_TYPE
from guise.common.files import write_whole
from guise.common.version import VERSION

_SETTINGS = {"builder": {"thumbnail": {"enabled": False}}}
_CURVES = {"secp256r1": "es256", "secp384r1": "es384", "secp521r1": "es512"}


def check_signing(path: Path, certificate: Path, key: Path) -> None:
    """Raise MediaError before any work if an output of that name could not be signed; a small picture is signed to try.

    path : a name without a suffix is a folder of pictures.
    certificate : PEM file, the signer's certificate followed by those of its issuers.
    key : PEM file, its private key.
    """
    library = _library()
    if path.suffix and _type_of(path) not in library.Builder.get_supported_mime_types():
        raise MediaError(
            f"{path.name} cannot be signed, as the format holds no C2PA manifest: write to .mp4, .mov, .jpg or .png."
        )
    picture = encode_image(np.zeros((8, 8, 3), np.uint8), None, ".png", {})
    _sign_stream("image/png", io.BytesIO(picture), io.BytesIO(), certificate, key)


def sign(path: Path, certificate: Path, key: Path) -> None:
    """Put a signed manifest into a finished file, or into each picture of a folder.

    On an error, a MediaError, the file stays as it was.
    """
    for file in list_images(path) if path.is_dir() else [path]:
        write_whole(file, partial(_sign_file, file, certificate, key))


def _sign_file(file: Path, certificate: Path, key: Path, signed: Path) -> None:
    with file.open("rb") as source, signed.open("w+b") as target:
        _sign_stream(_type_of(file), source, target, certificate, key)


def _type_of(path: Path) -> str:
    """The media type of a file by its name, .part left off; "" if unknown."""
    name = path.name.removesuffix(".part")
    return mimetypes.guess_type(name)[0] or ""


def _sign_stream(kind: str, source: BinaryIO, target: BinaryIO, certificate: Path, key: Path) -> None:
    library = _library()
    signer = _signer(certificate, key)
    try:
        context = library.Context.from_dict(_SETTINGS)
        with library.Builder(json.dumps(_manifest()), context) as builder:
            builder.sign(signer, kind, source, target)
    except library.C2paError as error:
        raise MediaError(
            f"Signing with {certificate} failed ({str(error).rstrip('.')}): "
            "check the certificate, those of its issuers, which follow it, and the key."
        ) from error
    finally:
        signer.close()


def _manifest() -> dict[str, object]:
    """The claim: made by this version of Guise, a composite with synthetic parts."""
    tool = {"name": "Guise", "version": VERSION}
    actions = [
        {"action": "c2pa.created", "digitalSourceType": DIGITAL_SOURCE_TYPE, "softwareAgent": tool},
        {"action": "c2pa.edited", "digitalSourceType": DIGITAL_SOURCE_TYPE, "softwareAgent": tool,
         "description": "Faces were replaced by synthetic ones or covered."},
    ]  # fmt: skip
    return {
        "claim_generator_info": [tool],
        "assertions": [{"label": "c2pa.actions.v2", "data": {"actions": actions}}],
    }


def _signer(certificate: Path, key: Path) -> Any:
    library = _library()
    chain, secret = (_read(path) for path in (certificate, key))
    algorithm = _algorithm(secret, key)
    try:
        return library.Signer.from_info(library.C2paSignerInfo(algorithm, chain, secret, None))
    except library.C2paError as error:
        raise MediaError(
            f"{certificate} and {key} cannot sign ({str(error).rstrip('.')}): give a PEM certificate with those of its "
            "issuers, and its private key."
        ) from error


def _algorithm(secret: bytes, path: Path) -> str:
    """C2PA's name of the signature that a private key makes."""
    from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        key = load_pem_private_key(secret, None)
    except (ValueError, TypeError) as error:
        raise MediaError(
            f"{path} is not a readable private key: give one in PEM, without a password."
        ) from error
    if isinstance(key, ec.EllipticCurvePrivateKey) and key.curve.name in _CURVES:
        return _CURVES[key.curve.name]
    if isinstance(key, ed25519.Ed25519PrivateKey):
        return "ed25519"
    if isinstance(key, rsa.RSAPrivateKey):
        return "ps256"
    raise MediaError(
        f"{path} is a kind of key that C2PA does not use: give one for P-256, P-384, P-521, Ed25519 or RSA."
    )


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise MediaError(f"{path} cannot be read ({error.strerror}): give a PEM file.") from error


def _library() -> Any:
    """The optional library c2pa-python."""
    try:
        import c2pa
    except ImportError as error:
        raise MediaError('Signing needs c2pa-python: pip install "guise-video[provenance]".') from error
    return c2pa
