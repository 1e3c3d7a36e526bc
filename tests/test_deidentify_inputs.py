"""What the inputs of a command stand for, and where their outputs go: never two into one, never over an input."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from guise.app.deidentify.run import remote
from guise.app.deidentify.run.inputs import BatchPlan, FilePair, InputError, make_plan, require_possible
from guise.app.deidentify.run.remote import RemoteError


def make(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def own(path: Path) -> str:
    return path.suffix


def plan(
    *inputs: str, output: str | None = None, recursive: bool = False, suffix_for: object = own
) -> BatchPlan:
    return make_plan(inputs, output, Path("work"), suffix_for, recursive=recursive)  # type: ignore[arg-type]


def told(made: BatchPlan) -> list[tuple[str, str]]:
    return [(pair.name, pair.shown_output) for pair in made.pairs]


def test_a_file_goes_beside_itself(here: Path) -> None:
    make(here, "a/talk.mp4")
    made = plan("a/talk.mp4")
    assert made == BatchPlan(
        [FilePair(here / "a/talk.mp4", here / "a/talk_deidentified.mp4", "a/talk.mp4")], []
    )


def test_a_folder_stands_for_its_videos_and_images(here: Path) -> None:
    make(
        here, "in/a2.mp4", "in/a10.MOV", "in/photo.JPG", "in/notes.txt", "in/.hidden.mp4", "in/b_deidentified.mp4",
        "in/b_deidentified.report.json", "in/b_deidentified.tracks.jpg", "in/b.mp4.part", "in/sub/c.mp4",
    )  # fmt: skip
    (here / "in/c_deidentified.mp4.work").mkdir()
    (here / "in/frames_deidentified").mkdir()
    made = plan("in")
    assert told(made) == [
        ("in/a2.mp4", "in/a2_deidentified.mp4"),
        ("in/a10.MOV", "in/a10_deidentified.MOV"),
        ("in/photo.JPG", "in/photo_deidentified.JPG"),
    ]
    assert made.notes == ["in: skipped 1 hidden, 6 from an earlier run, 1 not a video or image, 1 subfolders"]


def test_recursion_keeps_the_tree(here: Path) -> None:
    make(here, "in/a.mp4", "in/x/b.mp4", "in/x/y/c.mp4", "in/.git/d.mp4")
    assert told(plan("in", recursive=True, output="out")) == [
        ("in/a.mp4", "out/a_deidentified.mp4"),
        ("in/x/b.mp4", "out/x/b_deidentified.mp4"),
        ("in/x/y/c.mp4", "out/x/y/c_deidentified.mp4"),
    ]
    assert told(plan("in", recursive=True))[2] == ("in/x/y/c.mp4", "in/x/y/c_deidentified.mp4")


def test_the_folder_here_keeps_the_tree(here: Path) -> None:
    make(here, "x/b.mp4")
    assert told(plan(".", recursive=True, output="out")) == [("x/b.mp4", "out/x/b_deidentified.mp4")]


def test_a_folder_of_images_alone_is_a_clip(here: Path) -> None:
    make(
        here,
        "in/frames/1.png",
        "in/frames/2.png",
        "in/frames/notes.txt",
        "in/one/1.png",
        "in/mixed/1.png",
        "in/mixed/a.mp4",
    )
    assert told(plan("in/frames")) == [("in/frames", "in/frames_deidentified")]
    assert told(plan("in/frames", output="out.mp4")) == [("in/frames", "out.mp4")]
    assert told(plan("in/frames", output="out")) == [("in/frames", "out/frames_deidentified")]
    assert told(plan("in", recursive=True, output="out")) == [
        ("in/frames", "out/frames_deidentified"),
        ("in/mixed/1.png", "out/mixed/1_deidentified.png"),
        ("in/mixed/a.mp4", "out/mixed/a_deidentified.mp4"),
        ("in/one/1.png", "out/one/1_deidentified.png"),
    ]


def test_patterns_are_expanded(here: Path) -> None:
    make(here, "in/a.mp4", "in/x/b.mp4", "in/x/b.txt", "in/x/.c.mp4", "in/a[1].mp4")
    assert told(plan("in/*.mp4")) == [
        ("in/a.mp4", "in/a_deidentified.mp4"),
        ("in/a[1].mp4", "in/a[1]_deidentified.mp4"),
    ]
    made = plan("in/**/b.*", output="out")
    assert told(made) == [("in/x/b.mp4", "out/x/b_deidentified.mp4")]
    assert made.notes == ["in/**/b.*: skipped 1 not a video or image"]
    assert told(plan(str(here / "in/x/*")))[0][0] == "in/x/b.mp4"
    assert told(plan("in/a[1].mp4")) == [("in/a[1].mp4", "in/a[1]_deidentified.mp4")]


def test_an_input_given_twice_is_done_once(here: Path) -> None:
    make(here, "in/a.mp4", "in/b.mp4")
    assert [name for name, _ in told(plan("in/a.mp4", "./in/a.mp4", "in", "in/../in/b.mp4"))] == [
        "in/a.mp4",
        "in/b.mp4",
    ]


def test_one_output_may_be_named(here: Path) -> None:
    make(here, "a.mp4", "in/b.mp4")
    (here / "out.d").mkdir()
    assert told(plan("a.mp4", output="b.mkv")) == [("a.mp4", "b.mkv")]
    assert told(plan("a.mp4", output="out.d")) == [("a.mp4", "out.d/a_deidentified.mp4")]
    assert told(plan("a.mp4", output="new/")) == [("a.mp4", "new/a_deidentified.mp4")]
    with pytest.raises(InputError, match=r"-o x\.mp4 names one file, but the inputs are more"):
        plan("a.mp4", "in/b.mp4", output="x.mp4")
    with pytest.raises(InputError, match=r"-o x\.mp4 names one file"):
        plan("in", output="x.mp4")


def test_a_container_that_cannot_hold_the_result_changes(here: Path) -> None:
    make(here, "in/a.avi", "in/b.mp4", "in/bare")
    made = plan(
        "in", "in/bare", suffix_for=lambda path: path.suffix if path.suffix in (".mp4", ".mov") else ".mkv"
    )
    assert told(made) == [
        ("in/a.avi", "in/a.avi_deidentified.mkv"),
        ("in/b.mp4", "in/b_deidentified.mp4"),
        ("in/bare", "in/bare_deidentified.mkv"),
    ]
    assert made.notes == [
        "in: skipped 1 not a video or image",
        "in/a.avi: written as .mkv, because .avi can't hold the result",
        "in/bare: written as .mkv",
    ]


def test_a_container_that_was_asked_for_needs_no_note(here: Path) -> None:
    make(here, "b.mp4")
    assert plan("b.mp4", output="b.mkv").notes == []


def test_outputs_never_share_their_reports(here: Path) -> None:
    make(here, "in/a.jpg", "in/a.mov", "in/a/1.png", "in/a/2.png", "in/b.mov")
    assert told(plan("in", recursive=True)) == [
        ("in/a.jpg", "in/a.jpg_deidentified.jpg"),
        ("in/a.mov", "in/a.mov_deidentified.mov"),
        ("in/b.mov", "in/b_deidentified.mov"),
        ("in/a", "in/a_deidentified"),
    ]
    make(here, "in/b_deidentified.report.json")
    with pytest.raises(InputError) as caught:
        require_possible(plan("in/b.mov").pairs, force=False, resume=False)
    assert str(caught.value) == (
        "in/b_deidentified.report.json exists without its output: use --force to replace it, or -o to write elsewhere"
    )
    require_possible(plan("in/b.mov").pairs, force=False, resume=True)


@pytest.mark.parametrize(
    ("inputs", "output", "sentence"),
    [
        (
            ["no.mp4"],
            None,
            "no.mp4 does not exist: give a video, an image, a folder, a pattern in quotes or a URL",
        ),
        (["*.mov"], None, "no video or image matches *.mov"),
        (["empty"], None, "the folder empty holds no video or image to de-identify"),
        (
            ["nested"],
            None,
            "the folder nested holds no video or image to de-identify; use --recursive for its subfolders",
        ),
        (
            ["one/a.mp4", "two/a.mp4"],
            "out",
            "one/a.mp4 and two/a.mp4 would both be written to out/a_deidentified.mp4: rename one, or process "
            "them separately with different -o",
        ),
        (
            ["one/a.mp4", "one/a_deidentified.mp4"],
            None,
            "one/a_deidentified.mp4, the output for one/a.mp4, is itself an input: choose another with -o",
        ),
        (
            ["one/a.mp4"],
            "one/a.mp4",
            "one/a.mp4, the output for one/a.mp4, is itself an input: choose another with -o",
        ),
    ],
)
def test_what_cannot_be_is_one_sentence(
    here: Path, inputs: list[str], output: str | None, sentence: str
) -> None:
    make(here, "one/a.mp4", "two/a.mp4", "one/a_deidentified.mp4", "nested/x/b.mp4")
    (here / "empty").mkdir()
    with pytest.raises(InputError) as caught:
        plan(*inputs, output=output)
    assert str(caught.value) == sentence


def test_a_wrong_pattern_is_one_sentence(here: Path) -> None:
    with pytest.raises(InputError) as caught:
        plan("***/a.mp4")
    assert str(caught.value) == (
        "***/a.mp4 isn't a valid pattern: ** must stand alone between slashes, as in 'films/**/*.mp4'"
    )


def test_odd_names_are_names(here: Path) -> None:
    odd = ["-a.mp4", "a b.mp4", "a\nb.mp4", os.fsdecode(b"\xff.mp4"), "10:30.mp4", "100%.mp4"]
    make(here, *odd)
    for name in odd:
        made = plan(name)
        assert made.pairs[0].input.is_absolute()
        assert made.pairs[0].input.exists()
        assert made.pairs[0].output == here / (name[:-4] + "_deidentified.mp4")
    assert len(plan(".").pairs) == len(odd)


def test_links_do_not_lead_in_circles(here: Path) -> None:
    make(here, "in/a.mp4")
    (here / "in/loop").symlink_to(here / "in")
    (here / "in/gone.mp4").symlink_to(here / "nowhere.mp4")
    (here / "in/self.mp4").symlink_to("self.mp4")
    made = plan("in", recursive=True)
    assert [name for name, _ in told(made)] == ["in/a.mp4", "in/gone.mp4", "in/self.mp4"]
    assert made.notes == ["in: skipped 1 links to folders"]
    assert [name for name, _ in told(plan("in/**/*.mp4"))] == ["in/a.mp4", "in/gone.mp4", "in/self.mp4"]


def test_a_folder_without_permission_is_one_sentence(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make(here, "in/x/a.mp4")

    def refuse(self: Path) -> Iterator[Path]:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(InputError, match=r"^the folder in can't be read \(Permission denied\): check"):
        plan("in")


def test_nothing_is_overwritten(here: Path) -> None:
    make(here, "a.mp4", "b.mp4", "a_deidentified.mp4", "b_deidentified.mp4")
    pairs = plan("a.mp4", "b.mp4").pairs
    with pytest.raises(InputError) as caught:
        require_possible(pairs, force=False, resume=False)
    assert str(caught.value) == (
        "a_deidentified.mp4 exists (and 1 more): use --force to replace it, --resume to do only the rest, "
        "or -o to write elsewhere"
    )
    require_possible(pairs, force=True, resume=False)
    require_possible(pairs, force=False, resume=True)


def test_an_input_is_not_replaced_through_a_link(here: Path) -> None:
    make(here, "a.mp4")
    (here / "a_deidentified.mp4").hardlink_to(here / "a.mp4")
    with pytest.raises(InputError, match=r"a_deidentified\.mp4, the output for a\.mp4, is itself an input"):
        require_possible(plan("a.mp4").pairs, force=True, resume=False)


def test_a_folder_that_cannot_be_written_to_is_one_sentence(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(here, "a.mp4")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(InputError, match=r"can't be written to: choose another with -o"):
        require_possible(plan("a.mp4", output="new/deep/").pairs, force=False, resume=False)


# -- elsewhere --------------------------------------------------------------------------------------------------


@pytest.fixture
def bucket() -> Iterator[str]:
    """A folder in fsspec's memory with some files."""
    fsspec = pytest.importorskip("fsspec", reason="the cluster extra is not installed")
    memory = fsspec.filesystem("memory")
    memory.store.clear()
    for name in ("a.mp4", "x/b.mov", "notes.txt", "a_deidentified.mp4", "c?.mp4"):
        memory.pipe_file(f"/films/{name}", b"film")
    yield "memory://films"
    memory.store.clear()


