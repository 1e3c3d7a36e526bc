"""The documentation holds: its Python runs, its commands exist, its links lead somewhere, its pages are up to date,
and whatever tells people to install Guise names the right distribution.
"""

import importlib.util
import os
import re
import shlex
import tomllib
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer
from clips import cut
from made_up import SAMPLES

from guise.app.cli.commands import command_line

ROOT = Path(__file__).parents[1]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md")), ROOT / "benchmarks" / "README.md"]
READ_BY_PEOPLE = {".py", ".md", ".toml", ".js", ".html", ".css", ".yml", ".yaml", ".cff", ".txt"}
OURS = (
    "*.*", ".github/**/*", "aam/**/*", "analogy/**/*", "app/**/*", "benchmarks/**/*", "common/**/*", "docs/**/*",
    "guise/**/*", "render/**/*", "tests/**/*", "training/**/*",
)  # fmt: skip
IDS = [str(page.relative_to(ROOT)) for page in PAGES]
EVERY_PAGE = pytest.mark.parametrize("page", PAGES, ids=IDS)


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


@cache
def every_command() -> dict[str, Any]:
    """By its full name, such as "analogy mesh rig"."""
    return commands_of(typer.main.get_command(command_line()))


def commands_of(group: Any, before: str = "") -> dict[str, Any]:
    found = {}
    for name, command in group.commands.items():
        inner = commands_of(command, f"{before}{name} ") if hasattr(command, "commands") else {}
        found |= inner or {f"{before}{name}": command}
    return found


def command_lines() -> list[str]:
    """Every `guise ...` in a shell block or in backquotes, on any page."""
    found = []
    for page in PAGES:
        lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
        quoted = re.findall(r"`(guise [^`]*)`", page.read_text(encoding="utf-8"))
        found += [line.split("#")[0].strip() for line in lines if line.startswith("guise ")] + quoted
    return sorted(set(found))


def script(name: str) -> ModuleType:
    """A script that lies beside the pages."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def anchors(page: Path) -> set[str]:
    """The fragments that a page's headings have, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.fixture
def samples(tmp_path: Path) -> Path:
    """A folder with sample_videos, whose clips are cut to a second."""
    folder = tmp_path / "sample_videos"
    folder.mkdir()
    (folder / "heads").symlink_to(SAMPLES / "heads")
    for person, clip in (("p01", "talk2"), ("p06", "talk")):
        (folder / person).mkdir()
        cut(person, folder / person / f"{clip}.mp4", 30, clip=f"{clip}.mp4")
    (folder / "p01" / "talk.npz").symlink_to(SAMPLES / "p01" / "talk.npz")
    return tmp_path


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python")], ids=lambda p: p.name)
@pytest.mark.slow
@pytest.mark.usefixtures("quick_training")
def test_python_on_the_page_runs(page: Path, samples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(samples)
    names: dict[str, Any] = {"__name__": "docs"}  # the blocks of a page follow each other
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), names)


