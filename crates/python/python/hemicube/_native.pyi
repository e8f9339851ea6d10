from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_matrix  # type: ignore[import-untyped, unused-ignore]
from typing_extensions import disjoint_base

__version__: str
STEFAN_BOLTZMANN: float

_Axis = Literal["x", "y", "z"]
_Path = str | PathLike[str]
_Floats = NDArray[np.float64]
_Factors = NDArray[np.float32] | NDArray[np.float64]
_Row = tuple[int, NDArray[np.int32] | NDArray[np.int64], _Factors]

@final
class Scene:
    def __new__(
        cls,
        vertices: ArrayLike,
        triangles: ArrayLike,
        *,
        object: ArrayLike | None = None,
        material: ArrayLike | None = None,
        face: ArrayLike | None = None,
        objects: Sequence[str] | None = None,
        materials: Sequence[str] | None = None,
        two_sided: bool | ArrayLike | None = None,
        flip: Sequence[str] | None = None,
        exclude: Sequence[str] | None = None,
        up: _Axis | None = None,
        split: int | None = None,
        patch_size: float | None = None,
        keep_duplicates: bool = False,
    ) -> Scene: ...
    @classmethod
    def load(
        cls,
        path: _Path,
        *,
        scale: float = 1.0,
        two_sided: bool | None = None,
        flip: Sequence[str] | None = None,
        exclude: Sequence[str] | None = None,
        up: _Axis | None = None,
        split: int | None = None,
        patch_size: float | None = None,
        keep_duplicates: bool = False,
        allow_large: bool = False,
    ) -> Scene: ...
    @classmethod
    def generate(cls, kind: str, patches: int, *, seed: int = 1) -> Scene: ...
    def __len__(self) -> int: ...
    @property
    def areas(self) -> _Floats: ...
    @property
    def centroids(self) -> _Floats: ...
    @property
    def normals(self) -> _Floats: ...
    @property
    def corners(self) -> _Floats: ...
    @property
    def face(self) -> NDArray[np.uint32]: ...
    @property
    def object(self) -> NDArray[np.uint32]: ...
    @property
    def material(self) -> NDArray[np.uint32]: ...
    @property
    def side(self) -> NDArray[np.uint8]: ...
    @property
    def objects(self) -> list[str]: ...
    @property
    def materials(self) -> list[str]: ...
    @property
    def losses(self) -> list[dict[str, Any]]: ...
    @property
    def further_names(self) -> dict[int, list[str]]: ...
    @property
    def crs(self) -> str | None: ...
    @property
    def up(self) -> _Axis | None: ...
    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]: ...

@final
class Matrix:
    @property
    def shape(self) -> tuple[int, int]: ...
    def __len__(self) -> int: ...
    @property
    def nnz(self) -> int: ...
    @property
    def names(self) -> list[str] | None: ...
    @property
    def path(self) -> PathLike[str] | None: ...
    @property
    def complete(self) -> bool: ...
    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def areas(self) -> _Floats: ...
    @property
    def row_sums(self) -> _Floats: ...
    @property
    def escaped(self) -> _Floats: ...
    @property
    def blocked(self) -> _Floats: ...
    @property
    def unselected(self) -> _Floats: ...
    @property
    def specular_reflectance(self) -> _Floats: ...
    @property
    def transmittance(self) -> _Floats: ...
    @property
    def passed(self) -> _Floats: ...
    @property
    def cut_off(self) -> _Floats: ...
    @property
    def closure(self) -> _Floats: ...
    @property
    def errors(self) -> _Floats: ...
    @property
    def sum_errors(self) -> _Floats: ...
    @property
    def escaped_errors(self) -> _Floats: ...
    def expected_error(self) -> float | None: ...
    def to_scipy(self) -> csr_matrix: ...
    @property
    def csr(self) -> csr_matrix: ...
    def row(
        self, patch: int
    ) -> tuple[NDArray[np.int32] | NDArray[np.int64], _Factors] | None: ...
    def rows(self, *, stored_order: bool = False) -> Rows: ...
    def __iter__(self) -> Rows: ...
    def multiply(self, x: ArrayLike, *, threads: int = 0) -> _Floats: ...
    def __matmul__(self, x: ArrayLike, /) -> _Floats: ...
    def export(
        self,
        path: _Path,
        *,
        patches: bool = False,
        scene: Scene | None = None,
        values: dict[str, ArrayLike] | None = None,
        show: str | None = None,
        up: _Axis | None = None,
        overwrite: bool = False,
        format: Literal[
            "calculix",
            "elmer",
            "energyplus",
            "openfoam",
            "petsc",
            "udales",
            "view3d",
            "view3d-binary",
        ]
        | None = None,
        by: Literal["patch", "face", "object", "material"] | None = None,
        order: Sequence[str] | None = None,
        zone: str | None = None,
        program_version: str | None = None,
    ) -> int: ...
    def to_pandas(self) -> Any: ...
    def zones(self, by: Literal["object", "material", "face"] = "object") -> Zones: ...
    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]: ...

