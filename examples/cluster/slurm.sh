#!/usr/bin/env bash
# A batch as a Slurm job array: every task makes its part of the requests, and a task that fails goes back into the queue.
#
#   sbatch --array=1-8 examples/cluster/slurm.sh requests.jsonl motions --format glb,npy
#   lamogen batch requests.jsonl --out motions --format glb,npy --merge      # when the queue is empty: is everything there?
#
# Options of lamogen batch follow the folder. LAMOGEN names another program than `lamogen`, ATTEMPTS how often a task is begun (3).
#SBATCH --job-name=lamogen
#SBATCH --cpus-per-task=2
#SBATCH --mem=1G
#SBATCH --requeue
#SBATCH --open-mode=append
set -uo pipefail

if [ $# -lt 2 ]; then
    echo "usage: sbatch --array=1-N $0 REQUESTS FOLDER [OPTIONS OF lamogen batch]" >&2
    exit 2
fi
if [ -z "${SLURM_ARRAY_TASK_ID:-}" ]; then
    echo "error: expected a task of a job array; submit it by sbatch --array=1-N" >&2
    exit 2
fi
requests=$1 folder=$2
shift 2

"${LAMOGEN:-lamogen}" batch "$requests" --out "$folder" \
    --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --quiet "$@"
code=$?

# 2, 3 and 5: options, requests or data that another attempt does not mend. Whatever else it was, what is finished is not made again.
case $code in
    0 | 2 | 3 | 5) exit $code ;;
esac
if [ "${SLURM_RESTART_COUNT:-0}" -lt $((${ATTEMPTS:-3} - 1)) ]; then
    echo "lamogen batch ended with exit code $code; the task goes back into the queue" >&2
    scontrol requeue "${SLURM_ARRAY_JOB_ID}_${SLURM_ARRAY_TASK_ID}"
    # Slurm ends this attempt.
    sleep 60
fi
exit $code
