"""Opens what `hemicube export` wrote with somebody else's reader, and prints what is in it as JSON.

readers.py READER FILE; columns by name, null where there is no number, corners as nine numbers a patch, colours as they are
in the file.
"""

import json
import math
import sys


def numbers(values):
    return [None if math.isnan(v) else v for v in (float(v) for v in values)]


def columns(arrays, components):
    """Columns of one number each from arrays of one or more."""
    found = {}
    for name, values in arrays.items():
        if values.ndim == 1:
            found[name] = numbers(values)
        else:
            names = components(name, values.shape[1])
            for place, component in enumerate(names):
                found[f"{name}_{component}"] = numbers(values[:, place])
    return found


def read_csv(path):
    import csv

    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    words = ("object", "material")
    corners = [f"{corner}_{axis}" for corner in "abc" for axis in "xyz"]
    fields = [name for name in rows[0] if name not in words and name not in corners]
    return {
        "columns": {name: [float(row[name]) if row[name] else None for row in rows] for name in fields},
        "words": {name: [row[name] for row in rows] for name in words},
        "corners": [[float(row[name]) for name in corners] for row in rows] if corners[0] in rows[0] else None,
    }


def read_npz(path):
    import numpy

    with numpy.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    corners = arrays.pop("corners", None)
    texts = {name: arrays.pop(name).tolist() for name in list(arrays) if arrays[name].dtype.kind == "U"}
    return {
        "columns": columns(arrays, lambda name, _: texts[f"{name}_components"]),
        "names": {name: texts[f"{name}_names"] for name in ("object", "material")},
        "corners": None if corners is None else corners.reshape(len(corners), 9).tolist(),
    }


def read_meshio(path):
    import meshio

    mesh = meshio.read(path)
    (cells,) = mesh.cells
    assert cells.type == "triangle", cells.type
    arrays = {name: blocks[0] for name, blocks in mesh.cell_data.items()}
    # What the components are called does not come through: bands are red, green, blue in this test.
    known = lambda name, _: "xyz" if name in ("centroid", "normal") else ("red", "green", "blue")
    return {
        "columns": columns(arrays, known),
        "corners": mesh.points[cells.data].reshape(len(cells.data), 9).tolist(),
        "points": len(mesh.points),
    }


def read_vtk(path):
    # Not `vtk` itself, which loads everything that draws.
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    polygons = path.endswith(".vtp")
    reader = vtkXMLPolyDataReader() if polygons else vtkXMLUnstructuredGridReader()
    reader.SetFileName(path)
    reader.Update()
    assert reader.GetErrorCode() == 0, reader.GetErrorCode()
    mesh = reader.GetOutput()
    points = vtk_to_numpy(mesh.GetPoints().GetData())
    cells = mesh.GetPolys() if polygons else mesh.GetCells()
    used = vtk_to_numpy(cells.GetConnectivityArray()).reshape(-1, 3)
    data = mesh.GetCellData()
    arrays, components = {}, {}
    for index in range(data.GetNumberOfArrays()):
        array = data.GetArray(index)
        arrays[array.GetName()] = vtk_to_numpy(array)
        components[array.GetName()] = [array.GetComponentName(c) for c in range(array.GetNumberOfComponents())]
    fields = mesh.GetFieldData()
    names = {}
    for index in range(fields.GetNumberOfArrays()):
        array = fields.GetAbstractArray(index)
        names[array.GetName().removesuffix("_names")] = [array.GetValue(v) for v in range(array.GetNumberOfValues())]
    return {
        "columns": columns(arrays, lambda name, _: components[name]),
        "names": names,
        "corners": points[used].reshape(-1, 9).tolist(),
        "points": len(points),
    }


def read_ply(path):
    import trimesh

    mesh = trimesh.load(path, process=False)
    face = mesh.metadata["_ply_raw"]["face"]["data"]
    own = ("vertex_indices", "red", "green", "blue")
    return {
        "columns": {name: numbers(face[name]) for name in face.dtype.names if name not in own},
        "corners": mesh.vertices[mesh.faces].reshape(-1, 9).tolist(),
        "colors": [[int(face[c][f]) for c in own[1:]] for f in range(len(face))],
        "vertex_colors": mesh.visual.vertex_colors[mesh.faces[:, 0], :3].tolist(),
    }


def read_glb(path):
    import numpy
    import trimesh

    scene = trimesh.load(path, process=False)
    corners, colors, objects = {}, {}, {}
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        points = trimesh.transform_points(mesh.vertices, transform)
        color = mesh.visual.vertex_attributes["color"]
        for face in mesh.faces:
            (patch,) = set(mesh.vertex_attributes["_PATCH"][face].ravel().tolist())
            assert patch not in corners, patch
            corners[patch] = points[face].ravel().tolist()
            (colors[patch],) = {tuple(numpy.asarray(c)[:3].tolist()) for c in color[face]}
            objects[patch] = name
    return {
        "corners": [corners[patch] for patch in range(len(corners))],
        "colors": [colors[patch] for patch in range(len(corners))],
        "words": {"object": [objects[patch] for patch in range(len(corners))]},
    }


def triplets(row, col, value):
    return {"entries": [[int(i), int(j), float(v)] for i, j, v in zip(row, col, value)]}


def read_duckdb(path):
    import duckdb

    found = duckdb.sql(f"SELECT row, col, value FROM '{path}'").fetchnumpy()
    metadata = duckdb.sql(f"SELECT key, value FROM parquet_kv_metadata('{path}')").fetchall()
    sums = duckdb.sql(f"SELECT row, sum(value) AS total FROM '{path}' GROUP BY row ORDER BY row").fetchnumpy()
    return triplets(found["row"], found["col"], found["value"]) | {
        "types": [str(found[name].dtype) for name in ("row", "col", "value")],
        "metadata": {key.decode(): value.decode() for key, value in metadata},
        "row_sums": sums["total"].tolist(),
    }


def read_duckdb_table(path):
    import duckdb

    found = duckdb.sql(f"SELECT * FROM '{path}'")
    return {"names": found.columns, "types": [str(kind) for kind in found.types], "rows": found.fetchall()}


def read_pyarrow(path):
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    metadata = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    return triplets(*(table[name].to_numpy() for name in ("row", "col", "value"))) | {
        "types": [str(table.schema.field(name).type) for name in ("row", "col", "value")],
        "metadata": metadata,
    }


json.dump(globals()[f"read_{sys.argv[1]}"](sys.argv[2]), sys.stdout)
