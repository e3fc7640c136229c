"""The readers of docs/how-to/streams.md as they stand, in Python and C, at the end of the command's pipe."""

import io
import json
import re
import shutil
import subprocess
import sys

import pytest

numpy = pytest.importorskip("numpy", reason="no numpy: pip install numpy")

from processes import run
from snippet import snippets

# Rows, columns, and m per pixel of the view of 20 x 15 mm.
SIZE, PITCH = (60, 80), 0.25e-3


@pytest.fixture(scope="module")
def page(project):
    return project / "docs/how-to/streams.md"


@pytest.fixture(scope="module")
def code(page):
    """The page's programs: the reader in Python, the loop, the reader in C."""
    reader, loop = [code for code in snippets(page) if "answer" in code]
    return reader, loop, re.search(r"(?ms)^```c\n(.*?)^```", page.read_text())[1]


@pytest.fixture(scope="module")
def command(page):
    """The page's command and what reads its answers."""
    return re.search(r"(?m)^    (gelsim render .*) <frames.npy \| (.*)$", page.read_text()).groups()


@pytest.fixture(scope="module")
def python_reader(code):
    names = {}
    exec(code[0], names)
    return names["read_answer"]


@pytest.fixture(scope="module")
def c_reader(code, command, tmp_path_factory):
    """The reader in C, compiled."""
    if not shutil.which("cc"):
        pytest.skip("no C compiler: apt install gcc libc6-dev")
    folder = tmp_path_factory.mktemp("reader")
    (folder / "reader.c").write_text(code[2])
    run("cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-o", folder / command[1], folder / "reader.c")
    return folder / command[1]


def npy(*arrays):
    file = io.BytesIO()
    for array in arrays:
        numpy.save(file, array)
    return file.getvalue()


def ball(pressed_mm):
    """What the camera sees of a ball of 4 mm, m."""
    y, x = ((numpy.arange(count) + 0.5 - count / 2) * PITCH for count in SIZE)
    square = 16e-6 - x**2 - y[:, None] ** 2
    return numpy.where(square > 0, 14e-3 - 1e-3 * pressed_mm - numpy.sqrt(numpy.maximum(square, 0)), 0.05)


HOLES = numpy.full(SIZE, numpy.nan)


def answers_of(line, frames, more=()):
    return run(*line.split(), *more, input=npy(*frames), text=False).stdout


def all_answers(read, data):
    pipe = io.BytesIO(data)
    return list(iter(lambda: read(pipe), None))


@pytest.mark.parametrize("layers", ["surface", "surface,normal,contact", "markers,depth"])
def test_both_readers_read_the_same(command, python_reader, c_reader, layers):
    line = command[0].replace("--layers surface", f"--layers {layers}")
    frames = [ball(0.3), HOLES, ball(0.8), ball(-1)]
    data = answers_of(line, frames, ["--on-broken-frame", "skip", "--set", "markers.pitch_mm=2"])
    answers = all_answers(python_reader, data)
    assert [(frame, status) for frame, status, _ in answers] == [(0, 0), (1, 1), (2, 0), (3, 0)]
    told = []
    for frame, status, parts in answers:
        told.append(f"frame {frame}: status {status}")
        for name, part in parts.items():
            if isinstance(part, dict):
                told.append((name, part))
            else:
                first = f" first {part.flat[0]:g}" if part.dtype == "f4" else ""
                told.append(f"{name} {part.dtype.str} {' '.join(map(str, part.shape))}{first}")
    lines = run(c_reader, input=data, text=False).stdout.decode().splitlines()
    assert len(lines) == len(told)
    for found, expected in zip(lines, told):
        if isinstance(expected, tuple):
            name, kind, _, text = found.split(" ", 3)
            found = (name, json.loads(text)) if kind == "json" else found
        assert found == expected


def test_the_pages_command_ends_in_its_reader(command, c_reader, tmp_path):
    (tmp_path / "frames.npy").write_bytes(npy(ball(0.3), ball(0.5)))
    (tmp_path / command[1]).symlink_to(c_reader)
    done = run("bash", "-ec", f"set -o pipefail; {command[0]} <frames.npy | {command[1]}", cwd=tmp_path)
    assert re.findall(r"(?m)^frame (\d+): status 0$", done.stdout) == ["0", "1"]
    assert re.findall(r"(?m)^surface <f4 60 80 first ", done.stdout) == ["surface <f4 60 80 first "] * 2


def test_what_is_no_answer_is_refused_by_both(python_reader, c_reader):
    image = npy(numpy.zeros((*SIZE, 3), "uint8"))
    with pytest.raises(ValueError, match="NUM"):
        all_answers(python_reader, image)
    run(c_reader, input=image, text=False, status=1)


def test_the_loop_ends_when_the_ball_is_pressed_as_hard_as_wanted(code, tmp_path):
    reader, loop, _ = code
    more = """
import json
label = parts["label"]
print(json.dumps([touch.wait(), force_n, label["indentation_depth_mm"], 1e3 * pressed, parts["contact"].any().item(),
                  parts["surface"].dtype.str, parts["surface"].shape, parts["tactile"].shape]))
"""
    done = run(sys.executable, "-c", reader + loop + more, cwd=tmp_path)
    status, force_n, depth_mm, pressed_mm, touched, *forms = json.loads(done.stdout)
    assert status == 0 and touched and forms == ["<f4", [240, 320], [240, 320, 3]]
    assert 1.0 <= force_n < 1.2 and abs(depth_mm - pressed_mm) < 1e-3
