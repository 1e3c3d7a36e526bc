"""A virtual camera that other programs, such as a video call, see as a webcam.

It gets a steady rate whatever the pictures' own is: the latest picture is sent again when no new one has come.
"""

from __future__ import annotations

import platform
import threading
import time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from guise.app.live.letterbox import letterboxed
from guise.app.live.output import Output, Shown
from guise.common.errors import OutputError

if TYPE_CHECKING:
    import pyvirtualcam

_SETUP = {
    "Linux": "install v4l2loopback and load it with: sudo modprobe v4l2loopback exclusive_caps=1 card_label=Guise",
    "Darwin": "install OBS, press Start Virtual Camera in it, allow it in the system settings, then close OBS",
    "Windows": "install OBS, press Start Virtual Camera and Stop Virtual Camera in it once, then close OBS",
}
_ELSEWHERE = "there is one for Linux, macOS and Windows only"


class VirtualCamera(Output):
    """Feeds a virtual camera of this computer.

    Parameters
    ----------
    device : its name, such as /dev/video9 or "OBS Virtual Camera"; None for the first that is free.
    """

    def __init__(self, device: str | None = None) -> None:
        self._device = device
        self._camera: pyvirtualcam.Camera | None = None
        self._picture: NDArray[np.uint8] | None = None
        self._error: Exception | None = None
        self._closing = threading.Event()
        self._sender = threading.Thread(target=self._send_steadily, name="guise-live-virtualcam")

    def open(self, width: int, height: int, fps: float) -> None:
        """Take the device; sizes are made even, as the pixel formats of cameras want it."""
        self._camera = _open_camera(width - width % 2, height - height % 2, fps, self._device)
        self._sender.start()

    def show(self, shown: Shown) -> None:
        """Let this picture be the one that is sent from now on."""
        assert self._camera is not None
        if self._error is not None:
            raise OutputError(
                f"the virtual camera {self._camera.device} takes no more pictures: {self._error}"
            )
        self._picture = letterboxed(shown.frame.rgb(), self._camera.width, self._camera.height)

    def close(self) -> None:
        """Let the device go."""
        self._closing.set()
        if self._camera is not None:
            self._sender.join()
            self._camera.close()
            self._camera = None

    def _send_steadily(self) -> None:
        assert self._camera is not None
        due, step = time.perf_counter(), 1 / self._camera.fps
        while not self._closing.wait(max(0.0, due - time.perf_counter())):
            try:
                if self._picture is not None:
                    self._camera.send(self._picture)
            except Exception as error:  # whatever the driver says
                self._error = error
                return
            due = max(due + step, time.perf_counter() - step)  # after a pause it does not hurry


def _open_camera(width: int, height: int, fps: float, device: str | None) -> pyvirtualcam.Camera:
    """The device, or OutputError with the reasons and what to do."""
    try:
        import pyvirtualcam
    except ImportError as error:
        raise OutputError(
            'a virtual camera needs an extra: install it with pip install "guise-video[virtualcam]"'
        ) from error
    try:
        return pyvirtualcam.Camera(width, height, fps, device=device)
    except RuntimeError as error:
        reasons = "; ".join(str(error).splitlines())
        asked = "there is no virtual camera" if device is None else f"there is no virtual camera {device}"
        todo = _SETUP.get(platform.system(), _ELSEWHERE)
        raise OutputError(f"{asked} ({reasons}): {todo}") from error
