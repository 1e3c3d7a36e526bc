"""`guise rig`: what receivers, readers and Blender get is what was found, and mistakes are one sentence."""

import csv
import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from clips import cut, empty_scene
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from guise.aam.rig.calibration import ASKED
from guise.aam.rig.coefficients import Coefficients
from guise.aam.rig.names import ARKIT_NAMES, INDEX
from guise.aam.solid_shape import HeadPose
from guise.analogy.formats.files import read_frames, read_rig
from guise.analogy.formats.gltf_container import GltfContainer
from guise.app.cli.main import main
from guise.app.live.output import Output, OutputFrame
from guise.app.rig.asking import STEP_SECONDS, AskedCalibration
from guise.app.rig.curves import CurveRecorder, RigCurves
from guise.app.rig.formats import write_curves
from guise.app.rig.head import open_head, shipped_head
from guise.app.rig.live import run_rig_live
from guise.app.rig.options import RigLiveOptions
from guise.app.rig.turns import gltf_rotation, turn_beside, vmc_rotation
from guise.app.rig.vmc import PACKET_BYTES, VmcSender
from guise.common.closing import Closing


def curves(frames: int = 5) -> RigCurves:
    rng = np.random.default_rng(3)
    return RigCurves(
        np.arange(frames) / 24, rng.uniform(0, 1, (frames, 52)), rng.uniform(-40, 40, (frames, 3)),
        rng.uniform(-20, 20, (frames, 2, 3)) * (1, 1, 0), np.ones(frames, bool),
    )  # fmt: skip


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cut("p01", tmp_path_factory.mktemp("clip") / "talk2.mp4", 8)


def test_rotations_are_the_pose_in_the_axes_of_others() -> None:
    for turn in Rotation.random(20, np.random.default_rng(0)).as_matrix():
        found = HeadPose(turn, 1.0, np.zeros(2)).angles
        flipped = np.diag([1, -1, -1])  # x to the image's right, y up, z to the viewer
        assert_allclose(
            Rotation.from_quat(gltf_rotation(found)).as_matrix(), flipped @ turn @ flipped, atol=1e-9
        )
        assert_allclose(Rotation.from_quat(vmc_rotation(found)).as_matrix(), turn, atol=1e-9)


def test_a_recentred_head_turns_in_the_axes_of_where_it_was() -> None:
    rng = np.random.default_rng(1)
    for turn, rest in rng.uniform(-50, 50, (10, 2, 3)):
        was, now = (Rotation.from_quat(gltf_rotation(one)) for one in (rest, turn))
        found = Rotation.from_quat(gltf_rotation(turn_beside(turn, rest)))
        assert_allclose(found.as_matrix(), (was.inv() * now).as_matrix(), atol=1e-9)


def test_a_frame_without_a_face_holds_the_one_before() -> None:
    recorder, found = CurveRecorder(), Coefficients(np.full(52, 0.5, np.float32), np.ones(3), np.ones((2, 3)))
    for k, one in enumerate([None, found, None, None, found]):
        recorder.add(k / 10, one)
    made = recorder.curves()
    assert made.seen.tolist() == [False, True, False, False, True]
    assert made.weights[:, 0].tolist() == [0, 0.5, 0.5, 0.5, 0.5]
    assert made.longest_gap == pytest.approx(0.2)


def test_the_csv_has_the_columns_and_values_of_live_link_face(tmp_path: Path) -> None:
    write_curves(tmp_path / "a.csv", curves(), None)
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows[0]) == 63
    assert [row["Timecode"] for row in rows[:3]] == ["00:00:00:00.000", "00:00:00:02.500", "00:00:00:05.000"]
    assert list(rows[0])[16:20] == ["JawForward", "JawRight", "JawLeft", "JawOpen"]
    for row, weights, head in zip(rows, curves().weights, curves().head, strict=True):
        assert row["BlendshapeCount"] == "61"
        values = [float(row[name[0].upper() + name[1:]]) for name in ARKIT_NAMES]
        assert_allclose(values, weights, atol=1e-6)
        turned = [180 * float(row[f"Head{way}"]) for way in ("Yaw", "Pitch", "Roll")]
        assert_allclose(turned, head * (1, -1, -1), atol=1e-3)


