"""Touch in the loop of physics engines: what a pad feels of an engine's bodies, against rays that MuJoCo casts and against weights that
a pad carries."""

import copy
import inspect
import itertools
import pickle
import re
import sys
import warnings

import pytest

numpy = pytest.importorskip("numpy", reason="no numpy: pip install numpy")
gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

from gelsim import adapters
from gelsim.adapters import Touch, Transform, coupling, shapes
from gelsim.adapters import gymnasium as gymnasium_adapter
from gelsim.adapters import mujoco as mujoco_adapter
from processes import run

pytestmark = pytest.mark.wheel

HERE = Transform.of([0.0, 0.0, 0.0])


def at(x, y, z, **turn):
    """A place in mm."""
    return Transform.of(1e-3 * numpy.array([x, y, z]), **turn)


@pytest.fixture(scope="module")
def simulator():
    return gelsim.Simulator("gelsight-mini", "draft", set={"markers.pitch_mm": 1.5})


@pytest.mark.parametrize("module", [adapters, coupling, shapes, gymnasium_adapter, mujoco_adapter])
def test_every_public_name_says_what_it_is(module):
    """Without MuJoCo and Gymnasium the modules can be imported as well."""
    own = [thing for name, thing in vars(module).items() if not name.startswith("_")]
    own = [thing for thing in own if getattr(thing, "__module__", "") == module.__name__]
    members = [member for thing in own if isinstance(thing, type) for name, member in vars(thing).items() if not name.startswith("_")]
    members = [getattr(member, "__func__", member) for member in members]
    assert own and all(inspect.getdoc(each) for each in own)
    assert all(inspect.getdoc(each) for each in members if inspect.isroutine(each) or isinstance(each, property))


def test_the_example_of_touch_runs_as_it_stands(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", inspect.getdoc(Touch), re.DOTALL)
    exec(code, {})
    assert capsys.readouterr().out.count("ball") == 5


class TestTransform:
    @pytest.mark.parametrize("seed", range(20))
    def test_a_quaternion_comes_back(self, seed):
        given = numpy.random.default_rng(seed).normal(size=4)
        found = Transform.of([1, 2, 3], xyzw=given).xyzw
        assert min(abs(sign * given / numpy.linalg.norm(given) - found).max() for sign in (1, -1)) < 1e-12

    @pytest.mark.parametrize("axis", range(3))
    def test_half_turns_come_back(self, axis):
        given = numpy.eye(4)[axis]
        assert abs(abs(Transform.of([0, 0, 0], xyzw=given).xyzw) - given).max() < 1e-12

    def test_a_quarter_turn_about_z_turns_x_to_y(self):
        turn = Transform.of([0, 0, 5], wxyz=[1, 0, 0, 1])
        assert abs(turn.rotation @ [1, 0, 0] - [0, 1, 0]).max() < 1e-15

    def test_the_inverse_leads_back(self):
        there = Transform.of([1, 2, 3], xyzw=[0.1, 0.2, 0.3, 0.4])
        back = there @ there.inverse()
        assert abs(back.position_m).max() < 1e-15 and abs(back.rotation - numpy.eye(3)).max() < 1e-15

    def test_a_matrix_is_taken_as_it_is(self):
        there = Transform.of([1, 2, 3], xyzw=[0.1, 0.2, 0.3, 0.4])
        matrix = numpy.eye(4)
        matrix[:3, :3], matrix[:3, 3] = there.rotation, there.position_m
        for same in (Transform.of_matrix(matrix), Transform.of_matrix(there.rotation.ravel(), there.position_m)):
            assert (same.rotation == there.rotation).all() and (same.position_m == there.position_m).all()

    def test_a_matrix_of_float32_is_a_rotation(self):
        turn = Transform.of([0, 0, 0], xyzw=[0.1, 0.2, 0.3, 0.4]).rotation.astype(numpy.float32)
        assert (Transform.of_matrix(turn, [1, 2, 3]).rotation == turn).all()

    @pytest.mark.parametrize(
        "make, error, said",
        [
            (lambda: Transform.of([0, 0, 0], xyzw=[0, 0, 0, 0]), gelsim.UsageError, "no length"),
            (lambda: Transform.of([0, 0, 0], xyzw=[0, 0, 0, 1], wxyz=[1, 0, 0, 0]), gelsim.UsageError, "two orders"),
            (lambda: Transform.of([0, 0, 0], xyzw=[0, 0, 1]), gelsim.UsageError, "give 4 numbers"),
            (lambda: Transform.of(None), TypeError, "position_m is None"),
            (lambda: Transform.of_matrix(2 * numpy.eye(3)), gelsim.UsageError, "scales or shears.*of_arrays"),
            (lambda: Transform.of_matrix(numpy.diag([1, 1, -1])), gelsim.UsageError, "mirrors"),
            (lambda: Transform.of_matrix(4 * numpy.eye(4)), gelsim.UsageError, "last row"),
            (lambda: Transform.of_matrix([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 2, 3, 1]]), gelsim.UsageError, "matrix.T"),
            (lambda: Transform.of_matrix(numpy.eye(4), [1, 2, 3]), gelsim.UsageError, "leave position_m out"),
            (lambda: Transform.of_matrix(numpy.arange(16)), gelsim.UsageError, r"the shape \(16,\)"),
            (lambda: Transform.of_matrix("turn"), TypeError, "matrix is of type str"),
        ],
    )
    def test_what_is_none_is_refused(self, make, error, said):
        with pytest.raises(error, match=said):
            make()


