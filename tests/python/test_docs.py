"""The docs hold: every shell command of README.md and the book runs as it stands, links lead somewhere, tables that a command makes
are what it prints.

A command is a block fenced as `sh`, or an indented line that begins with a program. The commands of a page run in their order, in a
copy of the repository with the files that the pages speak of. What cannot run here is listed below with the reason and the test that runs it
instead; a command that is neither fails the test. Of commands with placeholders, and of those named within a sentence, the options are
looked up in the program's help; of `cargo test` and `cargo bench` the targets in their Cargo.toml, and the module of the tests.

A block fenced as `console` is a command (`$ gelsim list layers`) and what it prints; UPDATE=1 writes anew what it prints.
"""

import csv
import functools
import io
import json
import math
import os
import pathlib
import re
import subprocess
import tarfile
import tomllib

import pytest

PROJECT = pathlib.Path(__file__).resolve().parents[2]
DOCS = PROJECT / "docs"
PAGES = [*sorted(PROJECT.glob("*.md")), *sorted(DOCS.rglob("*.md"))]
NAMES = [str(page.relative_to(PROJECT)) for page in PAGES]
CARGO = {
    "test": tomllib.loads((PROJECT / "Cargo.toml").read_text())["test"],
    "bench": [
        bench
        for manifest in ("Cargo.toml", "tests/bench/Cargo.toml")
        for bench in tomllib.loads((PROJECT / manifest).read_text())["bench"]
    ],
}
PROGRAMS = "gelsim|gelsim-export|taskset|cargo|pip|python3?|pytest|bash|sh|sbatch|kubectl|npm|docker|make"
INDENTED = re.compile(rf"^    ((?:[A-Z_]+=\S+ )*(?:{PROGRAMS}) .*)$")
FENCED = re.compile(r"(?ms)^```.*?^```$")
CONSOLE = re.compile(r"(?m)^```console\n\$ (.*)\n((?:(?!```).*\n)*)```$")

# Options of the documentation that make a run shorter.
SMALL = "--set 'sensor.resolution_px=[160, 120]'"
CALIBRATION = "gelsim calibrate presses.csv --background untouched.png --out my-sensor.toml"
SHORTER = {
    "gelsim generate job.toml": "--samples 4",
    "gelsim generate job.toml --out presses": "--samples 4",
    "gelsim generate job.toml --all-effects": "--samples 4",
    "gelsim generate job.toml --set 'sensor.resolution_px=[320, 240]' --set 'object.0.path=\"other.stl\"'": "--samples 4",
    "gelsim augment configs/augment.toml": "--set mixing.synthetic_per_real=0.1",
    "gelsim generate job.toml --out out --partition 0/2": f"--samples 200 {SMALL}",
    "gelsim generate job.toml --out out --partition 1/2": f"--samples 200 {SMALL}",
    "gelsim preview job.toml --effects --out effects.png": SMALL,
    "gelsim tradeoff job.toml": f"--samples 2 {SMALL}",
    "gelsim tradeoff configs/quickstart.toml": f"--samples 2 {SMALL}",
    "gelsim tradeoff configs/slip.toml --samples 6": f"--set sequence.frame_rate_hz=5 {SMALL}",
    CALIBRATION: "--thickness-mm 3.0 --contact-over-disc 1.0 --steps 100",
}

