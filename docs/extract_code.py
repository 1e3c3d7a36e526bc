"""Write the Python of the pages, the examples and the notebook as a package, for a type checker.  FOLDER"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

DOCS = Path(__file__).parent


def code_of_pages() -> dict[str, str]:
    """By name of a module: the blocks of a page, a script, or the cells of a notebook."""
    pages = [DOCS.parent / "README.md", *sorted(DOCS.glob("*.md"))]
    found = {f"page_{page.stem}": "\n\n".join(blocks(page)) for page in pages if blocks(page)}
    for path in sorted((DOCS / "examples").iterdir()):
        text = path.read_text(encoding="utf-8")
        found[f"example_{path.stem}"] = text if path.suffix == ".py" else "\n\n".join(cells(path))
    return {name.replace("-", "_"): text for name, text in found.items()}


def blocks(page: Path) -> list[str]:
    """The blocks of Python on a page."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


def cells(notebook: Path) -> list[str]:
    """The code of a notebook, cell by cell."""
    read = json.loads(notebook.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in read["cells"] if cell["cell_type"] == "code"]


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.py"):
        old.unlink()
    for name, text in {"__init__": "", **code_of_pages()}.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
