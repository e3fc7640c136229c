"""docs/cluster/gelsim.sbatch under a real Slurm: every dataset it makes is the single run's, byte for byte.

Three virtual nodes on this machine, with a munge of their own; all of it listens on loopback, keeps its state in a
temporary folder and is gone when the tests end.
"""

import contextlib
import os
import pathlib
import shutil
import signal
import socket
import subprocess

import pytest
from processes import adopted, caught, descendants, finished, kill, parent, run, wait
from sets import PROJECT, assert_same, generate_alone, prepare

SCRIPT = PROJECT / "docs/cluster/gelsim.sbatch"
NODES = ["n1", "n2", "n3"]
CONF = """\
ClusterName=gelsim
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={root}/munge.socket,cred_expire=8
StateSaveLocation={root}/state
SlurmdSpoolDir={root}/spool.%n
SlurmctldPidFile={root}/slurmctld.pid
SlurmdPidFile={root}/slurmd.%n.pid
SlurmctldLogFile={root}/slurmctld.log
SlurmdLogFile={root}/slurmd.%n.log
SlurmdParameters=config_overrides
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_interval=1,bf_interval=1
ReturnToService=2
KillWait=5
MailProg=/bin/true
{nodes}
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE
"""


class Slurm:
    """A cluster of three nodes."""

    def __init__(self, root):
        self.root, self.daemons = root, {}
        self.environment = {**os.environ, "SLURM_CONF": str(root / "slurm.conf")}

    def begin(self):
        ports = free_ports(1 + len(NODES))
        host = socket.gethostname().split(".")[0]
        line = "NodeName={} NodeHostname={} NodeAddr=127.0.0.1 Port={} CPUs=4 RealMemory=4000"
        nodes = "\n".join(line.format(node, host, port) for node, port in zip(NODES, ports[1:]))
        (self.root / "slurm.conf").write_text(CONF.format(host=host, ports=ports, root=self.root, nodes=nodes))
        (self.root / "state").mkdir()
        key = self.root / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        files = [f"--{name}-file={self.root}/munge.{name}" for name in ["key", "log", "pid", "seed"]]
        self.start("munged", "--foreground", "--force", f"--socket={self.root}/munge.socket", *files)
        wait(lambda: (self.root / "munge.socket").exists(), "munge")
        self.start("slurmctld", "-D", "-c")
        self.start_nodes(NODES)

    def start_nodes(self, nodes):
        """Starts the daemons of nodes; a node that was down returns to service when its daemon registers."""
        for node in nodes:
            self.start("slurmd", "-D", "-N", node, name=node)
        wait(lambda: self.ask("sinfo", "-h", "-o", "%T %D").split() == ["idle", "3"], "three idle nodes")

    def start(self, program, *arguments, name=None):
        log = open(self.root / f"{name or program}.out", "wb")
        self.daemons[name or program] = subprocess.Popen(
            [f"/usr/sbin/{program}", *arguments], env=self.environment, stdout=log, stderr=log
        )

    def ask(self, *command, cwd=None):
        """What a command of Slurm's prints."""
        return run(*command, cwd=cwd, env=self.environment).stdout

    def submit(self, folder):
        """Submits as the script's head says; the numbers of the array and of the job that describes the dataset."""
        shutil.copy(SCRIPT, folder)
        words = self.ask("bash", "gelsim.sbatch", cwd=folder).split()
        return words[1].rstrip(","), words[-1]

    def submit_array(self, folder, numbers):
        shutil.copy(SCRIPT, folder)
        return self.ask("sbatch", "--parsable", f"--array={numbers}", "gelsim.sbatch", cwd=folder).strip()

    def ended(self, job):
        """Waits until a job has ended; the facts that Slurm knows of it, of each task."""
        wait(lambda: not self.ask("squeue", "-h", "-j", job), f"the end of job {job}")
        records = self.ask("scontrol", "-o", "show", "job", job).splitlines()
        return [dict(fact.split("=", 1) for fact in record.split() if "=" in fact) for record in records]

    def kill_node(self, node):
        """What a power cut does: its daemon, its steps and their tasks are gone at once; somebody notices."""
        tasks = [process for process in descendants(os.getpid()) if node_of(process) == node]
        steps = [parent(process) for process in tasks]
        kill([self.daemons[node].pid, *steps, *tasks])
        self.ask("scontrol", "update", f"nodename={node}", "state=down", "reason=power cut")


