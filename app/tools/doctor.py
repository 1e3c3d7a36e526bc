"""Check of this computer: which parts of Guise work, and what to install for the rest."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any, Literal

import numpy as np

from guise.app.media.encoder import find_codec, library_versions
from guise.app.media.hardware import DEVICES, ENCODERS, decoder_fault, encoder_fault
from guise.common.kernels import COMPILED, RUNNING
from guise.common.version import VERSION

_ENCODERS = {
    "libx264": "H.264",
    "libx265": "H.265",
    "libsvtav1": "AV1",
    "libvpx-vp9": "VP9",
    "ffv1": "lossless",
}
_DECODERS = {
    "h264": "H.264",
    "hevc": "H.265",
    "vp9": "VP9",
    "av1": "AV1",
    "aac": "AAC sound",
    "opus": "Opus sound",
}
_PACKAGES = (
    "av",
    "opencv-contrib-python-headless",
    "numpy",
    "scipy",
    "scikit-image",
    "moderngl",
    "nicegui",
    "onnxruntime",
    "safetensors",
)
_EXTRAS = {
    "window": ("moderngl-window", "glfw", "sounddevice"),
    "virtualcam": ("pyvirtualcam",),
    "cluster": ("distributed", "fsspec"),
    "provenance": ("c2pa-python", "cryptography"),
    "plots": ("matplotlib",),
    "compressed": ("DracoPy", "meshoptimizer"),
}
# What is for live pictures only -> the findings that it depends on.
_LIVE = {"a window": ["window"], "a virtual camera": ["virtualcam", "loopback"], "your own picture": ["none"]}
_VIDEO_DEVICES = Path("/sys/class/video4linux")
_VIRTUAL_DEVICES = Path("/sys/devices/virtual/video4linux")


@dataclass(frozen=True)
class Finding:
    """The result of one check: ok is True, False, or None for something optional that is missing."""

    topic: str
    name: str
    ok: bool | None
    detail: str


def examine() -> list[Finding]:
    """All findings, in the order in which they are shown."""
    checks: list[Callable[[], Iterator[Finding]]] = [
        _system,
        _packages,
        _extras,
        _codecs,
        _hardware,
        _renderer,
        _faces,
        _cameras,
    ]
    return [finding for check in checks for finding in check()]


def conclusion(findings: list[Finding]) -> str:
    """One sentence: whether files can be worked on, and what live pictures need besides."""
    wrong = [f"{f.name}, {f.detail}" for f in findings if f.ok is False and f.topic != "cameras"]
    if wrong:
        return f"Not everything that files need works: {'; '.join(wrong)}."
    wanted = ["Everything you need for files works"]
    for what, names in _LIVE.items():
        steps = [f.detail for f in findings if f.name in names and f.ok is None]
        wanted += [f"for {what}: {', and '.join(steps)}"] if steps else []
    return "; ".join(wanted) + "."


def as_json(findings: list[Finding]) -> dict[str, Any]:
    """The findings by topic, as JSON holds them."""
    topics: dict[str, Any] = {}
    for f in findings:
        topics.setdefault(f.topic, {})[f.name] = {"ok": f.ok, "detail": f.detail}
    return topics


def _system() -> Iterator[Finding]:
    yield Finding("system", "Guise", True, VERSION)
    yield Finding("system", "Python", True, f"{platform.python_version()} on {platform.platform()}")
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    yield Finding("system", "CPU threads", True, f"{usable} usable of {os.cpu_count()}")
    slower = "none are compiled, NumPy is slower: install a C++ compiler, then Guise again"
    yield Finding("system", "kernels", True if COMPILED else None, RUNNING if COMPILED else slower)


def _packages() -> Iterator[Finding]:
    for package in _PACKAGES:
        try:
            yield Finding("packages", package, True, installed(package))
        except PackageNotFoundError:
            yield Finding("packages", package, False, f"missing: pip install {package}")


def _extras() -> Iterator[Finding]:
    for extra, packages in _EXTRAS.items():
        try:
            yield Finding("extras", extra, True, ", ".join(f"{name} {installed(name)}" for name in packages))
        except PackageNotFoundError:
            yield Finding("extras", extra, None, f'pip install "guise-video[{extra}]"')


def _codecs() -> Iterator[Finding]:
    missing = "not in this PyAV: pip install --upgrade av"
    yield Finding("codecs", "FFmpeg", True, library_versions())
    kinds: list[tuple[dict[str, str], Literal["r", "w"], str]] = [
        (_ENCODERS, "w", "writes"), (_DECODERS, "r", "reads")
    ]  # fmt: skip
    for titles, mode, does in kinds:
        for name, title in titles.items():
            ok = find_codec(name, mode) is not None
            yield Finding("codecs", f"{name} ({does})", ok, title if ok else missing)


def _hardware() -> Iterator[Finding]:
    for name, fault in [(name, encoder_fault(name)) for name in ENCODERS if find_codec(name, "w")]:
        yield Finding("hardware", f"{name} (writes)", None if fault else True, fault or "--encoder " + name)
    for device in DEVICES:
        fault = decoder_fault(device)
        yield Finding(
            "hardware", f"{device} (reads)", None if fault else True, fault or "--hwaccel " + device
        )


def _renderer() -> Iterator[Finding]:
    from guise.render import GLMissing, probe_gl

    yield Finding("drawing", "cpu", True, "always available")
    found = probe_gl()
    if isinstance(found, GLMissing):
        yield Finding("drawing", "gl", None, found.reason)
        return
    kind = "software, so auto chooses cpu" if found.software else "hardware, which auto chooses"
    yield Finding("drawing", "gl", True, f"{found.description}, OpenGL {found.version}; {kind}")


def _faces() -> Iterator[Finding]:
    from guise.aam.landmarks import LandmarkError, open_detector, open_landmarker

    open_landmarker("builtin").detect(np.zeros((64, 64, 3), np.uint8))
    yield Finding("faces", "builtin", True, "faces and landmarks, by the networks that come with Guise")
    try:
        open_detector("lbp")
        yield Finding("faces", "lbp", True, "face boxes, by the cascade of scikit-image")
    except LandmarkError as error:
        yield Finding("faces", "lbp", False, str(error))
    for name in ("yunet", "centerface"):
        yield Finding(
            "faces", name, None, f"face boxes, by a model that you download: --detector {name}:MODEL.onnx"
        )


def _cameras() -> Iterator[Finding]:
    if platform.system() != "Linux":
        yield Finding("cameras", "any", None, "shown by `guise live`, which asks the system for one")
        return
    devices = sorted(_VIDEO_DEVICES.glob("video*")) if _VIDEO_DEVICES.is_dir() else []
    for device in devices:
        name = device / "name"
        title = name.read_text(errors="replace").strip() if name.is_file() else "unnamed"
        node = Path("/dev") / device.name
        ok = os.access(node, os.R_OK | os.W_OK)
        yield Finding("cameras", str(node), ok, title if ok else f"{title}; no access: join the group video")
    virtual = _VIRTUAL_DEVICES.is_dir() and any(_VIRTUAL_DEVICES.iterdir())
    if not devices:
        yield Finding("cameras", "none", None, "connect a camera")
    yield Finding(
        "cameras", "loopback", virtual or None, "a virtual camera" if virtual else "load v4l2loopback"
    )
