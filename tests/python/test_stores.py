"""Datasets in an S3 server on this machine: the bytes of a run on disk, whatever happens to the run or to the server.

moto listens on 127.0.0.1, and gelsim talks to it through a gate that can be shut. The program is one with stores:

    cargo build --release --locked --features stores --bin gelsim --target-dir target/stores
"""

import contextlib
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from processes import PATIENCE_S, wait
from sets import JOB, PROJECT, assert_same, contents

pytestmark = pytest.mark.full

HOST = "127.0.0.1"
BUCKET = "bucket"
KEYS = {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_REGION": "us-east-1"}


def free_port():
    with socket.socket() as one:
        one.bind((HOST, 0))
        return one.getsockname()[1]


class Gate:
    """Passes connections on to a port as long as it is open."""

    def __init__(self, port):
        self.target, self.port, self.open = port, free_port(), True
        self.ends = set()
        self.listener = socket.create_server((HOST, self.port))
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        while True:
            near, _ = self.listener.accept()
            if not self.open:
                near.close()
                continue
            far = socket.create_connection((HOST, self.target))
            self.ends |= {near, far}
            for one, other in [(near, far), (far, near)]:
                threading.Thread(target=self.pass_on, args=(one, other), daemon=True).start()

    def pass_on(self, one, other):
        with contextlib.suppress(OSError):
            while data := one.recv(1 << 16):
                other.sendall(data)
        for end in [one, other]:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def shut(self):
        """As a server that dies: what goes through is cut, and nobody answers."""
        self.open = False
        for end in self.ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self.ends.clear()


class Server:
    """moto, with a bucket; `checked`: keys are looked at."""

    def __init__(self, folder, checked=False):
        boto3 = pytest.importorskip("boto3", reason="no boto3: pip install 'moto[server]' boto3")
        pytest.importorskip("moto.server", reason="no moto: pip install 'moto[server]' boto3")
        self.port = free_port()
        env = {**os.environ, **({"INITIAL_NO_AUTH_ACTION_COUNT": "1"} if checked else {})}
        command = [sys.executable, "-m", "moto.server", "-H", HOST, "-p", str(self.port)]
        self.log = (folder / f"moto-{self.port}.log").open("w")
        self.process = subprocess.Popen(command, env=env, stdout=self.log, stderr=self.log)
        self.s3 = boto3.client(
            "s3", endpoint_url=f"http://{HOST}:{self.port}", aws_access_key_id="key",
            aws_secret_access_key="secret", region_name="us-east-1",
        )  # fmt: skip

        def listens():
            with contextlib.suppress(OSError), socket.create_connection((HOST, self.port)):
                return True

        wait(listens, "moto")
        self.s3.create_bucket(Bucket=BUCKET)

    def end(self):
        self.process.kill()
        self.process.wait()
        self.log.close()

    def names(self, prefix):
        pages = self.s3.get_paginator("list_objects_v2").paginate(Bucket=BUCKET, Prefix=f"{prefix}/")
        # Without what stands for a folder.
        return {entry["Key"][len(prefix) + 1 :] for page in pages for entry in page.get("Contents", [])} - {""}

    def shards(self, prefix):
        """How many shards are complete."""
        return sum(name.startswith("stats/") for name in self.names(prefix))

    def put(self, name, content):
        self.s3.put_object(Bucket=BUCKET, Key=name, Body=content)

    def delete(self, name):
        self.s3.delete_object(Bucket=BUCKET, Key=name)

    def upload(self, root, prefix):
        for path in root.rglob("*"):
            if path.is_file():
                self.put(f"{prefix}/{path.relative_to(root)}", path.read_bytes())

    def download(self, prefix, root):
        shutil.rmtree(root, ignore_errors=True)
        for name in self.names(prefix):
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            self.s3.download_file(BUCKET, f"{prefix}/{name}", str(root / name))
        return root

    def unfinished_uploads(self):
        return self.s3.list_multipart_uploads(Bucket=BUCKET).get("Uploads", [])


class Runs:
    """Runs of a program in a folder with a job."""

    def __init__(self, gelsim, folder, port):
        self.gelsim, self.folder, self.staging = gelsim, folder, folder / "staging"
        self.env = {**os.environ, **KEYS, "AWS_ENDPOINT_URL": f"http://{HOST}:{port}"}

    def start(self, arguments, **variables):
        command = [self.gelsim, *arguments.split()]
        command += ["--staging", self.staging] if "://" in arguments and command[1] == "generate" else []
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        return subprocess.Popen(command, cwd=self.folder, env={**self.env, **variables}, **pipes)

    def end(self, run, status=0):
        """What it said."""
        out, err = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == status, f"{run.args} ended with {run.returncode}\n{out}{err}"
        return out + err

    def wait_for_shards(self, server, prefix, run, count):
        """Until so many are in the bucket, or the run has ended."""
        wait(lambda: server.shards(prefix) >= count or run.poll() is not None, f"{count} shards")

    def run(self, arguments, status=0, **variables):
        said = self.end(self.start(arguments, **variables), status)
        assert str(self.staging) not in said, "a folder that means nothing to who reads it"
        return said

    def assert_nothing_stays(self):
        left = list(self.staging.iterdir()) if self.staging.exists() else []
        assert not left, f"left on this machine: {left}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stores")
    shutil.copy(PROJECT / "objects/sphere.obj", folder)
    (folder / "job.toml").write_text(JOB.format(samples=800, width=160, height=120))
    return folder