def volume(shape):
    a, b, c = numpy.moveaxis(shape.vertices[shape.faces], 1, 0)
    return numpy.einsum("ij,ij->", a, numpy.cross(b, c)) / 6


ROUND = {
    "sphere": (shapes.sphere(4.0), lambda p: numpy.linalg.norm(p, axis=1) - 4.0, 4 / 3 * numpy.pi * 64),
    "large sphere": (shapes.sphere(40.0), lambda p: numpy.linalg.norm(p, axis=1) - 40.0, 4 / 3 * numpy.pi * 64e3),
    "capsule": (
        shapes.capsule(4.0, 5.0),
        lambda p: numpy.linalg.norm(p - numpy.clip(p, [0, 0, -5], [0, 0, 5]), axis=1) - 4.0,
        numpy.pi * 16 * 10 + 4 / 3 * numpy.pi * 64,
    ),
    "cylinder": (
        shapes.cylinder(4.0, 5.0),
        lambda p: numpy.maximum(numpy.hypot(p[:, 0], p[:, 1]) - 4.0, abs(p[:, 2]) - 5.0),
        numpy.pi * 16 * 10,
    ),
}


class TestShapes:
    @pytest.mark.parametrize("name", ROUND)
    def test_every_triangle_is_within_a_micrometre_of_the_round_surface(self, name):
        shape, away, true = ROUND[name]
        weights = numpy.random.default_rng(1).dirichlet([1, 1, 1], 12)
        points = numpy.einsum("wc,fcd->wfd", weights, shape.vertices[shape.faces]).reshape(-1, 3)
        assert abs(away(points)).max() < 1.001e-3 and abs(away(shape.vertices)).max() < 1.001e-3
        assert volume(shape) == pytest.approx(true, rel=1e-3)

    @pytest.mark.parametrize("shape, true", [(shapes.box([1, 2, 3]), 48.0), (shapes.ellipsoid([1, 2, 3]), 8 * numpy.pi)])
    def test_the_outside_is_outside(self, shape, true):
        assert volume(shape) == pytest.approx(true, rel=2e-3)

    def test_a_mesh_that_is_mirrored_keeps_its_outside(self):
        corners, faces = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
        for scale in ([1, 1, 1], [1, -1, 1], 2.0):
            larger = numpy.prod(numpy.broadcast_to(abs(numpy.array(scale)), 3))
            assert volume(shapes.of_arrays(corners, faces, scale)) == pytest.approx(1e9 / 6 * larger)

    def test_joined_shapes_hold_what_each_holds(self):
        both = shapes.joined([shapes.box([1, 1, 1]), shapes.sphere(1.0).at(at(10, 0, 0))])
        assert volume(both) == pytest.approx(8 + 4 / 3 * numpy.pi, rel=1e-3) and both.vertices[:, 0].max() == pytest.approx(11.001)

    @pytest.mark.parametrize(
        "make, said",
        [
            (lambda: shapes.sphere(0.0), ["radius_mm is 0.0"]),
            (lambda: shapes.box([1, -1, 1]), ["half_mm[1] is -1.0"]),
            (lambda: shapes.capsule(1, float("nan")), ["half_length_mm is nan"]),
            (lambda: shapes.sphere(1.0, within_mm=0.0), ["within_mm is 0.0"]),
            (lambda: shapes.ellipsoid([1, 2, 3], within_mm=-1.0), ["within_mm is -1.0"]),
            (lambda: shapes.cylinder(0.0, -1.0, within_mm=-1.0), ["radius_mm is 0.0", "half_length_mm is -1.0", "within_mm is -1.0"]),
        ],
    )
    def test_sizes_that_are_none_are_refused_each_once(self, make, said):
        with pytest.raises(gelsim.UsageError) as raised:
            make()
        lines = str(raised.value).splitlines()
        assert len(lines) == len(said) and all(line.startswith(words) for line, words in zip(lines, said)), lines


def wedge(tip_mm):
    """A box of 60 cm whose face is tilted by 5 degrees: its lowest point in the view is `tip_mm` deep, far beyond it is 26 mm deep."""
    turn = numpy.radians(5.0)
    z = -tip_mm + 9.3 * numpy.tan(turn) + 20.0 / numpy.cos(turn)
    return shapes.box([300, 300, 20]), at(0, 0, z, xyzw=[0, numpy.sin(turn / 2), 0, numpy.cos(turn / 2)])


