#!/usr/bin/env bash
# A matrix by as many processes as `mpirun` starts: each computes one share of the rows into one shared directory.
#
#   mpirun -n 4 ./mpi.sh city.obj city.hemicube [OPTIONS OF COMPUTE] && hemicube merge city.hemicube
#
# The processes do not talk to each other: MPI only starts them and numbers them (OMPI_COMM_WORLD_RANK, PMI_RANK; `srun`
# says SLURM_PROCID), and `--shard auto` reads that.
set -euo pipefail

scene=$1
matrix=$2
shift 2
exec "${HEMICUBE:-hemicube}" compute "$scene" -o "$matrix" --shard auto --threads "${THREADS:-1}" "$@"