@final
class Zones:
    @property
    def names(self) -> list[str]: ...
    @property
    def areas(self) -> _Floats: ...
    @property
    def patches(self) -> NDArray[np.uint32]: ...
    @property
    def escaped(self) -> _Floats: ...
    @property
    def blocked(self) -> _Floats: ...
    @property
    def unselected(self) -> _Floats: ...
    @property
    def factors(self) -> _Floats: ...
    def to_pandas(self) -> Any: ...
    def __len__(self) -> int: ...
    def __getitem__(self, key: tuple[str, str], /) -> float: ...

@final
class Rows(Iterator[_Row]):
    def __iter__(self) -> Rows: ...
    def __next__(self) -> _Row: ...
    def __length_hint__(self) -> int: ...

@final
class Solution:
    @property
    def radiosity(self) -> _Floats: ...
    @property
    def irradiance(self) -> _Floats: ...
    @property
    def residuals(self) -> list[float]: ...
    @property
    def iterations(self) -> int: ...
    @property
    def converged(self) -> bool: ...
    @property
    def balance(self) -> list[dict[str, float]]: ...
    @property
    def energy_error(self) -> float | None: ...
    @property
    def flux(self) -> _Floats: ...
    @property
    def temperature(self) -> _Floats | None: ...
    def by_surface(self, matrix: Matrix, by: Literal["object", "material", "face"] = "object") -> HeatBySurface: ...
    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]: ...

@final
class HeatBySurface:
    @property
    def names(self) -> list[str]: ...
    @property
    def areas(self) -> _Floats: ...
    @property
    def heat(self) -> _Floats: ...
    @property
    def flux(self) -> _Floats: ...
    @property
    def temperature(self) -> _Floats: ...
    @property
    def least_temperature(self) -> _Floats: ...
    @property
    def greatest_temperature(self) -> _Floats: ...
    @property
    def radiosity(self) -> _Floats: ...
    @property
    def irradiance(self) -> _Floats: ...
    @property
    def balance(self) -> dict[str, float]: ...
    def to_dict(self) -> dict[str, Any]: ...
    def to_pandas(self) -> Any: ...
    def __len__(self) -> int: ...
    def __getitem__(self, name: str, /) -> float: ...

@final
class Exchange:
    @property
    def names(self) -> list[str]: ...
    @property
    def bands(self) -> list[str]: ...
    @property
    def areas(self) -> _Floats: ...
    @property
    def escaped(self) -> _Floats: ...
    @property
    def enclosures(self) -> NDArray[np.uint32]: ...
    @property
    def gebhart(self) -> _Floats: ...
    @property
    def exchange_areas(self) -> _Floats: ...
    @property
    def conductances(self) -> _Floats: ...
    def to_pandas(
        self,
        what: Literal["gebhart", "exchange_areas", "conductances"] = "gebhart",
        *,
        band: str | None = None,
    ) -> Any: ...
    def resistors(self) -> list[tuple[int, int, float]]: ...
    def __len__(self) -> int: ...