class TestTouch:
    def test_a_ball_is_where_it_is(self, simulator):
        """Right and down in the image are x and y of the pad, wherever the pad is in the world."""
        pad = Transform.of([0.3, -0.2, 0.5], xyzw=[0.5, -0.3, 0.2, 0.7])
        touch = Touch(simulator, {"ball": shapes.sphere(4.0)})
        press = touch.step(pad, {"ball": pad @ at(4, 2, 3.5)})
        rows, columns = numpy.nonzero(press.contact)
        width, height = simulator.field_of_view_mm
        assert columns.mean() + 0.5 - 160 == pytest.approx(4 / width * 320, abs=0.6)
        assert rows.mean() + 0.5 - 120 == pytest.approx(2 / height * 240, abs=0.6)
        assert touch.depth_mm == pytest.approx(0.5, abs=0.0011) and touch.touched == "ball"
        assert press.depth.max() == pytest.approx(0.5, abs=2e-3)

    def test_the_wrench_in_the_world_is_the_pads_turned(self, simulator):
        pad = Transform.of([0.3, -0.2, 0.5], xyzw=[0.5, -0.3, 0.2, 0.7])
        touch = Touch(simulator, {"ball": shapes.sphere(4.0)})
        for x in (0.0, 0.3):
            press = touch.step(pad, {"ball": pad @ at(2 + x, 1, 3.5)})
        force = pad.rotation.T @ touch.wrench.force_n
        assert abs(force - press.wrench[:3]).max() < 1e-12 and force[2] < -0.1 and force[0] > 0.05
        # About the ball's middle the pressure has nearly no torque, about the pad's it has the lever's.
        about = touch.wrench.about((pad @ at(2.3, 1, 3.5)).position_m)
        tangential = numpy.cross(pad.rotation @ [0, 0, -4e-3], touch.wrench.force_n)
        assert abs(touch.wrench.torque_nm).max() > 5e-4 and numpy.linalg.norm(about.torque_nm - tangential) < 2e-4
        assert ((-touch.wrench).force_n == -touch.wrench.force_n).all()

    def test_of_several_it_follows_the_deepest_until_that_leaves(self, simulator):
        touch = Touch(simulator, {"ball": shapes.sphere(4.0), "box": shapes.box([1, 1, 1])})
        seen = []
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            for ball, box in [(5, 5), (3.5, 5), (3.5, 0.8), (3.5, 0.3), (5, 0.3)]:
                press = touch.step(HERE, {"ball": at(-3, 0, ball), "box": at(5, 0, box)})
                seen.append((touch.touched, press.frame, round(touch.depth_mm, 2)))
        assert seen == [(None, 0, -1.0), ("ball", 1, 0.5), ("ball", 2, 0.5), ("ball", 3, 0.5), ("box", 0, 0.7)]
        assert [str(each.message) for each in said] == ["'box' touches, too, and is not felt: the pad follows 'ball'"]

    def test_what_is_left_out_is_away(self, simulator):
        touch = Touch(simulator, {"ball": shapes.sphere(4.0)})
        assert touch.step(HERE, {"ball": at(0, 0, 3.5)}).in_contact
        assert not touch.step(HERE, {}).in_contact and touch.touched is None and touch.depth_mm == -numpy.inf

    def test_a_reset_forgets_what_friction_held(self, simulator):
        touch = Touch(simulator, {"ball": shapes.sphere(4.0)})
        dragged = [touch.step(HERE, {"ball": at(x, 0, 3.2)}).wrench[0] for x in (0.0, 0.1)]
        touch.reset()
        assert dragged[1] > 0.02 and abs(touch.step(HERE, {"ball": at(0.1, 0, 3.2)}).wrench[0]) < 1e-3

    def test_deeper_than_the_pad_is_refused(self, simulator):
        touch = Touch(simulator, {"ball": shapes.sphere(4.0)})
        with pytest.raises(gelsim.UsageError, match="'ball' is 5 mm deep in a pad of 4 mm"):
            touch.step(HERE, {"ball": at(0, 0, -1)})
        assert touch.step(HERE, {"ball": at(0, 0, 3.5)}).in_contact

    def test_a_step_that_is_refused_leaves_the_memory_as_it_is(self, simulator):
        touch = Touch(simulator, {"ball": shapes.sphere(4.0), "box": shapes.box([1, 1, 1])})
        touch.step(HERE, {"ball": at(0, 0, 3.2)})
        with pytest.raises(gelsim.UsageError, match="'box' is 6 mm deep"):
            touch.step(HERE, {"box": at(0, 0, -5)})
        press = touch.step(HERE, {"ball": at(0.1, 0, 3.2)})
        assert press.frame == 1 and press.wrench[0] > 0.02

    @pytest.mark.parametrize("copied", [copy.deepcopy, lambda touch: pickle.loads(pickle.dumps(touch))], ids=["copied", "pickled"])
    def test_a_copy_begins_anew_with_the_same_friction(self, simulator, copied):
        def drag(touch):
            return [touch.step(HERE, {"ball": at(x, 0, 3.2)}) for x in (0.0, 0.1, 0.2)][-1]

        touch = Touch(simulator, {"ball": shapes.sphere(4.0)}, friction=0.1, seed=5)
        first = drag(touch)
        again = copied(touch)
        assert again.touched is None and again.depth_mm == -numpy.inf
        other = drag(again)
        assert (other.frame, other.wrench.tolist()) == (2, first.wrench.tolist())
        assert numpy.array_equal(other.image, first.image)

    def test_with_a_deepest_depth_it_is_held_there_and_said(self, simulator):
        touch = Touch(simulator, {"ball": shapes.sphere(4.0)}, deepest_mm=2.0)
        with pytest.warns(UserWarning, match="'ball' is 5 mm deep"):
            press = touch.step(HERE, {"ball": at(0, 0, -1)})
        assert press.depth.max() == pytest.approx(2.0, abs=2e-3) and touch.depth_mm == pytest.approx(5.001)

    @pytest.mark.parametrize("seed", range(4))
    def test_it_may_be_held_as_deep_as_the_pad_is_thick(self, simulator, seed):
        """Whatever is rounded on the way from the world."""
        random = numpy.random.default_rng(seed)
        pad = Transform.of(random.normal(size=3), xyzw=random.normal(size=4))
        its = coupling.Coupling(Touch(simulator, {"ball": shapes.sphere(4.0)}, deepest_mm=4.0), mass_kg=0.1)
        with pytest.warns(UserWarning, match="pressed by deepest_mm = 4 mm"):
            press = its.sense(pad, {"ball": pad @ at(0, 0, -2, xyzw=random.normal(size=4))}, 0.0)
        assert press.depth.max() == pytest.approx(4.0, abs=2e-3) and its.stiffness[2, 2] > 1e3

    def test_pad_and_view_are_those_that_set_made(self):
        changes = {"sensor.gelpad_thickness_mm": 2.0, "sensor.field_of_view_mm": [37.2, 28.6]}
        wide = gelsim.Simulator("gelsight-mini", "draft", resolution_px=(80, 60), set=changes)
        touch = Touch(wide, {"ball": shapes.sphere(4.0), "box": shapes.box([1, 1, 1])})
        with pytest.raises(gelsim.UsageError, match="'ball' is 2.5 mm deep in a pad of 2 mm"):
            touch.step(HERE, {"ball": at(0, 0, 1.5)})
        assert touch.step(HERE, {"ball": at(0, 0, 20), "box": at(14, 0, 0.5)}).in_contact and touch.touched == "box"

    @pytest.mark.parametrize(
        "place",
        [
            at(numpy.nan, 0, 3.5),
            at(0, 0, numpy.inf),
            at(0, 0, 3.5, xyzw=[numpy.nan, 0, 0, 1]),
            at(0, 0, 3.5, xyzw=[numpy.inf, 0, 0, 1]),
            Transform.of_matrix(numpy.full((4, 4), numpy.nan)),
        ],
    )
    def test_places_that_are_not_finite_are_refused(self, simulator, place):
        """A pad that an engine lost does not feel nothing."""
        its = coupling.Coupling(Touch(simulator, {"ball": shapes.sphere(4.0)}), mass_kg=0.1)
        asked = [its.touch.step, lambda *given: its.sense(*given, 0.0), lambda *given: its.wrench(*given, 0.0)]
        for begun in (False, True):
            for ask in asked:
                with pytest.raises(gelsim.UsageError, match="the place of 'ball' is not finite.*shorter steps"):
                    ask(HERE, {"ball": place})
                with pytest.raises(gelsim.UsageError, match="the place of the pad is not finite"):
                    ask(place, {"ball": at(0, 0, 3.5)})
            if not begun:
                assert its.sense(HERE, {"ball": at(0, 0, 3.5)}, 0.0).in_contact

    @pytest.mark.parametrize("tip_mm", [0.2, 0.5])
    def test_only_what_is_in_view_counts_for_the_depth(self, simulator, tip_mm):
        """All of the box is deeper than the pad: as a whole it would be refused."""
        shape, place = wedge(tip_mm)
        touch = Touch(simulator, {"box": shape})
        press = touch.step(HERE, {"box": place})
        assert touch.depth_mm == pytest.approx(tip_mm, abs=1e-9)
        x = (numpy.arange(320) + 0.5) / 320 * 18.6 - 9.3
        expected = tip_mm - (9.3 - x) * numpy.tan(numpy.radians(5.0))
        assert abs(press.depth - numpy.maximum(expected, 0.0)).max() < 1e-5

    def test_the_far_wall_of_a_cup_is_not_felt(self, simulator):
        wall = shapes.box([1, 20, 20])
        cup = shapes.joined([wall.at(at(19, 0, 0)), wall.at(at(-19, 0, 0)), shapes.box([20, 20, 1]).at(at(0, 0, -19))])
        place = at(0, 0, -18.3, xyzw=[0, -(0.5**0.5), 0, 0.5**0.5])  # its x is the pad's z
        found = [Touch(simulator, {"it": shape}).step(HERE, {"it": place}) for shape in (cup, wall.at(at(19, 0, 0)))]
        assert abs(found[0].depth - 0.3).max() < 1e-4 and abs(found[0].depth - found[1].depth).max() < 1e-6

    def test_what_is_behind_the_sensor_is_away(self, simulator):
        touch = Touch(simulator, {"ball": shapes.sphere(4.0)})
        assert not touch.step(HERE, {"ball": at(0, 0, -40)}).in_contact

    @pytest.mark.parametrize(
        "make, error, said",
        [
            (lambda s: Touch("digit", {"a": shapes.sphere(1.0)}), TypeError, "gelsim.Simulator"),
            (lambda s: Touch(s, {}), gelsim.UsageError, "objects is empty"),
            (lambda s: Touch(gelsim.Simulator("geltip"), {"a": shapes.sphere(1.0)}), gelsim.UsageError, "is curved.*simulator.step"),
            (lambda s: Touch(s, {"a": 5}), TypeError, "'a' is of type int"),
            (lambda s: Touch(s, {"a": shapes.sphere(1.0)}, friction=11.0), gelsim.UsageError, "friction"),
            (lambda s: Touch(s, {"a": shapes.sphere(1.0)}, deepest_mm=9.0), gelsim.UsageError, "deepest_mm"),
            (lambda s: Touch(s, {"a": shapes.sphere(1.0)}).step(HERE, {"b": HERE}), gelsim.UsageError, "'b'; known: 'a'"),
            (lambda s: Touch(s, [shapes.sphere(1.0)]), TypeError, "objects is of type list; give a dict"),
            (lambda s: Touch(s, {"a": shapes.sphere(1.0)}).step(HERE, HERE), TypeError, "objects is of type Transform; give a dict"),
            (lambda s: Touch(s, {"a": shapes.sphere(1.0)}).step(HERE, {"a": numpy.eye(4)}), TypeError, "'a' is of type ndarray; give"),
            (lambda s: Touch(s, {"a": shapes.sphere(1.0)}).step(None, {"a": HERE}), TypeError, "the pad is None.*Transform.of"),
            (
                lambda s: Touch(s, {"a": shapes.sphere(1.0)}).step(HERE, {"a": Transform(numpy.zeros(3), 2 * numpy.eye(3))}),
                gelsim.UsageError,
                "the place of 'a' scales",
            ),
            (lambda s: Touch(s, {"a": shapes.sphere(1.0)}).wrench, gelsim.UsageError, "before the first step"),
        ],
    )
    def test_mistakes_are_told(self, simulator, make, error, said):
        with pytest.raises(error, match=said):
            make(simulator)


