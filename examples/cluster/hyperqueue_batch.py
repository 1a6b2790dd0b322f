#!/usr/bin/env python3
"""A batch as tasks of HyperQueue: every task makes its part of the requests, and a task that fails is submitted again.

    pip install hyperqueue
    python examples/cluster/hyperqueue_batch.py requests.jsonl motions --shards 8 -- --format glb,npy

Without --server the tasks run on this machine. With --server they go to a HyperQueue server that runs already, such as one
whose workers were started on a cluster by `hq alloc` or `hq worker start`: --server is its server directory, the folder that
`hq server start --server-dir FOLDER` was given. Requests and folder must then be on storage that all machines share.
"""

import argparse
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

from hyperqueue import Client, Job, LocalCluster
from hyperqueue.cluster import WorkerConfig
from hyperqueue.ffi.protocol import ResourceRequest


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.usage = "%(prog)s [OPTIONS] REQUESTS FOLDER [-- OPTIONS OF lamogen batch]"
    parser.add_argument("requests", type=Path, help="the requests, one JSON object a line")
    parser.add_argument("folder", type=Path, help="folder for the motions")
    parser.add_argument("--shards", type=int, default=8, help="how many tasks (8)")
    parser.add_argument("--cores", type=int, default=1, help="CPU cores of a task (1)")
    parser.add_argument("--attempts", type=int, default=3, help="how often a task is begun (3)")
    parser.add_argument("--server", type=Path, help="server directory of a HyperQueue server that runs already")
    parser.add_argument("--lamogen", default="lamogen", help="the program")
    # What follows -- are options of lamogen batch.
    own, options = split(sys.argv[1:])
    arguments = parser.parse_args(own)

    if not arguments.requests.is_file():
        parser.error(f"{arguments.requests}: expected a file of requests")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    batch = [
        arguments.lamogen,
        "batch",
        str(arguments.requests.resolve()),
        "--out",
        str(arguments.folder.resolve()),
        *options,
    ]
    with connect(arguments.server) as client:
        shards = list(range(1, arguments.shards + 1))
        for attempt in range(1, arguments.attempts + 1):
            shards = failed(client, batch, shards, arguments)
            if not shards:
                break
            print(f"attempt {attempt}: {len(shards)} of {arguments.shards} shards failed: {shards}", file=sys.stderr)
    # Whether everything is there, whatever became of the tasks.
    return subprocess.run([*batch, "--merge"], check=False).returncode


@contextmanager
def connect(server):
    """A client of the server in this folder, or of one of our own with a worker on this machine."""
    if server is not None:
        yield Client(server)
        return
    with LocalCluster() as cluster:
        cluster.start_worker(WorkerConfig(cores=os.cpu_count()))
        yield cluster.client()


def failed(client, batch, shards, arguments):
    """Runs a task for each of these shards; returns the shards whose tasks failed."""
    job = Job(max_fails=None, name="lamogen")
    for shard in shards:
        job.program(
            [*batch, "--shard", f"{shard}/{arguments.shards}", "--quiet"],
            name=f"shard {shard}",
            env={"RAYON_NUM_THREADS": str(arguments.cores)},
            stdout=None,
            stderr=str((arguments.folder / f"shard-{shard}.log").resolve()),
            resources=ResourceRequest(cpus=arguments.cores),
        )
    submitted = client.submit(job)
    client.wait_for_jobs([submitted], raise_on_error=False)
    # Tasks are numbered in the order in which they were added.
    return sorted(shards[task] for task in client.get_failed_tasks(submitted))


def split(arguments):
    """The arguments before a --, and those after it."""
    if "--" not in arguments:
        return arguments, []
    place = arguments.index("--")
    return arguments[:place], arguments[place + 1 :]


if __name__ == "__main__":
    sys.exit(main())
