#!/usr/bin/env bash
# A matrix by a Slurm array: each task computes one share of the rows into one shared directory, and a last job merges.
#
#   sbatch --array=0-15 slurm-array.sh city.obj city.hemicube [OPTIONS OF COMPUTE]
#   sbatch --dependency=afterok:JOBID --wrap 'hemicube merge city.hemicube'
#
# A task that is killed or preempted is requeued and goes on with the parts that it had: give all tasks of an array the
# same options. `--shard auto` reads the task's number from SLURM_ARRAY_TASK_ID; number tasks without gaps. Options here
# are defaults of this script; those of the command line win.
#SBATCH --job-name=hemicube
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:TERM@60
set -euo pipefail

scene=$1
matrix=$2
shift 2

# `exec`, so that Slurm's signals reach the program: at SIGTERM it finishes the part that it is at, and keeps it.
exec "${HEMICUBE:-hemicube}" compute "$scene" -o "$matrix" --shard auto --threads "${SLURM_CPUS_PER_TASK:-1}" "$@"
