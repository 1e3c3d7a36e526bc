"""The pages for newcomers agree with the code: the table of rooms, and every path that a page names."""

import re
from pathlib import Path

import pytest
from test_layers import ROOMS

ROOT = Path(__file__).parents[1]
PAGES = (
    "README.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "docs/architecture.md",
    "docs/glossary.md",
    "docs/README.md",
)
PROGRAM = ("aam", "analogy", "app", "common", "guise", "render")
ROW = re.compile(r"^\| `([\w/]+)/` \| .* \| (.*) \|$", re.M)


def allowed_on_the_page(text: str, room: str) -> set[str]:
    """The rooms that a cell of the last column names; a room of the app is written without `app/`."""
    if text == "nothing of Guise":
        return set()
    excepted, words = re.match(r"(all but )?(.*)", text).groups()  # type: ignore[union-attr]
    names = {short.replace("/", ".") for short in words.split(", ")}
    rooms = {name if name in ROOMS else f"app.{name}" for name in names}
    return ROOMS.keys() - rooms - {room} if excepted else rooms


def test_the_table_of_rooms_is_the_rule_that_is_enforced() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = text.split("| room | holds | may import |")[1].split("\n\n")[0]
    rows = [(path.replace("/", "."), cell) for path, cell in ROW.findall(table)]
    assert {room: allowed_on_the_page(cell, room) for room, cell in rows} == ROOMS


def test_no_room_imports_one_that_stands_above_it_in_the_table() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    order = [path.replace("/", ".") for path, _ in ROW.findall(text) if path.replace("/", ".") in ROOMS]
    assert [room for room in order for used in ROOMS[room] if order.index(used) < order.index(room)] == []


@pytest.mark.parametrize("page", PAGES)
def test_paths_on_the_page_exist(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    paths = re.findall(r"`(\w[\w.]*(?:/[\w.]+)*(?:/|\.(?:py|toml|json|md)))`", text)
    homes = (ROOT, (ROOT / page).parent)
    assert [
        path for path in paths if not any((home / path).exists() for home in homes) and "NAME" not in path
    ] == []


def test_a_public_class_has_a_name_of_its_own() -> None:
    sources = [p for part in PROGRAM for p in (ROOT / part).rglob("*.py")]
    homes: dict[str, list[str]] = {}
    for path in sources:
        for name in re.findall(r"^class ([A-Z]\w*)", path.read_text(encoding="utf-8"), re.M):
            homes.setdefault(name, []).append(path.relative_to(ROOT).as_posix())
    assert len(homes) > 300
    assert {name: paths for name, paths in homes.items() if len(paths) > 1} == {}


def test_types_in_the_glossary_exist() -> None:
    sources = [p for part in PROGRAM for p in (ROOT / part).rglob("*.py")]
    known = {
        name
        for path in sources
        for name in re.findall(r"^class (\w+)", path.read_text(encoding="utf-8"), re.M)
    }
    named = set(
        re.findall(r"`([A-Z]\w*[a-z]\w*)`", (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8"))
    )
    assert len(named) > 20
    assert named <= known


def test_the_glossary_explains_a_word_once() -> None:
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    words = re.findall(r"^\| ([^|]+) \|[^|]+\|[^|]*\|$", text, re.M)
    words = [word for word in words if word not in ("word", "---")]
    assert len(words) > 60
    assert len(words) == len(set(words))
