"""Meshes of other packages: scenes of them, and results back on their cells.

Nothing of these packages is imported: a mesh is whatever has their attributes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hemicube._errors import InputError
from hemicube._native import Scene, _triangles_of

_Ids = NDArray[np.int64]

# Cell data by which cells are grouped to objects, in lower case, the first that is there; as the program's readers.
_OBJECTS = (
    "object",
    "zone",
    "group",
    "region",
    "physicalgroup",
    "gmsh:physical",
    "cellentityids",
    "geometryids",
)
_MATERIALS = ("material", "materialids")

# Corners of meshio's cells that are surfaces; those of higher order are read by their corners.
_MESHIO = {"triangle": 3, "quad": 4}
# The same of VTK's types: the places of their corners.
_VTK: dict[int, list[int]] = {
    **dict.fromkeys((5, 22, 34, 69, 76), [0, 1, 2]),
    **dict.fromkeys((9, 23, 28, 30, 70, 77), [0, 1, 2, 3]),
    8: [0, 1, 3, 2],
}
_VTK_POLYGON, _VTK_STRIP = 7, 6
# Vertices and lines.
_VTK_LESSER = {0, 1, 2, 3, 4, 21, 35, 68, 75}


def from_meshio(
    mesh: Any, *, object: str | ArrayLike | None = None, material: str | ArrayLike | None = None, **keywords: Any
) -> Scene:
    """The scene of a `meshio.Mesh`: its triangles, quadrilaterals and polygons, a face each.

    `object` and `material` name an array of cell data, or are a value (a name or a number) of each cell. By default the
    object is the cell data `object`, `zone`, `group`, `region`, `PhysicalGroup`, `gmsh:physical`, `CellEntityIds` or
    `GeometryIds`, the first that is there, otherwise the first cell set that holds a cell; the material is the cell
    data `material` or `MaterialIds`. Numbers have names from `field_data`; without one, 3 is `zone 3`. A face's number
    is its cell's, over all blocks. Other keywords are those of `Scene`.

    >>> from types import SimpleNamespace as Mesh           # whatever has these attributes
    >>> points = [[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0], [2, 1.5, 1]]
    >>> blocks = [Mesh(type="quad", data=[[0, 1, 2, 3]]), Mesh(type="triangle", data=[[0, 4, 1]])]
    >>> mesh = Mesh(points=points, cells=blocks, cell_data={"zone": [[7], [8]]}, cell_sets={}, field_data={})
    >>> scene = from_meshio(mesh, up="z")
    >>> scene.objects, scene.object.tolist(), scene.face.tolist()
    (['zone 7', 'zone 8'], [0, 0, 1], [0, 0, 1])
    """
    points = _points(mesh.points)
    corners: list[_Ids] = []
    lengths: list[_Ids] = []
    faces: list[_Ids] = []
    first, volumes = 0, 0
    for block in mesh.cells:
        kind, data = str(block.type), block.data
        count = len(data)
        used = _MESHIO.get(kind.rstrip("0123456789"))
        if kind.startswith("polygon"):
            # All of one length, or a list of some lengths.
            lengths.append(np.fromiter((len(cell) for cell in data), np.int64, count))
            corners.append(np.concatenate([np.asarray(cell, np.int64) for cell in data]) if count else _none())
        elif used is not None:
            corners.append(np.asarray(data)[:, :used].reshape(-1))
            lengths.append(np.full(count, used, np.int64))
        else:
            volumes += 0 if kind.startswith(("vertex", "line")) else count
            first += count
            continue
        faces.append(np.arange(first, first + count))
        first += count
    groups = _Groups(
        first,
        {name: _joined(blocks) for name, blocks in (mesh.cell_data or {}).items()},
        _meshio_names(getattr(mesh, "field_data", None) or {}),
        _meshio_sets(mesh),
    )
    cells = (_joined(corners), _joined(lengths), _joined(faces))
    return _scene(points, *cells, volumes, groups, object, material, keywords)


def from_pyvista(
    mesh: Any, *, object: str | ArrayLike | None = None, material: str | ArrayLike | None = None, **keywords: Any
) -> Scene:
    """The scene of a `pyvista.PolyData` or `pyvista.UnstructuredGrid`: its surface cells, a face each.

    `object` and `material` are as for `from_meshio`; names of numbers are the field data `zone_names` of the cell data
    `zone`, from 0. A face's number is its cell's.

    >>> from types import SimpleNamespace as Mesh           # whatever has these attributes
    >>> points = [[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]]
    >>> data = {"zone": [1]}
    >>> names = {"zone_names": ["wall", "floor"]}
    >>> mesh = Mesh(points=points, faces=[4, 0, 1, 2, 3], n_cells=1, cell_data=data, field_data=names)
    >>> scene = from_pyvista(mesh, up="z")
    >>> scene.objects, scene.object.tolist(), scene.areas.sum()
    (['floor'], [0, 0], np.float64(12.0))
    """
    points = _points(mesh.points)
    volumes = 0
    cells = int(mesh.n_cells)
    if hasattr(mesh, "celltypes"):
        corners, lengths, faces, volumes = _grid_cells(mesh)
    else:
        corners, lengths = _padded(np.asarray(mesh.faces))
        if int(getattr(mesh, "n_strips", 0)):
            raise InputError("the mesh has triangle strips; call its `triangulate()` first")
        # Vertices and lines have the numbers before those of polygons.
        faces = np.arange(cells - len(lengths), cells)
    field = mesh.field_data
    names: dict[str, dict[int, str]] = {}
    for key in field.keys():
        if str(key).lower().endswith("_names"):
            names[str(key).lower()[:-6]] = {at: str(name) for at, name in enumerate(field[key])}
    data = {str(key): np.asarray(mesh.cell_data[key]) for key in mesh.cell_data.keys()}
    groups = _Groups(cells, data, names, {})
    return _scene(points, corners, lengths, faces, volumes, groups, object, material, keywords)


def from_trimesh(
    mesh: Any, *, object: str | ArrayLike | None = None, material: str | ArrayLike | None = None, **keywords: Any
) -> Scene:
    """The scene of a `trimesh.Trimesh`, a face each triangle, or of a `trimesh.Scene`, an object each of its nodes.

    `object` and `material` name an array of `face_attributes`, or are a value of each face; by default they are the
    attributes that `from_meshio` looks for.

    >>> from types import SimpleNamespace as Mesh           # whatever has these attributes
    >>> mesh = Mesh(vertices=[[0, 0, 0], [4, 0, 0], [4, 3, 0]], faces=[[0, 1, 2]], face_attributes={})
    >>> from_trimesh(mesh, object=["floor"], up="z").objects
    ['floor']
    """
    if hasattr(mesh, "graph") and hasattr(mesh, "geometry"):
        if object is None:
            object = [name for name, part, _ in _nodes(mesh) for _ in range(len(part.faces))]
        parts = [(np.asarray(part.vertices), np.asarray(part.faces), place) for _, part, place in _nodes(mesh)]
        starts = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts])
        vertices = np.concatenate([v @ place[:3, :3].T + place[:3, 3] for v, _, place in parts] or [np.empty((0, 3))])
        turned = [np.linalg.det(place[:3, :3]) < 0 for _, _, place in parts]
        faces = [(f[:, ::-1] if turn else f) + start for (_, f, _), start, turn in zip(parts, starts, turned)]
        triangles = np.concatenate(faces or [np.empty((0, 3), np.int64)])
        data: dict[str, Any] = {}
    else:
        vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        attributes = getattr(mesh, "face_attributes", None) or {}
        data = {str(key): np.asarray(attributes[key]) for key in attributes.keys()}
    count = len(triangles)
    groups = _Groups(count, data, {}, {})
    lengths = np.full(count, 3, np.int64)
    corners = triangles.reshape(-1)
    return _scene(vertices, corners, lengths, np.arange(count), 0, groups, object, material, keywords)


def cell_data(scene: Scene, values: ArrayLike, mesh: Any, *, side: int | None = None) -> Any:
    """Values of patches as cell data of the mesh that the scene was made of: means over each cell, by area.

    `values` has a number, or a row of them, for each patch. Cells without patches get NaN; `side` takes patches of the
    front (0) or the back (1) only. For a `meshio.Mesh` the result is a list with an array a block, for others an array:
    either may be assigned to `mesh.cell_data["name"]`, or `mesh.face_attributes["name"]` of a `trimesh.Trimesh`. It
    works also for scenes loaded from a VTK file, and the mesh that another package reads from it.

    >>> from types import SimpleNamespace as Mesh           # whatever has these attributes
    >>> points = [[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]]
    >>> blocks = [Mesh(type="line", data=[[0, 1]]), Mesh(type="quad", data=[[0, 1, 2, 3]])]
    >>> mesh = Mesh(points=points, cells=blocks, cell_data={}, cell_sets={}, field_data={})
    >>> scene = from_meshio(mesh, split=2, up="z")
    >>> cell_data(scene, scene.centroids[:, 0], mesh)
    [array([nan]), array([2.])]
    """
    blocks = None
    if hasattr(mesh, "n_cells"):
        count = int(mesh.n_cells)
    elif hasattr(mesh, "cells"):
        blocks = [len(block.data) for block in mesh.cells]
        count = sum(blocks)
    elif hasattr(mesh, "geometry") and hasattr(mesh, "graph"):
        count = sum(len(part.faces) for _, part, _ in _nodes(mesh))
    else:
        count = len(mesh.faces)
    numbers = np.asarray(values, np.float64)
    if numbers.ndim not in (1, 2) or len(numbers) != len(scene):
        raise InputError(f"`values` has the shape {numbers.shape}; ({len(scene)},) or ({len(scene)}, k) is needed")
    face, areas = scene.face, scene.areas
    if side is not None:
        if side not in (0, 1):
            raise InputError(f"`side` is {side}; 0 (front), 1 (back) or None is needed")
        kept = scene.side == side
        face, areas, numbers = face[kept], areas[kept], numbers[kept]
    if face.size and int(face.max()) >= count:
        raise InputError(f"the scene has the face {face.max()}, and the mesh {count} cells: it is of another mesh")
    total = np.bincount(face, areas, count)
    columns = numbers.reshape(len(numbers), -1)
    with np.errstate(invalid="ignore"):
        means = [np.bincount(face, areas * column, count) / total for column in columns.T]
    result = means[0] if numbers.ndim == 1 else np.stack(means, axis=1) if means else np.empty((count, 0))
    return result if blocks is None else np.split(result, np.cumsum(blocks)[:-1])


class _Groups:
    """What cells are grouped by: arrays over all cells, names of their numbers by array in lower case, and sets."""

    def __init__(
        self,
        count: int,
        data: Mapping[str, Any],
        names: Mapping[str, Mapping[int, str]],
        sets: Mapping[str, _Ids],
    ) -> None:
        self.count, self.data, self.names, self.sets = count, data, names, sets

    def ids(
        self, given: str | ArrayLike | None, what: str, usual: Sequence[str], faces: _Ids
    ) -> tuple[_Ids | None, list[str] | None]:
        """Ids of the faces and their names; none where nothing groups them."""
        array: Any = None
        key = ""
        if isinstance(given, str):
            if given not in self.data:
                there = ", ".join(sorted(self.data)) or "none"
                raise InputError(f"`{what}` is `{given}`; the mesh's cell data are {there}")
            key, array = given, self.data[given]
        elif given is not None:
            array = np.asarray(given)
        else:
            lower = {name.lower(): name for name in reversed(list(self.data))}
            found = [lower[name] for name in usual if name in lower and np.ndim(self.data[lower[name]]) == 1]
            if found:
                key = found[0]
                array = self.data[key]
            elif self.sets and what == "object":
                return self._by_set(faces)
            else:
                return None, None
        array = np.asarray(array)
        if array.shape != (self.count,):
            raise InputError(f"`{what}` has the shape {array.shape}; ({self.count},), a value a cell, is needed")
        values, ids = np.unique(array[faces], return_inverse=True)
        # In the order of the faces, as the readers have them.
        first = np.full(len(values), len(ids))
        np.minimum.at(first, ids, np.arange(len(ids)))
        order = np.argsort(first)
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        return place[ids], [self._name(key, values[at]) for at in order]

    def _name(self, key: str, value: Any) -> str:
        if isinstance(value, (str, bytes)):
            return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
        if not np.isfinite(value):
            return f"{key} {value}".strip()
        number = int(value)
        return self.names.get(key.lower(), {}).get(number) or f"{key} {number}".strip()

    def _by_set(self, faces: _Ids) -> tuple[_Ids, list[str]]:
        of = np.full(self.count, -1, np.int64)
        # A set of all cells tells nothing apart: it comes last.
        sets = sorted(self.sets.items(), key=lambda item: len(item[1]) >= self.count)
        for number, (_, cells) in enumerate(sets):
            free = cells[of[cells] < 0]
            of[free] = number
        of[of < 0] = len(sets)
        names = [name for name, _ in sets] + [""]
        used, ids = np.unique(of[faces], return_inverse=True)
        return ids, [names[at] for at in used]


def _scene(
    points: NDArray[Any],
    corners: _Ids,
    lengths: _Ids,
    faces: _Ids,
    volumes: int,
    groups: _Groups,
    object: str | ArrayLike | None,
    material: str | ArrayLike | None,
    keywords: dict[str, Any],
) -> Scene:
    if not len(lengths):
        if volumes:
            raise InputError(
                f"the mesh has {volumes} volume cells and no surface cells; extract its surface, or save it and load "
                "the file, whose reader takes the boundary"
            )
        raise InputError("the mesh has no surface cells")
    object_ids, objects = groups.ids(object, "object", _OBJECTS, faces)
    material_ids, materials = groups.ids(material, "material", _MATERIALS, faces)
    if (lengths == 3).all():
        triangles: NDArray[Any] = corners.reshape(-1, 3)
        polygon: NDArray[Any] = np.arange(len(triangles))
    else:
        triangles, polygon = _triangles_of(points, corners, np.cumsum(lengths))
    return Scene(
        points,
        triangles,
        object=None if object_ids is None else object_ids[polygon],
        material=None if material_ids is None else material_ids[polygon],
        face=faces[polygon],
        objects=objects,
        materials=materials,
        **keywords,
    )


def _none() -> _Ids:
    return np.empty(0, np.int64)


def _joined(arrays: Iterable[Any]) -> Any:
    """Arrays one after the other; one alone is not copied."""
    every = [np.asarray(array) for array in arrays]
    return every[0] if len(every) == 1 else np.concatenate(every) if every else _none()


def _points(points: Any) -> NDArray[Any]:
    """Points in space; those of the plane lie at z = 0."""
    array = np.asarray(points)
    if array.ndim == 2 and array.shape[1] == 2:
        return np.column_stack([array, np.zeros(len(array))])
    return array


def _meshio_names(field_data: Mapping[str, Any]) -> dict[str, dict[int, str]]:
    """Names of Gmsh's physical groups of surfaces, as meshio has them: a number and a dimension each."""
    names = {}
    for name, value in field_data.items():
        numbers = np.ravel(value)
        if len(numbers) == 2 and int(numbers[1]) == 2:
            names[int(numbers[0])] = str(name)
    return {"gmsh:physical": names}


