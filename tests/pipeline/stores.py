"""Datasets in an S3 server on this machine: the bytes of a run on disk, whatever happens to the run or to the server.

    python stores.py GELSIM GELSIM_WITH_STORES [--away]     with --away also a server that is away for seconds, and for good (minutes)

Needs moto[server] and boto3 (PyPI). moto listens on 127.0.0.1, and gelsim talks to it through a gate that can be shut.
"""

import contextlib
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

import boto3
from sets import JOB, REPOSITORY, assert_same, contents

HOST = "127.0.0.1"
BUCKET = "bucket"
PATIENCE_S = 300
KEYS = {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_REGION": "us-east-1"}


def free_port():
    with socket.socket() as one:
        one.bind((HOST, 0))
        return one.getsockname()[1]


def wait(condition, what):
    end = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.02)
    return found


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
        self.port = free_port()
        env = {**os.environ, **({"INITIAL_NO_AUTH_ACTION_COUNT": "1"} if checked else {})}
        command = [sys.executable, "-m", "moto.server", "-H", HOST, "-p", str(self.port)]
        self.log = (folder / f"moto-{self.port}.log").open("w")
        self.process = subprocess.Popen(command, env=env, stdout=self.log, stderr=self.log)
        self.s3 = boto3.client(
            "s3",
            endpoint_url=f"http://{HOST}:{self.port}",
            aws_access_key_id="key",
            aws_secret_access_key="secret",
            region_name="us-east-1",
        )

        def listens():
            with contextlib.suppress(OSError), socket.create_connection((HOST, self.port)):
                return True

        wait(listens, "moto")
        self.s3.create_bucket(Bucket=BUCKET)

    def names(self, prefix):
        pages = self.s3.get_paginator("list_objects_v2").paginate(Bucket=BUCKET, Prefix=f"{prefix}/")
        # Without what stands for a folder.
        return {entry["Key"][len(prefix) + 1 :] for page in pages for entry in page.get("Contents", [])} - {""}

    def put(self, name, content):
        self.s3.put_object(Bucket=BUCKET, Key=name, Body=content)

    def download(self, prefix, root):
        shutil.rmtree(root, ignore_errors=True)
        for name in self.names(prefix):
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            self.s3.download_file(BUCKET, f"{prefix}/{name}", str(root / name))
        return root

    def unfinished_uploads(self):
        return self.s3.list_multipart_uploads(Bucket=BUCKET).get("Uploads", [])


