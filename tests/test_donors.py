"""Donors: the gallery, the choice, which never looks at a person, and the key file."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from models import model_file

from guise.aam.extrapolation import ReferenceMismatchError
from guise.aam.model import Identity, ModelError
from guise.aam.recognition import signature
from guise.app.people import kept
from guise.app.swapping.donors import (
    COMMON_FACES,
    FIRST_NAMES,
    DonorError,
    KeyFile,
    assign,
    gallery,
    heads_for,
    open_donor,
    open_face,
    parts,
    titled,
)

ROOT = Path(__file__).parents[1]


def test_the_gallery_is_small_and_names_nobody() -> None:
    files = sorted((ROOT / "app" / "gallery").glob("*.guise"))
    assert gallery() == tuple(file.stem for file in files)
    assert len(files) == 9
    assert sum(file.stat().st_size for file in files) < 30e6
    for name in gallery():
        person = open_donor(name)
        assert person.name == FIRST_NAMES[name]
        assert "/" not in json.dumps(person.facts)


def test_a_first_name_is_the_same_face_as_the_number() -> None:
    assert sorted(FIRST_NAMES) == list(gallery())
    assert len({name.lower() for name in FIRST_NAMES.values()}) == len(FIRST_NAMES)
    for spec in ("Mei", "mei", "p03"):
        np.testing.assert_array_equal(
            open_face(spec).rest_frame.picture, open_donor("p03").rest_frame.picture
        )
    assert parts("mean:Luca+walter") == ["Luca", "walter"]
    np.testing.assert_array_equal(
        open_donor("mean:Luca+walter").appearance.neutral, open_donor("mean:p01+p04").appearance.neutral
    )
    assert titled("mean:p01+p04+p07") == "the average of Luca, Walter and Kenji"


def test_somebody_who_is_kept_comes_before_a_fictional_person_of_that_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GUISE_PEOPLE", str(tmp_path))
    own = replace(Identity.load(model_file("p06")), name="Mei")
    own.save(kept.place_for("Mei"))
    assert own.reference.id != open_donor("p03").reference.id
    assert open_face("Mei").reference.id == own.reference.id
    assert open_face("mei").reference.id == open_donor("Mei").reference.id == open_donor("p03").reference.id


def test_donors_can_be_mixed() -> None:
    assert len({open_donor(name).reference.id for name in gallery()}) == 1


def test_a_donor_is_read_once() -> None:
    assert open_donor("p01") is open_donor("p01")
    assert open_donor("mean:p01+p02") is open_donor("mean:p01+p02")


def test_an_average_is_between_its_parts() -> None:
    one, other, mean = (open_donor(spec).appearance.neutral for spec in ("p01", "p02", "mean:p01+p02"))
    np.testing.assert_allclose(mean, (one + other) / 2, rtol=1e-5)


def test_own_models_are_donors(tmp_path: Path) -> None:
    file = tmp_path / "a+b c.guise"
    file.write_bytes(model_file("p01").read_bytes())
    assert open_donor(str(file)).name == "p01"
    assert parts(f"mean:{file}+p02") == [str(file), "p02"]


@pytest.mark.parametrize("spec", ["p99", "../p01", "mean:p01+p99"])
def test_an_unknown_donor_is_one_sentence(spec: str) -> None:
    with pytest.raises(DonorError, match=r"there is no donor .*; use NAME.guise, a photo, or one of Luca, "):
        open_donor(spec)


def test_a_missing_model_is_one_sentence() -> None:
    with pytest.raises(ModelError, match=r"there is no model file nobody\.guise"):
        open_donor("nobody.guise")


def test_people_of_different_reference_frames_are_not_averaged() -> None:
    with pytest.raises(ReferenceMismatchError, match=r"cannot be averaged.* \(64 and 160"):
        open_donor(f"mean:{model_file('p01')}+p02")


# -- the choice -------------------------------------------------------------------------------------------------------


def test_the_choice_is_the_same_again_and_in_another_process() -> None:
    here = assign(range(1, 12), "auto", seed=5, salt="a.mp4")
    code = "from guise.app.swapping.donors import assign; print(assign(range(1, 12), 'auto', seed=5, salt='a.mp4'))"
    there = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert there.stdout.strip() == str(here)


@pytest.mark.parametrize("people", [1, 7, 8, 28, 29])
def test_donors_are_distinct_single_ones_first(people: int) -> None:
    given = assign(range(people), "auto", seed=0, salt="x")
    assert len(set(given.values())) == people
    assert [len(parts(spec)) for spec in given.values()] == ([1] * 9 + [2] * 36 + [3])[:people]


def test_more_people_do_not_change_the_donors_of_the_first() -> None:
    few, many = (assign(range(n), "auto", seed=0, salt="x") for n in (3, 20))
    assert few == {person: many[person] for person in few}


def test_every_donor_but_the_common_ones_is_given_to_the_first_person_of_some_video() -> None:
    firsts = [assign([1], "auto", seed=0, salt=f"{k}.mp4")[1] for k in range(300)]
    counts = {name: firsts.count(name) for name in gallery()}
    assert sum(counts.values()) == 300
    assert {name for name, count in counts.items() if count < 20} == set(COMMON_FACES)
    nine = list(assign(range(9), "auto", seed=0, salt="x").values())
    assert set(nine[7:]) == set(COMMON_FACES)


def test_the_seed_changes_the_choice() -> None:
    chosen = {tuple(assign(range(4), "auto", seed=seed, salt="x").values()) for seed in range(8)}
    assert len(chosen) > 5


def test_means_of_k_are_distinct_subsets_as_long_as_there_are_any() -> None:
    given = list(assign(range(90), "mean:3", seed=0, salt="x").values())
    assert {tuple(parts(spec)) for spec in given[:84]} == set(combinations(gallery(), 3))
    assert set(given[84:]) <= set(given[:84])


def test_the_mean_of_all_is_one_donor_for_all() -> None:
    assert set(assign(range(3), "mean:9", seed=0, salt="x").values()) == {"mean:" + "+".join(gallery())}


@pytest.mark.parametrize(("donor", "size"), [("same", 1), ("average:3", 3), ("average:9", 9)])
def test_a_shared_donor_is_that_of_all_people_of_all_videos(donor: str, size: int, tmp_path: Path) -> None:
    given = {spec for salt in "abc" for spec in assign(range(4), donor, seed=3, salt=salt).values()}
    assert [len(parts(spec)) for spec in given] == [size]
    key = KeyFile.open(tmp_path / "key")
    known = signature(Identity.load(model_file("p01")))
    key.assign({1: known}, "auto", salt="a")
    assert len(set(key.assign({1: known, 2: None}, donor, salt="b").values())) == 1


def test_the_seed_changes_the_shared_donor() -> None:
    assert len({assign([1], "same", seed=seed, salt="x")[1] for seed in range(8)}) > 2
    assert len({assign([1], "average:3", seed=seed, salt="x")[1] for seed in range(8)}) > 4


@pytest.mark.parametrize("k", ["0", "10", "x", ""])
def test_a_shared_average_of_more_than_there_are_is_one_sentence(k: str) -> None:
    with pytest.raises(DonorError, match=f"average:{k} averages {k} donors, but there are 9; choose 1 to 9"):
        assign([1], f"average:{k}", seed=0, salt="x")


@pytest.mark.parametrize("k", [0, 10])
def test_a_mean_of_more_than_there_are_is_one_sentence(k: int) -> None:
    with pytest.raises(DonorError, match=f"mean:{k} averages {k} donors, but there are 9; choose 1 to 9"):
        assign([1], f"mean:{k}", seed=0, salt="x")


def test_a_named_donor_is_given_to_everybody() -> None:
    for spec in ("x.guise", "p02", "mean:p01+p04"):
        assert assign([1, 2], spec, seed=0, salt="x") == {1: spec, 2: spec}


def test_own_donors_replace_the_gallery_wherever_they_lie() -> None:
    own = [Path(f"/here/{name}.guise") for name in "abc"]
    moved = [Path(f"/there/{name}.guise") for name in "abc"]
    given = assign(range(7), "auto", own=own, seed=0, salt="x")
    assert {part for spec in given.values() for part in parts(spec)} == set(map(str, own))
    again = assign(range(7), "auto", own=moved, seed=0, salt="x")
    assert {p: spec.replace("/here", "/there") for p, spec in given.items()} == again


def test_own_donors_are_model_files() -> None:
    sentence = r"a donor is a file NAME\.guise or a fictional face, got photo\.jpg; make one with"
    with pytest.raises(DonorError, match=sentence):
        assign([1], "auto", own=[Path("photo.jpg")], seed=0, salt="x")


def test_heads_are_of_others_than_the_faces_and_differ_from_video_to_video() -> None:
    def head(face: str, asked: str = "auto", salt: str = "x") -> str:
        return heads_for({1: face}, asked, seed=0, salt=salt)[1]

    assert {head("p02", salt=f"{k}.mp4") for k in range(60)} == set(gallery()) - {"p02"}
    assert head("mean:p01+p02", "mean:2") not in ("p01", "p02")
    assert head("p02") == head("p02")
    every = "mean:" + "+".join(gallery())
    assert head(every, "mean:9") in gallery()


def test_nobody_in_a_video_has_the_head_of_another_while_there_are_enough() -> None:
    faces = dict(enumerate(gallery() * 2, 1))
    heads = heads_for(faces, "auto", seed=0, salt="x")
    assert len({heads[k] for k in range(1, 9)}) == 8
    assert all(heads[k] != faces[k] for k in faces)
    assert heads_for(dict(list(faces.items())[:3]), "auto", seed=0, salt="x") == {
        k: heads[k] for k in (1, 2, 3)
    }
    known = heads_for(faces, "auto", seed=0, salt="")
    assert known[1] == known[10], "the same face of a key file"


def test_somebody_whom_the_user_names_keeps_their_own_head() -> None:
    assert heads_for({1: "x.guise"}, "x.guise", seed=0, salt="x") == {1: "x.guise"}
    assert heads_for({1: "mean:p01+p04"}, "mean:p01+p04", seed=0, salt="x")[1] in gallery()


@pytest.mark.parametrize("donor", ["same", "average:3"])
def test_who_share_a_face_share_a_head(donor: str) -> None:
    given = {assign([1], donor, seed=0, salt=salt)[1] for salt in "abcdef"}
    heads = {heads_for({1: face}, donor, seed=0, salt=salt)[1] for face in given for salt in "abcdef"}
    assert len(heads) == 1


def test_known_donors_go_before_the_choice_and_stay_distinct_from_it() -> None:
    usual = assign([1, 2, 3], "auto", seed=0, salt="x")
    given = assign([1, 2, 3], "auto", seed=0, salt="x", known={3: usual[1]}, taken={usual[2]})
    assert given[3] == usual[1]
    assert {given[1], given[2]} & {usual[1], usual[2]} == set()


# -- the key file -----------------------------------------------------------------------------------------------------


@pytest.fixture
def key(tmp_path: Path) -> KeyFile:
    return KeyFile.open(tmp_path / "people.key")


def test_a_new_key_file_is_its_owners_alone(key: KeyFile) -> None:
    assert key.path.stat().st_mode & 0o777 == 0o600
    assert [file.name for file in key.path.parent.iterdir()] == ["people.key"]
    assert key.people == ()


def test_the_seed_is_secret_and_stays(key: KeyFile, tmp_path: Path) -> None:
    assert KeyFile.open(key.path).seed == key.seed
    assert KeyFile.open(tmp_path / "other.key").seed != key.seed


def test_a_person_is_recognised_again(key: KeyFile) -> None:
    person, other = Identity.load(model_file("p01")), Identity.load(model_file("p06"))
    assert key.recognise(person) is None
    kept = key.remember("", "p04", person)
    again = KeyFile.open(key.path)
    assert again.recognise(person) == kept
    assert again.recognise(other) is None
    assert (kept.name, kept.donor) == ("person 1", "p04")
    assert key.path.stat().st_mode & 0o777 == 0o600


def test_what_another_process_has_remembered_stays(key: KeyFile) -> None:
    person, second = Identity.load(model_file("p01")), KeyFile.open(key.path)
    kept = second.remember("Ann", "p03", person)
    assert key.remember("somebody", "p04", person) == kept
    assert len(KeyFile.open(key.path).people) == 1


def test_people_keep_their_donors_from_video_to_video(key: KeyFile) -> None:
    one, two, three = (signature(Identity.load(model_file(name))) for name in ("p01", "p02", "p06"))
    first = key.assign({1: one, 2: two, 3: None}, "auto", salt="a.mp4")
    second = KeyFile.open(key.path).assign({1: three, 2: one}, "auto", salt="b.mp4")
    assert second[2] == first[1]
    assert second[1] not in {first[1], first[2]}
    assert [entry.donor for entry in KeyFile.open(key.path).people] == [first[1], first[2], second[1]]


def test_who_may_not_keep_a_donor_gets_another_for_good(key: KeyFile) -> None:
    face = signature(Identity.load(model_file("p01")))
    refused = key.assign({1: face}, "auto", salt="a")[1]
    other = key.assign({1: face}, "auto", salt="a", taken=[refused])[1]
    assert other != refused
    assert KeyFile.open(key.path).assign({1: face}, "auto", salt="b") == {1: other}


def test_the_key_files_seed_chooses(key: KeyFile, tmp_path: Path) -> None:
    others = [KeyFile.open(tmp_path / f"{k}.key") for k in range(12)]
    assert len({other.assign({1: None}, "auto", salt="a")[1] for other in others}) > 2
    assert key.assign({1: None}, "auto", salt="a") == assign([1], "auto", seed=key.seed, salt="a")


@pytest.mark.slow
def test_writers_do_not_lose_each_others_people(key: KeyFile) -> None:
    code = (
        "import sys; from pathlib import Path; from guise.app.swapping.donors import KeyFile, open_donor;"
        "KeyFile.open(Path(sys.argv[1])).remember('', sys.argv[2], open_donor(sys.argv[2]))"
    )
    running = [
        subprocess.Popen([sys.executable, "-c", code, str(key.path), name], cwd=ROOT)
        for name in gallery()[:4]
    ]
    assert [process.wait() for process in running] == [0] * 4
    assert {entry.donor for entry in KeyFile.open(key.path).people} == set(gallery()[:4])


GOOD = {"format": "guise-key", "version": 1, "seed": 1, "people": []}
PERSON = {"name": "a", "donor": "p01", "signature": [0.1] * 64}


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("{", "isn't a key file or is damaged"),
        ("[]", "isn't a key file or is damaged"),
        (json.dumps({"format": "guise-key"}), "isn't a key file or is damaged"),
        (json.dumps(GOOD | {"version": 2}), "is guise-key of version 2, expected guise-key of version 1"),
        (json.dumps(GOOD | {"seed": None}), "is damaged"),
        (json.dumps(GOOD | {"seed": float("inf")}), "is damaged"),
        (json.dumps(GOOD | {"people": [{"name": "a"}]}), "is damaged"),
        (json.dumps(GOOD | {"people": [PERSON | {"signature": [0.1] * 3}]}), "a signature of 3 values"),
        (json.dumps(GOOD | {"people": [PERSON | {"signature": [float("nan")] * 64}]}), "is damaged"),
    ],
)  # fmt: skip
def test_a_damaged_key_file_is_one_sentence_and_stays_as_it_is(
    tmp_path: Path, content: str, sentence: str
) -> None:
    path = tmp_path / "people.key"
    path.write_text(content)
    with pytest.raises(DonorError, match=sentence):
        KeyFile.open(path)
    assert path.read_text() == content
    assert os.listdir(tmp_path) == ["people.key"]


def test_a_signature_survives_the_file(key: KeyFile) -> None:
    person = open_donor("p05")
    key.remember("", "p01", person)
    kept = KeyFile.open(key.path).people[0].signature
    np.testing.assert_allclose(kept, signature(person), atol=1e-5)
