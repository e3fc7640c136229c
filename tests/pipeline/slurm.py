"""docs/cluster/gelsim.sbatch under a real Slurm: every dataset it makes is the single run's, byte for byte.

    python slurm.py GELSIM

Three virtual nodes on this machine, with a munge of their own; all of it listens on loopback, keeps its state in a
temporary folder and is gone when the test ends. Needs root and Debian's slurm-wlm and munge; says so without them.
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
import time

from processes import adopt, caught, descendants, finished, kill, kill_descendants, parent, wait
from sets import REPOSITORY, assert_same, environment, prepare, single

SCRIPT = REPOSITORY / "docs/cluster/gelsim.sbatch"
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
    """A cluster of three nodes. A context manager, so that nothing of it stays."""

    def __init__(self, root, gelsim):
        self.root = root
        self.environment = environment(gelsim, SLURM_CONF=str(root / "slurm.conf"))
        self.daemons = {}

    def __enter__(self):
        adopt()
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
        for node in NODES:
            self.start("slurmd", "-D", "-N", node, name=node)
        wait(lambda: self.ask("sinfo", "-h", "-o", "%T %D").split() == ["idle", "3"], "three idle nodes")
        return self

    def __exit__(self, kind, *_):
        kill_descendants()
        if kind:
            print((self.root / "slurmctld.log").read_text()[-4000:])

    def start(self, program, *arguments, name=None):
        log = open(self.root / f"{name or program}.out", "wb")
        self.daemons[name or program] = subprocess.Popen(
            [f"/usr/sbin/{program}", *arguments], env=self.environment, stdout=log, stderr=log
        )

    def ask(self, *command, cwd=None):
        """What a command of Slurm's prints."""
        done = subprocess.run(command, cwd=cwd, env=self.environment, capture_output=True, text=True)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        return done.stdout

    def submit(self, folder):
        """Submits as the script's head says; the numbers of the array and of the job that describes the whole."""
        shutil.copy(SCRIPT, folder)
        words = self.ask("bash", "gelsim.sbatch", cwd=folder).split()
        return words[1].rstrip(","), words[-1]

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


def array_over_three_nodes(slurm, folder, reference):
    array, last = slurm.submit(folder)
    described = slurm.ended(last)
    tasks = slurm.ended(array)
    assert [task["JobState"] for task in tasks + described] == ["COMPLETED"] * 9, tasks + described
    assert sorted({task["NodeList"] for task in tasks}) == NODES, tasks
    assert_same(folder / "out", reference)


def node_lost(slurm, folder, reference):
    array, last = slurm.submit(folder)
    process = caught(folder)
    node = node_of(process)
    slurm.kill_node(node)
    before = finished(folder)
    assert 0 < len(before) < len(finished(reference.parent)), before
    slurm.ended(last)
    tasks = slurm.ended(array)
    assert {task["JobState"] for task in tasks} == {"COMPLETED"}, tasks
    again = [task for task in tasks if task["Restarts"] != "0"]
    assert again and node not in {task["NodeList"] for task in again}, tasks
    assert_same(folder / "out", reference)
    slurm.start("slurmd", "-D", "-N", node, name=node)
    slurm.ask("scontrol", "update", f"nodename={node}", "state=resume")
    print(f"  node {node} and its process {process} killed; task {again[0]['ArrayTaskId']} went on {again[0]['NodeList']}")


def cancelled_and_submitted_again(slurm, folder, reference):
    array, last = slurm.submit(folder)
    process = caught(folder)
    slurm.ask("scancel", array)
    os.kill(process, signal.SIGCONT)
    (described,) = slurm.ended(last)
    tasks = slurm.ended(array)
    log = (folder / f"slurm-{last}.out").read_text()
    assert described["JobState"] == "FAILED" and "missing" in log, (described, log)
    assert "CANCELLED" in {task["JobState"] for task in tasks}, tasks
    logs = "".join(path.read_text() for path in folder.glob(f"slurm-{array}_*.out"))
    assert "stopped; finished shards stay" in logs, logs
    before = {name: (folder / f"out/data/{name}.tar").stat().st_ino for name in finished(folder)}
    assert 0 < len(before) < len(finished(reference.parent)), before
    array, last = slurm.submit(folder)
    assert slurm.ended(last)[0]["JobState"] == "COMPLETED"
    assert before.items() <= {name: (folder / f"out/data/{name}.tar").stat().st_ino for name in finished(folder)}.items()
    assert_same(folder / "out", reference)
    print(f"  cancelled with {len(before)} shards of {len(finished(folder))} done")


def other_arrays(slurm, folder, reference):
    shutil.copy(SCRIPT, folder)
    array = slurm.ask("sbatch", "--parsable", "--array=1,2,4", "gelsim.sbatch", cwd=folder).strip()
    tasks = slurm.ended(array)
    assert {task["ExitCode"] for task in tasks} == {"2:0"} and not (folder / "out").exists(), tasks
    array = slurm.ask("sbatch", "--parsable", "--array=5-25:10%2", "gelsim.sbatch", cwd=folder).strip()
    tasks = slurm.ended(array)
    assert [task["JobState"] for task in tasks] == ["COMPLETED"] * 3, tasks
    assert_same(folder / "out", reference)


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


def main():
    missing = [name for name in ["munged", "slurmctld", "slurmd"] if not pathlib.Path("/usr/sbin", name).exists()]
    if missing or os.geteuid() != 0:
        print(f"skipped: {', '.join(missing) + ' not installed' if missing else 'needs root'}")
        return
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    gelsim = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as temporary:
        root = pathlib.Path(temporary)
        reference = single(root / "single", gelsim)
        with Slurm(root, gelsim) as slurm:
            for case in [array_over_three_nodes, node_lost, cancelled_and_submitted_again, other_arrays]:
                start = time.monotonic()
                case(slurm, prepare(root / case.__name__), reference)
                print(f"{case.__name__}: the single run's bytes, {time.monotonic() - start:.1f} s", flush=True)


if __name__ == "__main__":
    main()
