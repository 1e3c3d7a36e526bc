"""Benchmarks of the picture: telling frames are found, sheets show them, and worst figures are the worst."""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_up import SAMPLES

sys.path.append(str(Path(__file__).parents[1]))  # the benchmarks are part of the checkout, not of the package

from benchmarks.common import F64, Clip
from benchmarks.picture import identity, program, sheets, truth
from benchmarks.picture.turned import distances_from_line
from guise.aam.landmarks.schemes import BROWS, EYES, LOWER_LIP_INNER

FRAMES = 40


def still_face() -> F64:
    """(40, 81, 2) of one face that does not move."""
    face = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(float)
    return np.repeat(face[None], FRAMES, axis=0)


def rendered(name: str, **figures: float) -> truth.Row:
    return {**dict.fromkeys(truth.COLUMNS, 1.0), "scene": name, **figures}


def test_frames_are_chosen_for_what_the_face_does_in_them() -> None:
    points = still_face()
    points[8, LOWER_LIP_INNER, 1] += 12
    eyes = points[16][EYES]
    points[16, EYES, 1] = eyes[:, 1].mean() + 0.1 * (eyes[:, 1] - eyes[:, 1].mean())
    points[24, BROWS, 1] -= 10
    points[32] = np.nan
    scored = sheets.scores(points)
    found = sheets.chosen(scored)
    assert (found["widest mouth"], found["blink"], found["brows up"]) == (8, 16, 24)
    assert 32 not in found.values()


def test_chosen_frames_keep_apart() -> None:
    falling = np.arange(FRAMES, 0, -1.0)
    found = sheets.chosen({"a": falling, "b": falling, "nothing": np.full(FRAMES, np.nan)})
    assert found == {"a": 0, "b": sheets.GAP_FRAMES}


def test_light_error_is_the_change_of_lightness_in_the_face() -> None:
    shape = still_face()[0]
    grey, brighter = np.full((480, 640, 3), 119, np.uint8), np.full((480, 640, 3), 119, np.uint8)
    brighter[: int(shape[:, 1].min()) - 2] = 255  # above the face
    assert sheets.light_error(grey, brighter, shape) == 0
    brighter[:] = 145  # L 50 to 60
    assert sheets.light_error(grey, brighter, shape) == pytest.approx(10, abs=0.5)


def test_a_square_holds_the_pixels_around_a_place_and_black_beyond() -> None:
    picture = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)
    assert (sheets.square(picture, np.array([4.0, 3.0]), 4) == picture[1:5, 2:6]).all()
    corner = sheets.square(picture, np.array([0.0, 0.0]), 4)
    assert (corner[2:, 2:] == picture[:2, :2]).all()
    assert not corner[:2].any()


@pytest.mark.slow
def test_a_sheet_shows_the_original_above_the_swapped(tmp_path: Path) -> None:
    video = SAMPLES / "p01" / "talk.mp4"
    clip = Clip("p01", video, np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][:60].astype(float))
    found = sheets.contact_sheet(clip, video, tmp_path / "sheets" / "p01.png")
    assert len(found) == len(set(found.values())) == 6
    sheet = cv2.imread(str(tmp_path / "sheets" / "p01.png"))[sheets.TITLE_HEIGHT :]
    side = sheet.shape[1] // 6
    assert sheet.shape[0] == 2 * side
    assert sheet.any()
    assert (sheet[:side] == sheet[side:]).all()


def test_worst_is_told_by_what_a_figure_means() -> None:
    assert program.worst([0.2, 0.9, np.nan], program.LOW) == 0.2
    assert program.worst([0.2, 0.9], program.HIGH) == 0.9
    assert program.worst([-0.5, 0.4], program.FAR_FROM_0) == -0.5
    assert program.worst([0.7, 1.2], program.FAR_FROM_1) == 0.7
    assert np.isnan(program.worst([np.nan], program.HIGH))


def test_tables_end_with_means_and_worst_figures() -> None:
    rows = [rendered("a", gain=0.5), rendered("b", gain=0.1, highband=1.3)]
    lines = program.with_totals(rows, "scene", {"gain": program.LOW, "highband": program.FAR_FROM_1})
    assert lines == [("a", 0.5, 1.0), ("b", 0.1, 1.3), ("mean", 0.3, 1.15), ("worst", 0.1, 1.3)]


def test_a_refused_scene_lowers_the_mean_and_leaves_other_figures_to_the_others() -> None:
    report = truth.summary([rendered("a", gain=0.6, colour=1.2), truth.refused("b")])
    measured = {c.what: c.measured for c in report.criteria}
    assert measured["gain, mean"] == pytest.approx(0.3)
    assert measured["colour, worst scene"] == 1.2
    assert measured["frames not swapped, by the program's report, worst"] == 100


def test_gains_of_expression_are_judged_both_ways() -> None:
    row = {**dict.fromkeys(identity.COLUMNS, 1.0), "pair": "a__b", "lids_gain": 1.3, "sharp": -0.4}
    found = {"donor": 1.0, "source": 0.0, "margin": 0.3, "rows": [{"pair": "a__b", "taken_for": "b"}]}
    met = {c.what: c.met for c in identity.summary([row], found).criteria}
    assert met["taken for the donor"]
    assert met["mean gain of mouth, from 1"]
    assert not met["mean gain of lids, from 1"]
    assert not met["sharpness, absolute mean"]


def test_there_are_24_pairs_of_different_people() -> None:
    assert len(set(identity.PAIRS)) == len(identity.PAIRS) == 24
    assert all(source != donor for source, donor in identity.PAIRS)


def test_what_is_missing_is_said_and_nothing_is_measured(tmp_path: Path) -> None:
    options = argparse.Namespace(shared=tmp_path, peers_python=Path("python"), work=tmp_path, quick=False)
    for benchmark in (truth, identity):
        report = benchmark.measure(options)
        assert not report.criteria
        assert "is missing; --shared names" in report.notes[0]
    options.peers_python = None
    assert "--peers-python" in identity.measure(options).notes[0]


def test_a_point_may_lie_anywhere_along_a_line_but_not_beside_it_or_beyond_its_ends() -> None:
    corner = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    points = np.array([[7.0, 0.0], [10.0, 3.5], [4.0, 2.0], [-3.0, 4.0]])
    assert distances_from_line(points, corner) == pytest.approx([0, 0, 2, 5])
