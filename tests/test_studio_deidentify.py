"""The page De-identify in a browser: a video goes up, its faces are chosen, and it comes back with its report."""

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import av
import numpy as np
import pytest
from clips import cut, empty_scene, pictures
from made_up import SAMPLES
from studio_browser import (  # noqa: F401
    StudioServer,
    browser,
    page,
    studio,
    studio_server,
    visit,
)

from guise.aam.landmarks.detector import FaceDetector
from guise.app.media import MediaError
from guise.app.media.pictures import save_picture
from guise.app.studio.deidentify_editor import timeline
from guise.app.studio.deidentify_jobs import (
    TRACKS,
    DeidentifyChoices,
    preview,
    read_tracks,
    render,
    review,
    split,
    write_edited,
)
from guise.app.studio.jobs import with_user_names
from guise.app.studio.store import StudioError
from guise.common.progress import silent

pytestmark = pytest.mark.slow

FRAMES = 30
LONG = 120_000  # milliseconds, for a review or a rendering


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cut("p01", tmp_path_factory.mktemp("clip") / "party.mp4", FRAMES, clip="talk.mp4")


@pytest.fixture(scope="module")
def reviewed(studio_server: StudioServer, browser: Any, clip: Path) -> str:  # noqa: F811
    """Where the reviewed clip is in the studio."""
    with visit(browser, studio_server, "/deidentify") as visitor:
        return upload(visitor, clip)


@pytest.fixture
def case(page: Any, studio_server: StudioServer, reviewed: str) -> Any:  # noqa: F811
    """A visitor before the reviewed clip."""
    page.goto(studio_server.url(reviewed))
    show_faces(page)
    return page


def upload(visitor: Any, path: Path) -> str:
    """Upload a video, wait until its faces are found, and return where it is."""
    visitor.locator("input[type=file]").set_input_files(str(path))
    visitor.wait_for_url("**/deidentify/*")
    visitor.get_by_role("button", name="Render").wait_for(timeout=LONG)
    return urlsplit(visitor.url).path


def show_faces(visitor: Any) -> None:
    """Unfold the faces, which are folded when something was made of them."""
    visitor.wait_for_function("window.did_handshake")  # from then on the page hears what is clicked
    button = visitor.locator('[role="button"][aria-label*="Faces"]')
    button.wait_for()
    if button.get_attribute("aria-expanded") == "false":
        button.click()
    visitor.get_by_role("button", name="Render").wait_for()


def choose(visitor: Any, action: str) -> None:
    visitor.get_by_role("button", name=action, exact=True).click()


def pressed(visitor: Any, name: str) -> bool:
    button = visitor.get_by_role("button", name=name, exact=True)
    button.wait_for()
    return bool(button.get_attribute("aria-pressed") == "true")


def downloaded(visitor: Any, words: str, folder: Path) -> Path:
    with visitor.expect_download() as waiting:
        visitor.get_by_role("link", name=words).click()
    path = folder / waiting.value.suggested_filename
    waiting.value.save_as(path)
    return path


def wait_until(visitor: Any, true: Callable[[], bool]) -> None:
    for _ in range(200):
        if true():
            return
        visitor.wait_for_timeout(100)
    pytest.fail("it has not come true")


def delete(visitor: Any) -> None:
    """Delete a video with all that was made of it."""
    visitor.get_by_role("button", name="Delete", exact=True).click()
    visitor.get_by_role("alertdialog").get_by_role("button", name="Delete").click()
    visitor.wait_for_url("**/deidentify")
    visitor.get_by_text("Drop videos").wait_for()


def make(visitor: Any, sentence: str) -> None:
    """Have it rendered, by an impatient hand, and wait for what is said of it."""
    visitor.get_by_role("button", name="Render").dblclick()
    visitor.get_by_text(sentence).first.wait_for(timeout=LONG)


def test_a_face_is_covered_and_the_report_comes_with_the_video(case: Any, tmp_path: Path) -> None:
    videos = case.locator('a[download$=".mp4"]')
    before = videos.count()
    choose(case, "Cover")
    make(case, f"covered in {FRAMES} frames")
    assert videos.count() == before + 1
    cells = case.locator("tr", has_text="a face covered").first.locator("td")
    assert cells.all_inner_texts() == ["a face covered", str(FRAMES)]
    video, report_file, page_file = (
        downloaded(case, f"Download {words}", tmp_path)
        for words in ("video", "report (JSON)", "report (HTML)")
    )
    assert [p.name for p in (video, report_file, page_file)] == [
        f"party_deidentified{suffix}" for suffix in (".mp4", ".report.json", ".report.html")
    ]
    report = json.loads(report_file.read_text())
    assert report["counts"] == {"without face": 0, "swapped": 0, "covered": FRAMES, "left": 0}
    assert report["sha256"] == hashlib.sha256(video.read_bytes()).hexdigest()
    assert (report["input"], report["output"]) == ("party.mp4", "party_deidentified.mp4")
    assert "party_deidentified.mp4" in page_file.read_text()
    detector = FaceDetector(min_score=0.5)
    grey = [np.repeat(picture[..., None], 3, axis=2) for picture in pictures(video)[::10]]
    assert [len(detector.detect(picture)) for picture in grey] == [0] * len(grey)
    _the_report_stands_alone(case)


