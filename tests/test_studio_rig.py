"""The page Rig in a browser: the head that three.js draws gets what was found, and so do files and receivers."""
# ruff: noqa: F811 (fixtures)

import json
import re
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clips import cut
from numpy.testing import assert_allclose
from studio_browser import StudioServer, browser, hand_over, studio_server, visit  # noqa: F401

from guise.aam.rig.names import ARKIT_NAMES
from guise.analogy.formats.gltf_container import GltfContainer
from guise.app.cli.main import main
from guise.app.rig.head import shipped_head
from guise.app.rig.turns import gltf_rotation

pytestmark = pytest.mark.slow

SMALL = {"viewport": {"width": 360, "height": 740}}  # quickly drawn
GLB = "model/gltf-binary"
# Every state of the head that the page has drawn: influences by the names in the GLB, and its rotation.
WATCH = """() => {
  window.seen = [];
  const { part } = guiseRig.morphs[0], show = guiseRig.show;
  guiseRig.show = function (values) {
    show.call(this, values);
    const named = Object.entries(part.morphTargetDictionary).map(([name, k]) => [name, part.morphTargetInfluences[k]]);
    const { x, y, z, w } = this.turned[0].part.quaternion;
    seen.push([Object.fromEntries(named), [x, y, z, w]]);
  };
}"""


@pytest.fixture
def desk(browser: Any, studio_server: StudioServer) -> Iterator[Any]:
    with visit(browser, studio_server, "/rig", **SMALL) as page:
        page.wait_for_function("guiseRig.morphs.length > 0")
        page.wait_for_function("window.did_handshake")
        yield page


def start(desk: Any) -> None:
    desk.evaluate(WATCH)
    desk.get_by_role("button", name="Start").click()


def downloaded(desk: Any, label: str) -> str:
    with desk.expect_download() as waiting:
        desk.get_by_role("button", name=label).first.click()
    return Path(waiting.value.path()).read_text(encoding="utf-8")


def renamed_rig(path: Path, name: str) -> None:
    """The rig that ships with names as "jawOpen" in `name`, on a node below one that is turned."""
    held = GltfContainer.read(shipped_head().read_bytes(), path.parent)
    extras = held.json["meshes"][0]["extras"]
    extras["targetNames"] = [name.format(re.sub("(Left|Right)$", r"_\1", one)) for one in ARKIT_NAMES]
    held.json["nodes"].append({"name": "body", "children": [0], "rotation": [0.0, 0.6, 0.0, 0.8]})
    held.json["scenes"][0]["nodes"] = [1]
    path.write_bytes(held.to_glb())


def test_the_head_has_the_coefficients_that_are_recorded_and_sent(desk: Any) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(20)
        desk.get_by_label("VMC receiver").fill(f"127.0.0.1:{receiver.getsockname()[1]}")
        desk.get_by_role("switch", name="Send").click()
        start(desk)
        desk.get_by_role("button", name="Record").click()
        desk.wait_for_function("window.seen.length > 8")
        desk.locator("body").press("h")
        desk.wait_for_function("(n) => window.seen.length > n + 8", arg=desk.evaluate("seen.length"))
        desk.get_by_role("button", name="Stop recording").click()
        sent = b"".join(receiver.recv(4096) for _ in range(12))
        desk.get_by_role("button", name="Stop", exact=True).click()
    lines = [json.loads(line) for line in downloaded(desk, "JSON lines").splitlines()]
    rows = np.array([[line["weights"][name] for name in ARKIT_NAMES] for line in lines])
    turns = gltf_rotation(
        np.array([[line["head"][way] for way in ("yaw", "pitch", "roll")] for line in lines])
    )
    seen = desk.evaluate("seen")
    drawn = np.array([[named[name] for name in ARKIT_NAMES] for named, _ in seen])
    away = np.abs(rows[:, None] - drawn[None]).max(2)
    found = away.min(0) < 1e-5  # files have five digits
    assert found.sum() > 12
    assert np.ptp(drawn[found], axis=0).max() > 0.05  # it moves
    for k in np.flatnonzero(found):
        assert_allclose(abs(turns[away[:, k].argmin()] @ seen[k][1]), 1, atol=1e-7)
    yaw = [abs(line["head"]["yaw"]) for line in lines]
    assert min(yaw) < 1 < max(yaw)  # recentred
    (at,) = list(re.finditer(rb"/VMC/Ext/Blend/Val\0\0,sf\0JawOpen\0", sent))[:1]
    jaw = struct.unpack_from(">f", sent, at.end())[0]
    assert np.abs(drawn[:, ARKIT_NAMES.index("jawOpen")] - jaw).min() < 1e-6


