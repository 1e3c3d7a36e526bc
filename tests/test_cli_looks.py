"""info, doctor and bench: what they show."""

import json
from pathlib import Path

import cv2
import pytest
from clips import cut
from models import model_file

from guise.app.cli.main import main
from guise.app.people.info import describe
from guise.app.tools import doctor
from guise.app.tools.doctor import Finding, conclusion
from guise.render import GLMissing

ROOT = Path(__file__).parents[1]


def test_info_holds_the_whole_file() -> None:
    identity, facts = describe(model_file("p01"))
    assert facts.modes == identity.appearance.components.modes
    assert (facts.name, facts.resolution, facts.tracker_stages) == ("p01", 64, 3)
    header = 8 + int.from_bytes(model_file("p01").read_bytes()[:8], "little")
    assert sum(facts.sizes.values()) + header == facts.file_size


def test_info_as_table_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    path = str(model_file("p01"))
    assert main(["info", path]) == 0
    table = capsys.readouterr().out
    for word in (
        "reference frame",
        "appearance modes",
        "held-out error",
        "lost above",
        "talk.mp4",
        "tracker",
    ):
        assert word in table
    assert main(["info", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["clips"] == ["talk.mp4"]


def test_info_takes_the_names_of_fictional_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "Mei", "--json"]) == 0
    mei = json.loads(capsys.readouterr().out)
    assert main(["info", "p03", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == mei
    assert mei["path"].endswith("p03.guise")
    assert main(["info", "Bob"]) == 2
    assert capsys.readouterr().err.startswith(
        "error: there is no face Bob: give NAME.guise, a photo, or one of Luca, "
    )


def test_the_montage_is_drawn_and_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "modes.png"
    assert main(["info", str(model_file("p01")), "--picture", str(output), "-q"]) == 0
    picture = cv2.imread(str(output))
    assert min(picture.shape[:2]) > 400
    assert picture.std() > 20
    assert main(["info", str(model_file("p01")), "--picture", str(output), "-q"]) == 2
    assert capsys.readouterr().err == (
        f"error: {output} exists: use --force to replace it, or choose another name\n"
    )
    assert list(tmp_path.iterdir()) == [output]


def test_doctor_looks_at_everything(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"system", "packages", "extras", "codecs", "hardware", "drawing", "faces", "cameras"}
    assert found["codecs"]["libx264 (writes)"]["ok"]
    assert found["faces"]["lbp"]["ok"]
    assert main(["doctor", "--verbose"]) == 0
    listed = capsys.readouterr().out
    assert "libx264" in listed
    assert main(["doctor"]) == 0
    assert listed.endswith(sentence := capsys.readouterr().out)
    assert sentence.startswith("Everything you need for files works")
    assert len(sentence.splitlines()) == 1


def test_doctor_ends_with_what_to_do() -> None:
    camera = Finding("cameras", "/dev/video0", True, "Camera")
    missing = Finding("extras", "virtualcam", None, 'pip install "guise-video[virtualcam]"')
    driver = Finding("cameras", "loopback", None, "load v4l2loopback")
    assert conclusion([camera]) == "Everything you need for files works."
    assert conclusion([camera, missing]) == (
        'Everything you need for files works; for a virtual camera: pip install "guise-video[virtualcam]".'
    )
    assert conclusion([missing, driver]) == (
        "Everything you need for files works; for a virtual camera: "
        'pip install "guise-video[virtualcam]", and load v4l2loopback.'
    )
    codec = Finding("codecs", "libx264 (writes)", False, "not in this PyAV: pip install --upgrade av")
    assert conclusion([missing, codec]) == (
        "Not everything that files need works: libx264 (writes), not in this PyAV: pip install --upgrade av."
    )


def test_doctor_names_cameras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "video0").mkdir()
    (tmp_path / "video0" / "name").write_text("Integrated Camera\n")
    monkeypatch.setattr(doctor, "_VIDEO_DEVICES", tmp_path)
    camera = next(f for f in doctor.examine() if f.topic == "cameras")
    assert camera.name == "/dev/video0"
    assert "Integrated Camera" in camera.detail


def test_doctor_without_gl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("guise.render.probe_gl", lambda: GLMissing("no driver: install libegl1"))
    gl = next(f for f in doctor.examine() if f.name == "gl")
    assert (gl.ok, gl.detail) == (None, "no driver: install libegl1")


@pytest.mark.slow
def test_bench_times_every_stage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip, model = cut("p01", tmp_path / "clip.mp4", 32), str(model_file("p01"))
    assert main(["bench", str(clip), "--source", model, "--identity", "mei", "--frames", "20", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    timings = found["milliseconds"]
    on_cpu = {t["stage"]: t for t in timings if t["renderer"] == "cpu"}
    passes = {path.stem.replace("_", " ") for path in (ROOT / "app" / "drawing" / "passes").glob("[a-z]*.py")}
    of_other_looks = {"forehead", "mouth", "paper light", "shades"}
    assert set(on_cpu) == passes - of_other_looks | {"track", "solid shape", "all"}
    assert all(0 < t["median"] <= t["p95"] for t in on_cpu.values())
    whole = found["file"]
    assert whole["frames"] == 32
    assert 0 < whole["transcode_seconds"] < whole["seconds"]
    assert 0 < whole["transcode_processor_seconds"] < whole["processor_seconds"]
    assert 0 < whole["first_packet_seconds"] < whole["seconds"]
    assert 0 <= whole["encoder_idle_share"] <= 1