@pytest.mark.slow
@pytest.mark.usefixtures("quick_training")
def test_the_notebook_runs(samples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(samples)
    names: dict[str, Any] = {"__name__": "notebook"}
    read = script("extract_code").cells(ROOT / "docs" / "examples" / "first_steps.ipynb")
    for cell in read:
        exec(compile(cell, "first_steps.ipynb", "exec"), names)
    assert names["hidden"].picture.shape == names["frame"].shape


def test_all_python_of_the_documentation_is_given_to_the_type_checker() -> None:
    code = script("extract_code").code_of_pages()
    examples = [path for path in (ROOT / "docs" / "examples").iterdir() if path.suffix in (".py", ".ipynb")]
    pages = [page for page in PAGES if page.parent != ROOT / "benchmarks" and blocks(page, "python")]
    assert len(code) == len(examples) + len(pages) > 10
    assert all(block in "\n".join(code.values()) for page in pages for block in blocks(page, "python"))
    assert "-p code_of_docs" in (ROOT / ".ci" / "types").read_text(encoding="utf-8")


@pytest.mark.parametrize("line", command_lines())
def test_commands_on_the_pages_exist_with_their_options(line: str) -> None:
    known = every_command()
    _, *words = shlex.split(line)
    names = [name for name in known if words[: len(name.split())] == name.split()]
    groups = [name for name in known if name.split()[: len(words)] == words]
    alone = {opt for param in typer.main.get_command(command_line()).params for opt in param.opts}
    assert words[0] in {"COMMAND", "--help", *alone} or names or groups, line
    for name in names:
        options = {opt for param in known[name].params for opt in [*param.opts, "--help"]}
        assert {w.split("=")[0] for w in words if w.startswith("-")} <= options


def test_pages_name_commands_at_all() -> None:
    assert len(command_lines()) >= 7


@EVERY_PAGE
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if re.match(r"https?://", target):
            continue
        path, _, fragment = target.partition("#")
        linked = page.parent / path if path else page
        assert linked.exists(), target
        assert not fragment or fragment in anchors(linked), target


@EVERY_PAGE
def test_pages_do_not_speak_of_places_on_one_computer(page: Path) -> None:
    assert not re.search(r"(?<![\w.])/(home|root|work|tmp|Users)/", page.read_text(encoding="utf-8"))


def test_one_command_makes_every_picture_and_each_is_on_a_page() -> None:
    made = [file for _, files in script("make_pictures").PICTURES.values() for file in files]
    shown = {
        name for page in PAGES for name in re.findall(r"images/([\w.-]+)\)", page.read_text(encoding="utf-8"))
    }
    assert sorted(made) == sorted(shown) == sorted(path.name for path in (ROOT / "docs" / "images").iterdir())


def test_the_page_of_commands_is_up_to_date() -> None:
    make_cli = script("make_cli")
    assert (ROOT / "docs" / "cli.md").read_text(encoding="utf-8") == make_cli.page()
    assert (ROOT / "docs" / "guise.1").read_text(encoding="utf-8") == make_cli.manual()


def test_an_option_means_the_same_in_every_command_or_it_is_explained() -> None:
    assert script("make_cli").disagreements() == []


def test_what_is_not_explained_is_found() -> None:
    make_cli = script("make_cli")
    del make_cli.MEANINGS["--cover"], make_cli.DIFFERENCES["--alpha"]
    make_cli.DIFFERENCES["--force"] = "it is not so"
    assert make_cli.disagreements() == [
        "--cover: two meanings",
        "--alpha: two defaults",
        "--force: no difference",
    ]


def test_the_manual_has_every_command_and_no_line_that_troff_would_take_for_its_own() -> None:
    text = (ROOT / "docs" / "guise.1").read_text(encoding="utf-8")
    assert re.findall(r'^\.SS "guise (.*)"$', text, re.M) == list(every_command())
    assert {line.split()[0] for line in text.splitlines() if line[:1] in (".", "'")} == {
        ".TH", ".SH", ".SS", ".TP", ".B",
    }  # fmt: skip
    roff = script("make_cli").roff
    assert roff(".pts files, or a\\b") == r"\&.pts files, or a\eb"


def test_the_page_of_commands_names_every_option() -> None:
    text = script("make_cli").page()
    for name, command in every_command().items():
        section = text.split(f"\n## {name}\n")[1].split("\n## ")[0]
        for param in command.params:
            if param.name != "help" and param.opts[0].startswith("-"):
                assert f"`{', '.join(param.opts)}" in section, (name, param.name)


def test_the_readme_or_the_index_links_every_page() -> None:
    index = ROOT / "docs" / "README.md"
    linked = (ROOT / "README.md").read_text(encoding="utf-8")
    if index.is_file():
        assert "(docs/README.md)" in linked or "(docs/)" in linked or "(docs)" in linked
        linked += index.read_text(encoding="utf-8").replace("](", "](docs/")
    missing = [p.name for p in (ROOT / "docs").glob("*.md") if p != index and f"docs/{p.name}" not in linked]
    assert missing == []


def test_targets_of_make_in_the_readme_exist() -> None:
    made = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    named = set(re.findall(r"make ([a-z]+)", "\n".join(blocks(ROOT / "README.md", "sh"))))
    assert named
    assert named <= made


def test_scripts_of_the_build_can_be_run() -> None:
    assert os.access(ROOT / ".ci" / "run", os.X_OK)


def wrong_hints(text: str) -> list[str]:
    """Hints that would install a stranger's package or an extra that doesn't exist, or that zsh would not pass on."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wrong = re.findall(r"(?<![\w./-])guise\[[\w,]+\]|pip install (?:-\S+ )*[\"']?guise(?![\w-])", text)
    wrong += re.findall(r"pip install (?:-\S+ )*guise-video\\?\[", text)
    for names in re.findall(r"(?:guise-video|[\"' ]\.)\\?\[([a-z0-9,]+)\\?\]", text):
        wrong += set(names.split(",")) - set(project["optional-dependencies"])
    return wrong


@pytest.mark.parametrize(
    "hint",
    ["pip install guise", 'pip install "guise"', "pip install -U guise", 'pip install "guise[window' + ']"',
     "guise[window" + "]", "pip install guise-video" + "[window]", 'pip install "guise-video[window,nothing' + ']"'],
)  # fmt: skip
def test_a_wrong_hint_is_found(hint: str) -> None:
    assert wrong_hints(hint)


@pytest.mark.slow
def test_hints_name_our_own_distribution_and_extras_that_exist() -> None:
    files = {path for pattern in OURS for path in ROOT.glob(pattern) if path.suffix in READ_BY_PEOPLE}
    assert len(files) > 400
    own = {Path(__file__)}
    found = {
        str(f.relative_to(ROOT)): wrong_hints(f.read_text(encoding="utf-8")) for f in sorted(files - own)
    }
    assert {name: hints for name, hints in found.items() if hints} == {}


def test_every_extra_is_hinted_at_somewhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    told = " ".join(page.read_text(encoding="utf-8") for page in PAGES)
    extras = set(project["optional-dependencies"]) - {"dev", "train"}
    assert [extra for extra in sorted(extras) if f"[{extra}]" not in told] == []


def long_sentences(text: str) -> list[str]:
    """Sentences of 30 words or more, outside of code, tables and headings."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n|\n(?=[-*] |\d+\. )", text)]
    prose = [re.sub(r"\]\([^)]*\)", "]", one) for one in paragraphs if one[:1] not in ("|", "#", "!")]
    found = [s for one in prose for s in re.split(r"(?<=[.!?])\s+|(?<=[:;])\s+(?=[A-Z*`\[])", one)]
    return [s for s in found if len(s.split()) >= 30]


@pytest.mark.parametrize("page", ["README.md", "docs/install.md", "docs/presets.md", "docs/deidentify.md"])
def test_sentences_of_the_first_pages_are_short(page: str) -> None:
    assert long_sentences((ROOT / page).read_text(encoding="utf-8")) == []
    assert (
        len(long_sentences(f"# One\n\n{'word ' * 30}.\n\n```sh\n{'word ' * 40}\n```\n\n- Two. Three.")) == 1
    )