def test_the_button_that_renders_stays_while_choices_change(case: Any) -> None:
    """A click on one that is replaced meanwhile would be lost."""
    button = case.get_by_role("button", name="Render").element_handle()
    choose(case, "Leave")
    case.get_by_role("alertdialog").get_by_role("button", name="Show this face").click()
    case.get_by_text("1 track will show the real face").wait_for()
    assert button.is_visible()
    choose(case, "Swap")
    case.get_by_text("1 track will show the real face").wait_for(state="detached")
    assert button.is_visible()


def _the_report_stands_alone(visitor: Any) -> None:
    """It opens beside the studio, of which it can ask nothing."""
    with visitor.context.expect_page() as waiting:
        visitor.get_by_role("link", name="Open the report").click()
    opened = waiting.value
    opened.get_by_role("heading", name="De-identification report").wait_for()
    ask = "fetch('/people').then(() => 'let in', () => 'refused')"
    assert visitor.evaluate(ask) == "let in"
    assert opened.evaluate(ask) == "refused"
    opened.close()


def test_leaving_a_face_is_asked_for_in_words(case: Any) -> None:
    choose(case, "Cover")
    choose(case, "Leave")
    question = case.get_by_role("alertdialog")
    assert f"will be shown in {FRAMES} frames, recognisable to anyone" in question.inner_text()
    question.get_by_role("button", name="Keep it hidden").click()
    question.wait_for(state="detached")
    assert pressed(case, "Cover")
    choose(case, "Leave")
    question.get_by_role("button", name="Show this face").click()
    case.get_by_text("1 track will show the real face, recognisable to anyone.").wait_for()
    assert pressed(case, "Leave")
    choose(case, "Swap")
    case.get_by_text("1 track will show").wait_for(state="detached")


def test_choices_are_kept(case: Any, studio_server: StudioServer, reviewed: str) -> None:  # noqa: F811
    for action in ("Mosaic", "Drop"):
        choose(case, action)
        case.wait_for_timeout(500)
        if not pressed(case, action):  # a busy browser may miss a click; a hand presses again
            choose(case, action)
    case.get_by_role("button", name="Donor").click()
    case.get_by_role("button", name="Walter (fictional)").click()
    case.get_by_role("button", name="Donor: Walter (fictional)").wait_for()
    case.locator("[role=slider][aria-label='Strength of expression'] [tabindex]").press("ArrowLeft")
    kept = studio_server.folder / "jobs" / reviewed.split("/")[-1] / "choices.json"
    wanted = {"cover": "mosaic", "audio": "drop", "alpha": 0.2}
    wait_until(case, lambda: json.loads(kept.read_text()).items() >= wanted.items())
    case.reload()
    show_faces(case)
    assert pressed(case, "Mosaic")
    assert pressed(case, "Drop")
    case.get_by_role("button", name="Donor: Walter (fictional)").wait_for()
    assert case.get_by_role("slider", name="Strength of expression").get_attribute("aria-valuenow") == "0.2"


def test_a_video_without_faces_is_told_as_such(
    page: Any,  # noqa: F811
    studio_server: StudioServer,  # noqa: F811
    tmp_path: Path,
) -> None:
    page.goto(studio_server.url("/deidentify"))
    upload(page, empty_scene(tmp_path / "room.mp4"))
    page.get_by_text("Nobody is seen in this clip").wait_for()
    make(page, "No face was found in 8 frames.")
    delete(page)


def test_a_video_deleted_at_work_does_not_hold_up_the_next(
    page: Any,  # noqa: F811
    studio_server: StudioServer,  # noqa: F811
    clip: Path,
    tmp_path: Path,
) -> None:
    page.goto(studio_server.url("/deidentify"))
    page.locator("input[type=file]").set_input_files(str(clip))
    page.wait_for_url("**/deidentify/*")
    uploads, before = (
        studio_server.folder / "uploads",
        len(list((studio_server.folder / "uploads").iterdir())),
    )
    delete(page)
    assert len(list(uploads.iterdir())) == before - 1
    upload(page, empty_scene(tmp_path / "room.mp4"))


