#!/usr/bin/env bash
# A batch by GNU parallel: on the cores of this machine, or on several machines by ssh.
#
#   examples/cluster/parallel.sh requests.jsonl motions --format glb,npy
#   SHARDS=32 examples/cluster/parallel.sh requests.jsonl motions                # more parts than machines even out their speeds
#   PARALLEL='--sshlogin 4/node1,4/node2 --workdir .' examples/cluster/parallel.sh …  # needs a folder that all machines share
#
# A part that fails is begun again, three times in all (ATTEMPTS); what is finished is not made again.
set -euo pipefail

if [ $# -lt 2 ]; then
    echo "usage: $0 REQUESTS FOLDER [OPTIONS OF lamogen batch]" >&2
    exit 2
fi
requests=$1 folder=$2
shift 2
shards=${SHARDS:-$(nproc)}
lamogen=${LAMOGEN:-lamogen}

# One core a part: parts side by side are faster than threads within one.
seq "$shards" | parallel --will-cite --retries "${ATTEMPTS:-3}" --line-buffer --tag \
    env RAYON_NUM_THREADS=1 "$lamogen" batch "$requests" --out "$folder" --shard "{}/$shards" --quiet "$@" ||
    echo "some parts failed" >&2
"$lamogen" batch "$requests" --out "$folder" "$@" --merge