# What does not run here: why, and what runs it.
ELSEWHERE = {
    "cargo +nightly fuzz run --fuzz-dir tests/fuzz --sanitizer none TARGET": ("a nightly compiler", ".ci/run"),
    "pip install taxim==1.4.1 jax": ("400 MB", ".ci/run"),
    "python tests/transfer/tactip.py GELSIM --real FOLDER": ("pictures that are not part of this project", "docs/evidence/transfer.md"),
    "python tests/transfer/shear.py GELSIM --real FOLDER": ("pictures that are not part of this project", "docs/evidence/transfer.md"),
    "python tests/transfer/pretrain.py GELSIM --real FOLDER": ("real presses; what it printed", "docs/evidence/transfer.md"),
    "GELSIM_REAL_DATA=FOLDER python -m pytest -s tests/python/test_real_forces.py": (
        "pictures that are not part of this project",
        "docs/evidence/forces.md",
    ),
    "python tests/transfer/light.py FOLDER": ("pixels that a test traces for minutes", ".ci/run"),
    "python tests/bench/others.py GELSIM": ("numpy, OpenCV and 400 MB", "tests/bench/figures.py"),
    "pip install '.[numpy]'": ("a compiler; there without numpy", "tests/python/test_install.py"),
    "pip install '.[load]'": ("a compiler; there without extras", "tests/python/test_install.py"),
    "pip install '.[pybullet]'": ("a compiler; there without extras", "tests/python/test_install.py"),
    "pip install '.[export]'": ("a compiler; there without extras", "tests/python/test_install.py"),
    "pip install '.[mujoco]'": ("a compiler; there what it needs is there", "tests/python/test_adapters.py"),
    "pip install '.[gymnasium]'": ("a compiler; there what it needs is there", "tests/python/test_adapters.py"),
    "pip install matplotlib": ("PyPI", ".ci/run"),
    "python docs/examples/mujoco_gripper.py": ("MuJoCo", "tests/python/test_adapters.py"),
    "OMP_NUM_THREADS=1 RAYON_NUM_THREADS=1 taskset -c 0 python tests/bench/live.py": ("MuJoCo; what it printed", "docs/how-to/live.md"),
    "gelsim-export out/quickstart --to lerobot --out quickstart.lerobot": ("the wheel", "tests/python/test_formats.py"),
    "gelsim-export out/quickstart --to lerobot --out quickstart.lerobot --check": ("the wheel", "tests/python/test_formats.py"),
    "gelsim-export out/quickstart --to fota --out quickstart.fota": ("the wheel", "tests/python/test_formats.py"),
    "gelsim-export out/pretrain-sitr --to sitr --out sitr": (
        "the wheel",
        "tests/python/test_layouts.py",
    ),
    "gelsim preview job.toml --watch": ("does not end by itself", "tests/python/test_watch.py"),
    "gelsim preview job.toml --watch --count 4 --fidelity draft": ("does not end by itself", "tests/python/test_watch.py"),
    "bash gelsim.sbatch": ("Slurm", "tests/python/test_slurm.py"),
    "sbatch --array=0-99 gelsim.sbatch": ("Slurm; there with another range", "tests/python/test_slurm.py"),
    "python ray_driver.py job.toml out --parts 64 --threads 4": ("Ray; there in 8 parts", "tests/python/test_ray.py"),
    "kubectl apply -f indexed-job.yaml": ("a cluster; there each pod's command", "tests/python/test_recipes.py"),
    "kubectl wait --for=condition=complete --timeout=24h job/gelsim": ("a cluster", "tests/python/test_recipes.py"),
    "kubectl apply -f finalize-job.yaml": ("a cluster; there the pod's command", "tests/python/test_recipes.py"),
    "for host in node0 node1 node2; do": ("three machines; there with a false ssh", "tests/python/test_recipes.py"),
    "gelsim render --depth run.mcap --plane-mm 25 --sensor gelsight-2014 --out tactile": ("rosbags", "tests/python/test_logs.py"),
    "gelsim render --depth run.mcap --plane-mm 10 --sensor gelsight-2014 --pose-topic /object --sequence 0.3 --out slid": (
        "rosbags",
        "tests/python/test_logs.py",
    ),
    "gelsim render --depth run.mcap --plane-mm 25 --sensor gelsight-2014 --out tactile.mcap": ("rosbags", "tests/python/test_logs.py"),
    "gelsim render --depth frames --depth-unit m --plane-mm 10 --sensor gelsight-2014 --out tactile": (
        "MuJoCo's frames",
        "tests/python/test_simulators.py",
    ),
    "gelsim render --depth slide --depth-unit m --plane-mm 10 --sensor gelsight-2014 --poses slide.csv --sequence 0.3"
    " --layers slip,flow --set markers.pitch_mm=1.5 --out slid": ("MuJoCo's frames", "tests/python/test_simulators.py"),
    "gelsim render --depth rays --depth-unit mm --plane-mm 10 --max-depth-mm 19 --sensor gelsight-2014 --out from-rays": (
        "PyBullet's frames",
        "tests/python/test_simulators.py",
    ),
    "gelsim render --depth seen --depth-unit m --plane-mm 25 --projection perspective --fov-y-deg 40 --sensor gelsight-2014"
    " --out from-perspective": ("MuJoCo's frames", "tests/python/test_simulators.py"),
    "gelsim render --depth inside --depth-unit m --max-depth-mm 99 --projection perspective --fov-y-deg 73.7398 --sensor geltip"
    " --out from-inside": ("MuJoCo's frames", "tests/python/test_simulators.py"),
    "gelsim render --stream --labels --layers surface --depth-unit m --plane-mm 10 --sensor gelsight-2014 <frames.npy"
    " | ./read_answers": ("a C compiler", "tests/python/test_streams.py"),
    "gelsim calibrate --gelsight devices/series2_2EF6_4JNW.yaml --out my-sensor.toml": (
        "GelSight's files; there with made-up ones",
        "tests/cli/gelsight.rs",
    ),
    "gelsim calibrate calib_data --mm-per-px 0.0634 --out my-sensor.toml": (
        "a folder of gs_sdk; there with a drawn one",
        "tests/cli/calibration_folders.rs",
    ),
    "python tests/transfer/run.py GELSIM --real FOLDER": ("real presses; what it printed", "docs/evidence/transfer.md"),
    "python tests/transfer/run.py GELSIM --real FOLDER --set gsmini_gssdk digit_fots gelsight_thu": (
        "real presses; what it printed",
        "docs/evidence/transfer.md",
    ),
    "python docs/first-hour/train.py out/objects": ("PyTorch", ".ci/run"),
    "python tests/bench/accuracy.py target/release/gelsim": ("minutes", "tests/bench/figures.py"),
    "python tests/bench/sensor_sets.py target/release/gelsim": ("a minute", "tests/bench/figures.py"),
    "python tests/bench/recipes.py target/release/gelsim": ("minutes; what it printed", "docs/how-to/sensor-sets.md"),
    "python tests/bench/many_meshes.py target/release/gelsim": ("26 GB of meshes; what it printed", "docs/reference/objects.md"),
    "gelsim init --objects ycb job.toml": ("the meshes of YCB; there stand-ins", "tests/cli/object_sets.rs"),
    "python tests/bench/figures.py target/release/gelsim": ("minutes", ".ci/run"),
    "bash python/wheels.sh": ("minutes", ".ci/run"),
    "python3 python/notices.py x86_64-unknown-linux-gnu": ("the sources of all crates; there it is run", "python/wheels.sh"),
    "cargo fmt --all": ("changes the source; there it checks", ".ci/run"),
    "cargo clippy --release --workspace --all-targets --locked -- -D warnings": ("minutes", ".ci/run"),
    "cargo publish --dry-run --locked --workspace": ("minutes", ".ci/run"),
    "cargo run --release --example press": ("there from another folder", "tests/python/test_library.py"),
    "python3 -m venv env && . env/bin/activate": ("the environment that is there already", ".ci/run"),
    'pip install dist/gelsim-*"$(uname -m)".whl': ("the wheel; there from another folder", ".ci/run"),
    "cargo install --path . --features stores": ("minutes; there it is built", ".ci/run"),
    "gelsim generate job.toml --out s3://bucket/presses": ("an S3 server", "tests/python/test_stores.py"),
    "gelsim generate job.toml --out s3://bucket/presses --partition 0/2": ("an S3 server", "tests/python/test_stores.py"),
    "gelsim generate job.toml --out s3://bucket/presses --partition 1/2": ("an S3 server", "tests/python/test_stores.py"),
    "gelsim finalize s3://bucket/presses": ("an S3 server", "tests/python/test_stores.py"),
    "python -m gelsim.ros --sensor gelsight-mini --plane-mm 10 depth:=/camera/depth": ("ROS", "tests/python/test_ros_graph.py"),
    "python -m gelsim.ros --mesh objects/sphere.obj --resolution 320x240 --frame-id pad pose:=/ball/pose_in_pad": (
        "ROS",
        "tests/python/test_ros_graph.py",
    ),
    "python -m gelsim.ros --projection perspective --plane-mm 25 --resolution 320x240 depth:=/camera/depth/image_raw"
    " camera_info:=/camera/depth/camera_info": ("ROS", "tests/python/test_ros_graph.py"),
    "seq 0 63 | parallel": ("two machines; there with a false ssh", "tests/python/test_recipes.py"),
}


