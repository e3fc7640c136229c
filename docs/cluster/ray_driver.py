"""Renders one dataset on a Ray cluster: a task for each part, then the index and card of the dataset.

    python ray_driver.py JOB.toml OUT --parts 64 --threads 4

JOB.toml, its meshes and OUT lie in a folder that all nodes share under one name; `gelsim` is on the path of every node.
The part of a node that is lost goes on elsewhere. What is finished stays: the same command goes on after anything.
"""

import argparse
import os
import subprocess
import sys
import time

import ray


class Failed(Exception):
    """A part that may succeed when it is tried again."""


class Wrong(Exception):
    """A mistake in the job or in the command line, which no retry fixes."""


@ray.remote(max_retries=5, retry_exceptions=[Failed])
def part(command):
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True)
    if done.returncode == 2:
        raise Wrong(done.stderr)
    if done.returncode != 0:
        time.sleep(10)  # The locks of a lost node may outlive it.
        raise Failed(done.stderr)


def main():
    parser = argparse.ArgumentParser(description="Render one dataset on a Ray cluster.")
    parser.add_argument("job")
    parser.add_argument("out")
    parser.add_argument("--parts", type=int, required=True, help="no more than the job has shards")
    parser.add_argument("--threads", type=int, default=1, help="of each part; Ray counts them as its CPUs")
    parser.add_argument("--address", help="of the cluster [default: RAY_ADDRESS, or a new one on this machine]")
    arguments = parser.parse_args()
    ray.init(address=arguments.address)
    job, out = os.path.abspath(arguments.job), os.path.abspath(arguments.out)
    command = ["gelsim", "generate", job, "--out", out, "--threads", str(arguments.threads), "--quiet", "--partition"]
    parts = [f"{index}/{arguments.parts}" for index in range(arguments.parts)]
    waiting = [part.options(num_cpus=arguments.threads).remote([*command, which]) for which in parts]
    while waiting:
        (done,), waiting = ray.wait(waiting)
        ray.get(done)
        print(f"{len(parts) - len(waiting)} of {len(parts)} parts", flush=True)
    sys.exit(subprocess.run(["gelsim", "finalize", out]).returncode)


if __name__ == "__main__":
    main()
