"""The Python module as a whole: every name has words, types and a use."""

import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import module_names
from module_checks import refusal

from gelsim.lazy import lazy

pytestmark = pytest.mark.wheel

HERE = Path(__file__).parent
PUBLIC = [name for name in gelsim.__all__ if not isinstance(getattr(gelsim, name), str)]
STUBS = ast.parse(Path(gelsim._native.__file__).with_name("_native.pyi").read_text())


@pytest.mark.parametrize(
    "call, meant",
    [
        (lambda: gelsim.Sensor("digit"), ['gelsim.Sensor.preset("digit")', 'gelsim.Sensor.load("my.toml")']),
        (lambda: gelsim.Sensor("Mini", threads=2), ['gelsim.Sensor.preset("gelsight-mini")']),
        (lambda: gelsim.Sensor(preset="DIGIT"), ['gelsim.Sensor.preset("digit")']),
        (lambda: gelsim.Sensor(Path("a/b.toml")), ['gelsim.Sensor.load("a/b.toml")']),
        (lambda: gelsim.Sensor(), ['gelsim.Sensor.preset("digit")']),
        (lambda: gelsim.Sensor({}, 5), ['gelsim.Sensor.preset("digit")']),
        (lambda: gelsim.Job("mine.toml"), ['gelsim.Job.load("mine.toml")']),
        (lambda: gelsim.Job(path=Path("mine.toml")), ['gelsim.Job.load("mine.toml")']),
        (lambda: gelsim.Job(), ['gelsim.Job.load("job.toml")']),
    ],
    ids=lambda given: given[0] if isinstance(given, list) else None,
)
def test_a_class_that_is_called_is_answered_with_what_is_meant(call, meant):
    said = refusal(TypeError, call)
    assert all(name in said for name in meant), said


def test_mistakes_are_value_errors_and_what_happens_later_runtime_errors():
    assert issubclass(gelsim.UsageError, ValueError) and issubclass(gelsim.RunError, RuntimeError)


def compiled():
    """Names of the stubs that have words."""
    for node in STUBS.body:
        for member in [node, *node.body] if isinstance(node, ast.ClassDef) else [node]:
            if isinstance(member, (ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(member) is not None:
                thing = getattr(gelsim._native, node.name)
                if not (isinstance(thing, type) and issubclass(thing, Exception)):
                    found = thing if member is node else getattr(thing, member.name)
                    name = node.name if member is node else f"{node.name}.{member.name}"
                    yield pytest.param(found, ast.get_docstring(member), id=name)


@pytest.mark.parametrize("thing, words", list(compiled()))
def test_what_is_compiled_has_the_words_of_the_stubs(thing, words):
    assert inspect.getdoc(thing) == words


def test_the_stubs_have_words():
    assert len(list(compiled())) > 25


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_says_what_it_is(name):
    thing = getattr(gelsim, name)
    assert len(inspect.getdoc(thing) or "") > 20
    for part, value in vars(thing).items() if isinstance(thing, type) else []:
        value = getattr(value, "__func__", value)
        if not part.startswith("_") and (inspect.isroutine(value) or isinstance(value, (property, lazy))):
            assert inspect.getdoc(value), part


# The code in the words of the module and its names, and what it takes for granted.
WORDS = {"gelsim": inspect.getdoc(gelsim), **{name: inspect.getdoc(getattr(gelsim, name)) or "" for name in PUBLIC}}
EXAMPLES = {name: "".join(re.findall(r"```python\n(.*?)```", words, re.DOTALL)) for name, words in WORDS.items()}
GRANTED = {
    "Led": 'sensor = gelsim.Sensor.preset("digit")\n',
    "Mesh": "vertices_mm, faces = [(0, 0, 0), (1, 0, 1), (0, 1, 1)], [(0, 1, 2)]\n",
    "load": EXAMPLES["generate"],
}


@pytest.fixture(scope="module")
def workplace(project, tmp_path_factory):
    """A folder with what examples read: a job and a mesh."""
    folder = tmp_path_factory.mktemp("workplace")
    (folder / "job.toml").write_text(
        f'dataset = {{ name = "shown", samples = 50 }}\nobject = [{{ path = "{project}/objects/sphere.obj" }}]\n'
        "indentation.depth_mm = 0.5\nsensor.resolution_px = [24, 32]\n"
    )
    facets = [((0, 0, 0), (1, 0, 1), (0, 1, 1)), ((0, 0, 0), (0, 1, 1), (-1, -1, 1))]
    corners = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in corners) for corners in facets]
    facets = "".join(f"facet normal 0 0 0\nouter loop\n{each}endloop\nendfacet\n" for each in corners)
    (folder / "ball.stl").write_text(f"solid\n{facets}endsolid\n")
    return folder


@pytest.mark.parametrize("name", [name for name, code in EXAMPLES.items() if code])
def test_an_example_runs_as_it_stands(workplace, name):
    code = "\n".join(line for line in EXAMPLES[name].splitlines() if "trimesh" not in line)
    line = [sys.executable, "-W", "error", "-c", f"import gelsim\nimport numpy as np\n{GRANTED.get(name, '')}{code}"]
    done = subprocess.run(line, cwd=workplace, capture_output=True, text=True)
    assert done.returncode == 0, f"{code}\n{done.stderr}"


def test_there_are_examples():
    assert sum(map(bool, EXAMPLES.values())) == 9


@pytest.mark.filterwarnings("error")
class TestEveryName:
    """`module_names.py` is a program that uses every public name, as a user would write it."""

    @pytest.fixture(autouse=True)
    def at_the_root(self, monkeypatch, project):
        monkeypatch.chdir(project)

    def test_for_sensors_and_presses_works(self):
        module_names.presses(module_names.sensors())

    def test_for_datasets_works(self, tmp_path):
        module_names.datasets(tmp_path)

    def test_for_mistakes_works(self):
        module_names.mistakes()

    def test_is_used(self):
        nodes = list(ast.walk(ast.parse((HERE / "module_names.py").read_text())))
        used = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
        used |= {node.arg for node in nodes if isinstance(node, ast.keyword)}
        public = set(gelsim.__all__)
        for name in gelsim.__all__:
            thing = getattr(gelsim, name)
            parts = [part for part in dir(thing) if not part.startswith("_")] if isinstance(thing, type) else []
            if isinstance(thing, type) and not issubclass(thing, (Exception, dict)):
                public |= set(parts)
            if callable(thing) and name not in ("UsageError", "RunError", "Effect", "Sample", "Generated"):
                for call in [thing, *(getattr(thing, part) for part in parts)]:
                    if callable(call) and call not in (gelsim.Job, gelsim.Sensor):
                        given = inspect.signature(call).parameters.values()
                        public |= {each.name for each in given if each.kind == each.KEYWORD_ONLY}
        inherited = {"count", "raw", "manifest", "shards", "path", "transform", "mro", *dir(tuple)}
        assert sorted(public - used - inherited) == []


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(["mypy", "--strict", HERE / "module_names.py"], id="of a program that uses every name"),
        pytest.param(["mypy", "--strict", "--package", "gelsim"], id="of the package"),
        pytest.param(["mypy.stubtest", "gelsim", "--ignore-missing-stub"], id="of the stubs"),
    ],
)
def test_types_are_right(arguments, tmp_path):
    pytest.importorskip("mypy", reason="no mypy: pip install mypy")
    done = subprocess.run([sys.executable, "-m", *arguments], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