@pytest.fixture(scope="module")
def held(simulator):
    touch = Touch(simulator, {"ball": shapes.sphere(4.0)}, friction=None)
    its = coupling.Coupling(touch, mass_kg=0.1, damping=0.0)
    its.sense(HERE, {"ball": at(1, -1, 3.0)}, 0.0)
    return its


class TestCoupling:
    """Between frames the force follows the object as frames there would say."""

    MOVED = {
        "along x": at(0.02, 0, 0),
        "along y": at(0, 0.02, 0),
        "deeper": at(0, 0, -0.02),
        "turned about z": at(0, 0, 0, xyzw=[0, 0, 0.002, 1]),
    }

    @pytest.mark.parametrize("how", MOVED)
    def test_by_a_small_motion(self, held, simulator, how):
        place = self.MOVED[how] @ at(1, -1, 3.0)
        rest = held._felt[:3]
        found = held.wrench(HERE, {"ball": place}, 0.001).force_n
        other = Touch(simulator, {"ball": shapes.sphere(4.0)}, friction=None)
        other.step(HERE, {"ball": at(1, -1, 3.0)})
        expected = other.step(HERE, {"ball": place}).wrench[:3]
        assert numpy.linalg.norm(expected - rest) > 1e-3
        assert numpy.linalg.norm(found - expected) < 0.05 * numpy.linalg.norm(expected - rest) + 1e-4

    def test_coulombs_law_bounds_it(self, simulator):
        its = coupling.Coupling(Touch(simulator, {"ball": shapes.sphere(4.0)}, friction=0.3), mass_kg=0.1)
        its.sense(HERE, {"ball": at(0, 0, 3.0)}, 0.0)
        x, y, z = its.wrench(HERE, {"ball": at(3, 0, 3.0)}, 0.001).force_n
        assert z < -0.5 and x == pytest.approx(-0.3 * z, rel=1e-9) and abs(y) < 1e-3

    def test_contact_that_begins_between_frames_is_felt_at_once(self, simulator):
        its = coupling.Coupling(Touch(simulator, {"ball": shapes.sphere(4.0)}), mass_kg=0.1)
        its.sense(HERE, {"ball": at(0, 0, 4.5)}, 0.0)
        assert not its.wrench(HERE, {"ball": at(0, 0, 4.1)}, 0.001).force_n.any()
        assert its.wrench(HERE, {"ball": at(0, 0, 3.8)}, 0.002).force_n[2] < -0.01

    def test_what_leaves_is_not_held_back(self, simulator):
        its = coupling.Coupling(Touch(simulator, {"ball": shapes.sphere(4.0)}), mass_kg=0.1)
        its.sense(HERE, {"ball": at(0, 0, 3.9)}, 0.0)
        assert not its.wrench(HERE, {"ball": at(0, 0, 4.2)}, 0.001).force_n.any()

    def test_what_is_left_out_is_away(self, simulator):
        its = coupling.Coupling(Touch(simulator, {"ball": shapes.sphere(4.0)}), mass_kg=0.1)
        its.sense(HERE, {"ball": at(0, 0, 3.5)}, 0.0)
        assert its.wrench(HERE, {"ball": at(0, 0, 3.5)}, 0.001).force_n.any()
        assert not its.wrench(HERE, {}, 0.002).force_n.any()

    def test_an_earlier_time_begins_anew(self, simulator):
        its = coupling.Coupling(Touch(simulator, {"ball": shapes.sphere(4.0)}), mass_kg=0.1)
        frames = [its.sense(HERE, {"ball": at(0, 0, 3.9)}, time).frame for time in (0.0, 0.1, 0.2, 0.0, 0.1)]
        assert frames == [0, 1, 2, 0, 1]


