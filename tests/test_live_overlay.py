"""What is written over a picture: where, when, readable, and nowhere else."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks.schemes import JAW, NOSE_TIP
from guise.app.live.controls import Controls
from guise.app.live.face import FaceResult, Outcome
from guise.app.live.options import LiveSettings
from guise.app.live.output import OutputFrame
from guise.app.live.overlay import AMBER, GREEN, STYLE, Overlay, TextRenderer, draw_ring, mirrored
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame, open_input

SIZE = 320, 240
MESH = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(float) / 2
USUAL = LiveSettings()
LATE = 100.0  # seconds: nothing has changed for long


@pytest.fixture(scope="module")
def talk() -> Frame:
    """The first picture of a sample clip, half as large, in the decoder's planes."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as source:
        video = next(iter(source)).video_frame
    return Frame(video.reformat(*SIZE), pts=0, time_base=Fraction(1, 30), index=0)


def plain(value: int, size: tuple[int, int] = SIZE) -> Frame:
    return Frame.from_rgb(np.full((size[1], size[0], 3), value, np.uint8))


def shown(
    frame: Frame, outcome: Outcome = "swapped", mesh: np.ndarray | None = None, **others: object
) -> OutputFrame:
    return OutputFrame(frame, FaceResult(outcome, mesh), PipelineStats(), **{"arrived": LATE, **others})


def settled(settings: LiveSettings = USUAL) -> Overlay:
    """An overlay that has shown mode and face long ago."""
    overlay = Overlay(["p01", "p02"])
    overlay.draw(shown(plain(0), arrived=0.0), settings)
    return overlay


def changed(before: Frame, after: Frame) -> np.ndarray:
    """(h, w) bool: pixels that differ."""
    return (before.rgb() != after.rgb()).any(2)


