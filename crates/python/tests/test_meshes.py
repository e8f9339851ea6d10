"""Scenes of meshes of meshio, PyVista and trimesh, against the program's reader, and results back on their cells."""

import doctest
import pathlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hemicube

MESHES = pathlib.Path(__file__).resolve().parents[2] / "scene/tests/meshes"
POINTS = [[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0], [2, 1.5, 1.0]]


def package(name: str) -> Any:
    """A package, or a test that is skipped where all can see it."""
    return pytest.importorskip(name, reason=f"SKIP: {name} is not installed; what it makes is not tested")


def test_the_examples_run() -> None:
    ran = doctest.testmod(hemicube._meshes)
    assert ran.attempted > 15 and ran.failed == 0


def block(kind: str, data: Any) -> SimpleNamespace:
    return SimpleNamespace(type=kind, data=data)


def mesh(*blocks: SimpleNamespace, **attributes: Any) -> SimpleNamespace:
    given: dict[str, Any] = {"points": POINTS, "cells": list(blocks), "cell_data": {}, "cell_sets": {}, "field_data": {}}
    return SimpleNamespace(**{**given, **attributes})


def same(brought: hemicube.Scene, room: hemicube.Scene) -> None:
    assert np.array_equal(brought.corners, room.corners)
    assert np.array_equal(brought.face, room.face)


@pytest.mark.parametrize("name", ["room-22-text.msh", "room-41-binary.msh", "meshio-room.inp", "meshio-room-zlib.vtu"])
def test_meshio_brings_the_room_of_the_programs_reader(name: str) -> None:
    meshio = package("meshio")
    read = meshio.read(MESHES / name)
    room = hemicube.Scene.load(MESHES / "room.obj", up="z")
    brought = hemicube.from_meshio(read, up="z")
    same(brought, room)
    if name.endswith((".msh", ".inp")):
        assert [brought.objects[at] for at in brought.object] == [room.objects[at] for at in room.object]
    # Cells of the mesh have the mean of their patches.
    cut = hemicube.from_meshio(read, up="z", split=4)
    values = np.stack([cut.centroids[:, 0], np.ones(len(cut))], axis=1)
    data = hemicube.cell_data(cut, values, read)
    assert [array.shape for array in data] == [(len(block.data), 2) for block in read.cells]
    for block, cells in zip(read.cells, data):
        assert np.allclose(cells[:, 1], 1.0)
        assert np.allclose(cells[:, 0], read.points[block.data][..., 0].mean(axis=1))
    read.cell_data["x"] = [array[:, 0] for array in data]


def test_a_matrix_of_a_mesh_is_the_matrix_of_its_file(tmp_path: pathlib.Path) -> None:
    meshio = package("meshio")
    read = meshio.read(MESHES / "room-22-text.msh")
    settings: dict[str, Any] = {"resolution": 64, "correction": "pixel"}
    of_mesh = hemicube.compute(hemicube.from_meshio(read, up="z"), **settings)
    of_file = hemicube.compute(hemicube.Scene.load(MESHES / "room-22-text.msh", up="z"), **settings)
    assert (of_mesh.to_scipy() != of_file.to_scipy()).nnz == 0
    assert of_mesh.zones().names == ["floor", "ceiling", "walls", "tent"]
    # Written with its results, it is read again by meshio.
    read.cell_data["row_sum"] = hemicube.cell_data(hemicube.from_meshio(read, up="z"), of_mesh.row_sums, read)
    meshio.write(tmp_path / "result.vtu", read)
    again = meshio.read(tmp_path / "result.vtu")
    assert np.allclose(np.concatenate(again.cell_data["row_sum"]), np.concatenate(read.cell_data["row_sum"]))
    # The same cells are those of the file's own scene.
    scene = hemicube.Scene.load(tmp_path / "result.vtu", up="z")
    areas = np.concatenate(hemicube.cell_data(scene, scene.areas, again))
    assert areas.shape == (10,) and np.allclose(areas[6:], scene.areas[-4:])