def shell_commands(text):
    """The commands of a page, in their order."""
    found, fence = [], None
    for line in text.splitlines():
        if line.startswith("```"):
            if fence is None:
                fence, block = line[3:].strip(), []
                continue
            if fence in ("sh", "bash"):
                found.append("\n".join(block))
            fence = None
        elif fence is not None:
            block.append(line)
        elif match := INDENTED.match(line):
            found.append(re.sub(r"\s+#.*$", "", match[1]).strip())
    return found


def run_elsewhere(command):
    """The key of ELSEWHERE that stands for a command, if one does: itself, or a part of a block."""
    return next((key for key in ELSEWHERE if command == key or "\n" in command and key in command), None)


@functools.cache
def options_of(name):
    """The options that a subcommand's help names; None if there is no such subcommand."""
    done = subprocess.run(["gelsim", *name.split(), "--help"], capture_output=True, text=True)
    found = re.findall(r"--[a-z][a-z-]*", done.stdout)
    return {*found, "--help", "--version"} if done.returncode == 0 else None


def unknown_options(command):
    """What is wrong with a command's subcommand or options, in words; nothing if they exist."""
    words = command.split()
    name = words[1] if len(words) > 1 and re.fullmatch("[a-z]+", words[1]) else ""
    known = options_of(name)
    if known is None:
        return f"`{command}`: no such subcommand"
    unknown = set(re.findall(r"--[a-z][a-z-]*", command)) - known
    return f"`{command}`: no option {', '.join(sorted(unknown))}" if unknown else None