def _meshio_sets(mesh: Any) -> dict[str, _Ids]:
    """Cells of each set, over all blocks."""
    starts = np.cumsum([0] + [len(block.data) for block in mesh.cells])
    sets = {}
    for name, blocks in (getattr(mesh, "cell_sets", None) or {}).items():
        # Gmsh's bounding entities are sets of signs, not of cells.
        if str(name).startswith("gmsh:"):
            continue
        cells = [np.asarray(cells, np.int64) + start for cells, start in zip(blocks, starts) if cells is not None]
        sets[str(name)] = _joined(cells)
    return sets


def _padded(cells: NDArray[Any]) -> tuple[_Ids, _Ids]:
    """Corners and lengths of cells that have their length before them."""
    size = len(cells)
    if not size:
        return _none(), _none()
    length = int(cells[0])
    if length > 0 and size % (length + 1) == 0 and (cells[:: length + 1] == length).all():
        rows = cells.reshape(-1, length + 1)
        return rows[:, 1:].reshape(-1), np.full(len(rows), length, np.int64)
    kept = np.ones(size, bool)
    lengths = []
    at = 0
    while at < size:
        length = int(cells[at])
        if length < 0 or at + length >= size:
            raise InputError(f"a cell of {length} points is longer than the list of cells")
        lengths.append(length)
        kept[at] = False
        at += length + 1
    return cells[kept], np.asarray(lengths, np.int64)


