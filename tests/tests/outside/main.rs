//! Programs of others: SciPy, VTK, solvers, Slurm and MPI, a browser, an X server.

mod cluster;
mod formats;
mod live;
mod python;
mod report;
mod solvers;