def node_of(process):
    """The virtual node that a process runs on, if on any."""
    with contextlib.suppress(OSError):
        for fact in pathlib.Path(f"/proc/{process}/environ").read_bytes().split(b"\0"):
            if fact.startswith(b"SLURMD_NODENAME="):
                return fact.partition(b"=")[2].decode()
    return None


def free_ports(count):
    """Ports of loopback on which nobody listens."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    missing = [name for name in ["munged", "slurmctld", "slurmd"] if not pathlib.Path("/usr/sbin", name).exists()]
    if missing:
        pytest.skip(f"no {', '.join(missing)}: apt install slurm-wlm munge")
    if os.geteuid() != 0:
        pytest.skip("Slurm's nodes need root")
    cluster = Slurm(tmp_path_factory.mktemp("slurm"))
    with adopted():
        cluster.begin()
        yield cluster


@pytest.fixture
def slurm(cluster):
    yield cluster
    # Shown where a test fails.
    print((cluster.root / "slurmctld.log").read_text()[-4000:])


@pytest.fixture(scope="module")
def reference(run_gelsim, tmp_path_factory):
    return generate_alone(run_gelsim, tmp_path_factory.mktemp("reference") / "single")


@pytest.fixture
def folder(tmp_path):
    return prepare(tmp_path / "array")


def states(tasks):
    return [task["JobState"] for task in tasks]


def test_an_array_over_three_nodes_makes_the_single_runs_bytes(slurm, folder, reference):
    array, last = slurm.submit(folder)
    described = slurm.ended(last)
    tasks = slurm.ended(array)
    assert states(tasks + described) == ["COMPLETED"] * 9
    assert sorted({task["NodeList"] for task in tasks}) == NODES
    assert_same(folder / "out", reference)


def test_tasks_of_a_lost_node_go_on_elsewhere(slurm, folder, reference):
    array, last = slurm.submit(folder)
    process = caught(folder)
    node = node_of(process)
    slurm.kill_node(node)
    before = finished(folder)
    assert 0 < len(before) < len(finished(reference.parent))
    slurm.ended(last)
    tasks = slurm.ended(array)
    assert set(states(tasks)) == {"COMPLETED"}
    again = [task for task in tasks if task["Restarts"] != "0"]
    assert again and node not in {task["NodeList"] for task in again}
    assert_same(folder / "out", reference)
    slurm.start_nodes([node])


def test_an_array_that_was_cancelled_goes_on_when_it_is_submitted_again(slurm, folder, reference):
    array, last = slurm.submit(folder)
    process = caught(folder)
    slurm.ask("scancel", array)
    os.kill(process, signal.SIGCONT)
    (described,) = slurm.ended(last)
    tasks = slurm.ended(array)
    log = (folder / f"slurm-{last}.out").read_text()
    assert described["JobState"] == "FAILED" and "missing" in log
    assert "CANCELLED" in states(tasks)
    logs = "".join(path.read_text() for path in folder.glob(f"slurm-{array}_*.out"))
    assert "stopped; finished shards stay" in logs
    files = lambda: {name: (folder / f"out/data/{name}.tar").stat().st_ino for name in finished(folder)}
    before = files()
    assert 0 < len(before) < len(finished(reference.parent))
    array, last = slurm.submit(folder)
    assert states(slurm.ended(last)) == ["COMPLETED"]
    assert before.items() <= files().items()
    assert_same(folder / "out", reference)


def test_an_array_with_gaps_is_refused(slurm, folder):
    tasks = slurm.ended(slurm.submit_array(folder, "1,2,4"))
    assert {task["ExitCode"] for task in tasks} == {"2:0"} and not (folder / "out").exists()


def test_an_array_of_other_numbers_makes_the_single_runs_bytes(slurm, folder, reference):
    tasks = slurm.ended(slurm.submit_array(folder, "5-25:10%2"))
    assert states(tasks) == ["COMPLETED"] * 3
    assert_same(folder / "out", reference)