def _grid_cells(mesh: Any) -> tuple[_Ids, _Ids, _Ids, int]:
    """Corners, lengths and numbers of the surface cells of an unstructured grid, and how many cells are others."""
    types, connectivity = np.asarray(mesh.celltypes), np.asarray(mesh.cell_connectivity)
    # The name is new in PyVista 0.49, which warns of the old one.
    offsets = np.asarray(mesh.cell_offsets if hasattr(mesh, "cell_offsets") else mesh.offset)
    begins, ends = offsets[:-1], offsets[1:]
    if (types == _VTK_STRIP).any():
        raise InputError("the mesh has triangle strips; extract its surface first")
    pieces: list[tuple[_Ids, NDArray[Any]]] = []
    others = 0
    for kind in np.unique(types):
        cells = np.flatnonzero(types == kind)
        if int(kind) == _VTK_POLYGON:
            pieces.extend((cells[at : at + 1], connectivity[None, begins[c] : ends[c]]) for at, c in enumerate(cells))
        elif (places := _VTK.get(int(kind))) is not None:
            pieces.append((cells, connectivity[begins[cells][:, None] + np.asarray(places)]))
        elif int(kind) not in _VTK_LESSER:
            others += len(cells)
    if len(pieces) == 1:
        faces, corners = pieces[0]
        return corners.reshape(-1), np.full(len(faces), corners.shape[1], np.int64), faces, others
    pairs = [(face, row) for faces, rows in pieces for face, row in zip(faces.tolist(), rows)]
    pairs.sort(key=lambda pair: pair[0])
    lengths = np.fromiter((len(row) for _, row in pairs), np.int64, len(pairs))
    numbers = np.fromiter((face for face, _ in pairs), np.int64, len(pairs))
    return _joined(row for _, row in pairs), lengths, numbers, others


def _nodes(scene: Any) -> list[tuple[str, Any, NDArray[Any]]]:
    """Meshes of a `trimesh.Scene` with their nodes' names and transformations."""
    nodes = []
    for name in scene.graph.nodes_geometry:
        place, geometry = scene.graph[name]
        part = scene.geometry[geometry]
        if hasattr(part, "faces"):
            nodes.append((str(name), part, np.asarray(place)))
    return nodes