# A tetrahedron, cut from a corner of which no axis is one of its inertia, and placed away from its middle.
TETRAHEDRON = 'vertex="0 0 0  0.006 0 0  0.001 0.009 0  0.002 0.001 0.004"'
GEOMS = {
    "sphere": '<geom type="sphere" size="0.004" pos="0.001 0.002 0"/>',
    "capsule": '<geom type="capsule" size="0.002 0.005" pos="0.001 0 0" euler="70 20 10"/>',
    "ellipsoid": '<geom type="ellipsoid" size="0.002 0.004 0.006" euler="30 40 50"/>',
    "cylinder": '<geom type="cylinder" size="0.003 0.005" euler="50 20 10"/>',
    "box": '<geom type="box" size="0.002 0.004 0.003" euler="20 35 10"/>',
    "mesh": '<geom type="mesh" mesh="it" pos="0.001 -0.001 0" euler="200 20 30"/>',
    "scaled mesh": '<geom type="mesh" mesh="scaled" pos="0.001 -0.001 0" euler="200 20 30"/>',
    "hfield": '<geom type="hfield" hfield="it" euler="170 10 30"/>',
    "a body of several": """<geom type="sphere" size="0.002" pos="0.004 0 0"/>
        <body pos="-0.003 0.001 0" euler="0 30 0"> <geom type="box" size="0.002 0.003 0.002"/>
        <body pos="0 0 0.001" euler="90 0 0"> <geom type="capsule" size="0.001 0.004"/> </body> </body>""",
}


