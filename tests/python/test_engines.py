"""Adapters of physics engines: the same scene in each that is installed is pressed as gelsim presses it without one; and the scripts of
docs/how-to/engines.md run as they stand."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest
from snippet import snippets

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import engines
import numpy as np
from engines import OFFSET, PAD, TURN, in_body, in_pad, in_world

from gelsim.adapters import Touch, shapes
from gelsim.adapters.coupling import Coupling

pytestmark = pytest.mark.wheel

PAGE = Path(__file__).parents[2] / "docs/how-to/engines.md"
# Poses of several engines are float32: a tenth of a micrometre half a metre away.
WITHIN_MM = 0.002
# Corners of PyBullet's hulls lie on a grid of 1 / 10000 of their size.
ROUNDED = 5e-4


def skip_without(engine):
    if not importlib.util.find_spec(engines.MODULES[engine]):
        pytest.skip(f"no {engine}: pip install '.[{engine}]'")


@pytest.fixture(scope="module", params=engines.SCENES)
def engine(request):
    skip_without(request.param)
    return request.param


@pytest.fixture(scope="module")
def simulator():
    return gelsim.Simulator("gelsight-mini", "draft", resolution_px=(160, 120))


@pytest.fixture
def make(engine, simulator, tmp_path):
    """Makes the scene of an object, and what steps it: `step(x_mm)` moves the object and presses."""

    def make(name, **options):
        scene = engines.SCENES[engine](tmp_path, name)
        touch = Touch(simulator, {name: scene.shape}, **options)

        def step(depth_mm, x_mm=0.0):
            scene.move(in_world(in_pad(name, depth_mm, x_mm)))
            tip, body = scene.places()
            return touch.step(tip @ OFFSET, {name: body})

        step.shape = scene.shape
        return touch, step

    return make


@pytest.mark.parametrize("name", engines.OBJECTS)
def test_an_object_is_pressed_as_without_an_engine(make, simulator, name):
    touch, step = make(name)
    assert volume(step.shape) == pytest.approx(volume(in_body(name)), rel=ROUNDED)
    press = step(0.6)
    assert touch.touched == name and abs(touch.depth_mm - 0.6) < WITHIN_MM
    at = in_pad(name, 0.6)
    assert np.abs(press.pose[:3] - at).max() < WITHIN_MM
    corners = in_body(name).vertices @ TURN.T + at
    own = simulator.press(gelsim.Mesh(corners, in_body(name).faces), gelsim.Placement((0, 0, 0)))
    apart = np.abs(press.depth - own.depth)
    print(f"depth {apart.max() * 1e3:.3f} um, image {np.abs(press.image.astype(int) - own.image).max()} levels apart")
    # A pixel on an edge may see either side of it.
    assert np.quantile(apart, 0.999) < WITHIN_MM and (apart > WITHIN_MM).sum() <= 8
    assert np.quantile(np.abs(press.image.astype(int) - own.image), 0.999) <= 1
    assert press.force_n == pytest.approx(own.force_n, rel=2e-3)
    # What is mirrored or turned looks otherwise.
    for other in (own.depth[::-1], own.depth[:, ::-1], own.depth[::-1, ::-1]):
        assert np.abs(press.depth - other).max() > 0.1 or name == "ball"


@pytest.fixture
def kinds(engine, tmp_path):
    """Shapes of an engine beside those of its URDF, and what is refused."""
    return engines.SCENES[engine](tmp_path, "wedge").kinds()


def volume(shape):
    """Above 0 if its triangles show outwards."""
    a, b, c = np.moveaxis(shape.vertices[shape.faces], 1, 0)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def test_shapes_of_other_kinds_are_right(kinds):
    for kind, (found, expected) in next(kinds).items():
        for edge in (np.min, np.max):
            assert edge(found.vertices, axis=0) == pytest.approx(edge(expected.vertices, axis=0), abs=5e-4), kind
        assert volume(found) == pytest.approx(volume(expected), rel=ROUNDED), kind


def test_a_shape_without_triangles_is_refused_by_name(kinds):
    next(kinds)
    for kind, make in next(kinds).items():
        with pytest.raises(gelsim.UsageError, match=kind):
            make()


@pytest.mark.parametrize("concave", ["", 'concave="yes"'], ids=["parts", "concave"])
@pytest.mark.parametrize("more", ["", '<collision><geometry><box size="2 2 2"/></geometry></collision>'], ids=["alone", "beside"])
def test_a_file_of_several_parts_is_whole_in_pybullet(concave, more, tmp_path):
    """PyBullet tells some corners of some of them."""
    skip_without("pybullet")
    pytest.importorskip("trimesh", reason="no trimesh: pip install trimesh")
    import pybullet

    from gelsim.adapters.pybullet import shape_of

    lines = []
    for part, at in enumerate([(0, 0, 0), (10, 0, 0), (0, 20, 5)]):
        lines += [f"o part{part}", *("v {} {} {}".format(*corner) for corner in engines.WEDGE + at)]
        lines += ["f {} {} {}".format(*(face + 1 + part * len(engines.WEDGE))) for face in engines.WEDGE_FACES]
    (tmp_path / "parts.obj").write_text("\n".join(lines) + "\n")
    mesh = f'<collision {concave}><geometry><mesh filename="parts.obj"/></geometry></collision>'
    (tmp_path / "parts.urdf").write_text(f'<robot name="a"><link name="a">{engines.MASS}{mesh}{more}</link></robot>')
    client = pybullet.connect(pybullet.DIRECT)
    found = shape_of(pybullet.loadURDF(str(tmp_path / "parts.urdf"), physicsClientId=client), client=client)
    low, high = engines.WEDGE.min(axis=0), engines.WEDGE.max(axis=0) + (10, 20, 5)
    low = np.minimum(low, -1) if more else low
    assert found.vertices.min(axis=0) == pytest.approx(1e3 * low, abs=1)
    assert found.vertices.max(axis=0) == pytest.approx(1e3 * high, abs=1)
    wanted = 3e9 * volume(engines.SOLID) + (8e9 if more else 0.0)
    assert volume(found) == pytest.approx(wanted, rel=ROUNDED)


def test_a_ball_that_slides_drags_the_pad_along(make):
    touch, step = make("ball", friction=0.4)
    states = [step(min(0.2 * frame, 0.6), max(0.0, 0.06 * (frame - 3))).slip_state for frame in range(1, 16)]
    assert states[0] == "none" and "incipient" in states and states[-1] == "gross"
    assert states.index("incipient") < states.index("gross")
    force = PAD.rotation.T @ touch.wrench.force_n
    assert force[2] < -0.1 and force[0] > 0.1 and abs(force[1]) < 0.1 * force[0]
    assert force[0] == pytest.approx(-0.4 * force[2], rel=0.05)
    assert np.allclose(touch.wrench.point_m, PAD.position_m, atol=1e-6)


def test_a_block_that_falls_on_the_pad_rests_where_it_carries_its_weight(engine, simulator, tmp_path):
    """The pad's force acts where the page says, or the block, whose centre of mass lies beside its origin, would turn."""
    step_s = 1e-3
    shape, where, centre, push = engines.SCENES[engine].falling(tmp_path, step_s)
    coupling = Coupling(Touch(simulator, {"block": shape}), mass_kg=engines.MASS_KG, gyration_m=0.003)
    for step in range(300):
        objects, time_s = {"block": where()}, step * step_s
        if step % 20 == 0:
            press = coupling.sense(engines.HERE, objects, time_s)
        force, torque, _ = (-coupling.wrench(engines.HERE, objects, time_s)).about(centre())
        push(force, torque)
    weight_n = 9.81 * engines.MASS_KG
    assert press.wrench[:3] == pytest.approx([0, 0, -weight_n], abs=0.01 * weight_n)
    assert where().rotation == pytest.approx(np.eye(3), abs=1e-3)


def test_an_object_that_is_away_is_not_felt(make):
    touch, step = make("ball")
    assert not step(-1.0).in_contact and touch.touched is None
    assert touch.wrench.force_n == pytest.approx([0, 0, 0])


def test_adapters_leave_their_engines_alone_until_they_are_used():
    """They can be imported, and checked for types, where there are none."""
    names = "".join(f"import gelsim.adapters.{name}\n" for name in engines.SCENES)
    subprocess.run([sys.executable, "-c", f"{names}import sys\nassert not {set(engines.MODULES.values())} & set(sys.modules)"], check=True)


@pytest.mark.parametrize("number", range(len(snippets(PAGE)) if PAGE.is_file() else 0))
def test_a_script_of_the_page_runs(number):
    code = snippets(PAGE)[number]
    (engine,) = (engine for engine in engines.SCENES if f"gelsim.adapters.{engine}" in code)
    skip_without(engine)
    line = [sys.executable, Path(__file__).with_name("snippet.py"), PAGE, str(number)]
    done = subprocess.run(line, cwd=PAGE.parents[2], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    print(done.stdout)
    if "Coupling" in code:
        assert float(done.stdout.split()[-1]) == pytest.approx(-0.981, rel=0.01)
    else:
        assert "gross" in done.stdout
