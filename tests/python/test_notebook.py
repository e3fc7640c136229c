"""The cells of docs/training.ipynb run in their order, without Jupyter, with and without torch; networks learn."""

import json
import os
import subprocess
import sys

import pytest

for name, package in {"gelsim": ".", "PIL": "pillow", "OpenEXR": "OpenEXR", "matplotlib": "matplotlib"}.items():
    pytest.importorskip(name, reason=f"no {name}: pip install {package}")

pytestmark = pytest.mark.wheel

# All cells in one namespace, as a person would run them.
RUN = """
import json, sys
names = {"__name__": "__main__"}
for number, code in enumerate(json.load(sys.stdin)):
    exec(compile(code, f"cell {number}", "exec"), names)
print(json.dumps({
    "guess": float(names["error_mm"](names["np"].broadcast_to(names["mean"], names["truth"].shape)).mean()),
    "linear": [float(each) for each in names["linear"]],
    "network": [float(each) for each in names["network_curve"]],
    "torch": bool(names["torch"]),
    "lines": len(names["axes"].lines),
}))
"""


@pytest.fixture(scope="module")
def notebook(project):
    return project / "docs/training.ipynb"


@pytest.fixture(scope="module", params=["without torch", "with torch"])
def left(request, project, notebook, tmp_path_factory):
    """What the notebook leaves in a folder that has the project's jobs."""
    python = request.getfixturevalue("torch_python") if request.param == "with torch" else sys.executable
    folder = tmp_path_factory.mktemp("notebook")
    for name in ["configs", "objects"]:
        (folder / name).symlink_to(project / name)
    cells = json.loads(notebook.read_text())["cells"]
    codes = json.dumps(["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"])
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    line = [python, "-c", RUN]
    done = subprocess.run(line, input=codes, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    left = json.loads(done.stdout.splitlines()[-1])
    assert left["torch"] or request.param == "without torch", f"{python} has no torch"
    return left


def test_its_outputs_are_small(notebook):
    assert notebook.stat().st_size < 50_000


def test_a_linear_model_learns(left):
    assert left["linear"][-1] < 0.75 * left["guess"] and left["linear"][-1] < left["linear"][0]


def test_a_network_learns_more_where_there_is_torch(left):
    assert left["torch"] == bool(left["network"])
    if left["network"]:
        assert left["network"][-1] < 0.75 * left["guess"] and left["network"][-1] < left["network"][0]
        assert left["network"][-1] < left["linear"][-1], "a network sees more than a linear model"


def test_the_curves_are_drawn(left):
    assert left["lines"] == 1 + bool(left["network"])
