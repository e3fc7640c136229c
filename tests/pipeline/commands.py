"""Runs every shell command of README.md and docs/*.md as it stands, in a copy of the repository with the files they name.

    python commands.py GELSIM

A command is a block fenced as `sh`, or an indented line that begins with a program. What cannot run here is listed below
with the reason and the test that runs it instead; a command that is neither fails the test, and so does a list that names
what is in no page any more. Links must lead somewhere, and no page may be too long to be read. Of commands with placeholders, and of those named within a sentence, the options are looked up
in the program's help; of `cargo test` and `cargo bench` the targets in their Cargo.toml, and the module of the tests.
"""

import csv
import io
import json
import math
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib

from sets import REPOSITORY, environment

CARGO = {
    "test": tomllib.loads((REPOSITORY / "Cargo.toml").read_text())["test"],
    "bench": [
        bench
        for manifest in ("Cargo.toml", "tests/bench/Cargo.toml")
        for bench in tomllib.loads((REPOSITORY / manifest).read_text())["bench"]
    ],
}
INDENTED = re.compile(r"^    ((?:[A-Z_]+=\S+ )*(?:gelsim|gelsim-export|cargo|pip|python3?|bash|sh|sbatch|kubectl|npm|docker|make) .*)$")

# Words of a page.
MOST_WORDS = 2500

# Options of the documentation that make a run shorter.
SMALL = "--set 'sensor.resolution_px=[160, 120]'"
CALIBRATION = "gelsim calibrate presses.csv --background untouched.png --out my-sensor.toml"
SHORTER = {
    "gelsim generate configs/quickstart.toml --set dataset.samples=3000 --set 'sensor.resolution_px=[320, 240]'": "--samples 8",
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
    "cargo test --release": ("minutes", ".ci/run"),
    "cargo +nightly fuzz run --fuzz-dir tests/fuzz --sanitizer none TARGET": ("a nightly compiler", ".ci/run"),
    "pip install taxim==1.4.1 jax": ("400 MB", ".ci/run"),
    "python tests/pipeline/taxim_pictures.py OUT": ("the packages of the line before", ".ci/run"),
    "python tests/transfer/tactip.py GELSIM --real FOLDER": ("pictures that are not part of this project", "docs/transfer-tactip.md"),
    "python tests/pipeline/combinations.py GELSIM": ("minutes", ".ci/run"),
    "python tests/bench/others.py GELSIM": ("numpy, OpenCV and 400 MB", "tests/bench/figures.py"),
    "pip install '.[numpy]'": ("a compiler; there without numpy", "tests/pipeline/install.py"),
    "pip install '.[load]'": ("a compiler; there without extras", "tests/pipeline/install.py"),
    "pip install '.[export]'": ("a compiler; there without extras", "tests/pipeline/install.py"),
    "gelsim-export out/quickstart --to lerobot --out quickstart.lerobot": ("the wheel", "tests/pipeline/formats.py"),
    "gelsim-export out/quickstart --to lerobot --out quickstart.lerobot --check": ("the wheel", "tests/pipeline/formats.py"),
    "python tests/pipeline/formats.py target/release/gelsim": ("the wheel", ".ci/run"),
    "python tests/pipeline/formats.py target/release/gelsim --speed out/quickstart": ("minutes", "docs/formats.md"),
    "python tests/pipeline/extras.py FOLDER": ("the wheel", ".ci/run"),
    "python tests/pipeline/notebook.py": ("the wheel", ".ci/run"),
    "python tests/pipeline/attack.py": ("the wheel", ".ci/run"),
    "python tests/pipeline/workers.py target/release/gelsim --speed": ("the wheel", ".ci/run"),
    "bash gelsim.sbatch": ("Slurm", "tests/pipeline/slurm.py"),
    "sbatch --array=0-99 gelsim.sbatch": ("Slurm; there with another range", "tests/pipeline/slurm.py"),
    "python ray_driver.py job.toml out --parts 64 --threads 4": ("Ray; there in 8 parts", "tests/pipeline/ray_driver.py"),
    "kubectl apply -f indexed-job.yaml": ("a cluster; there each pod's command", "tests/pipeline/recipes.py"),
    "kubectl wait --for=condition=complete --timeout=24h job/gelsim": ("a cluster", "tests/pipeline/recipes.py"),
    "kubectl apply -f finalize-job.yaml": ("a cluster; there the pod's command", "tests/pipeline/recipes.py"),
    "for host in node0 node1 node2; do": ("three machines; there with a false ssh", "tests/pipeline/recipes.py"),
    "gelsim render --depth frames --depth-unit m --plane-mm 10 --sensor gelsight-2014 --out tactile": (
        "MuJoCo's frames",
        "tests/pipeline/simulators.py",
    ),
    "gelsim render --depth slide --depth-unit m --plane-mm 10 --sensor gelsight-2014 --poses slide.csv --sequence 0.3"
    " --layers slip,flow --set markers.pitch_mm=1.5 --out slid": ("MuJoCo's frames", "tests/pipeline/simulators.py"),
    "gelsim render --depth rays --depth-unit mm --plane-mm 10 --max-depth-mm 19 --sensor gelsight-2014 --out from-rays": (
        "PyBullet's frames",
        "tests/pipeline/simulators.py",
    ),
    "gelsim render --depth seen --depth-unit m --plane-mm 25 --projection perspective --fov-y-deg 40 --sensor gelsight-2014"
    " --out from-perspective": ("MuJoCo's frames", "tests/pipeline/simulators.py"),
    "gelsim render --depth inside --depth-unit m --max-depth-mm 99 --projection perspective --fov-y-deg 73.7398 --sensor geltip"
    " --out from-inside": ("MuJoCo's frames", "tests/pipeline/simulators.py"),
    "python tests/pipeline/simulators.py GELSIM": ("the packages of simulators", ".ci/run"),
    "gelsim calibrate --gelsight devices/series2_2EF6_4JNW.yaml --out my-sensor.toml": (
        "GelSight's files; there with made-up ones",
        "tests/cli/gelsight.rs",
    ),
    "gelsim calibrate --gelsight devices/series2_2EF6_4JNW.yaml --out gelsight-series2.toml": (
        "GelSight's files; there with made-up ones",
        "tests/cli/gelsight.rs",
    ),
    "python tests/transfer/run.py GELSIM --real FOLDER": ("real presses; what it printed", "docs/transfer.md"),
    "python tests/transfer/run.py GELSIM --real FOLDER --set gsmini_gssdk digit_fots gelsight_thu": (
        "real presses; what it printed",
        "docs/transfer.md",
    ),
    "python tests/transfer/run.py GELSIM --self-test": ("NumPy", ".ci/run"),
    "python docs/first-hour/train.py out/objects": ("PyTorch", ".ci/run"),
    "python tests/bench/accuracy.py target/release/gelsim": ("minutes", "tests/bench/figures.py"),
    "python tests/bench/figures.py target/release/gelsim": ("minutes", ".ci/run"),
    "bash python/wheels.sh": ("minutes", ".ci/run"),
    "python tests/pipeline/soak.py target/release/gelsim": ("minutes", ".ci/run"),
    "cargo publish --dry-run --locked --workspace": ("minutes", ".ci/run"),
    **{f"cargo run --release --example {name}": ("there from another folder", "tests/pipeline/library.py") for name in ("press", "sequence", "led")},
    "pip install dist/gelsim-*.whl": ("the wheel; there from another folder", ".ci/run"),
    "cargo install --path . --features stores": ("minutes; there it is built", ".ci/run"),
    "gelsim generate job.toml --out s3://bucket/presses": ("an S3 server", "tests/pipeline/stores.py"),
    "gelsim generate job.toml --out s3://bucket/presses --partition 0/2": ("an S3 server", "tests/pipeline/stores.py"),
    "gelsim generate job.toml --out s3://bucket/presses --partition 1/2": ("an S3 server", "tests/pipeline/stores.py"),
    "gelsim finalize s3://bucket/presses": ("an S3 server", "tests/pipeline/stores.py"),
    "seq 0 63 | parallel": ("two machines; there with a false ssh", "tests/pipeline/recipes.py"),
}