def test_the_animation_of_a_glb_is_the_curves(tmp_path: Path) -> None:
    path, made = tmp_path / "a.glb", curves(3)
    write_curves(path, made, open_head(None))
    held = GltfContainer.read(path.read_bytes(), tmp_path)
    (animation,) = held.json["animations"]
    values = {
        one["target"]["path"]: held.read_accessor(animation["samplers"][one["sampler"]]["output"])
        for one in animation["channels"]
    }
    assert_allclose(values["weights"].reshape(3, 52), made.weights, atol=1e-6)
    assert_allclose(values["rotation"], gltf_rotation(made.head), atol=1e-6)
    rig = read_rig(shipped_head())
    assert rig.names == ARKIT_NAMES
    rest = rig.file.mesh.vertices
    for (_, vertices), weights in zip(read_frames(path, rig.file), made.weights, strict=True):
        assert_allclose(vertices, rest + np.tensordot(weights, rig.shapes - rest, 1), atol=1e-5)


def test_blender_imports_the_shapes_by_name_and_exports_fbx_and_usd(tmp_path: Path) -> None:
    bpy = pytest.importorskip("bpy", reason="Blender as a Python module is 1.3 GB: pip install bpy")
    write_curves(tmp_path / "a.glb", curves(), open_head(None))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "a.glb"))
    keys = bpy.data.objects["head"].data.shape_keys
    assert [key.name for key in keys.key_blocks][1:] == list(ARKIT_NAMES)
    assert keys.animation_data is not None
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "a.fbx"))
    bpy.ops.wm.usd_export(filepath=str(tmp_path / "a.usda"))
    for suffix in (".fbx", ".usda"):
        assert b"mouthFunnel" in (tmp_path / "a").with_suffix(suffix).read_bytes()


class Receiver(Closing):
    """What comes by UDP, decoded by python-osc."""

    def __init__(self) -> None:
        self._packets = pytest.importorskip("pythonosc.osc_packet")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(10)
        self.address = f"127.0.0.1:{self._socket.getsockname()[1]}"

    def close(self) -> None:
        self._socket.close()

    def frame(self, ends_with: str = "/VMC/Ext/Blend/Apply") -> list[tuple[str, list[object]]]:
        found: list[tuple[str, list[object]]] = []
        while not found or found[-1][0] != ends_with:
            data = self._socket.recv(4096)
            assert len(data) <= PACKET_BYTES
            packet = self._packets.OscPacket(data)
            found += [(one.message.address, list(one.message.params)) for one in packet.messages]
        return found


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with Receiver() as made:
        yield made


def test_a_receiver_gets_what_is_sent(receiver: Receiver) -> None:
    sender = VmcSender(receiver.address)
    found = Coefficients(np.linspace(0, 1, 52, dtype=np.float32), np.array([30.0, 0, 0]), np.zeros((2, 3)))
    sender.send(found, calibrated=True)
    sender.send(None, calibrated=False)
    got = receiver.frame()
    assert got[0] == ("/VMC/Ext/OK", [1, 3, 0, 1])
    blends = dict(params for address, params in got if address == "/VMC/Ext/Blend/Val")
    assert blends["JawOpen"] == pytest.approx(found.weights[INDEX["jawOpen"]])
    assert len(blends) == 52
    bones = {params[0]: params[1:] for address, params in got if address == "/VMC/Ext/Bone/Pos"}
    assert set(bones) == {"Head", "LeftEye", "RightEye"}
    assert_allclose(bones["Head"], [0, 0, 0, 0, -np.sin(np.pi / 12), 0, np.cos(np.pi / 12)], atol=1e-6)
    lost = receiver.frame("/VMC/Ext/T")
    assert [address for address, _ in lost] == ["/VMC/Ext/OK", "/VMC/Ext/T"]
    assert lost[0][1] == [1, 0, 0, 0]
    sender.close()