@pytest.fixture(scope="module")
def mujoco():
    return pytest.importorskip("mujoco", reason="no mujoco: pip install mujoco")


@pytest.fixture(scope="module")
def Pad(mujoco):
    return mujoco_adapter.Pad


SCENE = """
<mujoco>
  <compiler angle="degree"/>
  <asset> <mesh name="it" {tetrahedron}/> <mesh name="scaled" {tetrahedron} scale="1.4 -0.8 1.1"/>
    <hfield name="it" nrow="9" ncol="7" size="0.008 0.006 0.002 0.001"/> </asset>
  <worldbody>
    <body name="finger" pos="0.1 0.2 0.3" euler="20 50 -70">
      <geom type="box" size="0.01 0.01 0.002" pos="0.002 0 -0.004"/>
      <body pos="0.001 0 0" euler="0 0 30"> <site name="pad" pos="0.001 0.002 0.003" euler="10 -20 130"/> </body>
    </body>
    <body name="object"> <freejoint/> <inertial mass="0.1" pos="0.001 0 0" diaginertia="1e-5 1e-5 1e-5"/> {geoms} </body>
  </worldbody>
</mujoco>"""


class TestMujoco:
    @pytest.mark.parametrize("kind, seed", list(itertools.product(GEOMS, range(2))))
    def test_depth_is_that_of_rays_through_the_pad(self, mujoco, Pad, simulator, kind, seed):
        """Pad and object are turned at random, the object's lowest point in view is 0.8 mm deep; MuJoCo's rays know its geoms exactly."""
        random = numpy.random.default_rng(seed)
        model = mujoco.MjModel.from_xml_string(SCENE.format(tetrahedron=TETRAHEDRON, geoms=GEOMS[kind]))
        model.hfield_data[:] = random.random(len(model.hfield_data))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        site = model.site("pad").id
        turn, origin = data.site_xmat[site].reshape(3, 3), data.site_xpos[site].copy()
        wanted = Transform.of([1e-3, -2e-3, 0.02], xyzw=[*(0.1 * random.normal(size=3)), 1.0])

        def place(z_m):
            there = Transform.of_matrix(turn, origin) @ Transform(numpy.array([*wanted.position_m[:2], z_m]), wanted.rotation)
            data.qpos[:3], data.qpos[3:] = there.position_m, numpy.roll(there.xyzw, 1)
            mujoco.mj_forward(model, data)

        columns, rows = numpy.meshgrid(numpy.arange(4, 320, 9), numpy.arange(4, 240, 9))
        x, y = (columns + 0.5) / 320 * 18.6 - 9.3, (rows + 0.5) / 240 * 14.3 - 7.15

        def cast():
            hit, found = numpy.zeros(1, numpy.int32), numpy.full(x.shape, numpy.inf)
            for at in numpy.ndindex(x.shape):
                start = origin + turn @ (1e-3 * numpy.array([x[at], y[at], -50.0]))
                more = (None,) if tuple(map(int, mujoco.__version__.split(".")[:2])) >= (3, 4) else ()
                away = mujoco.mj_ray(model, data, start, turn[:, 2].copy(), None, 1, model.body("finger").id, hit, *more)
                found[at] = 1e3 * away - 50.0 if away >= 0.0 else numpy.inf
            return found

        place(0.02)
        place(0.02 - 1e-3 * (cast().min() + 0.8))
        expected = numpy.maximum(-cast(), 0.0)
        pad = Pad(simulator, model, "pad", ["object"])
        found = pad.sense(data).depth[rows, columns]
        assert expected.max() == pytest.approx(0.8, abs=1e-6) and (expected > 0).sum() > 3
        off = abs(found - expected)
        # Beside vertical walls a pixel's centre is on one side or on the other.
        assert (off > 3e-3).sum() <= 2 and numpy.median(off[expected > 0]) < 2e-3, numpy.sort(off.ravel())[-5:]

    def test_groups_choose_the_geoms(self, mujoco, Pad, simulator):
        text = '<geom type="sphere" size="0.004" group="2"/> <geom type="box" size="0.005 0.005 0.005" group="3"/>'
        model = mujoco.MjModel.from_xml_string(SCENE.format(tetrahedron=TETRAHEDRON, geoms=text))
        shape_of, body = mujoco_adapter.shape_of, model.body("object").id
        assert [round(shape_of(model, body, groups).vertices[:, 0].max(), 2) for groups in ([2], [3], None)] == [4.0, 5.0, 5.0]
        with pytest.raises(gelsim.UsageError, match="no geom"):
            shape_of(model, body, [5])

    def test_names_that_are_not_there_are_told_with_those_that_are(self, mujoco, Pad, simulator):
        model = mujoco.MjModel.from_xml_string(SCENE.format(tetrahedron=TETRAHEDRON, geoms=GEOMS["sphere"]))
        with pytest.raises(gelsim.UsageError, match="no site 'pda'; it has 'pad'"):
            Pad(simulator, model, "pda", ["object"])
        with pytest.raises(gelsim.UsageError, match="no body 'ball'; it has 'world', 'finger', .*'object'"):
            Pad(simulator, model, "pad", ["ball"])

    def test_mistakes_are_told(self, mujoco, Pad, simulator):
        model = mujoco.MjModel.from_xml_string(SCENE.format(tetrahedron=TETRAHEDRON, geoms=GEOMS["sphere"]))
        for arguments, more, said in [
            (("scene.xml", "pad", ["object"]), {}, "model is of type str; give a mujoco.MjModel"),
            ((model, "pad", "object"), {}, r"bodies is of type str; give a list of names, such as \['knob'\]"),
            ((model, "pad", [3]), {}, "the name of a body is of type int"),
            ((model, "pad", ["object"]), {"groups": 2}, r"groups is of type int; give a list of whole numbers, such as \[2\]"),
        ]:
            with pytest.raises(TypeError, match=said):
                Pad(simulator, *arguments, **more)
        pad, data = Pad(simulator, model, "pad", ["object"]), mujoco.MjData(model)
        with pytest.raises(TypeError, match="data is None; give a mujoco.MjData"):
            pad.sense(None)
        with pytest.raises(gelsim.UsageError, match="call mujoco.mj_forward"):
            pad.sense(data)
        data.qpos[2] = numpy.nan
        mujoco.mj_kinematics(model, data)
        for ask in (pad.sense, pad.push):
            with pytest.raises(gelsim.UsageError, match="the place of 'object' is not finite"):
                ask(data)

    @pytest.mark.parametrize("rate_hz, mass_kg", [(60, 0.1), (30, 0.1), (250, 0.02)])
    def test_a_pad_carries_a_ball_as_deep_as_its_weight_presses_it(self, mujoco, Pad, simulator, rate_hz, mass_kg):
        model = mujoco.MjModel.from_xml_string(f"""
        <mujoco> <option timestep="0.001"/> <worldbody> <site name="pad" pos="0 0 0.1" euler="0 0 40"/>
          <body name="ball" pos="0.002 0 0.1045"> <joint type="slide" axis="1 0 0"/> <joint type="slide" axis="0 1 0"/>
            <joint type="slide" axis="0 0 1"/> <geom type="sphere" size="0.004" mass="{mass_kg}" contype="0" conaffinity="0"/> </body>
        </worldbody> </mujoco>""")
        data = mujoco.MjData(model)
        pad = Pad(simulator, model, "pad", ["ball"])
        frames = 0
        while data.time < 0.6:
            mujoco.mj_step1(model, data)
            if data.time * rate_hz >= frames:
                press, frames = pad.sense(data), frames + 1
            data.xfrc_applied[:] = 0.0
            pad.push(data)
            mujoco.mj_step2(model, data)
        weight_n = 9.81 * mass_kg
        assert -press.wrench[2] == pytest.approx(weight_n, rel=0.01) and abs(press.wrench[:2]).max() < 0.01 * weight_n
        depths = numpy.linspace(0.9, 1.1, 5) * pad.touch.depth_mm
        x, y = 1e3 * (pad._where(data)[0].rotation.T @ [0.002, 0, 0])[:2]
        straight = [-simulator.press(shapes.sphere(4.0), gelsim.Pose(depth, x_mm=x, y_mm=y)).wrench[2] for depth in depths]
        assert numpy.interp(weight_n, straight, depths) == pytest.approx(pad.touch.depth_mm, rel=0.01)


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    return tmp_path_factory.mktemp("gripper") / "mujoco.png"


