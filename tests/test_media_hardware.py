"""Encoders and decoders in hardware: tried before they are used, and left to the processor where they do not work."""

from pathlib import Path
from typing import get_args

import pytest
from clips import cut

from guise.app.cli.options import Device
from guise.app.media import EncodeOptions, MediaError, hardware, open_input, open_sink, process
from guise.app.media.encoder import encoded_size, encoder_settings
from guise.app.media.hardware import DEVICES, ENCODERS, decoder_fault, encoder_fault, working_encoder


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return cut("p01", tmp_path / "clip.mp4", 6)


@pytest.mark.parametrize("name", ["h264_nvenc", "hevc_qsv", "av1_vaapi"])
def test_a_hardware_encoder_that_does_not_work_gives_way_to_the_processor_with_one_sentence(
    tmp_path: Path, clip: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(hardware, "encoder_fault", lambda name: "no driver")
    out = tmp_path / "out.mkv"
    with open_input(clip) as source, open_sink(out, source, EncodeOptions(name, crf=30)) as sink:
        problems = process(source, sink, lambda frame: None).problems
    assert problems == (
        f"Encoder {name} does not work on this computer (no driver): {ENCODERS[name]} was used.",
    )
    with open_input(out) as made:
        assert sum(1 for _ in made) == 6


def test_a_working_encoder_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hardware, "encoder_fault", lambda name: "")
    notes: list[str] = []
    for name in ("h264_nvenc", "libx264", "ffv1"):
        assert working_encoder(EncodeOptions(name), notes.append) == EncodeOptions(name)
    assert notes == []


@pytest.mark.parametrize("name", list(ENCODERS))
def test_each_encoder_is_tried_and_gets_a_quality(name: str) -> None:
    assert isinstance(encoder_fault(name), str)
    assert "25" in " ".join(encoder_settings(EncodeOptions(name, crf=25)).values()) or "videotoolbox" in name
    assert encoded_size(name, "yuv420p", 37, 23) == (38, 24)
    with pytest.raises(MediaError, match="no lossless mode"):
        encoder_settings(EncodeOptions(name, lossless=True))


@pytest.mark.parametrize("device", DEVICES)
def test_a_device_decodes_the_same_pictures_or_says_why_not(clip: Path, device: str) -> None:
    with open_input(clip) as plain, open_input(clip, device) as other:  # type: ignore[arg-type]
        for one, two in zip(plain, other, strict=True):
            assert (one.rgb() == two.rgb()).all()
        problems = list(other.problems)
    fault = decoder_fault(device)
    said = [f"Decoding by {device} does not work on this computer ({fault}): the processor decoded."]
    assert problems == (said if fault else [])


def test_the_command_knows_every_device() -> None:
    assert set(get_args(Device)) == {"none", "auto", *DEVICES}


def test_auto_is_silent(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hardware, "decoder_fault", lambda device: "no driver")
    with open_input(clip, "auto") as source:
        assert sum(1 for _ in source) == 6
        assert source.problems == []
