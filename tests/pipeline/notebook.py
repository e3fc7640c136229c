"""Runs the cells of docs/training.ipynb in their order, without Jupyter, and looks at the curves.

    python notebook.py [PYTHON_WITH_TORCH]      from the project's root, where the wheel, pillow, OpenEXR and matplotlib are
                                                installed, for the second interpreter, too
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

project = Path.cwd()
notebook = project / "docs/training.ipynb"


def cells():
    """The code of each cell."""
    book = json.loads(notebook.read_text())
    return ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]


def run():
    """All cells in one namespace, as a person would run them, in a folder that has the project's jobs."""
    os.environ["MPLBACKEND"] = "Agg"
    names = {"__name__": "__main__"}
    with tempfile.TemporaryDirectory() as folder:
        for name in ["configs", "objects"]:
            (Path(folder) / name).symlink_to(project / name)
        os.chdir(folder)
        for number, code in enumerate(cells()):
            exec(compile(code, f"{notebook.name}, cell {number}", "exec"), names)
        os.chdir(project)
    guess = names["error_mm"](names["np"].broadcast_to(names["mean"], names["truth"].shape)).mean()
    curves = {"linear": names["linear"], "network": names["network_curve"]}
    for name, curve in curves.items():
        if curve or name == "linear":
            assert curve[-1] < 0.75 * guess and curve[-1] < curve[0], (name, guess, curve)
    assert bool(names["torch"]) == bool(curves["network"])
    if curves["network"]:
        assert curves["network"][-1] < curves["linear"][-1], "a network sees more than a linear model"
    assert len(names["axes"].lines) == 1 + bool(curves["network"])
    print(f"notebook: {', '.join(f'{name} {curve[-1]:.2f} mm' for name, curve in curves.items() if curve)}", flush=True)


if __name__ == "__main__":
    assert notebook.stat().st_size < 50_000, "its outputs are too large"
    run()
    if len(sys.argv) > 1:
        subprocess.run([sys.argv[1], Path(__file__).resolve()], check=True)