@pytest.fixture(scope="module")
def server(folder):
    server = Server(folder)
    yield server
    server.end()


@pytest.fixture(scope="module")
def gate(server):
    return Gate(server.port)


@pytest.fixture(scope="module")
def runs(pytestconfig, folder, gate):
    """Of the program with stores."""
    program = pathlib.Path(pytestconfig.getoption("--gelsim-with-stores")).resolve()
    if not program.is_file():
        pytest.skip(f"no {program}: build it as {__file__} says, or name it by --gelsim-with-stores")
    return Runs(program, folder, gate.port)


@pytest.fixture(scope="module")
def on_disk(folder, runs):
    """The dataset of a run on disk. Made where its job.toml names the paths that a store's names."""
    runs.run("generate job.toml --out out/cluster --quiet")
    return (folder / "out/cluster").rename(folder / "on-disk")


@pytest.fixture
def assert_on_disk(server, folder, on_disk):
    """Fails if what is in the bucket differs from what is on disk."""
    # Where `--out` would have put it, so that even its job.toml is the same.
    return lambda prefix: assert_same(server.download(prefix, folder / "out/cluster"), on_disk)


def says(text, *parts):
    missing = [part for part in parts if part not in text]
    assert not missing, text


def test_a_bucket_gets_the_bytes_of_a_run_on_disk(runs, assert_on_disk):
    says(runs.run(f"generate job.toml --out s3://{BUCKET}/plain --threads 2"), f"-> s3://{BUCKET}/plain")
    runs.assert_nothing_stays()
    assert_on_disk("plain")
    says(runs.run(f"generate job.toml --out s3://{BUCKET}/plain"), "0 samples in 0 shards", "shards were there already")


def test_a_folder_that_is_taken_for_a_store_gets_the_same_bytes(runs, on_disk):
    out = runs.folder / "filed"
    runs.run(f"generate job.toml --out file://{out} --quiet")
    assert_same(out, on_disk)
    assert (out / "job.toml").read_bytes() == (on_disk / "job.toml").read_bytes()
    runs.run("verify filed")


def test_a_shard_that_goes_in_several_requests_has_the_same_bytes(runs, server):
    large = "--set sensor.resolution_px=[640,480] --samples 110 --set dataset.samples_per_shard=110 --quiet"
    runs.run(f"generate job.toml --out large {large}")
    assert max(path.stat().st_size for path in (runs.folder / "large/data").iterdir()) > 17 << 20
    runs.run(f"generate job.toml --out s3://{BUCKET}/large {large}")
    found = contents(server.download("large", runs.folder / "found"))
    expected = contents(runs.folder / "large")
    # It was made beside another folder.
    del found["job.toml"], expected["job.toml"]
    assert found == expected and not server.unfinished_uploads()


def test_parts_make_the_bytes_of_a_run_on_disk(runs, assert_on_disk):
    command = f"generate job.toml --out s3://{BUCKET}/parts --threads 1 --partition"
    for part in [runs.start(f"{command} {part}/2") for part in [0, 1]]:
        runs.end(part)
    # Who ended last described it, unless both ended at once.
    says(runs.run(f"finalize s3://{BUCKET}/parts"), "finalized")
    assert_on_disk("parts")