def test_a_url_is_copied_to_and_fro(bucket: str, here: Path) -> None:
    (pair,) = plan(f"{bucket}/x/b.mov").pairs
    assert (pair.fetch, pair.put) == (f"{bucket}/x/b.mov", f"{bucket}/x/b_deidentified.mov")
    assert pair.input.name == "b.mov"
    assert pair.output.name == "b_deidentified.mov"
    assert {pair.input.parents[1], pair.output.parents[1]} == {here / "work"}
    (pair,) = plan(f"{bucket}/x/b.mov", output="out/").pairs
    assert (pair.output, pair.put) == (here / "out/b_deidentified.mov", "")
    make(here, "z.mp4")
    (pair,) = plan("z.mp4", output=f"{bucket}/out/").pairs
    assert (pair.input, pair.fetch, pair.put) == (here / "z.mp4", "", f"{bucket}/out/z_deidentified.mp4")


def test_a_folder_behind_a_url(bucket: str, here: Path) -> None:
    made = plan(bucket)
    assert [pair.name for pair in made.pairs] == ["memory:///films/a.mp4", "memory:///films/c?.mp4"]
    assert made.notes == [f"{bucket}: skipped 1 from an earlier run, 1 not a video or image"]


def test_a_tree_behind_a_url_is_kept(bucket: str, here: Path) -> None:
    made = plan(bucket, recursive=True, output="out")
    assert [pair.shown_output for pair in made.pairs] == [
        "out/a_deidentified.mp4",
        "out/c?_deidentified.mp4",
        "out/x/b_deidentified.mov",
    ]