def cargo_target(command):
    """The match of a `cargo test` or `cargo bench` that names a target; that, and the module that follows it, must exist."""
    if unit := re.search(r"\bcargo test .*--lib ([a-z_]+)", command):
        sources = (path.read_text() for path in (PROJECT / "src").rglob("*.rs"))
        assert any(re.search(rf"\b(mod|fn) \w*{unit[1]}", source) for source in sources), f"`{command}`: no such test"
        return unit
    match = re.search(r"\bcargo (test|bench) .*--(test|bench) ([a-z_]+)(?: ([a-z_:]+))?", command)
    if match:
        assert match[3] in [target["name"] for target in CARGO[match[2]]], f"`{command}`: no such target"
    if match and match[2] == "test" and match[4]:
        folder, *file = match[4].split("::")
        places = [f"{folder}/{'/'.join(file) or 'mod'}.rs", f"{match[3]}/{folder}.rs"]
        exists = any((PROJECT / "tests" / place).is_file() for place in places)
        listed = f"mod {folder};" in (PROJECT / f"tests/{match[3]}/main.rs").read_text()
        assert exists and listed, f"`{command}`: no such module of the tests"
    return match


def failure_of(command, folder):
    """Runs a command, or checks what of it can be checked: what is wrong, in words; nothing if it is right."""
    line = re.sub(r"^cargo run --release --(?= )", "gelsim", command)
    if line.startswith("gelsim ") and re.search(r"\[-|\.\.\.| [A-Z]{3,}\b|\b[A-Z]+\.toml", line):
        return unknown_options(line)
    if test := re.match(r"(?:[A-Z]+=\S+ )?pytest (\S+)", line):
        return None if (PROJECT / test[1]).exists() else f"`{command}`: no such file"
    if cargo_target(line):
        return None
    if not line.startswith("gelsim "):
        return f"`{command}` neither runs here nor is listed as run elsewhere"
    done = subprocess.run(["bash", "-ec", f"{line} {SHORTER.get(line, '')}".strip()], cwd=folder, capture_output=True, text=True)
    return f"`{command}` ended with {done.returncode}\n{done.stdout}{done.stderr}" if done.returncode else None


