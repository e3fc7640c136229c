"""`gelsim.Sensor` against jobs and against `gelsim render`: the same arrays, labels and words."""

import copy
import json
import pickle
from types import SimpleNamespace

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")

import numpy as np
import samples
from module_checks import LAYERS, LEVELS, assert_refused, refusal, refusals, same, warned

pytestmark = pytest.mark.wheel

BALL_MM = 4.0
NOISY = ["camera.read_noise_levels=1.0", "camera.exposure=[0.9, 1.1]"]
SILENT = ["camera.read_noise_levels=0.0", "camera.speckle_levels=0.0"]

# A flat punch: where it does not reach, nothing is above the pad either.
PUNCH = """
dataset = { name = "punch", samples = 2, seed = 3 }
sensor = { preset = "digit", resolution_px = [120, 160] }
object = [{ path = "OBJECTS/cylinder.obj" }]
pose.x_mm = [-1.0, 1.0]
indentation.depth_mm = [0.2, 0.8]
camera = { read_noise_levels = 1.0, exposure = [0.9, 1.1], distortion_k1 = -0.05 }
output = { depth_format = "npy", layers = ["depth"] }
"""


@pytest.fixture(scope="module")
def punch(project, tmp_path_factory):
    """The job's file."""
    path = tmp_path_factory.mktemp("job") / "punch.toml"
    path.write_text(PUNCH.replace("OBJECTS", str(project / "objects")))
    return path


@pytest.fixture(scope="module")
def digit():
    return gelsim.Sensor.preset("digit")


@pytest.fixture(scope="module")
def noisy():
    """A sensor with the punch's camera but for its lens."""
    return gelsim.Sensor.preset("digit", set=NOISY)


@pytest.fixture(scope="module")
def geltip():
    return gelsim.Sensor.preset("geltip", set=["camera.read_noise_levels=0.0"])


@pytest.fixture(scope="module")
def ball():
    """Depth below the pad of a ball, -inf where it is not."""
    row, column = np.mgrid[:160, :120]
    across2 = ((row - 80) ** 2 + (column - 60) ** 2) * (16.0 / 120) ** 2
    with np.errstate(invalid="ignore"):
        return np.where(across2 < BALL_MM**2, 0.8 - BALL_MM + np.sqrt(BALL_MM**2 - across2), -np.inf)


@pytest.fixture(scope="module")
def alone(digit, ball):
    """What the sensor makes of the ball."""
    return digit.render(ball)


@pytest.fixture(scope="module")
def analytic(project, punch):
    """A ball of which all is known, also what is above the pad, which bulges up to it: a job's sample, and its map."""
    bare = ["camera={}", *SILENT, 'output.layers=["surface"]']
    job = gelsim.Job.load(punch, samples=1, set=[f'object=[{{ path = "{project}/objects/sphere.obj" }}]', *bare])
    label, pitch_mm = job[0]["label"], 16.0 / 120
    x, y = np.meshgrid((np.arange(120) + 0.5 - 60) * pitch_mm, (np.arange(160) + 0.5 - 80) * pitch_mm)
    x0, y0, _ = label["pose"]["translation_mm"]
    across2 = (x - x0) ** 2 + (y - y0) ** 2
    with np.errstate(invalid="ignore"):
        above = BALL_MM - np.sqrt(BALL_MM**2 - across2) - label["indentation_depth_mm"]
    return job[0], np.where(across2 < BALL_MM**2, -above, -np.inf)


@pytest.fixture(scope="module")
def silent():
    return gelsim.Sensor.preset("digit", set=SILENT)


def test_a_sensor_says_what_it_is(noisy):
    assert (noisy.name, noisy.resolution_px, noisy.gelpad_thickness_mm) == ("digit", (240, 320), 4.0)