@pytest.fixture(scope="module")
def table(project, mujoco, picture):
    def table(*arguments):
        script = project / "docs/examples/mujoco_gripper.py"
        lines = run(sys.executable, script, "--fidelity", "draft", *arguments, cwd=picture.parent).stdout.splitlines()
        rows = [line.split() for line in lines if line.strip()[:1].isdigit()]
        return [(*map(float, row[:4]), row[4], *map(float, row[5:])) for row in rows]

    return table


@pytest.fixture(scope="module")
def rows(table):
    return table()


class TestGripper:
    """docs/examples/mujoco_gripper.py as it stands."""

    WEIGHT_N, FRICTION = 0.2 * 9.81, 0.5

    def test_friction_carries_the_weight_between_lift_and_slip(self, rows):
        held = [row for row in rows if 0.6 < row[0] < 0.95 or row[0] > 2.0]
        assert len(held) > 8 and all(row[4] in ("none", "incipient") for row in held)
        assert all(row[3] == pytest.approx(self.WEIGHT_N / 2, rel=0.05) for row in held)
        assert all(row[2] == pytest.approx(row[1], rel=0.01) for row in held)

    def test_it_slips_when_friction_no_longer_carries_it(self, rows):
        number = next(number for number, row in enumerate(rows) if row[4] == "gross" and row[0] > 1.1)
        least_n = self.WEIGHT_N / 2 / self.FRICTION
        assert rows[number][2] < 1.02 * least_n and rows[number - 2][2] > 0.98 * least_n

    def test_the_controller_holds_it_again(self, rows):
        slipped = [row[6] for row in rows]
        assert 1.0 < slipped[-1] < 7.0 and abs(slipped[-1] - slipped[-4]) < 0.01 and rows[-1][5] > rows[0][5] + 15.0

    def test_a_picture_shows_it(self, rows, picture):
        pytest.importorskip("matplotlib", reason="no matplotlib: pip install matplotlib")
        Image = pytest.importorskip("PIL.Image", reason="no pillow: pip install pillow")
        image = numpy.asarray(Image.open(picture).convert("RGB"))
        assert min(image.shape[:2]) > 800 and len(numpy.unique(image.reshape(-1, 3), axis=0)) > 1000

    @pytest.mark.full
    def test_a_second_run_is_the_same(self, table, rows):
        assert table() == rows

    @pytest.mark.parametrize(
        "arguments, time_s",
        [pytest.param(("--blind",), 1.9, marks=pytest.mark.full), (("--friction", "0.2"), 0.6)],
    )
    def test_without_grip_or_controller_it_is_lost(self, table, arguments, time_s):
        """It slides out of the pads, early or as they let go."""
        rows = table(*arguments)
        assert rows[-1][4] == "gross" and rows[-1][6] > 5.0 and rows[-1][0] == pytest.approx(time_s, abs=0.1)

    @pytest.mark.full
    def test_at_half_the_rate_it_is_held_as_well(self, table):
        held = [row for row in table("--rate", "30") if 0.6 < row[0] < 0.95]
        assert held and all(row[3] == pytest.approx(self.WEIGHT_N / 2, rel=0.05) for row in held)


