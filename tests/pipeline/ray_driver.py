"""docs/cluster/ray_driver.py on a Ray cluster of two nodes, one of which is lost: the single run's bytes.

    python ray_driver.py GELSIM

Needs the package ray; says so without it.
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import time

from processes import PATIENCE_S, adopt, caught, descendants, finished, kill, kill_descendants
from sets import REPOSITORY, assert_same, environment, prepare, single

# Ray is to listen on loopback only, and to tell nobody of it.
os.environ |= {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_USAGE_STATS_ENABLED": "0"}
try:
    from ray.cluster_utils import Cluster
except ModuleNotFoundError:
    print("skipped: no package ray")
    sys.exit()


def drive(folder, gelsim, address, *arguments):
    driver = REPOSITORY / "docs/cluster/ray_driver.py"
    command = [sys.executable, driver, "job.toml", "out", "--parts", "8", "--threads", "2", *arguments]
    return subprocess.Popen(
        command, cwd=folder, env=environment(gelsim, RAY_ADDRESS=address), stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True,
    )


def main():
    gelsim = pathlib.Path(sys.argv[1]).resolve()
    # Workers take the path from their node.
    os.environ.update(environment(gelsim))
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as temporary:
        root = pathlib.Path(temporary)
        os.environ["RAY_TMPDIR"] = temporary
        reference = single(root / "single", gelsim)
        folder = prepare(root / "lost")
        adopt()
        try:
            node = {"num_cpus": 2, "object_store_memory": 80_000_000}
            cluster = Cluster(initialize_head=True, head_node_args={**node, "include_dashboard": False})
            second = cluster.add_node(**node)
            cluster.wait_for_nodes()
            (raylet,) = [info.process.pid for info in second.all_processes["raylet"]]
            driver = drive(folder, gelsim, cluster.address)
            process = caught(folder, lambda process: process in descendants(raylet))
            kill([raylet, *descendants(raylet)])
            before = finished(folder)
            assert 0 < len(before) < len(finished(reference.parent)), before
            said, _ = driver.communicate(timeout=PATIENCE_S)
            assert driver.returncode == 0 and "8 of 8 parts" in said, said
            assert_same(folder / "out", reference)

            wrong = drive(prepare(root / "wrong"), gelsim, cluster.address, "--parts", "0")
            said, _ = wrong.communicate(timeout=PATIENCE_S)
            assert wrong.returncode != 0, said
        finally:
            kill_descendants()
    print(f"ray: node and process {process} killed with {len(before)} shards done; the single run's bytes, "
          f"{time.monotonic() - start:.1f} s")


if __name__ == "__main__":
    main()
