"""The benchmarks of privacy and expression: who is who, and figures of made-up scores."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from made_up import SAMPLES

from benchmarks.deidentify import attack, expression, identity
from benchmarks.landmarks.clips import RealClip
from guise.app.measure.curves import CURVES
from guise.app.measure.job import MatchScores
from guise.app.media import open_input


def scores(every: list[list[float]], embeddings: list[list[float]]) -> MatchScores:
    values = np.array(every)
    return MatchScores(values[:, 0], values, np.array(embeddings, np.float32))


def test_clips_of_one_person_have_one_name() -> None:
    real, rendered = Path("data/real"), Path("synthetic/people/p03")
    assert identity.person_of(real / "address_o1.mp4") == identity.person_of(real / "address_o3.mp4")
    assert identity.person_of(real / "talk_r1.mp4") != identity.person_of(real / "talk_r2.mp4")
    assert identity.person_of(real / "grid_pwij3p.mpg") == identity.person_of(
        real / "grid_id2_vcd_swwp2s.mpg"
    )
    assert identity.person_of(rendered / "talk2.mp4") == "rendered p03"


def test_a_rendered_person_gets_another_face_than_the_own() -> None:
    words = identity.others_than("rendered p03")
    assert len(words) == 2 * (len(identity.gallery()) - 1)
    assert all(Path(word).is_file() for word in words[1::2])
    assert not any(word.endswith("p03.guise") for word in words)
    assert identity.others_than("talk_r1") == []


def test_ranks_are_told_among_all_and_among_real_people() -> None:
    """The first column is the source, the second a donor: best of all, and no real person."""
    after = scores([[0.3, 0.8, 0.1], [0.2, 0.9, 0.4]], [[1, 0, 0], [1, 0, 0.1]])
    own = np.array([[1, 0, 0], [0.6, 0.8, 0]], np.float32)
    templates = [np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0])]
    found = identity.outcome(Path("a.mp4"), [{"donor": "x/p03.guise"}], after, own, [0, 2], templates)
    assert found.ranks == (0, 0.5)
    assert (found.place, found.of, found.donor) == (1, 2, "p03")
    assert found.unswapped == pytest.approx([0.6])


def test_criteria_are_over_real_clips_with_the_same_weight() -> None:
    def clip(name: str, values: list[float]) -> identity.Outcome:
        return identity.Outcome(Path(name), "p01", np.array(values), np.ones(2), (0.0, 0.0), 2, 3)

    clips = [clip("real/a.mp4", [0.1] * 50), clip("real/b.mp4", [0.4]), clip("people/p01/talk2.mp4", [0.9])]
    rank, mean, p99 = identity.summary(clips, 100).criteria
    assert (rank.measured, rank.target) == (0, 3)
    assert mean.measured == pytest.approx(0.25)
    assert p99.measured == pytest.approx(0.4)


@pytest.mark.slow
def test_takes_are_the_beginning_and_the_second_half_of_a_clip(tmp_path: Path) -> None:
    clip = RealClip("p01", SAMPLES / "p01" / "talk2.mp4", np.zeros((20, 81, 2)))
    attack.write_takes(clip, tmp_path, "p01", 0.0)
    attack.write_takes(clip, tmp_path / "tilted", "p01", 30.0)
    with open_input(clip.video) as media:
        whole = [frame.luma.copy() for frame in islice(media, 20)]
    for number, first in ((1, 0), (2, 10)):
        with open_input(tmp_path / f"p01_{number}.mp4") as media:
            taken = [frame.luma.copy() for frame in media]
        assert len(taken) == 10
        assert np.abs(taken[0].astype(int) - whole[first]).mean() < 2
    with open_input(tmp_path / "tilted" / "p01_2.mp4") as media:
        assert media.width > whole[0].shape[1]


def test_kept_expression_is_over_the_frames_that_both_have() -> None:
    face = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][60:120].astype(float)
    after = face.copy()
    after[:15] = np.nan
    correlations, found = expression.kept(face, after)
    assert found == 0.75
    assert set(correlations) == set(CURVES)
    assert correlations["mouth opening"] == pytest.approx(1)