@disjoint_base
class Views:
    def __len__(self) -> int: ...
    @property
    def ground(self) -> _Floats: ...
    @property
    def blocked(self) -> _Floats: ...
    @property
    def changes(self) -> _Floats: ...

@final
class Sky(Views):
    @property
    def view_factors(self) -> _Floats: ...
    @property
    def sunlight(self) -> NDArray[np.float32] | None: ...
    @property
    def solid_angles(self) -> _Floats: ...
    def to_scipy(self) -> csr_matrix: ...
    def patches_to_scipy(self) -> csr_matrix | None: ...

@final
class Points(Views):
    @property
    def sky(self) -> _Floats: ...
    @property
    def settled(self) -> NDArray[np.bool_]: ...
    @property
    def passed(self) -> _Floats: ...
    @property
    def cut_off(self) -> _Floats: ...
    def to_scipy(self) -> csr_matrix: ...
    def zones(self, by: Literal["object", "material"] = "object") -> _Floats: ...
    def to_pandas(self, by: Literal["object", "material"] = "object") -> Any: ...
    def mean_radiant_temperature(
        self,
        radiosity: ArrayLike,
        *,
        sky: float | str,
        ground: float | str | None = None,
        backs: float | str | None = None,
    ) -> _Floats: ...

@overload
def compute(
    scene: Scene,
    *,
    tolerance: float | None = None,
    correction: Literal["tolerance", "pixel"] | None = None,
    resolution: int | None = None,
    samples: int | None = None,
    rotation: bool = True,
    rows: tuple[int, int] | None = None,
    sample_rows: int | None = None,
    seed: int = 1,
    emitters: Sequence[str] = ...,
    receivers: Sequence[str] = ...,
    occluders: Sequence[str] = ...,
    patches: Literal["triangle", "face", "object", "material"] | None = None,
    min_factor: float | None = None,
    output: _Path | None = None,
    store: Literal["plain", "compact", "double"] | None = None,
    overwrite: bool = False,
    update: _Path | None = None,
    backend: str = "cpu",
    backend_dir: _Path | None = None,
    backend_options: Mapping[str, str] | None = None,
    engine: Literal["auto", "depth", "order", "claims"] = "auto",
    culling: bool | None = None,
    batch: int = 0,
    threads: int = 0,
    progress: Callable[[int, int], object] | None = None,
    specular: Mapping[str, object] | None = None,
    specular_bound: float | None = None,
    symmetry: Mapping[str, float] = ...,
    sector: tuple[str, int] | None = None,
    periodic: Mapping[str, tuple[float, float]] = ...,
    repeats: int | None = None,
    band: str | None = None,
) -> Matrix: ...
@overload
def compute(
    scene: Scene,
    *,
    tolerance: float | None = None,
    correction: Literal["tolerance", "pixel"] | None = None,
    resolution: int | None = None,
    samples: int | None = None,
    rotation: bool = True,
    rows: tuple[int, int] | None = None,
    sample_rows: int | None = None,
    seed: int = 1,
    emitters: Sequence[str] = ...,
    receivers: Sequence[str] = ...,
    occluders: Sequence[str] = ...,
    patches: Literal["triangle", "face", "object", "material"] | None = None,
    min_factor: float | None = None,
    output: _Path | None = None,
    store: Literal["plain", "compact", "double"] | None = None,
    overwrite: bool = False,
    update: _Path | None = None,
    backend: str = "cpu",
    backend_dir: _Path | None = None,
    backend_options: Mapping[str, str] | None = None,
    engine: Literal["auto", "depth", "order", "claims"] = "auto",
    culling: bool | None = None,
    batch: int = 0,
    threads: int = 0,
    progress: Callable[[int, int], object] | None = None,
    specular: Mapping[str, object] | None = None,
    specular_bound: float | None = None,
    symmetry: Mapping[str, float] = ...,
    sector: tuple[str, int] | None = None,
    periodic: Mapping[str, tuple[float, float]] = ...,
    repeats: int | None = None,
    band: list[str],
) -> dict[str, Matrix]: ...
def open(path: _Path) -> Matrix: ...
def solve(
    matrix: Matrix,
    reflectance: ArrayLike,
    emission: ArrayLike,
    *,
    outside: ArrayLike | None = None,
    method: Literal["gmres", "gauss-seidel", "jacobi"] = "gmres",
    restart: int = 20,
    tolerance: float = 1e-6,
    max_iterations: int = 500,
    memory: int = 1_000_000_000,
    threads: int = 0,
    progress: Callable[[int, float], object] | None = None,
    as_stored: bool = False,
) -> Solution: ...
def solve_heat(
    matrix: Matrix,
    emissivity: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    *,
    properties: Mapping[str, object] | None = None,
    ambient: float | str | None = None,
    ground: float | str | None = None,
    below_horizon: ArrayLike | None = None,
    load: ArrayLike | None = None,
    method: Literal["gmres", "gauss-seidel", "jacobi"] = "gmres",
    restart: int = 20,
    tolerance: float = 1e-6,
    max_iterations: int = 500,
    memory: int = 1_000_000_000,
    threads: int = 0,
    progress: Callable[[int, float], object] | None = None,
    as_stored: bool = False,
) -> Solution: ...
def exchange(
    matrix: Matrix,
    properties: Mapping[str, object],
    *,
    by: Literal["object", "material", "face", "patch"] = "object",
    threads: int = 0,
    as_stored: bool = False,
) -> Exchange: ...
def sky(
    scene: Scene,
    *,
    division: str = "tregenza",
    up: _Axis | None = None,
    north: float = 0.0,
    tolerance: float | None = None,
    resolution: int = 256,
    samples: int = 1,
    rotation: bool = True,
    backend: str = "cpu",
    backend_dir: _Path | None = None,
    backend_options: Mapping[str, str] | None = None,
    engine: Literal["auto", "depth", "order", "claims"] = "auto",
    threads: int = 0,
    progress: Callable[[int, int], object] | None = None,
    suns: ArrayLike | None = None,
    specular: Mapping[str, object] | None = None,
    specular_bound: float | None = None,
    symmetry: Mapping[str, float] = ...,
    sector: tuple[str, int] | None = None,
    periodic: Mapping[str, tuple[float, float]] = ...,
    repeats: int | None = None,
    band: str | None = None,
) -> Sky: ...
def sky_of_points(
    scene: Scene,
    positions: ArrayLike,
    normals: ArrayLike,
    *,
    division: str = "tregenza",
    up: _Axis | None = None,
    north: float = 0.0,
    tolerance: float | None = None,
    resolution: int = 256,
    rotation: bool = True,
    backend: str = "cpu",
    backend_dir: _Path | None = None,
    backend_options: Mapping[str, str] | None = None,
    engine: Literal["auto", "depth", "order", "claims"] = "auto",
    threads: int = 0,
    progress: Callable[[int, int], object] | None = None,
) -> Sky: ...
def points(
    scene: Scene,
    positions: ArrayLike,
    *,
    normals: ArrayLike | None = None,
    body: Literal["plane", "sphere", "cube", "person", "cylinder"] | None = None,
    up: _Axis | None = None,
    tolerance: float | None = None,
    resolution: int | None = None,
    backend: str = "cpu",
    backend_dir: _Path | None = None,
    backend_options: Mapping[str, str] | None = None,
    engine: Literal["auto", "depth", "order", "claims"] = "auto",
    threads: int = 0,
    progress: Callable[[int, int], object] | None = None,
    specular: Mapping[str, object] | None = None,
    specular_bound: float | None = None,
    symmetry: Mapping[str, float] = ...,
    sector: tuple[str, int] | None = None,
    periodic: Mapping[str, tuple[float, float]] = ...,
    repeats: int | None = None,
    band: str | None = None,
) -> Points: ...
def _triangles_of(
    points: ArrayLike, corners: ArrayLike, ends: ArrayLike
) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]: ...
def _main(words: Sequence[str], again: Sequence[str]) -> int: ...