def test_what_is_no_reviewed_video_is_said(page: Any, studio_server: StudioServer) -> None:  # noqa: F811
    page.goto(studio_server.url("/deidentify/nothing"))
    page.get_by_text("no longer exists").wait_for()
    page.complaints.clear()  # the browser calls a page of status 404 an error


def test_videos_and_what_was_made_of_them_are_there_after_a_restart(
    browser: Any,  # noqa: F811
    studio_server: StudioServer,  # noqa: F811
    reviewed: str,
    tmp_path: Path,
) -> None:
    """A copy of the studio's folder is opened by another studio, on a phone."""
    with visit(browser, studio_server, reviewed) as visitor:
        show_faces(visitor)
        choose(visitor, "Cover")
        make(visitor, "The faces that were found are covered")
    folder = tmp_path / "studio"
    shutil.copytree(studio_server.folder, folder)
    phone = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}
    with studio(folder) as server, visit(browser, server, "/deidentify", **phone) as visitor:
        visitor.get_by_role("link", name="party").first.click()
        visitor.get_by_text("The faces that were found are covered").first.wait_for()
        show_faces(visitor)
        wide = visitor.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
        assert wide[0] <= wide[1], "nothing is to be moved aside on a phone"
        assert downloaded(visitor, "Download video", tmp_path).stat().st_size > 10_000
        uploads, id = len(list((folder / "uploads").iterdir())), reviewed.split("/")[-1]
        for path in ("/people", "/swap", "/live"):
            visitor.goto(server.url(path))
            visitor.wait_for_function("window.did_handshake")
            assert "party" not in visitor.content(), path
        visitor.goto(server.url(reviewed))
        delete(visitor)
        assert len(list((folder / "uploads").iterdir())) == uploads - 1
        assert list((folder / "jobs").rglob("out.mp4")) == list((folder / "jobs" / id).glob("*")) == []


def glimpse(path: Path) -> Path:
    """A video in which somebody is seen in two frames only, too few for a track."""
    with av.open(str(SAMPLES / "p01" / "talk.mp4")) as source:
        faces = [frame.to_ndarray(format="rgb24") for frame in islice(source.decode(video=0), 2)]
    empty = np.full_like(faces[0], 120)
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 30, {"crf": "16"})
        stream.height, stream.width = empty.shape[:2]
        stream.pix_fmt = "yuv420p"
        for picture in [*[empty] * 6, *faces, *[empty] * 6]:
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        out.mux(stream.encode(None))
    return path


