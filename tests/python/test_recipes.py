"""What docs/how-to/cluster.md says of schedulers that are not at hand: each task's command under `sh` and its variables.

Every dataset made so is the single run's, byte for byte.
"""

import os
import re
import shutil
import subprocess

import pytest
from processes import run
from sets import PROJECT, assert_same, generate_alone, prepare

CLUSTER = PROJECT / "docs/cluster"
TASKS = 8
GENERATE = ["gelsim", "generate", "job.toml"]
SIZE = {"samples": 800, "width": 48, "height": 36}
# What each scheduler sets for task number i of eight.
VARIABLES = {
    "AWS Batch, array job": lambda i: {"AWS_BATCH_JOB_ARRAY_INDEX": i, "AWS_BATCH_JOB_ARRAY_SIZE": 8},
    "Google Batch": lambda i: {"BATCH_TASK_INDEX": i, "BATCH_TASK_COUNT": 8},
    "Grid Engine": lambda i: {"SGE_TASK_ID": i + 1, "SGE_TASK_FIRST": 1, "SGE_TASK_LAST": 8, "SGE_TASK_STEPSIZE": 1},
    "LSF": lambda i: {"LSB_JOBINDEX": i + 1, "LSB_JOBINDEX_END": 8},
    "PBS": lambda i: {"PBS_ARRAY_INDEX": i},
}
# Runs what is for another machine on this one; SHELL is set as sshd sets it (a CI has none, GNU parallel asks).
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


@pytest.fixture(scope="module")
def page():
    return (PROJECT / "docs/how-to/cluster.md").read_text()


@pytest.fixture(scope="module")
def reference(run_gelsim, tmp_path_factory):
    return generate_alone(run_gelsim, tmp_path_factory.mktemp("reference") / "single", **SIZE)


@pytest.fixture
def folder(tmp_path):
    return prepare(tmp_path / "recipe", **SIZE)


def with_variables(variables):
    return {**os.environ, **{name: str(value) for name, value in variables.items()}}


def run_task(command, folder, **variables):
    run(*command, cwd=folder, env=with_variables(variables))


def test_every_scheduler_of_the_page_is_tried(page):
    assert set(re.findall(r"^\| ([^|]+) \|.*\| `\"\$.*` \|$", page, re.M)) == set(VARIABLES)


@pytest.mark.parametrize("scheduler", VARIABLES)
def test_tasks_of_a_scheduler_make_the_single_runs_bytes(page, folder, reference, scheduler):
    (part,) = re.findall(rf"^\| {scheduler} \|.*\| `(.+)` \|$", page, re.M)
    command = ["sh", "-c", f"gelsim generate job.toml --out out --partition {part}"]
    for task in range(TASKS):
        run_task(command, folder, **VARIABLES[scheduler](task))
    assert_same(folder / "out", reference)


@pytest.fixture
def kubernetes():
    """The job of the parts, the one that describes the dataset, and the container of each."""
    yaml = pytest.importorskip("yaml", reason="no PyYAML: pip install pyyaml")
    jobs = [yaml.safe_load((CLUSTER / name).read_text()) for name in ["indexed-job.yaml", "finalize-job.yaml"]]
    containers = [job["spec"]["template"]["spec"]["containers"] for job in jobs]
    assert [len(each) for each in containers] == [1, 1]
    return *jobs, *(each for (each,) in containers)


def variables_of(container):
    return {variable["name"]: variable["value"] for variable in container["env"]}


def test_a_kubernetes_job_makes_the_single_runs_bytes(kubernetes, folder, reference):
    job, _, container, last = kubernetes
    command = container["command"] + container["args"]
    for index in range(job["spec"]["completions"]):
        run_task(command, folder, JOB_COMPLETION_INDEX=index, **variables_of(container))
    run_task(last["command"], folder)
    assert_same(folder / "out", reference)


def test_a_kubernetes_jobs_numbers_agree(kubernetes):
    job, _, container, _ = kubernetes
    variables = variables_of(container)
    assert job["spec"]["completionMode"] == "Indexed" and job["spec"]["completions"] == int(variables["PARTS"])
    assert container["resources"]["requests"]["cpu"] == variables["THREADS"]


def test_a_kubernetes_jobs_rules_are_for_its_container(kubernetes):
    job, _, container, _ = kubernetes
    rule, _ = job["spec"]["podFailurePolicy"]["rules"]
    assert rule["onExitCodes"]["containerName"] == container["name"]


def test_both_kubernetes_jobs_have_the_same_image_and_volumes(kubernetes):
    _, _, container, last = kubernetes
    assert (last["image"], last["volumeMounts"]) == (container["image"], container["volumeMounts"])


@pytest.mark.parametrize("what", ['ssh "$host"', "parallel"], ids=["ssh", "GNU parallel"])
def test_a_shells_block_makes_the_single_runs_bytes(page, folder, reference, tmp_path, gelsim_path, what):
    """With an `ssh` that goes nowhere."""
    if what == "parallel" and not shutil.which("parallel"):
        pytest.skip("no GNU parallel: apt install parallel")
    (block,) = [block for block in re.findall(r"^```sh\n(.*?)^```$", page, re.M | re.S) if what in block]
    ssh = tmp_path / "bin/ssh"
    ssh.parent.mkdir()
    ssh.write_text(SSH)
    ssh.chmod(0o755)
    shutil.copy(gelsim_path, ssh.with_name("gelsim"))
    (folder / "hosts").write_text("node0\nnode1\n")
    path = f"{ssh.parent}:{os.environ['PATH']}"
    run_task(["sh", "-ec", block], folder, PATH=path, PARALLEL_SSH=ssh, PARALLEL_HOME=tmp_path / "parallel")
    assert_same(folder / "out", reference)


def test_parts_on_separate_disks_are_put_together_in_any_order(folder, reference):
    for task in range(3):
        run_task([*GENERATE, "--out", f"part{task}", "--partition", f"{task}/3"], folder)
    for task in [2, 0, 1]:
        shutil.copytree(folder / f"part{task}", folder / "out", dirs_exist_ok=True)
    run_task(["gelsim", "finalize", "out"], folder)
    assert_same(folder / "out", reference)


def test_more_samples_later_may_come_in_another_number_of_parts(folder, reference):
    for parts, more in [(3, ["--samples", "390"]), (TASKS, [])]:
        for part in range(parts):
            run_task([*GENERATE, "--out", "out", "--partition", f"{part}/{parts}", *more], folder)
    assert_same(folder / "out", reference)


def test_two_processes_without_locks_make_the_single_runs_bytes(folder, reference, tmp_path):
    """The same shards at the same time."""
    if not shutil.which("cc"):
        pytest.skip("no C compiler: apt install gcc")
    shim = tmp_path / "no_locks.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-x", "c", "-o", shim, "-"], input=NO_LOCKS, text=True, check=True)
    command = [*GENERATE, "--out", "out", "--quiet"]
    twice = [subprocess.Popen(command, cwd=folder, env=with_variables({"LD_PRELOAD": shim})) for _ in range(2)]
    assert {one.wait() for one in twice} <= {0, 1}
    run_task(command, folder, LD_PRELOAD=shim)
    assert_same(folder / "out", reference)