def commands(text):
    """The commands of a page, in their order."""
    found, fence = [], None
    for line in text.splitlines():
        if line.startswith("```"):
            if fence is None:
                fence, block = line[3:].strip(), []
                continue
            if fence in ("sh", "bash", "console"):
                found.append("\n".join(block))
            fence = None
        elif fence is not None:
            block.append(line)
        elif match := INDENTED.match(line):
            found.append(re.sub(r"\s+#.*$", "", match[1]).strip())
    return found


def elsewhere(command):
    """The key of ELSEWHERE that stands for a command, if one does: itself, or a part of a block."""
    return next((key for key in ELSEWHERE if command == key or "\n" in command and key in command), None)


def look_up(command, helps):
    """That a command's subcommand and options exist; `helps` remembers what each says of itself."""
    words = command.split()
    name = words[1] if len(words) > 1 and re.fullmatch("[a-z]+", words[1]) else ""
    if name not in helps:
        done = subprocess.run(["gelsim", *[name][: len(name)], "--help"], capture_output=True, text=True)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        helps[name] = set(re.findall(r"--[a-z][a-z-]*", done.stdout)) | {"--help", "--version"}
    unknown = set(re.findall(r"--[a-z][a-z-]*", command)) - helps[name]
    assert not unknown, f"{command}: no option {unknown}"


def look_up_target(command):
    """That the target of `cargo test` or `cargo bench`, if it names one, exists, and the module that follows it."""
    match = re.search(r"\bcargo (test|bench) .*--(test|bench) ([a-z_]+)(?: ([a-z_:]+))?", command)
    if match:
        assert match[3] in [target["name"] for target in CARGO[match[2]]], command
    if match and match[2] == "test" and match[4]:
        folder, *file = match[4].split("::")
        places = [f"{folder}/{'/'.join(file) or 'mod'}.rs", f"{match[3]}/{folder}.rs"]
        there = any((REPOSITORY / "tests" / place).is_file() for place in places)
        assert there and f"mod {folder};" in (REPOSITORY / f"tests/{match[3]}/main.rs").read_text(), command
    return match