@pytest.fixture(scope="module")
def copy(tmp_path_factory, gelsim_path):
    """A copy of every file that is or will be tracked, with what the pages speak of: a job as in the README, its meshes, presses of a
    ball, an untouched pad, and a sensor that was calibrated with them."""
    folder = tmp_path_factory.mktemp("repository")
    listed = subprocess.run(["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=PROJECT, capture_output=True)
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (PROJECT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes((PROJECT / name).read_bytes())
    readme = (folder / "README.md").read_text()
    (folder / "job.toml").write_text(re.search(r"```toml\n(.*?)```", readme, re.S)[1])
    (folder / "meshes").mkdir()
    for name, mesh in [("my-part.stl", "gear"), ("other.stl", "coin"), ("meshes/gear.stl", "gear"), ("meshes/coin.stl", "coin")]:
        (folder / name).write_text(stl((folder / f"objects/{mesh}.obj").read_text()))
    presses(folder)
    # What one page makes, and another one goes on with.
    subprocess.run(f"{CALIBRATION} {SHORTER[CALIBRATION]}".split(), cwd=folder, capture_output=True, check=True)
    return folder


def stl(obj):
    """A mesh as ASCII STL."""
    lines = [line.split() for line in obj.splitlines()]
    vertices = [" ".join(words[1:4]) for words in lines if words[:1] == ["v"]]
    facets = []
    for first, *rest in [[int(word.split("/")[0]) - 1 for word in words[1:]] for words in lines if words[:1] == ["f"]]:
        for second, third in zip(rest, rest[1:]):
            corners = "".join(f"vertex {vertices[index]}\n" for index in (first, second, third))
            facets.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    return f"solid mesh\n{''.join(facets)}endsolid mesh\n"


def presses(folder):
    """Two tables of presses of the bundled ball (radius 4 mm), measured in their labels, and the untouched pad."""
    job = """
        dataset = { name = "presses", samples = 12, seed = 3 }
        sensor.resolution_px = [160, 120]
        object = [{ path = "objects/sphere.obj" }]
        pose = { x_mm = [-6.0, 6.0], y_mm = [-4.0, 4.0] }
        indentation.depth_mm = [0.3, 1.0]
        output.layers = ["reference"]
    """
    (folder / "presses.toml").write_text(re.sub(r"(?m)^\s+", "", job))
    subprocess.run(["gelsim", "generate", "presses.toml", "--quiet"], cwd=folder, check=True)
    tables = {"presses.csv": ("press", []), "others/annotations.csv": ("others", [])}
    forces = {table: [] for table in tables}
    with tarfile.open(folder / "out/presses/data/train-000000.tar") as tar:
        members = {name: tar.extractfile(name).read() for name in tar.getnames()}
    for index in range(12):
        key = f"{index:09}"
        label = json.loads(members[f"{key}.json"])
        (pitch, _), contact = label["sensor"]["mm_per_px"], label["contact"]
        x, y = contact["centroid_mm"]
        circle = x / pitch + 79.5, y / pitch + 59.5, math.sqrt(contact["area_mm2"] / math.pi) / pitch
        table = "presses.csv" if index < 8 else "others/annotations.csv"
        pictures, rows = tables[table]
        name = f"{pictures}/{index:02}.png"
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(members[f"{key}.tactile.png"])
        rows.append([os.path.relpath(name, pathlib.Path(table).parent), *circle, 4.0, pitch])
        depth = label["indentation_depth_mm"]
        forces[table].append([name, 4.0, depth, contact["total_force_n"]])
    (folder / "untouched.png").write_bytes(members["000000000.reference.png"])
    names = ["file", "centre_x_px", "centre_y_px", "radius_px", "ball_radius_mm", "mm_per_px"]
    with_forces = {"forces.csv": forces["presses.csv"], "other-forces.csv": forces["others/annotations.csv"]}
    named = {table: [names, *rows] for table, (_, rows) in tables.items()}
    named |= {table: [["file", "ball_radius_mm", "depth_mm", "force_n"], *rows] for table, rows in with_forces.items()}
    for table, rows in named.items():
        text = io.StringIO()
        csv.writer(text).writerows(rows)
        (folder / table).write_text(text.getvalue())


def anchors(text):
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", FENCED.sub("", text), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name):
    page = PROJECT / name
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCED.sub("", page.read_text())):
        file, _, anchor = target.partition("#")
        if "://" in target:
            continue
        linked = (page.parent / file).resolve() if file else page
        if not linked.exists():
            broken.append(f"{target} is not there")
        elif anchor and anchor not in anchors(linked.read_text()):
            broken.append(f"{target} has no such heading")
        elif page.is_relative_to(DOCS) and not linked.is_relative_to(DOCS):
            broken.append(f"{target} leaves the book")
    assert not broken


def test_the_table_of_contents_lists_every_page():
    listed = re.findall(r"\]\(([^)\s]+\.md)\)", (DOCS / "SUMMARY.md").read_text())
    pages = {str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md")} - {"SUMMARY.md"}
    assert sorted(listed) == sorted(pages)


@pytest.mark.parametrize("name", NAMES)
def test_commands_run(name, copy):
    # What one page made is another job's for the next.
    subprocess.run(["rm", "-rf", copy / "out"], check=True)
    commands = shell_commands((copy / name).read_text())
    failures = [failure_of(command, copy) for command in commands if not run_elsewhere(command)]
    assert not any(failures), "\n".join(filter(None, failures))


@pytest.mark.parametrize("name", NAMES)
def test_commands_within_sentences_exist(name):
    text = (PROJECT / name).read_text()
    spans = re.findall(r"`(gelsim [^`]*)`", FENCED.sub("", text))
    wrong = [unknown_options(" ".join(span.split())) for span in spans]
    assert not any(wrong), "\n".join(filter(None, wrong))
    for span in re.findall(r"`(cargo (?:test|bench)\s[^`]*)`", text):
        cargo_target(" ".join(span.split()))


@pytest.mark.parametrize("name", [name for name, page in zip(NAMES, PAGES) if CONSOLE.search(page.read_text())])
def test_tables_are_what_commands_print(name):
    page = PROJECT / name
    printed = lambda match: subprocess.run(match[1], shell=True, capture_output=True, text=True, check=True).stdout.strip("\n")
    text = page.read_text()
    anew = CONSOLE.sub(lambda match: f"```console\n$ {match[1]}\n{printed(match)}\n```", text)
    if os.environ.get("UPDATE"):
        page.write_text(anew)
    assert text == anew or os.environ.get("UPDATE"), "UPDATE=1 pytest tests/python/test_docs.py writes what the commands print"


def test_what_is_listed_above_is_in_a_page():
    commands = {command for page in PAGES for command in shell_commands(page.read_text())}
    stale = {*SHORTER, *ELSEWHERE} - commands - {run_elsewhere(command) for command in commands}
    assert not stale
    missing = {where for _, where in ELSEWHERE.values() if not (PROJECT / where).is_file()}
    assert not missing
