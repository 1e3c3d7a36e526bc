"""A virtual camera that other programs, such as video calls, see as a webcam.

It is fed at a fixed rate: the latest picture is sent again when no new one has come.
"""

from __future__ import annotations

import platform
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from guise.app.live.output import Output, OutputFrame
from guise.app.media.pictures import letterboxed
from guise.common.arrays import U8
from guise.common.errors import OutputError

if TYPE_CHECKING:
    import pyvirtualcam

_SETUP = {
    "Linux": "install v4l2loopback and load it with: sudo modprobe v4l2loopback exclusive_caps=1 card_label=Guise",
    "Darwin": "install OBS, press Start Virtual Camera in it, allow it in the system settings, then close OBS",
    "Windows": "install OBS, press Start Virtual Camera and Stop Virtual Camera in it once, then close OBS",
}
_LINUX_DEVICES = Path("/sys/devices/virtual/video4linux")
_UNSUPPORTED = "virtual cameras are supported on Linux, macOS and Windows only"


class VirtualCamera(Output):
    """Feeds a virtual camera of this computer.

    Parameters
    ----------
    device : its name, such as /dev/video9 or "OBS Virtual Camera"; None for the first free one.
    """

    def __init__(self, device: str | None = None) -> None:
        self._device = device
        self._camera: pyvirtualcam.Camera | None = None
        self._picture: U8 | None = None
        self._error: Exception | None = None
        self._closing = threading.Event()
        self._sender = threading.Thread(target=self._send_at_fixed_rate, name="guise-live-virtualcam")

    def check(self) -> None:
        """OutputError when the optional package is missing, or on Linux a device that no hardware has."""
        _library()
        if platform.system() == "Linux" and self._device is None and not any(_LINUX_DEVICES.glob("video*")):
            raise OutputError(f"there is no virtual camera: {_SETUP['Linux']}")

    def open(self, width: int, height: int, fps: float) -> None:
        """Open the device; sizes are rounded down to even ones, as the pixel formats of cameras require."""
        self._camera = _open_camera(width - width % 2, height - height % 2, fps, self._device)
        self._sender.start()

    def show(self, shown: OutputFrame) -> None:
        """Send this picture from now on."""
        assert self._camera is not None
        if self._error is not None:
            raise OutputError(
                f"the virtual camera {self._camera.device} no longer accepts pictures: {self._error}"
            )
        self._picture = letterboxed(shown.frame.rgb(), self._camera.width, self._camera.height)

    def close(self) -> None:
        """Release the device."""
        self._closing.set()
        if self._camera is not None:
            self._sender.join()
            self._camera.close()
            self._camera = None

    def _send_at_fixed_rate(self) -> None:
        assert self._camera is not None
        due, interval = time.perf_counter(), 1 / self._camera.fps
        while not self._closing.wait(max(0.0, due - time.perf_counter())):
            try:
                if self._picture is not None:
                    self._camera.send(self._picture)
            except Exception as error:  # drivers raise all kinds
                self._error = error
                return
            due = max(due + interval, time.perf_counter() - interval)  # no burst after a pause


def _open_camera(width: int, height: int, fps: float, device: str | None) -> pyvirtualcam.Camera:
    """The device; OutputError with the reasons and what to do when there is none."""
    library = _library()
    try:
        return library.Camera(width, height, fps, device=device)
    except RuntimeError as error:
        reasons = "; ".join(str(error).splitlines())
        asked = "there is no virtual camera" if device is None else f"there is no virtual camera {device}"
        todo = _SETUP.get(platform.system(), _UNSUPPORTED)
        raise OutputError(f"{asked} ({reasons}): {todo}") from error


def _library() -> Any:
    """The optional library; OutputError when it is missing."""
    try:
        import pyvirtualcam
    except ImportError as error:
        raise OutputError(
            'a virtual camera needs an extra: install it with pip install "guise-video[virtualcam]"'
        ) from error
    return pyvirtualcam