def test_a_clip_becomes_lines_of_its_frames(
    clip: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rig", "from-video", str(clip), "-o", "a.jsonl", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    lines = [json.loads(line) for line in (here / "a.jsonl").read_text(encoding="utf-8").splitlines()]
    assert [report["frames"], report["held"]] == [len(lines), 0] == [8, 0]
    assert [line["time"] for line in lines] == pytest.approx(np.arange(8) / 30, abs=1e-5)
    assert all(line["face"] and list(line["weights"]) == list(ARKIT_NAMES) for line in lines)
    assert lines[0]["head"]["yaw"] == pytest.approx(6.5, abs=3)


def test_a_live_run_sends_each_frame_and_ends_well_when_interrupted(
    clip: Path, tmp_path: Path, receiver: Receiver
) -> None:
    class Interrupting(Output):
        main_thread, shown = True, 0

        def show(self, shown: OutputFrame) -> None:
            self.shown += 1

        def pump(self) -> bool:
            if self.shown > 2:
                raise KeyboardInterrupt
            return True

    said: list[str] = []
    options = RigLiveOptions(
        input=str(clip), vmc=receiver.address, window=False, output=tmp_path / "a.csv", calibration=None
    )
    report = run_rig_live(options, say=said.append, outputs=[Interrupting()])
    assert report.sent > 0
    assert ("/VMC/Ext/Blend/Apply", []) in receiver.frame()
    assert report.file is not None
    assert len((tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()) == report.file.frames + 1 > 2
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
    stopped = threading.Event()
    stopped.set()
    assert (
        run_rig_live(RigLiveOptions(input=str(clip), window=False, vmc="127.0.0.1:9"), stopped=stopped).file
        is None
    )


class SeeingSteps:
    """Stands for `Calibrator`."""

    def __init__(self) -> None:
        self.seen: dict[str, int] = {}

    def see(self, rgb: object, points: object, step: str) -> None:
        self.seen[step] = self.seen.get(step, 0) + 1

    def result(self) -> str:
        return "learned"


@pytest.mark.parametrize("lost", ["", "smile"])
def test_a_calibration_asks_for_each_step(lost: str) -> None:
    asking = AskedCalibration(SeeingSteps())  # type: ignore[arg-type]
    rgb, points = np.zeros((2, 2, 3), np.uint8), np.zeros((81, 2))
    assert "not seen" in asking.see(rgb, None, 3.0)
    steps, said = list(ASKED), []
    for k in range(round(5 * STEP_SECONDS * 10) + 1):
        step = steps[min(int(k / 10 / STEP_SECONDS), 4)]
        said.append(asking.see(rgb, None if step == lost else points, 7 + k / 10))
    assert [sentence[0] for sentence in dict.fromkeys(said) if sentence] == list("12345")
    assert said[-1] == ""
    if lost:
        assert asking.result is None
        assert "no face was seen for smile" in asking.problem
    else:
        assert asking.result == "learned"
        assert set(asking.calibrator.seen) == set(ASKED)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["from-video", "CLIP", "-o", "a.txt"], "a.txt must end in .csv (Live Link Face)"),
        (["from-video", "EMPTY", "-o", "a.csv"], "no face was found in empty.mp4, and nothing was written"),
        (["from-video", "no.mp4", "-o", "a.csv"], "no.mp4 does not exist"),
        (["from-video", "CLIP", "-o", "a.csv", "--head", "a.glb"], "--head is for a .glb"),
        (["from-video", "CLIP", "-o", "a.glb", "--head", "no.glb"], "no.glb does not exist"),
        (["from-video", "CLIP", "-o", "a.csv", "--calibrate", "EMPTY"], "empty.mp4 cannot calibrate"),
        (["live", "--camera", "63", "--no-window", "-o", "a.csv"], "camera 63 cannot be opened"),
        (["live", "--input", "CLIP", "--no-window"], "nothing would be shown or sent"),
        (["live", "--vmc", "127.0.0.1:x", "--no-window"], "--vmc must be HOST or HOST:PORT"),
        (
            ["live", "--input", "EMPTY", "--no-window", "-o", "a.csv"],
            "no face was seen, and a.csv was not written",
        ),
    ],
)
def test_a_mistake_is_one_sentence_and_writes_nothing(
    arguments: list[str], sentence: str, clip: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if "EMPTY" in arguments:
        empty_scene(here / "empty.mp4")
    before = sorted(here.iterdir())
    names = {"CLIP": str(clip), "EMPTY": "empty.mp4"}
    assert main(["rig", *(names.get(one, one) for one in arguments)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[-1].startswith(f"error: {sentence}")
    assert sorted(here.iterdir()) == before
