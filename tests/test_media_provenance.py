"""Signed manifests: what they claim is read back, and what cannot be signed is known before the work."""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from test_media import make_clip, video_planes
from test_media_private import rich_image

from guise.app.media import MediaError
from guise.app.media.provenance import check_signing, sign
from guise.app.media.synthetic import DIGITAL_SOURCE_TYPE
from guise.common.version import VERSION

c2pa = pytest.importorskip("c2pa")
x509 = pytest.importorskip("cryptography.x509")
from cryptography.hazmat.primitives import hashes, serialization  # noqa: E402
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa  # noqa: E402

_USAGES = (
    "digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement",
    "key_cert_sign", "crl_sign", "encipher_only", "decipher_only",
)  # fmt: skip
_NOW = datetime.now(UTC)


def certificate(name: str, key: Any, issuer: str, issuer_key: Any, *, ca: bool) -> Any:
    """A certificate as C2PA wants them (C2PA 2.1, 14.5)."""

    def named(text: str) -> Any:
        parts = [(x509.NameOID.COMMON_NAME, text), (x509.NameOID.ORGANIZATION_NAME, "Guise tests")]
        return x509.Name([x509.NameAttribute(oid, value) for oid, value in parts])

    usage = {use: use in (("key_cert_sign", "crl_sign") if ca else ("digital_signature",)) for use in _USAGES}
    builder = (
        x509.CertificateBuilder().subject_name(named(name)).issuer_name(named(issuer)).public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(_NOW - timedelta(days=1)).not_valid_after(_NOW + timedelta(days=9))
        .add_extension(x509.BasicConstraints(ca, None), True)
        .add_extension(x509.KeyUsage(**usage), True)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), False)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)
    )  # fmt: skip
    if not ca:
        purpose = x509.ExtendedKeyUsage([x509.ExtendedKeyUsageOID.EMAIL_PROTECTION])
        builder = builder.add_extension(purpose, False)
    digest = None if isinstance(issuer_key, ed25519.Ed25519PrivateKey) else hashes.SHA256()
    return builder.sign(issuer_key, digest)


def write_chain(folder: Path, key: Any) -> tuple[Path, Path]:
    """A signer's certificate with its issuer's, and the signer's key, as PEM files."""
    issuer = ec.generate_private_key(ec.SECP256R1())
    chain = [
        certificate("Signer", key, "Issuer", issuer, ca=False),
        certificate("Issuer", issuer, "Issuer", issuer, ca=True),
    ]
    pem = serialization.Encoding.PEM
    (folder / "cert.pem").write_bytes(b"".join(one.public_bytes(pem) for one in chain))
    plain = serialization.NoEncryption()
    (folder / "key.pem").write_bytes(key.private_bytes(pem, serialization.PrivateFormat.PKCS8, plain))
    return folder / "cert.pem", folder / "key.pem"


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    (tmp_path / "pki").mkdir()
    return write_chain(tmp_path / "pki", ec.generate_private_key(ec.SECP256R1()))


def manifest(path: Path) -> dict[str, Any]:
    """The active manifest of a file, whose signature and hashes are right."""
    with c2pa.Reader(str(path)) as reader:
        assert reader.get_validation_state() in ("Valid", "Trusted")
        active: dict[str, Any] = json.loads(reader.json())
    return active["manifests"][active["active_manifest"]]


def check_claims(path: Path) -> None:
    found = manifest(path)
    assert (found["claim_generator_info"][0]["name"], found["claim_generator_info"][0]["version"]) == (
        "Guise",
        VERSION,
    )
    [data] = [one["data"] for one in found["assertions"] if one["label"].startswith("c2pa.actions")]
    assert [action["action"] for action in data["actions"]] == ["c2pa.created", "c2pa.edited"]
    assert {action["digitalSourceType"] for action in data["actions"]} == {DIGITAL_SOURCE_TYPE}
    assert not {"ingredients", "thumbnail"} & set(found)