def test_a_pattern_behind_a_url(bucket: str, here: Path) -> None:
    made = plan(f"{bucket}/**/*.mov", output="out")
    assert [pair.shown_output for pair in made.pairs] == ["out/x/b_deidentified.mov"]


def test_the_web_only_gives(here: Path) -> None:
    pytest.importorskip("aiohttp", reason="the cluster extra is not installed")
    url = "https://films.example/a%20b.mp4?key=1"
    (pair,) = plan(url, output="out/").pairs
    assert (pair.fetch, pair.output) == (url, here / "out/a b_deidentified.mp4")
    assert pair.name == "https://films.example/a%20b.mp4"
    with pytest.raises(InputError, match=r"a b_deidentified\.mp4 can't be written to: give a local folder"):
        plan(url)


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        (
            "memory://films/no.mp4",
            "memory://films/no.mp4 holds no video or image to de-identify",
        ),
        ("gopher://x/a.mp4", "gopher://x/a.mp4 can't be opened"),
        ("gs://x/a.mp4", "gs://x/a.mp4 needs one more package: pip install gcsfs"),
    ],
)
def test_a_url_that_leads_nowhere_is_one_sentence(bucket: str, url: str, sentence: str) -> None:
    with pytest.raises((InputError, RemoteError)) as caught:
        plan(url)
    assert str(caught.value).startswith(sentence)


def test_a_clip_of_images_is_not_written_to_a_url(bucket: str, here: Path) -> None:
    make(here, "frames/1.png", "frames/2.png")
    with pytest.raises(InputError, match="frames is a folder of images, which can't be written to a URL"):
        plan("frames", output=f"{bucket}/out/")


def test_a_key_in_an_address_is_not_told(here: Path) -> None:
    pytest.importorskip("aiohttp", reason="the cluster extra is not installed")
    with pytest.raises(RemoteError) as caught:
        remote.fetch("http://127.0.0.1:1/a.mp4?key=secret", here / "a.mp4")
    assert str(caught.value).startswith("http://127.0.0.1:1/a.mp4 can't be read or written")
    assert "secret" not in str(caught.value)


def test_an_output_behind_a_url_is_not_overwritten(bucket: str) -> None:
    with pytest.raises(InputError, match=r"a_deidentified\.mp4 exists: use --force"):
        require_possible(plan(f"{bucket}/a.mp4").pairs, force=False, resume=False)