def test_groups_of_meshio() -> None:
    quad, pair = block("quad", [[0, 1, 2, 3]]), block("triangle6", [[0, 4, 1, 9, 9, 9], [1, 4, 2, 9, 9, 9]])
    line = block("line", [[0, 1], [1, 2]])

    def names(**attributes: Any) -> list[str]:
        scene = hemicube.from_meshio(mesh(line, quad, pair, **attributes), up="z")
        assert scene.face.tolist() == [2, 2, 3, 4]
        return [scene.objects[at] for at in scene.object]

    assert names() == ["", "", "", ""]
    physical = {"gmsh:physical": [[9, 9], [2], [1, 2]]}
    groups = {"roof": np.array([1, 2]), "edge": np.array([2, 1])}
    assert names(cell_data=physical, field_data=groups) == ["gmsh:physical 2"] * 2 + ["roof", "gmsh:physical 2"]
    # The first of the names that readers know, and not vectors.
    several = {**physical, "Zone": [[0, 0], [5], [5, 6]], "object": [np.zeros((2, 2)), np.zeros((1, 2)), np.zeros((2, 2))]}
    assert names(cell_data=several) == ["Zone 5", "Zone 5", "Zone 5", "Zone 6"]
    sets = {"all": [[0, 1], [0], [0, 1]], "floor": [[], [0], []], "more": [[], [0], [1]]}
    assert names(cell_sets=sets) == ["floor", "floor", "all", "more"]
    given = hemicube.from_meshio(mesh(quad, pair), object=["b", "a", "b"], material=[3, 1, 3], up="z")
    assert (given.objects, given.object.tolist()) == (["b", "a"], [0, 0, 1, 0])
    assert given.materials == ["3", "1"]
    named = hemicube.from_meshio(mesh(quad, pair, cell_data={"paint": [["red"], ["blue", "red"]]}), material="paint", up="z")
    assert [named.materials[at] for at in named.material] == ["red", "red", "blue", "red"]


def test_polygons_are_one_face_and_concave_ones_are_cut_inside() -> None:
    points = [[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]]
    u = hemicube.from_meshio(mesh(block("polygon", [list(range(8))]), points=points), up="z", two_sided=True)
    assert abs(u.areas[u.side == 0].sum() - 5.0) < 1e-12 and set(u.face.tolist()) == {0}
    dart = mesh(block("quad", [[0, 1, 2, 3]]), points=[[0, 0], [2, -1], [0, 2], [-2, -1]])
    assert abs(hemicube.from_meshio(dart, up="z").areas.sum() - 4.0) < 1e-12
    front = hemicube.cell_data(u, u.side, mesh(block("polygon", [list(range(8))])), side=0)
    both = hemicube.cell_data(u, u.side, mesh(block("polygon", [list(range(8))])))
    assert front[0].tolist() == [0.0] and both[0].tolist() == [0.5]


def test_what_cannot_be_taken_is_refused_with_the_next_step() -> None:
    quad = block("quad", [[0, 1, 2, 3]])
    for given, keywords, words in [
        (mesh(block("tetra", [[0, 1, 2, 4]])), {}, "1 volume cells and no surface cells"),
        (mesh(), {}, "no surface cells"),
        (mesh(block("quad", [[0, 1, 2, 7]])), {}, "a cell has the point 7, and there are 5"),
        (mesh(block("triangle", [[0, 1, -1]])), {}, "the vertex -1"),
        (mesh(quad), {"object": "zone"}, "`object` is `zone`; the mesh's cell data are none"),
        (mesh(quad), {"material": [1, 2]}, r"`material` has the shape \(2,\); \(1,\), a value a cell"),
    ]:
        with pytest.raises(hemicube.InputError, match=words):
            hemicube.from_meshio(given, up="z", **keywords)
    scene = hemicube.from_meshio(mesh(quad), up="z")
    for values, other, words in [
        ([1.0], mesh(quad), "`values` has the shape"),
        ([1.0, 2.0], mesh(), "the mesh 0 cells: it is of another mesh"),
    ]:
        with pytest.raises(hemicube.InputError, match=words):
            hemicube.cell_data(scene, values, other)
    with pytest.raises(hemicube.InputError, match="`side` is 2"):
        hemicube.cell_data(scene, [1.0, 2.0], mesh(quad), side=2)
    padded = SimpleNamespace(points=POINTS, faces=[4, 0, 1, 2], n_cells=1, cell_data={}, field_data={})
    with pytest.raises(hemicube.InputError, match="longer than the list"):
        hemicube.from_pyvista(padded, up="z")
    for face in [[1, 0], [-1, 0], [0]]:
        with pytest.raises(hemicube.InputError, match="`face`"):
            hemicube.Scene(POINTS, [[0, 1, 2], [0, 2, 3]], face=face)


