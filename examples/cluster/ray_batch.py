#!/usr/bin/env python3
"""A batch as tasks of Ray: every task makes its part of the requests, and Ray begins a task again whose machine was lost or that failed.

    pip install ray
    python examples/cluster/ray_batch.py requests.jsonl motions --shards 8 -- --format glb,npy

Requests and folder must be on storage that all machines of the Ray cluster share, and `lamogen` on all of them.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import ray


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.usage = "%(prog)s [OPTIONS] REQUESTS FOLDER [-- OPTIONS OF lamogen batch]"
    parser.add_argument("requests", type=Path, help="the requests, one JSON object a line")
    parser.add_argument("folder", type=Path, help="folder for the motions")
    parser.add_argument("--shards", type=int, default=8, help="how many tasks (8)")
    parser.add_argument("--cores", type=int, default=1, help="CPU cores of a task (1)")
    parser.add_argument("--attempts", type=int, default=3, help="how often a task is begun (3)")
    parser.add_argument("--address", help="address of a Ray cluster (one of its own on this machine)")
    parser.add_argument("--lamogen", default="lamogen", help="the program")
    # What follows -- are options of lamogen batch.
    own, options = split(sys.argv[1:])
    arguments = parser.parse_args(own)

    ray.init(address=arguments.address)
    batch = [
        arguments.lamogen,
        "batch",
        str(arguments.requests.resolve()),
        "--out",
        str(arguments.folder.resolve()),
        *options,
    ]

    @ray.remote(num_cpus=arguments.cores, max_retries=arguments.attempts - 1, retry_exceptions=True)
    def make(shard: int) -> None:
        command = [*batch, "--shard", f"{shard}/{arguments.shards}", "--quiet"]
        subprocess.run(command, check=True, env={**os.environ, "RAYON_NUM_THREADS": str(arguments.cores)})

    tasks = [make.remote(shard) for shard in range(1, arguments.shards + 1)]
    for task in tasks:
        try:
            ray.get(task)
        except ray.exceptions.RayError as error:
            print(error, file=sys.stderr)
    # Whether everything is there, whatever became of the tasks.
    return subprocess.run([*batch, "--merge"], check=False).returncode


def split(arguments):
    """The arguments before a --, and those after it."""
    if "--" not in arguments:
        return arguments, []
    place = arguments.index("--")
    return arguments[:place], arguments[place + 1 :]


if __name__ == "__main__":
    sys.exit(main())
