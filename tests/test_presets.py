"""Options from files and presets: the command line wins, what is unknown is one sentence, what is saved comes back."""

import os
from pathlib import Path
from typing import Any

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st

from guise.app.cli.commands import command_line, commands
from guise.app.cli.main import main
from guise.app.cli.presets import notes_on_files, take_defaults
from guise.common import presets
from guise.common.presets import PresetError

PROJECT = """
crf = 18
identity = "Mei"

[swap]
crf = 19
no-keep = true

[analogy]
strength = 0.5

[analogy.mesh]
method = "cloning"

[presets.court]
region = "head"
crf = 21

[presets.court.live]
identity = ["Mei", "Kofi"]
"""


@pytest.fixture(autouse=True)
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in; the user's settings are in the folder `settings` of it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(presets.FOLDER_VARIABLE, str(tmp_path / "settings"))
    (tmp_path / "settings").mkdir()
    return tmp_path


def understood(arguments: str) -> dict[str, Any]:
    """The values of a command and, as "notes", what it says of them."""
    words = arguments.split()
    one: Any = typer.main.get_command(command_line(words[0]))
    context = typer.Context(one, info_name="guise")
    while hasattr(one, "commands"):
        name = words.pop(0)
        one = one.commands[name]
        if hasattr(one, "commands"):
            context = typer.Context(one, parent=context, info_name=name)
        else:
            context = one.make_context(name, words, parent=context)
    return {**context.params, "notes": list(notes_on_files(context))}


def test_the_command_line_wins_then_the_preset_then_the_closer_table() -> None:
    Path("guise.toml").write_text(PROJECT, encoding="utf-8")
    assert understood("puppet v.mp4 -o o.mp4")["crf"] == 18
    assert understood("swap v.mp4 -o o.mp4")["crf"] == 19
    assert understood("swap v.mp4 -o o.mp4 --preset court")["crf"] == 21
    assert understood("swap v.mp4 -o o.mp4 --preset court --crf 22")["crf"] == 22
    assert understood("deidentify v.mp4 --preset court")["region"] == "head"
    assert understood("deidentify v.mp4")["region"] == "face"


def test_each_kind_of_option_is_read() -> None:
    Path("guise.toml").write_text(PROJECT, encoding="utf-8")
    swap = understood("swap v.mp4 -o o.mp4")
    assert (swap["identity"], swap["no_keep"]) == ("Mei", True)
    assert understood("live")["identities"] == ("Mei",)
    assert understood("live --preset court")["identities"] == ("Mei", "Kofi")
    assert understood("live --identity Asha")["identities"] == ("Asha",)
    assert understood("analogy image a b c -o o.png")["strength"] == 0.5
    assert understood("analogy mesh rig r.glb --target t.obj -o o.glb")["method"] == "cloning"
    assert understood("analogy image a b c -o o.png")["method"] == "tents"


