"""A video is coded about as finely as its input."""

from pathlib import Path

import av
import numpy as np
import pytest

from guise.app.media import EncodeOptions, open_input
from guise.app.media.coded_quality import LEAST_CRF, MOST_CRF, USUAL_CRF, crf_like, quantiser
from guise.app.media.encoding import encoding_for

OUT = Path("out.mp4")  # for which an encoder is chosen


def coded(path: Path, encoder: str, settings: dict[str, str]) -> Path:
    """A short video of noise."""
    rng = np.random.default_rng(0)
    with av.open(str(path), "w") as out:
        stream = out.add_stream(encoder, 25, settings)
        stream.width, stream.height, stream.pix_fmt = 160, 96, "yuv420p"
        for _ in range(3):
            noise = rng.integers(60, 190, (96, 160, 3), dtype=np.uint8)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(noise, "rgb24")))
        out.mux(stream.encode(None))
    return path


@pytest.mark.parametrize("step", [12, 24, 36])
def test_the_quantiser_of_a_file_is_known(tmp_path: Path, step: int) -> None:
    path = coded(tmp_path / "in.mp4", "libx264", {"qp": str(step), "preset": "ultrafast"})
    with open_input(path) as media:
        assert media.quantiser == pytest.approx(step, abs=3.5)  # an I picture has less


def test_other_formats_do_not_tell(tmp_path: Path) -> None:
    path = coded(tmp_path / "in.mkv", "ffv1", {})
    with open_input(path) as media:
        assert media.quantiser is None
        assert encoding_for(media, EncodeOptions(), OUT).settings["crf"] == str(USUAL_CRF)


def test_a_picture_that_no_decoder_made_has_no_quantiser() -> None:
    assert quantiser(av.VideoFrame(16, 16, "yuv420p")) is None


def test_what_was_coded_finely_is_coded_finely_again() -> None:
    factors = [crf_like(step) for step in (0.0, 19.0, 21.6, 23.0, 24.0, 51.0)]
    assert factors == [LEAST_CRF, LEAST_CRF, 18, 19, MOST_CRF, MOST_CRF]


@pytest.mark.parametrize(("step", "expected"), [(10, LEAST_CRF), (45, MOST_CRF)])
def test_an_encoder_gets_the_crf_of_its_input_unless_one_is_chosen(
    tmp_path: Path, step: int, expected: int
) -> None:
    path = coded(tmp_path / "in.mp4", "libx264", {"qp": str(step), "preset": "ultrafast"})
    with open_input(path) as media:
        assert encoding_for(media, EncodeOptions(), OUT).settings["crf"] == str(expected)
        assert encoding_for(media, EncodeOptions(crf=27), OUT).settings["crf"] == "27"
        assert encoding_for(media, EncodeOptions("libvpx-vp9"), OUT).settings["crf"] == "20"
        assert "crf" not in encoding_for(media, EncodeOptions(lossless=True), OUT).settings