def test_a_clip_drives_a_head_of_the_user_as_the_command_does(
    desk: Any, studio_server: StudioServer, here: Path
) -> None:
    clip = cut("p01", here / "anna.mp4", 8)
    renamed_rig(here / "mine.glb", "Face.{}")
    hand_over(desk, "drop", here / "mine.glb", GLB, "[aria-label=Head] [data-drop]")
    desk.get_by_text("mine has 52 of 52 shapes, and turns head.").wait_for()
    hand_over(desk, "drop", clip, "video/mp4", "[aria-label=Clip] [data-drop]")
    desk.get_by_text("Start plays anna.").wait_for()
    desk.wait_for_function("'Face.jawOpen' in (guiseRig.morphs[0]?.part.morphTargetDictionary ?? {})")
    start(desk)
    desk.get_by_text("anna-1: 0.2 s, 8 frames").wait_for()
    lines = downloaded(desk, "JSON lines of anna-1").splitlines()
    expected = []
    for more in ([], ["--no-smooth"]):
        assert main(["rig", "from-video", str(clip), "-o", "a.jsonl", "--json", "--force", *more]) == 0
        expected.append((here / "a.jsonl").read_text(encoding="utf-8").splitlines())
    for line, other in zip(map(json.loads, lines), map(json.loads, expected[0]), strict=True):
        assert line["weights"] == pytest.approx(other["weights"], abs=2e-4)
    named, turn = desk.evaluate("seen.at(-1)")
    raw = [json.loads(line) for line in expected[1]]  # nothing is smoothed before the end
    away = [abs(named["Face.eyeBlink_Left"] - line["weights"]["eyeBlinkLeft"]) for line in raw]
    assert min(away) < 2e-4
    last = raw[int(np.argmin(away))]  # the connection may have been closed before the last frame of all
    # the turn of the head in the scene is the same, whatever the head is in
    x, y, z, _ = gltf_rotation(np.array([last["head"][way] for way in ("yaw", "pitch", "roll")]))
    assert turn[1] == pytest.approx(y, abs=1e-4)  # about the axis about which the body is turned
    assert np.hypot(turn[0], turn[2]) == pytest.approx(np.hypot(x, z), abs=1e-4)
    assert abs(np.hypot(x, z)) > 1e-2

    uploads = studio_server.folder / "uploads"
    assert len(list(uploads.glob("*"))) == 3  # the rig, its picture and what is drawn
    for name in ("Head", "Clip"):
        desk.get_by_role("button", name=f"Delete the files chosen for {name}").click()
        desk.get_by_role("alertdialog").get_by_role("button", name="Delete").click()
        desk.get_by_role("alertdialog").wait_for(state="detached")
    desk.get_by_text("The head that ships has 52 of 52 shapes").wait_for()
    assert list(uploads.glob("*")) == list((studio_server.folder / "clips").glob("*")) == []


def test_a_head_without_the_shapes_and_a_wrong_address_are_told_of(
    desk: Any, studio_server: StudioServer, here: Path
) -> None:
    renamed_rig(here / "plain.glb", "my {}")
    hand_over(desk, "drop", here / "plain.glb", GLB, "[aria-label=Head] [data-drop]")
    desk.get_by_text("plain has none of ARKit's 52 shapes").wait_for()
    assert list((studio_server.folder / "uploads").iterdir()) == []
    desk.get_by_label("VMC receiver").fill("127.0.0.1:x")
    desk.get_by_role("switch", name="Send").click()
    desk.get_by_text("The address of the receiver must be HOST or HOST:PORT").wait_for()
    desk.get_by_role("switch", name="Send", checked=False).wait_for()