def test_the_project_wins_over_the_user_and_both_are_told() -> None:
    Path("guise.toml").write_text("crf = 18\n", encoding="utf-8")
    Path("settings/guise.toml").write_text('crf = 30\nencoder = "ffv1"\n', encoding="utf-8")
    found = understood("swap v.mp4 -o o.mp4 --identity Mei")
    assert (found["crf"], found["encoder"]) == (18, "ffv1")
    user = Path("settings").absolute() / "guise.toml"
    assert sorted(found["notes"]) == sorted([f"from {user}: --encoder ffv1", "from guise.toml: --crf 18"])
    assert understood("swap v.mp4 -o o.mp4 --crf 5 --encoder libx264")["notes"] == []


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("crff = 18", "guise.toml: crff is not an option: `guise --help` lists what there is"),
        (
            "[swap]\nregion = 'head'",
            "guise.toml: swap.region is not an option: `guise swap --help` lists what there is",
        ),
        ("[swpa]\ncrf = 8", "guise.toml: swpa.crf is not an option: `guise swpa --help` lists what there is"),
        ("preset = 'a'", "guise.toml: preset is not an option: `guise --help` lists what there is"),
        ("crf = 'x'", "guise.toml: crf: 'x' is not a valid int range."),
        ("crf = 90", "guise.toml: crf: 90 is not in the range 0<=x<=63."),
        ("crf = true", "guise.toml: crf must be a value, as on the command line, got True"),
        ("crf = [1, 2]", "guise.toml: crf must be one value, got 2"),
        ("lossless = 1", "guise.toml: lossless must be true or false, got 1"),
        ("presets = 3", "guise.toml: presets must be tables, as [presets.NAME]"),
        ("[presets.fast]", "fast is a preset of video encoders: call yours otherwise"),
        ("[presets.'a/b']", "a preset is called by letters, digits, blanks, dots and hyphens, got 'a/b'"),
    ],
)
def test_what_is_wrong_in_a_file_is_one_sentence_with_its_name(
    text: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("guise.toml").write_text(text, encoding="utf-8")
    more = ["--preset", "court"] if "presets" in text else []
    assert main(["swap", "v.mp4", "-o", "o.mp4", *more]) == 2
    assert capsys.readouterr() == ("", f"error: {sentence}\n")


def test_what_is_no_toml_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    for text in (b"crf =", b"\xff\xfe"):
        Path("guise.toml").write_bytes(text)
        assert main(["doctor"]) == 2
        assert capsys.readouterr().err.startswith("error: guise.toml is not TOML: ")


def test_an_unknown_preset_is_one_sentence_that_says_which_there_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["doctor", "--preset", "court"]) == 2
    assert capsys.readouterr().err == (
        "error: there is no preset court: write one as [presets.court] in guise.toml\n"
    )
    presets.save("calm", "swap", {"crf": 20})
    assert main(["doctor", "--preset", "court"]) == 2
    assert capsys.readouterr().err == "error: there is no preset court: there are calm\n"


def test_every_option_of_every_command_can_be_saved() -> None:
    seen = 0
    for name, command in commands(typer.main.get_command(command_line())):
        context: Any = typer.Context(command)
        for word in name.split():
            context = typer.Context(command, parent=context, info_name=word)
        params = [
            p
            for p in command.params
            if p.opts[0].startswith("--") and p.opts[0] not in ("--help", "--preset")
        ]
        values = {p.opts[0][2:]: some_value(p) for p in params}
        presets.save("all", name, values)
        take_defaults(context, "all")
        assert set(context.default_map) == {p.name for p in params}
        seen += len(params)
    assert seen > 200


def some_value(param: Any) -> Any:
    if param.is_flag:
        return True
    one = next(iter(getattr(param.type, "choices", [None]))) or getattr(param.type, "min", None) or 1
    return [one] * param.nargs if param.multiple or param.nargs > 1 else one


def test_a_saved_preset_comes_back_for_its_command_alone_and_is_deleted() -> None:
    presets.save("My interview", "deidentify", {"region": "head", "seed": 3, "label": True, "cover": None})
    presets.save("My interview", "analogy mesh rig", {"method": "cloning"})
    assert presets.names() == presets.saved() == ["My interview"]
    assert presets.preset("My interview", "deidentify") == {"region": "head", "seed": 3, "label": True}
    assert presets.preset("My interview", "analogy mesh rig") == {"method": "cloning"}
    assert presets.preset("My interview", "swap") == {}
    presets.save("My interview", "deidentify", {"gallery": ("Mei", "Kofi")})
    assert presets.preset("My interview", "deidentify") == {"gallery": ["Mei", "Kofi"]}
    presets.delete("My interview")
    assert presets.names() == []
    with pytest.raises(PresetError, match="there is no saved preset My interview"):
        presets.delete("My interview")


@given(st.dictionaries(st.text(st.characters(codec="utf-8")), st.one_of(
    st.text(st.characters(codec="utf-8")), st.integers(-(2**60), 2**60), st.booleans(), st.floats(-1e6, 1e6),
    st.lists(st.text(st.characters(codec="utf-8"))),
), min_size=1))  # fmt: skip
def test_whatever_is_saved_is_read_back(options: dict[str, Any]) -> None:
    presets.save("any", "swap", options)
    assert presets.preset("any", "swap") == options
    os.unlink(presets.folder() / "presets.toml")