def bounds(where: np.ndarray) -> tuple[int, int, int, int]:
    """x0, y0, x1, y1 of what is True."""
    rows, columns = np.flatnonzero(where.any(1)), np.flatnonzero(where.any(0))
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Relative luminance of sRGB, as WCAG 2 defines it."""
    linear = np.where(rgb <= 10, rgb / 255 / 12.92, ((rgb / 255 + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def test_a_picture_of_which_nothing_is_to_be_said_stays_as_it_is(talk: Frame) -> None:
    after = settled().draw(shown(talk, mesh=MESH), USUAL)
    assert not changed(talk, after).any()
    assert after is not talk


@pytest.mark.parametrize(
    "settings", [LiveSettings(readout=True), LiveSettings(help=True, mirror=True), LiveSettings(mesh=True)]
)
def test_the_picture_that_others_see_is_never_drawn_on(talk: Frame, settings: LiveSettings) -> None:
    before = talk.copy()
    after = settled().draw(shown(talk, "lost", MESH, message="words", ring=0.5, recording=72.9), settings)
    assert not changed(before, talk).any()
    assert changed(mirrored(talk) if settings.mirror else talk, after).any()


def test_nothing_changes_but_the_corners(talk: Frame) -> None:
    settings = LiveSettings(readout=True)
    where = changed(talk, settled(settings).draw(shown(talk), settings))
    _, _, right, bottom = bounds(where[:, : SIZE[0] // 2 + 40])
    assert right < SIZE[0] * 0.63
    assert bottom < SIZE[1] * 0.4
    assert not where[SIZE[1] // 2 :].any()


@pytest.mark.parametrize("ground", [0, 90, 160, 255])
def test_it_can_be_read_on_any_ground(ground: int) -> None:
    """Letters and the panel below them have at least the contrast 4.5 : 1 of WCAG."""
    settings = LiveSettings(readout=True)
    frame = plain(ground, (1280, 720))
    rgb = settled(settings).draw(shown(frame), settings).rgb()
    panel = luminance(rgb[20:120, 20:80])
    assert (panel.max() + 0.05) / (np.median(panel) + 0.05) > 4.5


@pytest.mark.parametrize(("width", "height"), [(640, 480), (1280, 720), (1920, 1080), (720, 1280)])
def test_letters_grow_with_the_picture(width: int, height: int) -> None:
    def tall(size: tuple[int, int]) -> int:
        frame = plain(128, size)
        left, top, right, bottom = bounds(changed(frame, settled().draw(shown(frame, message="Ag"), USUAL)))
        assert left > 0
        assert bottom < size[1]
        assert (left + right) / 2 == pytest.approx(size[0] / 2, abs=2)
        return bottom - top

    assert tall((width, height)) / tall((640, 480)) == pytest.approx(min(width, height) / 480, rel=0.08)


@pytest.mark.parametrize("size", [(64, 48), (120, 160), (320, 240)])
def test_all_keys_fit_into_small_pictures(size: tuple[int, int]) -> None:
    frame = plain(255, size)
    settings = LiveSettings(help=True)
    after = settled(settings).draw(shown(frame, message="a message " * 20), settings)
    assert changed(frame, after)[1:-1, 1:-1].any()


def test_help_names_every_key() -> None:
    from guise.app.live.overlay import HELP, KEYS

    said = {row[0][0].lower() for row in HELP}
    assert {key.lower() for key in KEYS} <= said
    assert "f11" in said


def test_mode_and_face_are_shown_for_a_while_after_a_change(talk: Frame) -> None:
    controls, overlay = Controls(2), settled()
    controls.press("2")
    first = overlay.draw(shown(talk), controls.settings)
    assert changed(talk, first)[: SIZE[1] // 3, SIZE[0] // 2 :].any()
    assert not changed(talk, first)[SIZE[1] // 2 :].any()
    soon = overlay.draw(shown(talk, arrived=LATE + 0.9 * STYLE.change_seconds), controls.settings)
    assert not changed(first, soon).any()
    later = overlay.draw(shown(talk, arrived=LATE + 1.1 * STYLE.change_seconds), controls.settings)
    assert not changed(talk, later).any()


def test_each_face_has_its_name_in_any_script(talk: Frame) -> None:
    names = ["p01", "Zoë", "Ёлка", "漢字", "?", "??"]
    settings = [LiveSettings(identity=number, readout=True) for number in range(len(names))]
    drawn = [Overlay(names).draw(shown(talk), each).rgb().tobytes() for each in settings]
    assert len(set(drawn)) == len(names)


def test_figures_can_be_read_as_they_change_a_few_times_a_second(talk: Frame) -> None:
    settings = LiveSettings(readout=True)
    overlay = settled(settings)

    def drawn(fps: float, arrived: float) -> Frame:
        return overlay.draw(replace(shown(talk, arrived=arrived), stats=PipelineStats(fps=fps)), settings)

    first = drawn(59, LATE)
    assert not changed(first, drawn(61, LATE + 0.5 * STYLE.readout_seconds)).any()
    assert changed(first, drawn(61, LATE + 1.5 * STYLE.readout_seconds)).any()


def test_a_long_message_is_wrapped_and_stays_in_the_picture() -> None:
    frame, overlay = plain(255), settled()
    short = bounds(changed(frame, overlay.draw(shown(frame, message="camera 0 is back"), USUAL)))
    words = "camera 0 sends no pictures; plug it in again, or choose another camera with the option --camera"
    left, top, right, bottom = bounds(changed(frame, overlay.draw(shown(frame, message=words), USUAL)))
    assert 0 < left < right < SIZE[0]
    assert bottom < SIZE[1]
    assert bottom - top > 1.5 * (short[3] - short[1])


@pytest.mark.parametrize("outcome", ["shown", "lost"])
@pytest.mark.parametrize("settings", [LiveSettings(), LiveSettings(help=True)])
def test_what_must_be_known_is_said_whatever_else_is(outcome: Outcome, settings: LiveSettings) -> None:
    """That the real face is visible stays on the picture beside a message and the keys."""
    frame = plain(255, (640, 480))
    for message in ("", "a message"):
        usual = settled(settings).draw(shown(frame, message=message), settings)
        warned = settled(settings).draw(shown(frame, outcome, message=message), settings)
        assert changed(usual, warned)[400:].any()


def test_recording_is_red_in_the_corner(talk: Frame) -> None:
    after = settled().draw(shown(talk, recording=72.9), USUAL)
    left, _, _, bottom = bounds(changed(talk, after))
    assert left > SIZE[0] / 2
    assert bottom < SIZE[1] / 4
    rgb = after.rgb()[:bottom, left:].astype(int)
    assert (rgb[..., 0] - rgb[..., 1:].max(2)).max() > 80


@pytest.mark.parametrize("mirror", [False, True])
def test_the_mesh_lies_on_the_face(mirror: bool) -> None:
    """On a dark picture the landmarks, mirrored with it, are the green places."""
    settings = LiveSettings(mesh=True, mirror=mirror)
    rgb = settled(settings).draw(shown(plain(0), mesh=MESH), settings).rgb()
    places = MESH * (-1, 1) + (SIZE[0] - 1, 0) if mirror else MESH
    x, y = np.round(places).astype(int).T
    near = np.stack([rgb[y + dy, x + dx, 1] for dy in (-1, 0, 1) for dx in (-1, 0, 1)]).max(0)
    assert near.min() > 0.4 * GREEN[1]
    left, top, right, bottom = bounds(rgb[..., 1] > 60)
    assert np.abs(np.array([left, top, right, bottom]) - [*places.min(0), *places.max(0)]).max() < 3


def test_the_mask_tints_the_face_and_nothing_else() -> None:
    settings = LiveSettings(mask=True)
    rgb = settled(settings).draw(shown(plain(0), mesh=MESH), settings).rgb()
    x, y = np.round(MESH[NOSE_TIP]).astype(int)
    assert rgb[y, x] == pytest.approx(0.35 * np.array(AMBER), abs=2)
    outside = np.ones((SIZE[1], SIZE[0]), bool)
    (x0, y0), (x1, y1) = MESH.min(0).astype(int) - 2, MESH.max(0).astype(int) + 3
    outside[y0:y1, x0:x1] = False
    assert rgb[outside].max() == 0
    jaw = MESH[JAW[[0, 4, 12, 16]]] + 0.05 * (MESH[NOSE_TIP] - MESH[JAW[[0, 4, 12, 16]]])
    xs, ys = np.round(jaw).astype(int).T
    assert rgb[ys, xs].max(1).min() > 50


@pytest.mark.parametrize("shift", [1e9, np.nan, 5000.0, -500.0])
def test_a_mesh_out_of_the_picture_is_not_drawn(talk: Frame, shift: float) -> None:
    settings = LiveSettings(mesh=True, mask=True)
    after = settled(settings).draw(shown(talk, mesh=MESH + shift), settings)
    assert not changed(talk, after).any()


def test_a_mesh_that_leaves_the_picture_is_drawn_up_to_its_border(talk: Frame) -> None:
    settings = LiveSettings(mesh=True, mask=True)
    mesh = MESH - (MESH[:, 0].mean(), 0)
    after = settled(settings).draw(shown(talk, mesh=mesh), settings)
    left, _, right, _ = bounds(changed(talk, after))
    assert left == 0
    assert right == pytest.approx(mesh[:, 0].max(), abs=3)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_the_ring_closes_with_the_share(share: float) -> None:
    frame = plain(0, (640, 480))
    draw_ring(frame, share)
    y, x = np.nonzero(frame.rgb()[..., 1] > 120)
    turn = np.degrees(np.arctan2(x - 319.5, 239.5 - y)) % 360
    radius = np.hypot(x - 319.5, y - 239.5)
    covered = np.unique(turn.astype(int))
    assert len(covered) == pytest.approx(360 * share, abs=8)
    if share:
        assert radius.max() - radius.min() < 20
        assert 0.3 * 480 < radius.min() < radius.max() < 0.5 * 480


def test_a_ring_beyond_its_ends_is_empty_or_closed() -> None:
    for share, end in [(-1.0, 0.0), (7.0, 1.0)]:
        beyond, at = plain(0), plain(0)
        draw_ring(beyond, share)
        draw_ring(at, end)
        assert not changed(beyond, at).any()


def test_mirroring_twice_gives_the_picture_again(talk: Frame) -> None:
    assert (mirrored(talk).rgb() == talk.rgb()[:, ::-1]).all()
    assert not changed(talk, mirrored(mirrored(talk))).any()


def test_a_panel_is_made_once() -> None:
    """Making a text takes longer than a picture may; showing it again does not make it again."""
    overlay = settled()
    made: list[object] = []
    real = TextRenderer.panel

    def panel(self: TextRenderer, *what: object) -> object:
        made.append(what)
        return real(self, *what)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TextRenderer, "panel", panel)
        overlay = Overlay(["p01"])
        for number in range(5):
            overlay.draw(shown(plain(number), message="again and again"), LiveSettings(help=True))
    assert len(made) == 2