def test_a_sensor_file_is_loaded(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('preset = "digit"\ngelpad_thickness_mm = 1.5\n')
    assert gelsim.Sensor.load(path).gelpad_thickness_mm == 1.5


@pytest.mark.parametrize("level", LEVELS)
def test_a_depth_map_of_a_job_gives_what_the_job_gives(punch, noisy, level):
    layers = ["depth", "surface", "contact", "normal"]
    flags = ["camera.distortion_k1=0.0", f"output.layers={json.dumps(layers)}"]
    job = gelsim.Job.load(punch, fidelity=level, set=flags)
    for index in range(len(job)):
        theirs = job[index]
        ours = noisy.render(theirs["depth"], fidelity=level, layers=layers, index=index, seed=3)
        # A depth map has nothing between its pixels, over which a job averages light at walls.
        walls = theirs["label"]["effects"]["supersampling"]["ran"]
        differ = (ours["tactile"] != theirs["tactile"]).mean()
        assert differ < 0.25 if walls else differ == 0, (index, differ)
        for name in layers:
            assert np.array_equal(ours[name], theirs[name]), (index, name)
        # Nor does it know what lies beyond it.
        for name in ["total_force_n", "in_view_fraction", "force_unknown"]:
            assert ours["label"]["contact"][name] is None or name == "force_unknown"
            ours["label"]["contact"][name] = theirs["label"]["contact"][name]
        for key in ["contact", "sensor", "camera", "fidelity"]:
            assert ours["label"][key] == theirs["label"][key], key


def test_an_analytic_ball_gives_nearly_what_a_job_gives(silent, analytic):
    theirs, depth = analytic
    worst = np.abs(silent.render(depth, layers=["surface"])["tactile"].astype(int) - theirs["tactile"]).max()
    assert worst <= 2


def test_the_order_of_an_array_does_not_matter(silent, analytic):
    depth = analytic[1].astype(np.float32)
    same(silent.render(depth), silent.render(np.asfortranarray(depth)))


def test_a_flat_map_touches_nothing(silent):
    flat = silent.render(np.zeros((160, 120), np.float32))
    assert not flat["label"]["contact"]["in_contact"] and list(flat) == ["tactile", "label"]


def test_a_place_deeper_than_the_pad_is_cut_off_with_a_warning(silent):
    deep = np.zeros((160, 120), np.float32)
    deep[80, 60] = 25.0
    pressed, said = warned(lambda: silent.render(deep))
    assert pressed["label"]["health"]["over_thickness_px"] == 1
    assert len(said) == 1 and "goes through the pad and is cut off at its thickness, 4 mm" in said[0], said


@pytest.fixture(scope="module")
def maps(analytic):
    """The ball at several heights."""
    return np.stack([analytic[1] - lift for lift in [0.0, 0.1, 5.0, 0.05, 0.15]])


def test_a_batch_is_its_maps_one_by_one_whatever_the_threads(noisy, maps):
    every = [layer for layer in LAYERS if layer != "markers"]
    batch = noisy.render(maps, layers=every, index=7)
    on_one_thread = gelsim.Sensor.preset("digit", set=NOISY, threads=1).render(maps, layers=every, index=7)
    for number in range(len(maps)):
        single = noisy.render(maps[number], layers=every, index=7 + number)
        for several in [batch, on_one_thread]:
            same({name: value[number] for name, value in several.items()}, single)


def test_the_image_may_be_named_among_the_layers(noisy, ball):
    same(noisy.render(ball, layers=["tactile", "depth"]), noisy.render(ball, layers=["depth"]))


def test_a_batch_has_markers_for_each_map(maps):
    dotted = gelsim.Sensor.preset("digit", set=["markers.pitch_mm=2.0"]).render(maps, layers=["markers"])
    counts = [label["markers"]["count"] for label in dotted["label"]]
    assert [len(dots["moved_px"]) for dots in dotted["markers"]] == counts


def test_dots_stand_where_a_file_or_a_grid_says(ball, tmp_path):
    path = tmp_path / "dots.csv"
    path.write_text("x_mm,y_mm\n-1,0.5\n3,-2\n")
    grid = {"rows": 2, "columns": 2, "missing": [[0, 0], [1, 1]], "offset_mm": [1.0, -0.75]}
    for keys in [{"file": str(path)}, {**grid, "pitch_mm": 4.0, "pitch_y_mm": 2.5, "jitter_mm": 0.0}]:
        sensor = gelsim.Sensor.preset("digit", set={f"markers.{key}": value for key, value in keys.items()})
        rest_px = sensor.render(ball, layers=["markers"])["markers"]["rest_px"]
        places_mm = (rest_px / ball.shape[::-1] - 0.5) * sensor.field_of_view_mm
        assert np.allclose(sorted(places_mm.tolist()), [[-1, 0.5], [3, -2]])


def test_a_map_with_an_axis_for_its_one_channel_is_taken(digit, ball, alone):
    """As `gelsim render` takes a picture."""
    same(digit.render(ball[..., None]), alone)
    batch, single = digit.render(np.stack([ball, ball])[..., None]), digit.render(np.stack([ball, ball]))
    assert batch["tactile"].shape == (2, 160, 120, 3) and np.array_equal(batch["tactile"], single["tactile"])


def test_a_map_that_is_right_is_not_warned_of(digit, ball):
    assert warned(lambda: digit.render(ball))[1] == []


def test_a_map_that_lies_on_its_side_is_warned_of_once(ball):
    digit = gelsim.Sensor.preset("digit")
    _, said = warned(lambda: digit.render(ball.T))
    assert len(said) == 1 and "out of proportion" in said[0], said
    assert "turn the frames by 90 degrees, as numpy.rot90 does" in said[0], said
    assert warned(lambda: digit.render(np.rot90(ball.T)))[1] == []
    assert warned(lambda: digit.render(ball.T))[1] == []


@pytest.mark.parametrize("factor, unit", [(1e-3, "metres"), (1e3, "micrometres")], ids=["metres", "micrometres"])
def test_another_unit_is_warned_of_and_the_advice_is_right(digit, ball, alone, factor, unit):
    _, said = warned(lambda: digit.render(ball * factor))
    assert len(said) == 1 and unit in said[0], said
    advised = said[0].rsplit("give ", 1)[1]
    right, said = warned(lambda: digit.render(eval(advised, {"depth_mm": ball * factor})))
    assert not said and np.array_equal(right["tactile"], alone["tactile"])


@pytest.mark.parametrize("background", ["inf", "13 mm", "nan", "nothing else"])
def test_a_cameras_distances_are_refused_with_how_to_turn_them_to_depths(digit, ball, alone, background):
    distance_mm = 10.0 - ball
    if background == "nothing else":
        distance_mm = np.full_like(ball, np.inf)
    elif background != "inf":
        distance_mm[~np.isfinite(ball)] = {"13 mm": 13.0, "nan": np.nan}[background]
    said = refusal(gelsim.UsageError, lambda: digit.render(distance_mm))
    # No remedy for depths is given for distances.
    assert "goes through the pad" in said and said.count("error: ") == 1 and "write -inf" not in said, said
    assert ("with inf in place of nan" in said) == (background == "nan"), said
    filled = np.where(np.isnan(distance_mm), np.inf, distance_mm)
    advised = said.split("camera: ", 1)[1].split(",")[0]
    pressed, said = warned(lambda: digit.render(eval(advised, {"plane_mm": 10.0, "distance_mm": filled})))
    assert not said
    if background in ["inf", "nan"]:
        assert np.array_equal(pressed["tactile"], alone["tactile"])


def test_depths_with_inf_for_nothing_are_answered_with_both_that_may_be_meant(digit, ball):
    said = refusal(gelsim.UsageError, lambda: digit.render(np.where(np.isfinite(ball), ball, np.inf)))
    assert "is infinite at" in said and "write -inf" in said and "plane_mm - distance_mm" in said, said


def from_inside(value=45.0):
    """Distances from inside a gel: something is in the middle, and nothing around it."""
    away = np.full((120, 160), np.inf)
    away[40:80, 60:100] = value
    return away


@pytest.mark.parametrize("preset", ["digit", "geltip"])
def test_a_masked_array_is_refused_and_filled_as_advised_it_is_right(digit, geltip, ball, preset):
    """Nothing is -inf for depths, and inf for distances."""
    sensor, depth = (digit, ball) if preset == "digit" else (geltip, from_inside())
    masked = np.ma.masked_array(depth, ~np.isfinite(depth))
    said = refusal(TypeError, lambda: sensor.render(masked))
    filled = eval(said.rsplit(": ", 1)[1], {"depth_mm": masked, "np": np})
    assert np.array_equal(sensor.render(filled)["tactile"], sensor.render(depth)["tactile"])


def test_the_largest_index_is_taken(digit, ball):
    digit.render(ball, index=18446744073709551615)


def test_files_of_the_same_maps_give_the_same(run_gelsim, tmp_path):
    flags = ["camera.read_noise_levels=1.0", 'output.depth_format="npy"']
    rows, columns = np.mgrid[:160, :120]
    ball = 0.6 - 0.004 * ((rows - 70) ** 2 + (columns - 50) ** 2) * np.float32(0.1)
    maps = np.stack([ball, ball - 0.4]).astype(np.float32)
    frames = tmp_path / "frames"
    frames.mkdir()
    for number, depth in enumerate(maps):
        np.save(frames / f"{number}.npy", -depth)
    known = ["--sensor", "digit", "--depth-unit", "mm", "--plane-mm", 0, "--layers", "surface,contact,normal"]
    assigned = (word for text in flags for word in ["--set", text])
    run_gelsim("render", *known, *assigned, "--depth", frames, "--out", tmp_path / "out", "--quiet")
    ours = gelsim.Sensor.preset("digit", set=flags).render(maps, layers=["surface", "contact", "normal"])
    for number in range(len(maps)):
        for name in ["tactile.png", "surface.npy", "contact.png", "normal.npy"]:
            written = samples.DECODERS[name.split(".")[1]]((tmp_path / f"out/{number}.{name}").read_bytes())
            written = written[..., 0] if name == "contact.png" else written
            assert np.array_equal(ours[name.split(".")[0]][number], written), (number, name)
        label = json.loads((tmp_path / f"out/{number}.json").read_text())
        # An array has no path, class or hash of its own.
        named = {key: label["object"][key] for key in ["id", "class", "path", "mesh_sha256"]}
        known = {**ours["label"][number], "object": label["object"]}
        known["objects"] = [{**one, **named} for one in known["objects"]]
        assert known == label


def seen_from_inside(rows, columns, focal, along):
    """A ball of 4 mm, 0.8 mm deep in the tip of a gel that has a shape, from 45.5 mm away."""
    x, y = np.meshgrid((np.arange(columns) + 0.5 - columns / 2) / focal, (np.arange(rows) + 0.5 - rows / 2) / focal)
    to, away = 48.7, 1 + x**2 + y**2
    with np.errstate(invalid="ignore"):
        z = (to - np.sqrt(to**2 - away * (to**2 - 16))) / away
    return np.where(np.isnan(z), np.inf, z * np.sqrt(away) if along == "ray" else z)


@pytest.fixture(scope="module")
def inside():
    """By rays of the lens."""
    return seen_from_inside(120, 160, 80, "axis")


@pytest.mark.parametrize(
    "frame, options, flags",
    [
        pytest.param((120, 160, 80, "axis"), {}, [], id="along the axis"),
        pytest.param((120, 160, 80, "ray"), {"along": "ray"}, ["--depth-along", "ray"], id="along rays"),
        pytest.param(
            (480, 640, 320, "axis"),
            {"fov_y_deg": 73.7398},
            ["--projection", "perspective", "--fov-y-deg", 73.7398],
            id="by a finer pinhole",
        ),
    ],
)
def test_files_of_a_frame_from_inside_give_the_same(run_gelsim, tmp_path, geltip, frame, options, flags):
    frame = seen_from_inside(*frame)
    np.save(tmp_path / "frame.npy", frame)
    flags = [*flags, "--set", "camera.read_noise_levels=0.0"]
    known = ["--sensor", "geltip", "--depth-unit", "mm", "--layers", "surface,contact,normal", "--quiet"]
    run_gelsim("render", *known, *flags, "--depth", tmp_path / "frame.npy", "--out", tmp_path / "out")
    ours = geltip.render(frame, layers=["surface", "contact", "normal"], **options)
    theirs = json.loads((tmp_path / "out/frame.json").read_text())
    assert theirs["contact"]["in_contact"] and theirs["health"]["unseen_px"] == 0
    assert np.array_equal(ours["tactile"], samples.DECODERS["png"]((tmp_path / "out/frame.tactile.png").read_bytes()))
    for key in ["contact", "sensor", "health", "indentation_depth_mm", "numerics"]:
        assert ours["label"][key] == theirs[key], key


def test_a_batch_from_inside_is_its_frames_one_by_one(geltip, inside):
    batch = geltip.render(np.stack([inside, np.full_like(inside, np.inf)]))
    assert np.array_equal(batch["tactile"][0], geltip.render(inside)["tactile"])
    assert [label["contact"]["in_contact"] for label in batch["label"]] == [True, False]


AMBER = gelsim.Led(azimuth_deg=45.0, color=(1.0, 0.6, 0.0), intensity=3.0)


@pytest.fixture(scope="module")
def lit(digit):
    return digit.with_leds([*digit.leds, AMBER])


@pytest.fixture
def pressed():
    depth = np.zeros((80, 60), np.float32)
    depth[30:50, 20:40] = 0.5
    return depth


def test_an_led_more_is_seen_in_the_image(digit, lit, pressed):
    assert (len(digit.leds), len(lit.leds), lit.leds[:3]) == (3, 4, digit.leds)
    before, after = (each.render(pressed)["tactile"].astype(int) for each in (digit, lit))
    assert (after - before)[..., 0].max() > 20


def test_the_same_leds_give_the_same_image(digit, lit, pressed):
    same(digit.with_leds(digit.leds).render(pressed), digit.render(pressed))
    by_hand = gelsim.Sensor.preset("digit", set={"sensor.led": gelsim.scene.led_tables(lit.leds)})
    same(by_hand.render(pressed), lit.render(pressed))


def test_leds_of_a_dict_are_the_sensors(project):
    led = {"azimuth_deg": 10, "color": [1.0, 0.5, 0.0], "name": 'a "quoted" \\ name\n'}
    sensor = gelsim.Sensor.preset("digit", set={"sensor.led": [led], "camera.exposure": 1.2})
    assert sensor.leds == [gelsim.Led(10.0, (1.0, 0.5, 0.0), name=led["name"])]
    assert gelsim.Sensor.load(project / "configs/sensors/digit.toml", set={"sensor.led": [led]}).leds == sensor.leds
    assert pickle.loads(pickle.dumps(sensor)).leds == sensor.leds


def test_the_defaults_of_an_led_are_the_sensor_files():
    assert gelsim.Sensor.preset("digit", set=["sensor.led=[{}]"]).leds == [gelsim.Led(0.0)]


def test_leds_of_a_sensor_without_any_are_warned_of():
    _, said = warned(lambda: gelsim.Sensor.preset("gelsight-series2").with_leds([AMBER]))
    assert any("LEDs are no part" in each for each in said), said


def test_all_mistakes_of_an_led_are_told_and_nothing_else():
    said = refusal(gelsim.UsageError, lambda: gelsim.Led(0.0, color=(2.0, -1.0, 0.5), elevation_deg=100.0))
    assert all(word in said for word in ["color[0]", "color[1]", "elevation_deg"]) and "color[2]" not in said, said


def test_frames_from_inside_that_are_too_large_are_told_so_and_nothing_else(geltip):
    said = refusal(gelsim.UsageError, lambda: geltip.render(np.full((2100, 2100), 45.0)))
    assert "2100x2100 px" in said and "smaller frames" in said and "along" not in said, said


def two_maps(*values, dtype=np.float32):
    """Two maps of which each touches; with values at places."""
    maps = np.zeros((2, 160, 120), dtype)
    maps[:, 80, 60] = 0.5
    for place, value in values:
        maps[place] = value
    return maps


def not_aligned(maps):
    return np.zeros(maps.nbytes + 1, np.uint8)[1:].view(np.float32).reshape(maps.shape)


@pytest.fixture
def it(digit, geltip, ball, inside):
    return SimpleNamespace(digit=digit, geltip=geltip, ball=ball, inside=inside, absent="absent.toml")


def preset(name):
    return lambda it: gelsim.Sensor.preset(name)


def maps_of(given):
    return lambda it: it.digit.render(given)


def layer(name, **more):
    return lambda it: it.digit.render(it.ball, layers=[name], **more)


def distance(value, after=0):
    """A frame from inside with a value that cannot be, after so many that are right."""

    def render(it):
        frames = np.stack([it.inside] * (after + 1))
        frames[after, 3, 4] = value
        return it.geltip.render(frames if after else frames[0])

    return render


def frame(factor=1, **more):
    return lambda it: it.geltip.render(it.inside * factor, **more)


def parallel(it):
    sensor = gelsim.Sensor.preset("geltip", set=['sensor.lens="orthographic"'])
    return sensor.render(from_inside(), fov_y_deg=60.0)


NUMBERS = [((1, 3, 4), np.nan), ((1, 3, 5), np.nan), ((0, 9, 0), np.inf)]
TOO_MANY = ["2 values that are not a number, the first in map 1, row 3, column 4"]
TOO_MANY += ["infinite at 1 places, the first in map 0, row 9, column 0", "-inf"]
THROUGH = "all of map 1 of depth_mm goes through the pad, which is 4 mm thick"
BEHIND = "behind the camera in row 3"


@refusals({
    "a preset in capitals": (preset("DIGIT"), gelsim.UsageError, "did you mean `digit`?"),
    "a preset's maker": (preset("gelsight"), gelsim.UsageError, "did you mean `gelsight-mini`?"),
    "a preset's end": (preset("mini"), gelsim.UsageError, "did you mean `gelsight-mini`?"),
    "a preset's product": (preset("GelSight Mini"), gelsim.UsageError, "did you mean `gelsight-mini`?"),
    "a preset's other name": (preset("wedge"), gelsim.UsageError, "did you mean `gelsight-2017`?"),
    "a mistyped preset": (preset("digti"), gelsim.UsageError, "did you mean `digit`?"),
    "a file as preset": (preset("my.toml"), gelsim.UsageError, 'gelsim.Sensor.load("my.toml")'),
    "a preset as file": (lambda it: gelsim.Sensor.load("digit"), gelsim.UsageError, 'gelsim.Sensor.preset("digit")'),
    "an absent file": (lambda it: gelsim.Sensor.load(it.absent), gelsim.UsageError, "absent.toml"),
    "another word for a layer": (layer("heightmap"), gelsim.UsageError, "did you mean `surface`?"),
    "a mistyped layer": (layer("detph"), gelsim.UsageError, "did you mean `depth`?"),
    "the image as layer": (layer("rgb"), gelsim.UsageError, "the tactile image is always written"),
    "a layer of other levels": (layer("pressure", fidelity="paper"), gelsim.UsageError, "pressure"),
    "a layer of other sensors": (layer("markers"), gelsim.UsageError, "markers"),
    "a negative index": (lambda it: it.digit.render(it.ball, index=-1), gelsim.UsageError, f"0 to {2**64 - 1}"),
    "all wrong values at once": (maps_of(two_maps(*NUMBERS)), gelsim.UsageError, TOO_MANY),
    "a map through the pad": (maps_of(two_maps((1, 25.0))), gelsim.UsageError, THROUGH),
    "axes": (maps_of(two_maps()[None]), gelsim.UsageError, "4 axes"),
    "axes of one map": (maps_of(two_maps()[:1][None]), gelsim.UsageError, "4 axes"),
    "no map": (maps_of(two_maps()[:0]), gelsim.UsageError, "empty"),
    "columns": (maps_of(np.zeros((1, 9000), np.float32)), gelsim.UsageError, "9000 columns"),
    "whole numbers": (maps_of(two_maps(dtype=np.uint16)), TypeError, "float32"),
    "byte order": (maps_of(two_maps(dtype=">f4")), TypeError, "float32"),
    "alignment": (maps_of(not_aligned(two_maps())), gelsim.UsageError, "not aligned"),
    "a list": (maps_of(two_maps().tolist()), TypeError, "np.asarray"),
    "parallel rays with an angle": (parallel, gelsim.UsageError, ["parallel rays", "leave fov_y_deg out"]),
    "a distance of nan": (distance(np.nan), gelsim.UsageError, "NaN in row 3, column 4"),
    "a distance of 0": (distance(0), gelsim.UsageError, "0 in row 3, column 4"),
    "a negative distance": (distance(-1), gelsim.UsageError, BEHIND),
    "such distances in the second frame": (distance(-1, after=1), gelsim.UsageError, ["map 1: ", BEHIND]),
    "distances in metres": (frame(1e-3), gelsim.UsageError, "behind the gel"),
    "an angle of 0": (frame(fov_y_deg=0), gelsim.UsageError, "out of range"),
    "an angle in words": (frame(fov_y_deg="wide"), TypeError, ""),
    "a mistyped direction": (frame(along="rays"), gelsim.UsageError, "did you mean `ray`?"),
    "a direction": (lambda it: it.digit.render(it.ball, along="axis"), gelsim.UsageError, "this sensor is flat"),
    "no LED": (lambda it: it.digit.with_leds([]), gelsim.UsageError, "no LED"),
    "65 LEDs": (lambda it: it.digit.with_leds([AMBER] * 65), gelsim.UsageError, "65 LEDs"),
    "an LED as dict": (lambda it: it.digit.with_leds([{"azimuth_deg": 1}]), TypeError, "gelsim.Led"),
})  # fmt: skip
def test_is_refused_with_a_way_out(it, tmp_path, monkeypatch, call, kind, words):
    monkeypatch.chdir(tmp_path)
    assert_refused(lambda: call(it), kind, words)


def test_a_sensor_is_what_set_makes_of_it():
    sensor = gelsim.Sensor.preset(
        "gelsight-mini",
        set={"sensor.field_of_view_mm": [9.0, 6.75], "sensor.gelpad_thickness_mm": 2.0, "sensor.resolution_px": [80, 60]},
    )
    assert (sensor.field_of_view_mm, sensor.gelpad_thickness_mm) == ((9.0, 6.75), 2.0)
    assert sensor.resolution_px == (80, 60) and "80x60" in repr(sensor)
    label = sensor.render(np.zeros((60, 80), np.float32))["label"]
    assert label["sensor"]["gelpad_thickness_mm"] == 2.0
    assert gelsim.Sensor.preset("digit", set={"sensor.preset": "gelsight-mini"}).name == "gelsight-mini"


def test_a_sensor_is_its_own_copy_and_does_not_become_another_with_its_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('preset = "digit"\n')
    sensor = gelsim.Sensor.load(path)
    assert copy.copy(sensor) is sensor and copy.deepcopy(sensor) is sensor
    path.write_text('preset = "digit"\ngelpad_thickness_mm = 1.5\n')
    said = refusal(gelsim.UsageError, lambda: sensor.render(np.zeros((30, 40), np.float32)))
    assert "mine.toml has changed since this sensor was made of it" in said, said
    assert gelsim.Sensor.load(path).gelpad_thickness_mm == 1.5