@pytest.mark.parametrize("suffix", [".mp4", ".mov"])
def test_a_signed_video_says_what_it_is_and_plays_as_before(
    tmp_path: Path, pair: tuple[Path, Path], suffix: str
) -> None:
    clip = make_clip(tmp_path / f"out{suffix}", sound=1)
    before = video_planes(clip)
    check_signing(clip, *pair)
    sign(clip, *pair)
    check_claims(clip)
    for old, new in zip(before, video_planes(clip), strict=True):
        assert all((a == b).all() for a, b in zip(old, new, strict=True))
    assert sorted(file.name for file in tmp_path.iterdir()) == [clip.name, "pki"]


@pytest.mark.parametrize("kind", ["P-384", "Ed25519", "RSA"])
def test_other_keys(tmp_path: Path, kind: str) -> None:
    key = {
        "P-384": lambda: ec.generate_private_key(ec.SECP384R1()),
        "Ed25519": ed25519.Ed25519PrivateKey.generate,
        "RSA": lambda: rsa.generate_private_key(65537, 2048),
    }[kind]()
    clip = make_clip(tmp_path / "out.mp4")
    sign(clip, *write_chain(tmp_path, key))
    check_claims(clip)


def test_a_changed_file_is_found_out(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    clip = make_clip(tmp_path / "out.mp4")
    sign(clip, *pair)
    data = clip.read_bytes()
    at = data.index(b"mdat") + 40
    clip.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
    with c2pa.Reader(str(clip)) as reader:
        assert reader.get_validation_state() == "Invalid"


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_pictures_of_a_folder_are_signed_one_by_one(
    tmp_path: Path, pair: tuple[Path, Path], suffix: str
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    files = [rich_image(folder / f"{number}{suffix}") for number in range(2)]
    check_signing(folder, *pair)
    sign(folder, *pair)
    for file in files:
        check_claims(file)
    assert sorted(folder.iterdir()) == files


@pytest.mark.parametrize("name", ["out.mkv", "out.webm", "out.ts"])
def test_a_container_without_a_place_is_refused_before_the_work(pair: tuple[Path, Path], name: str) -> None:
    with pytest.raises(
        MediaError, match=f"{name} cannot be signed, as the format holds no C2PA manifest: write to .mp4"
    ):
        check_signing(Path(name), *pair)


def test_a_key_of_another_certificate_is_refused(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    _, other = write_chain(tmp_path, ec.generate_private_key(ec.SECP256R1()))
    with pytest.raises(MediaError, match=r"check the certificate"):
        check_signing(Path("out.mp4"), pair[0], other)


def test_files_that_are_no_keys_are_one_sentence(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    (tmp_path / "text.pem").write_text("hello")
    for cert, key, match in [
        (pair[0], tmp_path / "none.pem", "none.pem cannot be read"),
        (tmp_path / "none.pem", pair[1], "none.pem cannot be read"),
        (pair[0], tmp_path / "text.pem", "text.pem is not a readable private key"),
        (tmp_path / "text.pem", pair[1], "cannot sign|failed"),
    ]:
        with pytest.raises(MediaError, match=match) as caught:
            check_signing(Path("out.mp4"), cert, key)
        assert str(caught.value).endswith(".")
        assert "\n" not in str(caught.value)


def test_a_failure_leaves_the_file_as_it_was(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    broken = tmp_path / "out.mp4"
    broken.write_bytes(b"no video")
    with pytest.raises(MediaError, match=r"Signing with .*cert\.pem failed"):
        sign(broken, *pair)
    assert broken.read_bytes() == b"no video"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["out.mp4", "pki"]


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "c2pa", None)
    with pytest.raises(MediaError, match=r'pip install "guise-video\[provenance\]"'):
        check_signing(Path("out.mp4"), Path("c.pem"), Path("k.pem"))
