"""Form-factor (view-factor) matrices of triangle scenes by the hemicube method.

>>> import hemicube
>>> scene = hemicube.Scene.generate("room", 500)
>>> matrix = hemicube.compute(scene, tolerance=0.05)
>>> matrix.to_scipy().shape == matrix.shape
True

F[i, j] is the fraction of the diffuse energy leaving patch i that reaches patch j directly.
"""

from hemicube._errors import (
    BackendError,
    Error,
    FileError,
    InputError,
    MissingFileError,
    StoreError,
)
from hemicube._meshes import cell_data, from_meshio, from_pyvista, from_trimesh
from hemicube._native import (
    STEFAN_BOLTZMANN,
    Exchange,
    HeatBySurface,
    Matrix,
    Points,
    Rows,
    Scene,
    Sky,
    Solution,
    Zones,
    __version__,
    compute,
    exchange,
    open,
    points,
    sky,
    sky_of_points,
    solve,
    solve_heat,
)

__all__ = [
    "STEFAN_BOLTZMANN",
    "BackendError",
    "Error",
    "Exchange",
    "FileError",
    "HeatBySurface",
    "InputError",
    "Matrix",
    "MissingFileError",
    "Points",
    "Rows",
    "Scene",
    "Sky",
    "Solution",
    "StoreError",
    "Zones",
    "__version__",
    "cell_data",
    "compute",
    "from_meshio",
    "from_pyvista",
    "from_trimesh",
    "exchange",
    "open",
    "points",
    "sky",
    "sky_of_points",
    "solve",
    "solve_heat",
]