def test_finalize_describes_a_dataset_in_a_bucket(runs, server, on_disk, assert_on_disk):
    server.upload(on_disk, "described")
    for name in ["dataset.json", "README.md"]:
        server.delete(f"described/{name}")
    says(runs.run(f"finalize s3://{BUCKET}/described --quick"), "finalized")
    assert_on_disk("described")


def test_finalize_names_what_is_wrong_in_a_bucket_and_generate_makes_it_again(runs, server, on_disk, assert_on_disk):
    server.upload(on_disk, "damaged")
    tar = (on_disk / "data/train-000001.tar").read_bytes()
    server.put("damaged/data/train-000001.tar", tar[:1000] + b"!" + tar[1001:])
    said = runs.run(f"finalize s3://{BUCKET}/damaged", status=1)
    says(said, "data/train-000001.tar: is not what was written", "not finalized", f"s3://{BUCKET}/damaged")
    for name in ["stats/train-000001.json", "data/val-000000.tar"]:
        server.delete(f"damaged/{name}")
    said = runs.run(f"finalize s3://{BUCKET}/damaged --quick", status=1)
    says(said, "stats/train-000001.json: is missing", "data/val-000000.tar: is missing")
    says(runs.run(f"generate job.toml --out s3://{BUCKET}/damaged"), "in 2 shards", "made again", "val-000000")
    assert_on_disk("damaged")


def test_finalize_refuses_a_prefix_without_a_dataset(runs):
    says(runs.run(f"finalize s3://{BUCKET}/nowhere", status=2), f"s3://{BUCKET}/nowhere is no dataset")


@pytest.mark.parametrize("name, status", [("SIGKILL", -9), ("SIGINT", 130), ("SIGTERM", 143)])
def test_a_run_that_was_stopped_goes_on(runs, server, assert_on_disk, name, status):
    prefix, number = f"stopped-by-{name}", signal.Signals[name]
    run = runs.start(f"generate job.toml --out s3://{BUCKET}/{prefix} --threads 2")
    runs.wait_for_shards(server, prefix, run, 3)
    run.send_signal(number)
    said = runs.end(run, status)
    if number != signal.SIGKILL:
        says(said, "stopped; finished shards stay, the same command goes on from there")
        runs.assert_nothing_stays()
    there = server.shards(prefix)
    assert "dataset.json" not in server.names(prefix)
    said = runs.run(f"generate job.toml --out s3://{BUCKET}/{prefix}")
    runs.assert_nothing_stays()
    says(said, f"{there} shards were there already")
    assert_on_disk(prefix)


def test_a_run_waits_for_a_server_that_is_away_for_seconds(runs, server, gate, assert_on_disk):
    run = runs.start(f"generate job.toml --out s3://{BUCKET}/away --threads 2")
    runs.wait_for_shards(server, "away", run, 2)
    gate.shut()
    time.sleep(2)
    gate.open = True
    runs.end(run)
    assert_on_disk("away")


def test_a_run_without_its_server_ends_in_words_or_when_it_is_told_to(runs, server, gate, assert_on_disk):
    started = []
    for prefix in ["gone", "left"]:
        started.append(runs.start(f"generate job.toml --out s3://{BUCKET}/{prefix} --threads 1"))
        runs.wait_for_shards(server, prefix, started[-1], 2)
    gate.shut()
    try:
        gone, left = started
        time.sleep(1)
        left.send_signal(signal.SIGINT)
        begun = time.monotonic()
        runs.end(left, 130)
        said = runs.end(gone, 1)
        print(f"a server that is away was waited for {time.monotonic() - begun:.0f} s")
        says(said, f"error: s3://{BUCKET}/gone/", "check the network", "the same command goes on from there")
    finally:
        gate.open = True
    for prefix in ["gone", "left"]:
        runs.run(f"generate job.toml --out s3://{BUCKET}/{prefix}")
        assert_on_disk(prefix)
    runs.assert_nothing_stays()


