//! Programs of others: SciPy, VTK, solvers, Slurm and MPI, GDAL and xarray, a browser, an X server.

mod cluster;
mod formats;
mod live;
mod maps;
mod python;
mod report;
mod solvers;
