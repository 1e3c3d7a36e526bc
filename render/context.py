"""The one place where GL contexts are made and their errors checked.

The context is standalone (no window): EGL where it exists, the system's own off-screen context on Windows
and macOS; or the one of a window, made by a window library. A context belongs to the thread that made it.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from guise.render.errors import RendererError

if TYPE_CHECKING:
    import moderngl

MIN_GL_VERSION = 330
INSTALL_HINT = (
    "install libegl1 and libgl1-mesa-dri (Debian, Ubuntu), mesa-libEGL and mesa-dri-drivers (Fedora), "
    "or choose --renderer cpu"
)

_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "software rasterizer", "swiftshader", "basic render")
_DEVICES = ("dri/renderD*", "nvidia[0-9]*", "mali*", "kgsl*", "dxg")  # below /dev on Linux
_EGL_ATTEMPTS: Mapping[str, Mapping[str, Any]] = {
    "EGL": {"backend": "egl"},
    "EGL from libEGL.so.1 and libGL.so.1": {
        "backend": "egl",
        "libegl": "libEGL.so.1",
        "libgl": "libGL.so.1",
    },
    "EGL from libEGL.so.1 and libOpenGL.so.0": {
        "backend": "egl",
        "libegl": "libEGL.so.1",
        "libgl": "libOpenGL.so.0",
    },
}
_NATIVE_ATTEMPTS: Mapping[str, Mapping[str, Any]] = {"native off-screen context": {}}


@dataclass(frozen=True)
class GLInfo:
    """The GL that `create_context` gives on this computer."""

    renderer: str
    vendor: str
    version: str
    software: bool

    @property
    def description(self) -> str:
        """One line for a person, such as ``llvmpipe (LLVM 15.0.6, 256 bits)``."""
        return self.renderer


@dataclass(frozen=True)
class GLMissing:
    """Why there is no GL. Falsy, so that ``if probe_gl():`` reads as it should.

    reason : one sentence with every attempt, its failure and what to install.
    """

    reason: str

    def __bool__(self) -> Literal[False]:
        return False


def create_context() -> moderngl.Context:
    """A new standalone GL context of at least version 3.3, free of errors.

    Returns
    -------
    moderngl.Context
        Current in the calling thread; the caller releases it.

    Raises
    ------
    RendererError
        When no attempt succeeds: it names each attempt with its reason.
    """
    import moderngl

    failures: list[str] = []
    for name, settings in _attempts().items():
        try:
            return _checked(moderngl.create_context(require=MIN_GL_VERSION, standalone=True, **settings))
        except Exception as error:  # moderngl and its loaders raise bare Exception
            failures.append(f"{name}: {error}")
    raise RendererError(f"no GL context could be made ({'; '.join(failures)}): {INSTALL_HINT}")


def leave_thread() -> None:
    """Make no EGL context current in this thread: GLX would refuse a window's context beside it, fatally."""
    with contextlib.suppress(OSError):
        egl = ctypes.CDLL("libEGL.so.1")
        egl.eglGetCurrentDisplay.restype = ctypes.c_void_p
        egl.eglMakeCurrent.argtypes = [ctypes.c_void_p] * 4
        if display := egl.eglGetCurrentDisplay():
            egl.eglMakeCurrent(display, None, None, None)


def window_context(address: Callable[[str], int]) -> moderngl.Context:
    """The GL context that a window library has made current in this thread, whatever the system made it with.

    address : gives the address of a GL function by its name, 0 when there is none.

    Raises
    ------
    RendererError
        When it is older than version 3.3.
    """
    import moderngl

    settings: dict[str, Any] = {"context": _Loader(address)}
    try:
        return _checked(moderngl.create_context(require=MIN_GL_VERSION, **settings))
    except Exception as error:  # moderngl raises bare Exception
        raise RendererError(f"the window's GL cannot be used ({error})") from error


class _Loader:
    """Gives moderngl the addresses of GL functions."""

    def __init__(self, address: Callable[[str], int]) -> None:
        self.load_opengl_function = address

    def __enter__(self) -> None: ...

    def __exit__(self, *problem: object) -> None: ...

    def release(self) -> None: ...


def check(context: moderngl.Context, action: str) -> None:
    """Raise RendererError when GL has recorded an error; `action` says during what."""
    error = context.error
    if error != "GL_NO_ERROR":
        raise RendererError(f"GL reported {error} while {action}")


def describe(context: moderngl.Context) -> GLInfo:
    """What draws in this context, and whether it is software."""
    renderer = str(context.info["GL_RENDERER"])
    return GLInfo(
        renderer=renderer,
        vendor=str(context.info["GL_VENDOR"]),
        version=str(context.info["GL_VERSION"]),
        software=any(name in renderer.lower() for name in _SOFTWARE_RENDERERS),
    )


def may_have_hardware() -> bool:
    """False where GL can only be software: on a Linux that shows no graphics device.  Making a context takes longer."""
    return not sys.platform.startswith("linux") or any(any(Path("/dev").glob(name)) for name in _DEVICES)


def probe_gl() -> GLInfo | GLMissing:
    """The GL of this computer, or one sentence on why there is none."""
    try:
        context = create_context()
    except RendererError as error:
        return GLMissing(str(error))
    try:
        return describe(context)
    finally:
        context.release()


def _attempts() -> Mapping[str, Mapping[str, Any]]:
    return _NATIVE_ATTEMPTS if sys.platform in ("win32", "darwin") else _EGL_ATTEMPTS


def _checked(context: moderngl.Context) -> moderngl.Context:
    try:
        check(context, "making the context")
    except RendererError:
        context.release()
        raise
    return context