def test_a_cover_is_refused_a_box_is_drawn_and_the_report_says_both(
    page: Any,  # noqa: F811
    studio_server: StudioServer,  # noqa: F811
    tmp_path: Path,
) -> None:
    page.goto(studio_server.url("/deidentify"))
    upload(page, glimpse(tmp_path / "glimpse.mp4"))
    card = page.locator(".q-card", has_text="Cover 1").last
    card.get_by_role("img", name="What cover 1 hides").wait_for()
    card.get_by_role("button", name="Not a face").click()
    page.get_by_text("1 place stays as it is, as you said that there is no face.").wait_for()
    stage = page.get_by_role("group", name="A frame before and after")
    stage.scroll_into_view_if_needed()
    box = stage.bounding_box()
    corners = [
        (box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in ((0.06, 0.4), (0.2, 0.55))
    ]
    page.mouse.move(*corners[0])
    page.mouse.down()
    page.mouse.move(*corners[1])
    page.mouse.up()
    page.get_by_role("button", name="Cover it").click()
    page.get_by_text("Covered: frames 6 to 13, box").wait_for()
    save_picture(tmp_path / "red.png", np.full((60, 60, 3), (255, 0, 0), np.uint8))
    page.locator("input[type=file]").set_input_files(str(tmp_path / "red.png"))
    page.get_by_role("img", name="What covers faces").wait_for()
    make(page, "The faces that were found are covered in 8 frames.")
    page.get_by_text("Covers: a picture.").wait_for()
    page.get_by_text("What has no track is left as it is in 2 frames, as you said.").first.wait_for()
    delete(page)


# -- the work -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def work(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The choices for a rendering of the reviewed clip."""
    folder = tmp_path_factory.mktemp("review")
    found = review({"source": str(clip), "name": "Party: Ann's"}, folder, silent)
    assert len(found["pictures"]["1"]) == len(list(folder.glob("1.*.jpg")))
    assert all(0 <= frame < FRAMES == found["frames"] for frame in found["pictures"]["1"])
    assert found["seconds"] == pytest.approx((FRAMES - 1) / 30)
    return {
        "source": str(clip), "name": "Party: Ann's", "found": str(folder), "output": found["output"],
        "choices": {"actions": {"1": "swap"}, "donors": {"1": ""}},
    }  # fmt: skip


def test_a_video_is_rendered_again_with_other_choices(work: dict[str, Any], tmp_path: Path) -> None:
    results = []
    for donor, audio in (("p02", "keep"), ("p05", "drop")):
        folder = tmp_path / donor
        folder.mkdir()
        choices = work["choices"] | {"donors": {"1": donor}, "audio": audio}
        made = render(work | {"choices": choices}, folder, silent)
        assert made["outcome"] == 0
        assert made["counts"]["swapped"] == FRAMES
        report = json.loads((folder / "out.report.json").read_text())
        with av.open(str(folder / "out.mp4")) as video:
            results.append(
                (report["tracks"][0]["donor"], report["settings"]["audio"], len(video.streams.audio))
            )
        assert not (folder / "out.mp4.work").exists()
    assert results == [("p02", "keep", 1), ("p05", "drop", 0)]


def test_a_track_is_split_and_its_parts_get_what_is_chosen_for_each(
    work: dict[str, Any], tmp_path: Path
) -> None:
    folder, source = tmp_path / "review", Path(work["source"])
    shutil.copytree(work["found"], folder)
    choices = split(folder, work["output"], DeidentifyChoices(**work["choices"]), 1, 12)
    assert choices.actions == {"1": "swap", "2": "swap"}
    assert choices.people == {"1": 1, "2": 2}
    choices = split(folder, work["output"], choices, 2, 20)
    assert [row["frames"] for row in read_tracks(folder)["tracks"]] == [[0, 11], [12, 19], [20, FRAMES - 1]]
    with pytest.raises(StudioError, match="not within track 1"):
        split(folder, work["output"], choices, 1, 25)
    choices.actions["2"] = "leave"
    choices.people["3"], choices.donors["1"] = 1, "p02"
    changed = [
        float(np.abs(after.astype(int) - before).max())
        for before, after in (preview(source, folder, choices, work["output"], n, 640) for n in (5, 15, 25))
    ]
    assert changed[1] == 0
    assert min(changed[0], changed[2]) > 30
    done = render(work | {"found": str(folder), "choices": asdict(choices)}, tmp_path, silent)
    assert done["counts"] == {"swapped": FRAMES - 8, "covered": 0, "left": 8, "without face": 0}


def test_a_review_of_the_command_line_goes_on_here_and_its_file_is_kept_up_to_date(
    work: dict[str, Any], tmp_path: Path
) -> None:
    found, source = Path(work["found"]), work["source"]
    (folder := tmp_path / "here").mkdir()
    about = {"source": source, "name": "Party", "reviewed": str(found / work["output"])}
    assert review(about, folder, silent)["frames"] == FRAMES
    choices = DeidentifyChoices.load(folder)
    choices.actions["1"], choices.boxes = "cover", [{"first": 1, "last": 2, "box": [5, 5, 50, 60]}]
    write_edited(folder, choices, tmp_path / "party.tracks.json")
    value, before = (
        json.loads(path.read_text()) for path in (tmp_path / "party.tracks.json", found / TRACKS)
    )
    assert (value["tracks"][0]["action"], value["boxes"]) == ("cover", choices.boxes)
    assert value["fingerprint"] == before["fingerprint"]
    with pytest.raises(StudioError, match="run guise deidentify --review again"):
        review(about | {"reviewed": str(tmp_path / "gone.mp4")}, folder, silent)


def test_a_deleted_review_is_said(work: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(StudioError, match="the review of Party: Ann's was deleted"):
        render(work | {"found": str(tmp_path / "gone")}, tmp_path, silent)


def test_mistakes_are_told_with_the_name_of_the_clip(tmp_path: Path) -> None:
    source = tmp_path / "0123abcd.mp4"
    source.write_bytes(b"no video")
    about = {"source": str(source), "name": "Party", "files": {str(source): "Party"}}
    with pytest.raises(MediaError) as error:
        review(about, tmp_path, silent)
    sentence = with_user_names(str(error.value), about)
    assert sentence.startswith("Party is not a video that can be read")
    assert "0123abcd" not in sentence


def test_the_timeline_says_when_a_track_is_seen() -> None:
    track = {
        "track": 3, "frames": [50, 99], "seconds": [2.0, 4.0], "seen": 50, "width": 80.0, "confidence": [0.0, 1.0]
    }  # fmt: skip
    line = timeline(track, 100, "cover")
    assert "Track 3: 0:02.0 to 0:04.0, seen in 50 frames, 80 pixels wide; mean confidence 0.50" in line
    assert 'd="M500.0 38V38.0h250.00V4.0h250.00V38Z"' in line
