"""Sends coefficients by the Virtual Motion Capture protocol, OSC 1.0 over UDP (protocol.vmc.info).

Blend shapes have the names of Perfect Sync, ARKit's with a capital letter; presets have those of VRM 0.x and of 1.0,
as a receiver takes no notice of names that its avatar lacks.  Head, LeftEye and RightEye turn, in Unity's
axes; their positions are sent as 0.  A frame is a few bundles, each small enough for one packet, and the last one holds
`Apply`.  Messages are packed here: 0.2 ms a frame, where python-osc takes 2.7.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator

from guise.aam.rig.coefficients import Coefficients
from guise.aam.rig.names import ARKIT_NAMES, perfect_sync_name
from guise.aam.rig.presets import preset_values
from guise.analogy.formats.vrm import LEGACY_NAMES
from guise.app.live.output import Output, OutputFrame
from guise.app.rig.shown import RigFrame
from guise.app.rig.turns import vmc_rotation
from guise.common.errors import OutputError
from guise.common.tuned import derived

PORT = derived(39539, "port", "where a marionette listens, by the protocol")
PACKET_BYTES = derived(1400, "bytes", "what an Ethernet frame of 1,500 takes")
BONES = ("Head", "LeftEye", "RightEye")
NAMES = tuple(map(perfect_sync_name, ARKIT_NAMES))
CALIBRATED, UNCALIBRATED = 3, 0  # of /VMC/Ext/OK


class VmcSender(Output):
    """Sends every frame to a receiver.

    address : "HOST[:PORT]".   presets : also send VRM's presets.   sent : frames so far.

    Raises OutputError when there is no such address.
    """

    def __init__(self, address: str, *, presets: bool = False) -> None:
        self._presets = presets
        family, self._to = vmc_address(address)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._start = time.perf_counter()
        self.sent = 0

    def show(self, shown: OutputFrame) -> None:
        """Send a frame; without a face, only that there is none."""
        assert isinstance(shown, RigFrame)
        self.send(shown.coefficients, calibrated=shown.calibrated)

    def send(self, found: Coefficients | None, *, calibrated: bool) -> None:
        """Send coefficients, or that no face is seen."""
        seconds = time.perf_counter() - self._start
        try:
            for packet in packets(messages(found, seconds, calibrated=calibrated, presets=self._presets)):
                self._socket.sendto(packet, self._to)
        except OSError:  # nobody listens yet
            return
        self.sent += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def messages(
    found: Coefficients | None, seconds: float, *, calibrated: bool, presets: bool = False
) -> Iterator[bytes]:
    """The messages of a frame."""
    state = CALIBRATED if calibrated else UNCALIBRATED
    yield _text("/VMC/Ext/OK") + _text(",iiii") + struct.pack(">4i", 1, state, 0, found is not None)
    yield _text("/VMC/Ext/T") + _text(",f") + struct.pack(">f", seconds)
    if found is None:
        return
    for bone, turn in zip(BONES, (found.head, *found.eyes), strict=True):
        place = struct.pack(">7f", 0, 0, 0, *vmc_rotation(turn).tolist())
        yield _text("/VMC/Ext/Bone/Pos") + _text(",sfffffff") + _text(bone) + place
    for begin, value in zip(_BLENDS, found.weights.tolist(), strict=True):
        yield begin + struct.pack(">f", value)
    for name, value in preset_values(found.weights).items() if presets else ():
        for called in (name, LEGACY_NAMES[name]):
            yield _BLEND + _text(called) + struct.pack(">f", value)
    yield _text("/VMC/Ext/Blend/Apply") + _text(",")


def packets(waiting: Iterator[bytes]) -> Iterator[bytes]:
    """Bundles, to be carried out at once, that hold messages in order."""
    begin = b"#bundle\0" + struct.pack(">Q", 1)
    packet = begin
    for message in waiting:
        if len(packet) + 4 + len(message) > PACKET_BYTES:
            yield packet
            packet = begin
        packet += struct.pack(">i", len(message)) + message
    yield packet


def _text(text: str) -> bytes:
    """A string of OSC: ended by 0, up to whole four bytes."""
    return text.encode() + bytes(4 - len(text) % 4)


_BLEND = _text("/VMC/Ext/Blend/Val") + _text(",sf")
_BLENDS = [_BLEND + _text(name) for name in NAMES]


def vmc_address(text: str) -> tuple[socket.AddressFamily, tuple[str, int]]:
    """Kind of address, host and port.

    >>> vmc_address("127.0.0.1:39540")[1], vmc_address("127.0.0.1")[1]
    (('127.0.0.1', 39540), ('127.0.0.1', 39539))
    """
    host, colon, port = text.rpartition(":")
    if not colon or text.endswith("]"):
        host, port = text, str(PORT)
    if not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
        raise OutputError(f"--vmc must be HOST or HOST:PORT, such as 127.0.0.1:{PORT}, got {text}")
    try:
        found = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_DGRAM)
    except OSError as error:
        raise OutputError(f"--vmc {text}: there is no such address ({error.strerror or error})") from error
    return found[0][0], (str(found[0][4][0]), int(port))
