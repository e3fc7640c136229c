"""What docs/cluster.md says of schedulers that are not at hand: each task's command under `sh` with its variables set.

    python recipes.py GELSIM

Every dataset made so is the single run's, byte for byte. Needs PyYAML; without GNU parallel its recipe is left out.
"""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import yaml
from sets import REPOSITORY, assert_same, environment, prepare, single

CLUSTER = REPOSITORY / "docs/cluster"
PAGE = (REPOSITORY / "docs/cluster.md").read_text()
TASKS = 8
# What each scheduler sets for task number i of eight.
VARIABLES = {
    "AWS Batch, array job": lambda i: {"AWS_BATCH_JOB_ARRAY_INDEX": i, "AWS_BATCH_JOB_ARRAY_SIZE": 8},
    "Google Batch": lambda i: {"BATCH_TASK_INDEX": i, "BATCH_TASK_COUNT": 8},
    "Grid Engine": lambda i: {"SGE_TASK_ID": i + 1, "SGE_TASK_FIRST": 1, "SGE_TASK_LAST": 8, "SGE_TASK_STEPSIZE": 1},
    "LSF": lambda i: {"LSB_JOBINDEX": i + 1, "LSB_JOBINDEX_END": 8},
    "PBS": lambda i: {"PBS_ARRAY_INDEX": i},
}
# Runs what it is given for another machine on this one; SHELL is set as sshd sets it (a CI has none, GNU parallel asks).
SSH = """#!/bin/sh
export SHELL=/bin/sh
while [ "${1#-}" != "$1" ]; do shift; done
shift
[ "$1" = -- ] && shift
cd /
exec sh -c "$*"
"""
# A file system without locks, as Lustre mounted without them.
NO_LOCKS = "#include <errno.h>\nint flock(int file, int how) { (void)file; (void)how; errno = ENOSYS; return -1; }\n"


def run(command, folder, gelsim, **variables):
    """A command that is to succeed, of a task with these variables."""
    texts = {name: str(value) for name, value in variables.items()}
    done = subprocess.run(command, cwd=folder, env=environment(gelsim, **texts), capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stderr}"


def table(folder, gelsim, scheduler):
    (part,) = re.findall(rf"^\| {scheduler} \|.*\| `(.+)` \|$", PAGE, re.M)
    for task in range(TASKS):
        command = f"gelsim generate job.toml --out out --partition {part}"
        run(["sh", "-c", command], folder, gelsim, **VARIABLES[scheduler](task))


def indexed_job(folder, gelsim):
    job, finalize = (yaml.safe_load((CLUSTER / name).read_text()) for name in ["indexed-job.yaml", "finalize-job.yaml"])
    (container,) = job["spec"]["template"]["spec"]["containers"]
    (rule, _) = job["spec"]["podFailurePolicy"]["rules"]
    variables = {variable["name"]: variable["value"] for variable in container["env"]}
    assert job["spec"]["completionMode"] == "Indexed" and job["spec"]["completions"] == int(variables["PARTS"])
    assert container["resources"]["requests"]["cpu"] == variables["THREADS"]
    assert rule["onExitCodes"]["containerName"] == container["name"]
    for index in range(job["spec"]["completions"]):
        run(container["command"] + container["args"], folder, gelsim, JOB_COMPLETION_INDEX=index, **variables)
    (last,) = finalize["spec"]["template"]["spec"]["containers"]
    for one, other in [(last["image"], container["image"]), (last["volumeMounts"], container["volumeMounts"])]:
        assert one == other
    run(last["command"], folder, gelsim)


def shell(folder, gelsim, what):
    """A block of the page, with an `ssh` that goes nowhere."""
    (block,) = [block for block in re.findall(r"^```sh\n(.*?)^```$", PAGE, re.M | re.S) if what in block]
    ssh = folder.parent / "bin" / "ssh"
    ssh.parent.mkdir(exist_ok=True)
    ssh.write_text(SSH)
    ssh.chmod(0o755)
    shutil.copy(gelsim, ssh.parent / "gelsim")
    (folder / "hosts").write_text("node0\nnode1\n")
    run(["sh", "-ec", block], folder, ssh.parent / "gelsim", PARALLEL_SSH=ssh, PARALLEL_HOME=folder.parent / "parallel")
    (folder / "hosts").unlink()


def separate_disks(folder, gelsim):
    for task in range(3):
        run(["gelsim", "generate", "job.toml", "--out", f"part{task}", "--partition", f"{task}/3"], folder, gelsim)
    for task in [2, 0, 1]:
        shutil.copytree(folder / f"part{task}", folder / "out", dirs_exist_ok=True)
    run(["gelsim", "finalize", "out"], folder, gelsim)


def more_later(folder, gelsim):
    """Half the samples in three parts, then all of them in eight."""
    for parts, more in [(3, ["--samples", "390"]), (TASKS, [])]:
        for part in range(parts):
            which = ["--partition", f"{part}/{parts}"]
            run(["gelsim", "generate", "job.toml", "--out", "out", *which, *more], folder, gelsim)


def no_locks(folder, gelsim):
    """A file system without locks; and two processes that then make the same shards at the same time."""
    shim = folder.parent / "no_locks.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-x", "c", "-o", shim, "-"], input=NO_LOCKS, text=True, check=True)
    command = [gelsim, "generate", "job.toml", "--out", "out", "--quiet"]
    twice = [subprocess.Popen(command, cwd=folder, env=environment(gelsim, LD_PRELOAD=str(shim))) for _ in range(2)]
    assert {one.wait() for one in twice} <= {0, 1}
    run(["gelsim", "generate", "job.toml", "--out", "out"], folder, gelsim, LD_PRELOAD=shim)


def main():
    gelsim = pathlib.Path(sys.argv[1]).resolve()
    recipes = {name: lambda *where, name=name: table(*where, name) for name in VARIABLES}
    recipes |= {"Kubernetes": indexed_job, "separate disks": separate_disks}
    recipes |= {"more samples later": more_later, "no locks": no_locks}
    recipes["ssh"] = lambda *where: shell(*where, 'ssh "$host"')
    if shutil.which("parallel"):
        recipes["GNU parallel"] = lambda *where: shell(*where, "parallel")
    assert set(VARIABLES) == set(re.findall(r"^\| ([^|]+) \|.*\| `\"\$.*` \|$", PAGE, re.M))
    size = {"samples": 800, "width": 48, "height": 36}
    with tempfile.TemporaryDirectory() as temporary:
        root = pathlib.Path(temporary)
        reference = single(root / "single", gelsim, **size)
        for number, (name, recipe) in enumerate(recipes.items()):
            folder = prepare(root / f"recipe{number}", **size)
            recipe(folder, gelsim)
            assert_same(folder / "out", reference)
            print(f"{name}: the single run's bytes")


if __name__ == "__main__":
    main()