@pytest.fixture(scope="module")
def gymnasium():
    return pytest.importorskip("gymnasium", reason="no gymnasium: pip install gymnasium")


@pytest.fixture(scope="module")
def adapter(gymnasium):
    return gymnasium_adapter


class TestGymnasium:
    def test_an_environment_of_touch_passes_gymnasiums_checks(self, gymnasium, adapter, simulator):
        from gymnasium.utils.env_checker import check_env

        class Push(gymnasium.Env):
            """A ball is pushed over the pad."""

            def __init__(self):
                self.observation_space = adapter.observation_space(simulator, adapter.PARTS)
                self.action_space = gymnasium.spaces.Box(-0.1, 0.1, (2,), numpy.float32)
                self.touch = Touch(simulator, {"ball": shapes.sphere(4.0)}, friction=0.5)

            def look(self):
                press = self.touch.step(HERE, {"ball": at(*self.place, 3.3)})
                return adapter.observation(press, self.observation_space)

            def reset(self, *, seed=None, options=None):
                super().reset(seed=seed)
                self.touch.reset()
                self.place = self.np_random.uniform(-1, 1, 2)
                return self.look(), {}

            def step(self, action):
                self.place = self.place + action
                seen = self.look()
                return seen, float(seen["slip"]), False, False, {}

        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", message=".*(render|spec|Box observation space maximum|minimum value).*")
            check_env(Push(), skip_render_check=True)

    def test_what_slips_is_observed(self, adapter, simulator):
        space = adapter.observation_space(simulator, adapter.PARTS)
        touch = Touch(simulator, {"ball": shapes.sphere(4.0)}, friction=0.5)
        seen = [adapter.observation(touch.step(HERE, {"ball": at(x, 0, 3.3)}), space) for x in (0.0, 0.1, 3.0)]
        assert [int(each["slip"]) for each in seen] == [0, 1, 2] and all(space.contains(each) for each in seen)
        assert seen[2]["wrench"][0] == pytest.approx(-0.5 * seen[2]["wrench"][2], rel=0.01) and seen[2]["markers"].max() > 1.0

    def test_depth_is_within_the_pad_that_set_made(self, adapter):
        thick = gelsim.Simulator("digit", "draft", resolution_px=(60, 80), set={"sensor.gelpad_thickness_mm": 6.0})
        assert adapter.observation_space(thick, ["depth"])["depth"].high.max() == 6.0

    def test_parts_that_are_not_there_are_told(self, adapter):
        with pytest.raises(gelsim.UsageError, match="no markers"):
            adapter.observation_space(gelsim.Simulator("gelsight-mini", "draft"), ["markers"])
        with pytest.raises(gelsim.UsageError, match="'smell'; allowed: 'image'"):
            adapter.observation_space(gelsim.Simulator("gelsight-mini", "draft"), ["smell"])

    def test_dots_that_move_into_view_are_not_observed(self, adapter):
        dense = gelsim.Simulator("digit", "draft", set={"markers.pitch_mm": 1.0})
        space = adapter.observation_space(dense, ["markers"])
        touch = Touch(dense, {"ball": shapes.sphere(4.0)}, friction=0.5)
        presses = [touch.step(HERE, {"ball": at(0.1 * step, 0, 3.0)}) for step in range(10)]
        assert all(space.contains(adapter.observation(press, space)) for press in presses)
        assert len(presses[-1].markers["rest_px"]) > space["markers"].shape[0]