class Runs:
    """Runs of the program in a folder with a job."""

    def __init__(self, gelsim, folder, port):
        self.gelsim, self.folder, self.staging = gelsim, folder, folder / "staging"
        self.env = {**os.environ, **KEYS, "AWS_ENDPOINT_URL": f"http://{HOST}:{port}"}

    def start(self, arguments, **variables):
        command = [self.gelsim, *arguments.split()]
        command += ["--staging", self.staging] if "://" in arguments and command[1] == "generate" else []
        env = {**self.env, **variables}
        return subprocess.Popen(command, cwd=self.folder, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def run(self, arguments, status=0, **variables):
        """What it says."""
        run = self.start(arguments, **variables)
        out, err = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == status, f"{arguments}: {run.returncode}: {out}{err}"
        assert str(self.staging) not in out + err, f"a folder that means nothing to who reads it: {out}{err}"
        return out + err

    def assert_nothing_stays(self):
        left = list(self.staging.iterdir()) if self.staging.exists() else []
        assert not left, f"left on this machine: {left}"


def says(text, *parts):
    for part in parts:
        assert part in text, f"{part!r} is not in\n{text}"


def shards_there(server, prefix):
    return sum(name.startswith("stats/") for name in server.names(prefix))


def same_bytes(runs, server, whole):
    """Also of a shard that goes in several requests, and of a folder that is taken for a store."""
    text = runs.run(f"generate job.toml --out s3://{BUCKET}/plain --threads 2")
    says(text, f"-> s3://{BUCKET}/plain")
    runs.assert_nothing_stays()
    # Where `--out` would have put it, so that even its job.toml is the same.
    assert_same(server.download("plain", runs.folder / "out/cluster"), whole)
    text = runs.run(f"generate job.toml --out s3://{BUCKET}/plain")
    says(text, "0 samples in 0 shards", "shards were there already")
    runs.run(f"generate job.toml --out file://{runs.folder}/filed --quiet")
    assert_same(runs.folder / "filed", whole)
    assert (runs.folder / "filed/job.toml").read_bytes() == (whole / "job.toml").read_bytes()
    runs.run("verify filed")

    large = "--set sensor.resolution_px=[640,480] --samples 110 --set dataset.samples_per_shard=110 --quiet"
    runs.run(f"generate job.toml --out large {large}")
    assert max(path.stat().st_size for path in (runs.folder / "large/data").iterdir()) > 17 << 20
    runs.run(f"generate job.toml --out s3://{BUCKET}/large {large}")
    found = contents(server.download("large", runs.folder / "found"))
    expected = contents(runs.folder / "large")
    # It was made beside another folder.
    del found["job.toml"], expected["job.toml"]
    assert found == expected and not server.unfinished_uploads()


def parts(runs, server, whole):
    both = [runs.start(f"generate job.toml --out s3://{BUCKET}/parts --partition {part}/2 --threads 1") for part in [0, 1]]
    for run in both:
        _, err = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == 0, err
    # Who ended last described it, unless both ended at once.
    says(runs.run(f"finalize s3://{BUCKET}/parts"), "finalized")
    assert_same(server.download("parts", runs.folder / "out/cluster"), whole)


def finalize(runs, server, whole):
    for name in ["dataset.json", "README.md"]:
        server.s3.delete_object(Bucket=BUCKET, Key=f"parts/{name}")
    says(runs.run(f"finalize s3://{BUCKET}/parts --quick"), "finalized")
    assert_same(server.download("parts", runs.folder / "out/cluster"), whole)
    tar = (whole / "data/train-000001.tar").read_bytes()
    server.put("parts/data/train-000001.tar", tar[:1000] + b"!" + tar[1001:])
    text = runs.run(f"finalize s3://{BUCKET}/parts", status=1)
    says(text, "data/train-000001.tar: is not what was written", "not finalized", f"s3://{BUCKET}/parts")
    for name in ["stats/train-000001.json", "data/val-000000.tar"]:
        server.s3.delete_object(Bucket=BUCKET, Key=f"parts/{name}")
    text = runs.run(f"finalize s3://{BUCKET}/parts --quick", status=1)
    says(text, "stats/train-000001.json: is missing", "data/val-000000.tar: is missing")
    says(runs.run(f"generate job.toml --out s3://{BUCKET}/parts"), "in 2 shards", "made again", "val-000000")
    assert_same(server.download("parts", runs.folder / "out/cluster"), whole)
    says(runs.run(f"finalize s3://{BUCKET}/nowhere", status=2), f"s3://{BUCKET}/nowhere is no dataset")


def killed(runs, server, whole):
    for signal_, status, prefix in [(signal.SIGKILL, -9, "killed"), (signal.SIGINT, 130, "stopped"), (signal.SIGTERM, 143, "ended")]:
        run = runs.start(f"generate job.toml --out s3://{BUCKET}/{prefix} --threads 2")
        wait(lambda: shards_there(server, prefix) >= 3, "three shards")
        run.send_signal(signal_)
        _, err = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == status, f"{run.returncode}: {err}"
        if signal_ != signal.SIGKILL:
            says(err, "stopped; finished shards stay, the same command goes on from there")
            runs.assert_nothing_stays()
        there = shards_there(server, prefix)
        assert "dataset.json" not in server.names(prefix)
        text = runs.run(f"generate job.toml --out s3://{BUCKET}/{prefix}")
        runs.assert_nothing_stays()
        says(text, f"{there} shards were there already")
        assert_same(server.download(prefix, runs.folder / "out/cluster"), whole)


def server_away(runs, server, gate, whole):
    """For seconds: the run goes on. For ever: it ends in words, or when it is told to."""
    away = f"generate job.toml --out s3://{BUCKET}/away --threads 2"
    run = runs.start(away)
    wait(lambda: shards_there(server, "away") >= 2, "two shards")
    gate.shut()
    time.sleep(2)
    gate.open = True
    _, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 0, err
    assert_same(server.download("away", runs.folder / "out/cluster"), whole)

    both = []
    for prefix in ["gone", "left"]:
        both.append(runs.start(f"generate job.toml --out s3://{BUCKET}/{prefix} --threads 1"))
        wait(lambda: shards_there(server, prefix) >= 2, "two shards")
    gate.shut()
    gone, left = both
    time.sleep(1)
    left.send_signal(signal.SIGINT)
    begun = time.monotonic()
    _, err = left.communicate(timeout=PATIENCE_S)
    assert left.returncode == 130, f"{left.returncode}: {err}"
    _, err = gone.communicate(timeout=PATIENCE_S)
    assert gone.returncode == 1, f"{gone.returncode}: {err}"
    print(f"a server that is away was waited for {time.monotonic() - begun:.0f} s")
    says(err, f"error: s3://{BUCKET}/gone/", "check the network", "the same command goes on from there")
    gate.open = True
    for prefix in ["gone", "left"]:
        runs.run(f"generate job.toml --out s3://{BUCKET}/{prefix}")
        assert_same(server.download(prefix, runs.folder / "out/cluster"), whole)
    runs.assert_nothing_stays()


def of_others(runs, server, whole):
    """What is there of others is named, and goes only when it is told to."""
    shutil.copy(runs.folder / "job.toml", runs.folder / "other.toml")
    runs.run(f"generate other.toml --seed 5 --samples 100 --out s3://{BUCKET}/taken --quiet")
    server.put("taken/notes.txt", b"mine")
    before = server.names("taken")
    text = runs.run(f"generate job.toml --out s3://{BUCKET}/taken", status=2)
    says(text, f"s3://{BUCKET}/taken holds a dataset of another job", "dataset.seed is 5 there and 0 here", "--overwrite")
    assert server.names("taken") == before
    runs.run(f"generate job.toml --out s3://{BUCKET}/taken --overwrite --quiet")
    found = server.download("taken", runs.folder / "out/cluster")
    assert (found / "notes.txt").read_bytes() == b"mine"
    (found / "notes.txt").unlink()
    assert_same(found, whole)
    server.put("notes/notes.txt", b"mine")
    text = runs.run(f"generate job.toml --out s3://{BUCKET}/notes", status=2)
    says(text, f"s3://{BUCKET}/notes is not empty and holds no dataset of gelsim")
    # Some programs put an empty object for a folder.
    server.put("marked/", b"")
    runs.run(f"generate job.toml --out s3://{BUCKET}/marked/ --samples 25 --quiet")
    # More samples in the same place.
    says(runs.run(f"generate job.toml --out s3://{BUCKET}/marked"), "the dataset had 25 samples")
    assert_same(server.download("marked", runs.folder / "out/cluster"), whole)


def wrong(runs, server, checked):
    """Status, and what is said."""
    generate = "generate job.toml --quiet --out"
    text = runs.run(f"{generate} s3://nobucket/presses", status=1)
    says(text, "error: s3://nobucket/presses: NoSuchBucket", "make the bucket first, or name another one")
    says(runs.run("finalize s3://nobucket/presses", status=1), "NoSuchBucket", "make the bucket first")
    nobody = f"http://{HOST}:{free_port()}"
    text = runs.run(f"{generate} s3://{BUCKET}/presses", status=1, AWS_ENDPOINT_URL=nobody)
    says(text, f"error: s3://{BUCKET}/presses: ", "check the network and AWS_ENDPOINT_URL")
    text = runs.run(f"{generate} s3://{BUCKET}/presses", status=1, AWS_ENDPOINT_URL=f"http://{HOST}:{checked.port}")
    says(text, "InvalidAccessKeyId", "check AWS_ACCESS_KEY_ID", "export-credentials")
    for address, said in [
        ("http://host/presses", "http:// is no store that is known: s3:// (S3), gs://"),
        ("s3://", "names no bucket: write s3://BUCKET/PREFIX"),
        ("file://presses", "three slashes"),
    ]:
        says(runs.run(f"generate job.toml --out {address}", status=2), said)
    text = runs.run(f"generate job.toml --set output.container=\"folder\" --out s3://{BUCKET}/folders", status=2)
    says(text, "cannot be put into a store whole")
    text = runs.run(f"generate job.toml --set fidelity={{max_ms=5}} --out s3://{BUCKET}/chosen", status=2)
    says(text, "name a level with --fidelity")
    says(runs.run("generate job.toml --staging here", status=2), "--staging is for datasets in stores")
    assert not server.names("folders") and not server.names("chosen")


def elsewhere(runs):
    """Commands that take folders, and a program without stores."""
    for command in [f"verify s3://{BUCKET}/plain", f"report s3://{BUCKET}/plain", f"preview s3://{BUCKET}/plain --out sheet.png"]:
        says(runs.run(command, status=2), f"s3://{BUCKET}/plain is in an object store", "aws s3 sync")
    assert not list(runs.folder.glob("s3:*"))


def without(gelsim, folder, runs):
    bare = Runs(gelsim, folder, 1)
    for command in [f"generate job.toml --out s3://{BUCKET}/p", f"finalize s3://{BUCKET}/p", "plan job.toml --out gs://b/p"]:
        says(bare.run(command, status=2), "built without them", "--features stores")
    assert not list(folder.glob("s3:*"))


def main(gelsim, with_stores):
    with tempfile.TemporaryDirectory(prefix="gelsim-stores-") as root:
        folder = pathlib.Path(root)
        shutil.copy(REPOSITORY / "objects/sphere.obj", folder)
        (folder / "job.toml").write_text(JOB.format(samples=800, width=160, height=120))
        server, checked = Server(folder), Server(folder, checked=True)
        try:
            gate = Gate(server.port)
            runs = Runs(with_stores, folder, gate.port)
            # Where its job.toml names the paths that a store's names.
            runs.run("generate job.toml --out out/cluster --quiet")
            whole = (folder / "out/cluster").rename(folder / "whole")
            for what, arguments in [
                (wrong, (runs, server, checked)),
                (same_bytes, (runs, server, whole)),
                (elsewhere, (runs,)),
                (without, (gelsim, folder, runs)),
                (parts, (runs, server, whole)),
                (finalize, (runs, server, whole)),
                (killed, (runs, server, whole)),
                (of_others, (runs, server, whole)),
                (server_away, (runs, server, gate, whole)),
            ]:
                if what is server_away and "--away" not in sys.argv:
                    continue
                begun = time.monotonic()
                what(*arguments)
                print(f"{what.__name__}: {time.monotonic() - begun:.0f} s", flush=True)
        finally:
            for one in [server, checked]:
                one.process.kill()
                one.process.wait()
                one.log.close()
    print("datasets in an S3 server: the bytes of a run on disk, each time")


if __name__ == "__main__":
    main(*(pathlib.Path(name).resolve() for name in sys.argv[1:3]))
