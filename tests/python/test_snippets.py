"""Python snippets of the docs run as they stand, in fresh interpreters, and leave what they say."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from snippet import snippets

pytestmark = pytest.mark.wheel

PROJECT = Path(__file__).parents[2]
PAGES = ["README.md", "docs/how-to/python.md", "docs/how-to/live.md"]
THERE = [page for page in PAGES if (PROJECT / page).is_file()]
FOUND = [(page, number) for page in THERE for number in range(len(snippets(PROJECT / page)))]


@pytest.fixture(scope="module")
def place(project, quickstart, tmp_path_factory):
    """A folder that has the project's jobs and objects, and the quickstart's dataset."""
    folder = tmp_path_factory.mktemp("place")
    for name in ["configs", "objects"]:
        (folder / name).symlink_to(project / name)
    (folder / "out").symlink_to(quickstart.parent)
    return folder


@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_snippets(page):
    assert page in dict(FOUND), f"{page} has no Python snippet"


@pytest.mark.parametrize("page, number", FOUND)
def test_a_snippet_runs(request, project, place, page, number):
    for package in re.findall(r"\b(mujoco|gymnasium)\b", snippets(project / page)[number]):
        pytest.importorskip(package, reason=f"no {package}: pip install {package}")
    with_torch = "import torch" in snippets(project / page)[number]
    python = request.getfixturevalue("torch_python") if with_torch else sys.executable
    line = [python, Path(__file__).with_name("snippet.py"), project / page, str(number)]
    done = subprocess.run(line, cwd=place, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
