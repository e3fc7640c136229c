"""docs/cluster/ray_driver.py on a Ray cluster of two nodes, one of which is lost: the single run's bytes."""

import os
import subprocess
import sys
import tempfile

import pytest
from processes import PATIENCE_S, adopted, caught, descendants, finished, kill
from sets import PROJECT, assert_same, generate_alone, prepare

pytestmark = pytest.mark.full


@pytest.fixture
def nodes():
    """The cluster's address, and the process of its second node."""
    # Ray listens on loopback only, and tells nobody of it.
    quiet = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_USAGE_STATS_ENABLED": "0"}
    # The names of its sockets are long, and may have 107 characters at most.
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="ray", dir="/tmp") as folder:
        for name, value in {**quiet, "RAY_TMPDIR": folder}.items():
            patch.setenv(name, value)
        utils = pytest.importorskip("ray.cluster_utils", reason="no ray: pip install ray")
        with adopted():
            node = {"num_cpus": 2, "object_store_memory": 80_000_000}
            cluster = utils.Cluster(initialize_head=True, head_node_args={**node, "include_dashboard": False})
            second = cluster.add_node(**node)
            cluster.wait_for_nodes()
            (raylet,) = [info.process.pid for info in second.all_processes["raylet"]]
            yield cluster.address, raylet


def drive(folder, address, *arguments):
    line = [sys.executable, PROJECT / "docs/cluster/ray_driver.py", "job.toml", "out"]
    line += ["--parts", "8", "--threads", "2", *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(line, cwd=folder, env={**os.environ, "RAY_ADDRESS": address}, **pipes)


def test_parts_of_a_lost_node_go_on_elsewhere(nodes, run_gelsim, tmp_path):
    address, raylet = nodes
    reference, folder = generate_alone(run_gelsim, tmp_path / "single"), prepare(tmp_path / "lost")
    driver = drive(folder, address)
    caught(folder, lambda process: process in descendants(raylet))
    kill([raylet, *descendants(raylet)])
    before = finished(folder)
    assert 0 < len(before) < len(finished(reference.parent))
    said, _ = driver.communicate(timeout=PATIENCE_S)
    assert driver.returncode == 0 and "8 of 8 parts" in said, said
    assert_same(folder / "out", reference)


def test_no_parts_are_refused(nodes, tmp_path):
    driver = drive(prepare(tmp_path / "wrong"), nodes[0], "--parts", "0")
    said, _ = driver.communicate(timeout=PATIENCE_S)
    assert driver.returncode != 0, said