def handle(command, folder, helps, used):
    """Runs a command, or checks what of it can be checked; says which."""
    if command in used and "generate" not in command:
        return "as above"
    command = re.sub(r"^cargo run --release --(?= )", "gelsim", command)
    if command.startswith("gelsim ") and re.search(r"\[-|\.\.\.| [A-Z]{3,}\b|\b[A-Z]+\.toml", command):
        look_up(command, helps)
        return "looked up"
    if look_up_target(command):
        return "target found"
    assert command.startswith("gelsim "), f"neither runs here nor is listed as run elsewhere: {command}"
    start = time.monotonic()
    line = f"{command} {SHORTER.get(command, '')}".strip()
    done = subprocess.run(["bash", "-ec", line], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    return f"{time.monotonic() - start:.1f} s"


def copy_of_repository(folder):
    """Every file that is or will be tracked."""
    listed = subprocess.run(["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=REPOSITORY, capture_output=True)
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (REPOSITORY / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes((REPOSITORY / name).read_bytes())


def fixtures(folder):
    """The files that the pages speak of: a job as in the README, its meshes, presses of a ball and an untouched pad."""
    readme = (folder / "README.md").read_text()
    (folder / "job.toml").write_text(re.search(r"```toml\n(.*?)```", readme, re.S)[1])
    (folder / "meshes").mkdir()
    for name, mesh in [("my-part.stl", "gear"), ("other.stl", "coin"), ("meshes/gear.stl", "gear"), ("meshes/coin.stl", "coin")]:
        (folder / name).write_text(stl((folder / f"objects/{mesh}.obj").read_text()))
    presses(folder)


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
    tables = {"presses.csv": ("press", []), "others.csv": ("others", [])}
    with tarfile.open(folder / "out/presses/data/train-000000.tar") as tar:
        members = {name: tar.extractfile(name).read() for name in tar.getnames()}
    for index in range(12):
        key = f"{index:09}"
        label = json.loads(members[f"{key}.json"])
        (pitch, _), contact = label["sensor"]["mm_per_px"], label["contact"]
        x, y = contact["centroid_mm"]
        circle = x / pitch + 79.5, y / pitch + 59.5, math.sqrt(contact["area_mm2"] / math.pi) / pitch
        pictures, rows = tables["presses.csv" if index < 8 else "others.csv"]
        name = f"{pictures}/{index:02}.png"
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(members[f"{key}.tactile.png"])
        rows.append([name, *circle, 4.0, pitch])
    (folder / "untouched.png").write_bytes(members["000000000.reference.png"])
    names = ["file", "centre_x_px", "centre_y_px", "radius_px", "ball_radius_mm", "mm_per_px"]
    for table, (_, rows) in tables.items():
        text = io.StringIO()
        csv.writer(text).writerows([names, *rows])
        (folder / table).write_text(text.getvalue())


def misguided(page):
    """What is wrong with a page beside its commands: links that lead nowhere, and more words than are read at one go."""
    text = re.sub(r"(?ms)^```.*?^```$", "", page.read_text())
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        file, _, anchor = target.partition("#")
        if "://" in target:
            continue
        there = (page.parent / file).resolve() if file else page
        if not there.exists():
            yield f"{page.name}: {target} is not there"
        elif anchor and anchor not in anchors(there.read_text()):
            yield f"{page.name}: {target} has no such heading"
    words = len(page.read_text().split())
    if words > MOST_WORDS:
        yield f"{page.name} has {words} words; {MOST_WORDS} are the most of a page"


def anchors(text):
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"(?ms)^```.*?^```$", "", text), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def main():
    pages = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").glob("*.md"))]
    assert not (wrong := [line for page in pages for line in misguided(page)]), "\n".join(wrong)
    os.environ.update(environment(pathlib.Path(sys.argv[1]).resolve()))
    helps, used = {}, set()
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        copy_of_repository(folder)
        fixtures(folder)
        for page in [folder / "README.md", *sorted((folder / "docs").glob("*.md"))]:
            text = page.read_text()
            # What one page made is another job's for the next.
            subprocess.run(["rm", "-rf", folder / "out"], check=True)
            for command in commands(text):
                key = elsewhere(command)
                said = f"{ELSEWHERE[key][1]} ({ELSEWHERE[key][0]})" if key else handle(command, folder, helps, used)
                used.update([key, command])
                print(f"{page.name}: {command.splitlines()[0]}: {said}", flush=True)
            for span in re.findall(r"`(gelsim [^`]*)`", re.sub(r"(?ms)^```.*?^```$", "", text)):
                look_up(span, helps)
            for span in re.findall(r"`(cargo (?:test|bench)\s[^`]*)`", text):
                look_up_target(" ".join(span.split()))
    stale = (SHORTER.keys() | ELSEWHERE.keys()) - used
    assert not stale, f"listed, but in no page: {stale}"
    assert all((REPOSITORY / where).is_file() for _, where in ELSEWHERE.values())


if __name__ == "__main__":
    main()
