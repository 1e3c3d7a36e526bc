"""The files around the code agree with it: version, Python versions, scripts of the build, the README's commands."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

from guise.app.cli.commands import GROUPS
from guise.common.version import VERSION

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_citation_changelog_and_code_name_the_version_of_the_project() -> None:
    assert PROJECT["version"] == VERSION
    assert re.findall(r"^version: (.*)$", read("CITATION.cff"), re.M) == [PROJECT["version"]]
    assert re.findall(r"^## (\d\S*)", read("CHANGELOG.md"), re.M)[0] == PROJECT["version"]


def test_every_supported_python_is_tested_and_declared() -> None:
    low, high = re.fullmatch(r">=3\.(\d+),<3\.(\d+)", PROJECT["requires-python"]).groups()  # type: ignore[union-attr]
    supported = [f"3.{minor}" for minor in range(int(low), int(high))]
    declared = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    linux = read(".github/workflows/ci.yml").split("smoke:")[0]
    assert declared == supported
    assert re.findall(r'"(3\.\d+)"', linux) == supported


def test_the_workflow_runs_the_check_that_developers_run() -> None:
    assert "run: .ci/run" in read(".github/workflows/ci.yml")


def test_a_release_has_the_version_of_its_tag() -> None:
    """The workflow compares a tag with what this prints, and builds what it drafts."""
    steps = read(".github/workflows/release.yml")
    [code] = re.findall(r"version=\$\(python -c '(.*)'\)", steps)
    told = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == VERSION
    assert 'test "$GITHUB_REF_NAME" = "v$version"' in steps
    assert steps.index("python -m build") < steps.index("doctor") < steps.index("gh release create")


def test_the_readme_lists_every_command_in_its_group() -> None:
    table = read("README.md").split("## Commands\n")[1].split("\n## ")[0]
    listed: dict[str, list[str]] = {}
    for group, cells in re.findall(r"^\| (?:\*\*(\w+)\*\* )?\| (`guise .*)$", table, re.M):
        current = listed.setdefault(group, []) if group else listed[list(listed)[-1]]
        current += [
            name for name in re.findall(r"`guise (\w+)", cells.split(" | ")[0]) if name not in current
        ]
    assert {group: sorted(found) for group, found in listed.items()} == {
        group: sorted(expected) for group, expected in GROUPS.items()
    }


def test_moving_pictures_are_small() -> None:
    moving = list((ROOT / "docs" / "images").glob("*.webp"))
    assert {path.stem for path in moving} == {"studio", "swap"}
    assert max(path.stat().st_size for path in moving) < 1_500_000
