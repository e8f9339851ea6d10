#!/usr/bin/env bash
# Within slurm.sh: an array of 16 tasks computes a matrix; one is killed in the middle, another is requeued while it runs,
# and Slurm starts both again. array.sh JOB-SCRIPT SCENE MATRIX [OPTIONS OF COMPUTE]; HEMICUBE is the program.
set -euo pipefail
script=$1
scene=$2
matrix=$3
shift 3

job=$(sbatch --parsable --chdir="$PWD" --output="$PWD/task-%a.log" --array=0-15 "$script" "$scene" "$matrix" "$@")
state() { squeue -h -r -j "$job" -t all -o '%K %T' | awk -v task="$1" '$1 == task { print $2 }'; }
# Task T has the parts T, T + 16, T + 32…
part() { printf '%s/parts/part-%05d.npz' "$matrix" "$1"; }
wait_for() {
    for _ in $(seq 6000); do
        "$@" && return 0
        sleep 0.02
    done
    printf 'array.sh: never: %s\n' "$*" >&2
    squeue -r -j "$job" -t all >&2
    return 1
}

# Slurm lets a task that is requeued wait for two minutes, unless it is told not to.
is_pending() { [ "$(state "$1")" = PENDING ]; }
requeue() {
    scontrol requeue "${job}_$1"
    wait_for is_pending "$1"
    scontrol update "JobId=${job}_$1" StartTime=now
}

wait_for test -e "$(part 3)"
scancel --signal=KILL --batch "${job}_3"
is_over() { case $(state 3) in FAILED | CANCELLED | COMPLETED | NODE_FAIL) ;; *) return 1 ;; esac; }
wait_for is_over
killed=$(state 3)
[ "$killed" = FAILED ] || { printf 'array.sh: task 3 was to be killed and is %s\n' "$killed" >&2; exit 1; }
requeue 3

wait_for test -e "$(part 9)"
[ "$(state 9)" = RUNNING ] || { printf 'array.sh: task 9 ended too soon to be requeued\n' >&2; exit 1; }
requeue 9

all_done() { [ "$(squeue -h -r -j "$job" -t all -o %T | grep -vc COMPLETED)" = 0 ]; }
for _ in $(seq 3000); do all_done && break; sleep 0.1; done
squeue -h -r -j "$job" -t all -o '%K %T' | sort -n | tr '\n' ' '
for task in 3 9; do
    restarts=$(scontrol show job "${job}_$task" | sed -n 's/.*Restarts=\([0-9]*\).*/\1/p')
    printf 'task %s: %s restarts\n' "$task" "$restarts"
    [ "$restarts" = 1 ]
done
all_done