def test_grids_and_surfaces_as_pyvista_has_them() -> None:
    # What PyVista's attributes hold, without PyVista: lines first, a pixel, a polygon.
    cells = SimpleNamespace(
        points=POINTS,
        celltypes=np.array([3, 8, 7, 5, 10], np.uint8),
        cell_connectivity=np.array([0, 1, 0, 1, 3, 2, 0, 1, 4, 1, 2, 4, 0, 1, 2, 4]),
        offset=np.array([0, 2, 6, 9, 12, 16]),
        n_cells=5,
        cell_data={"zone": np.array([0, 1, 0, 1, 0])},
        field_data={"zone_names": np.array(["wall", "floor"])},
    )
    scene = hemicube.from_pyvista(cells, up="z")
    assert scene.face.tolist() == [1, 1, 2, 3] and scene.objects == ["floor", "wall"]
    assert abs(scene.areas[:2].sum() - 12.0) < 1e-12
    assert np.isnan(hemicube.cell_data(scene, scene.areas, cells)).tolist() == [True, False, False, False, True]
    surface = SimpleNamespace(
        points=POINTS, faces=[4, 0, 1, 2, 3, 3, 0, 4, 1], n_cells=3, cell_data={}, field_data={}, n_strips=0
    )
    assert hemicube.from_pyvista(surface, up="z").face.tolist() == [1, 1, 2]


@pytest.mark.parametrize("name", ["room-raw-zlib.vtp", "room-raw-none.vtu", "room-polydata-51-binary.vtk"])
def test_pyvista_brings_the_room_of_the_programs_reader(name: str) -> None:
    pyvista = package("pyvista")
    read = pyvista.read(MESHES / name)
    brought, room = hemicube.from_pyvista(read, up="z"), hemicube.Scene.load(MESHES / name, up="z")
    same(brought, room)
    assert [brought.objects[at] for at in brought.object] == [room.objects[at] for at in room.object]
    read.cell_data["area"] = hemicube.cell_data(room, room.areas, read)
    assert read.cell_data["area"].shape == (10,)


def test_trimesh_brings_meshes_and_scenes() -> None:
    trimesh = package("trimesh")
    box = trimesh.creation.box((4, 3, 2.5))
    scene = hemicube.from_trimesh(box, up="z", flip=["all"])
    assert len(scene) == 12 and abs(scene.areas.sum() - box.area) < 1e-12
    matrix = hemicube.compute(scene, tolerance=0.01)
    box.face_attributes["row_sum"] = hemicube.cell_data(scene, matrix.row_sums, box)
    assert np.allclose(box.face_attributes["row_sum"], 1.0, atol=0.01)
    box.face_attributes["zone"] = np.repeat([0, 1], 6)
    assert hemicube.from_trimesh(box, up="z").objects == ["zone 0", "zone 1"]
    # Two nodes of one mesh, one moved and one mirrored: both face outwards.
    both = trimesh.Scene()
    both.add_geometry(box, node_name="a", transform=trimesh.transformations.translation_matrix([9, 0, 0]))
    both.add_geometry(box, node_name="b", transform=np.diag([-1.0, 1, 1, 1]))
    nodes = hemicube.from_trimesh(both, up="z")
    assert nodes.objects == ["a", "b"] and len(nodes) == 24
    middles = np.array([[9.0, 0, 0], [0, 0, 0]])[nodes.object]
    assert (np.einsum("ij,ij->i", nodes.normals, nodes.centroids - middles) > 0).all()


def test_a_folder_is_one_scene(tmp_path: pathlib.Path) -> None:
    floor = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nf 1 2 3 4\n"
    (tmp_path / "floor.obj").write_text(floor)
    (tmp_path / "lamp.obj").write_text("v 0 0 1\nv 0 1 1\nv 1 1 1\nf 1 2 3\n")
    scene = hemicube.Scene.load(tmp_path, up="z")
    assert list(scene.objects) == ["floor", "lamp"]
    assert len(scene) == 3