def test_a_dataset_of_another_job_goes_only_when_it_is_told_to(runs, server, folder, on_disk):
    shutil.copy(folder / "job.toml", folder / "other.toml")
    runs.run(f"generate other.toml --seed 5 --samples 100 --out s3://{BUCKET}/taken --quiet")
    server.put("taken/notes.txt", b"mine")
    before = server.names("taken")
    said = runs.run(f"generate job.toml --out s3://{BUCKET}/taken", status=2)
    says(said, f"s3://{BUCKET}/taken holds a dataset of another job", "--overwrite")
    says(said, "dataset.seed is 5 there and 0 here")
    assert server.names("taken") == before
    runs.run(f"generate job.toml --out s3://{BUCKET}/taken --overwrite --quiet")
    found = server.download("taken", folder / "out/cluster")
    assert (found / "notes.txt").read_bytes() == b"mine"
    (found / "notes.txt").unlink()
    assert_same(found, on_disk)


def test_what_is_no_dataset_is_left_alone(runs, server):
    server.put("notes/notes.txt", b"mine")
    said = runs.run(f"generate job.toml --out s3://{BUCKET}/notes", status=2)
    says(said, f"s3://{BUCKET}/notes is not empty and holds no dataset of gelsim")


def test_an_empty_object_for_a_folder_is_none_and_more_samples_come_later(runs, server, assert_on_disk):
    # Some programs put an empty object for a folder.
    server.put("marked/", b"")
    runs.run(f"generate job.toml --out s3://{BUCKET}/marked/ --samples 25 --quiet")
    says(runs.run(f"generate job.toml --out s3://{BUCKET}/marked"), "the dataset had 25 samples")
    assert_on_disk("marked")


def test_a_bucket_that_is_not_there_is_to_be_made(runs):
    said = runs.run("generate job.toml --quiet --out s3://nobucket/presses", status=1)
    says(said, "error: s3://nobucket/presses: NoSuchBucket", "make the bucket first, or name another one")
    says(runs.run("finalize s3://nobucket/presses", status=1), "NoSuchBucket", "make the bucket first")


def test_a_server_that_nobody_is_is_looked_for_in_the_network(runs):
    nobody = f"http://{HOST}:{free_port()}"
    said = runs.run(f"generate job.toml --quiet --out s3://{BUCKET}/presses", status=1, AWS_ENDPOINT_URL=nobody)
    says(said, f"error: s3://{BUCKET}/presses: ", "check the network and AWS_ENDPOINT_URL")


def test_wrong_keys_are_named(runs, folder):
    checked = Server(folder, checked=True)
    try:
        address = f"http://{HOST}:{checked.port}"
        said = runs.run(f"generate job.toml --quiet --out s3://{BUCKET}/presses", status=1, AWS_ENDPOINT_URL=address)
        says(said, "InvalidAccessKeyId", "check AWS_ACCESS_KEY_ID", "export-credentials")
    finally:
        checked.end()


ADDRESSES = {
    "http://host/presses": "http:// is no store that is known: s3:// (S3), gs://",
    "s3://": "names no bucket: write s3://BUCKET/PREFIX",
    "file://presses": "three slashes",
}


@pytest.mark.parametrize("address", ADDRESSES)
def test_an_address_that_is_none_is_refused(runs, address):
    says(runs.run(f"generate job.toml --out {address}", status=2), ADDRESSES[address])


def test_folders_are_not_put_into_a_bucket(runs, server):
    said = runs.run(f'generate job.toml --set output.container="folder" --out s3://{BUCKET}/folders', status=2)
    says(said, "cannot be put into a store as one object")
    assert not server.names("folders")


def test_a_level_is_not_chosen_for_a_bucket(runs, server):
    said = runs.run(f"generate job.toml --set fidelity={{max_ms=5}} --out s3://{BUCKET}/chosen", status=2)
    says(said, "name a level with --fidelity")
    assert not server.names("chosen")


def test_staging_is_for_stores_alone(runs):
    says(runs.run("generate job.toml --staging here", status=2), "--staging is for datasets in stores")


@pytest.mark.parametrize("command", ["verify {}", "report {}", "preview {} --out sheet.png"])
def test_other_commands_take_folders(runs, command):
    address = f"s3://{BUCKET}/plain"
    says(runs.run(command.format(address), status=2), f"{address} is in an object store", "aws s3 sync")
    assert not list(runs.folder.glob("s3:*"))


@pytest.mark.parametrize(
    "command", [f"generate job.toml --out s3://{BUCKET}/p", f"finalize s3://{BUCKET}/p", "plan job.toml --out gs://b/p"]
)
def test_a_program_without_stores_says_so(gelsim_path, folder, command):
    says(Runs(gelsim_path, folder, 1).run(command, status=2), "built without them", "--features stores")
    assert not list(folder.glob("s3:*"))
