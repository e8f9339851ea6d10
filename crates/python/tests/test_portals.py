"""Mirrors, panes, symmetry, sectors and periods: closed forms, and what a matrix tells of them."""

import pathlib
from collections.abc import Sequence

import numpy as np
import pytest

import hemicube

CORNERS = {
    "bottom": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)],
    "top": [(0, 0, 1), (0, 1, 1), (1, 1, 1), (1, 0, 1)],
    "x0": [(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)],
    "x1": [(1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)],
    "y0": [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)],
    "y1": [(0, 1, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)],
}


def room(tmp_path: pathlib.Path, names: Sequence[str] = tuple(CORNERS)) -> hemicube.Scene:
    lines, first = [], 1
    for name in names:
        lines += [f"v {x} {y} {z}" for x, y, z in CORNERS[name]]
        lines += [f"o {name}", f"f {first} {first + 1} {first + 2} {first + 3}"]
        first += 4
    path = tmp_path / "room.obj"
    path.write_text("\n".join(lines) + "\n")
    return hemicube.Scene.load(path)


def of_quads(matrix: hemicube.Matrix) -> np.ndarray:
    """Form factors between quads, of two triangles of one area each."""
    dense = matrix.to_scipy().toarray().astype(float)
    return dense.reshape(len(dense) // 2, 2, -1, 2).sum(axis=(1, 3)) / 2


def test_a_cube_with_a_mirror_has_the_rows_of_its_unfolding(tmp_path: pathlib.Path) -> None:
    scene = room(tmp_path)
    matrix = hemicube.compute(scene, tolerance=0.01, specular={"object": {"x1": {"specular": np.float64(0.5)}}})
    factors = of_quads(matrix)
    assert abs(factors[0, 1] - 0.24285014027455) < 3e-3
    assert np.array_equal(matrix.specular_reflectance, np.repeat([0, 0, 0, 0.5, 0, 0], 2))
    assert not matrix.transmittance.any()
    assert np.abs(matrix.closure).max() < 1e-3
    passed = matrix.to_scipy() @ matrix.specular_reflectance
    assert np.allclose(matrix.passed, passed, rtol=1e-5)
    assert (matrix.cut_off >= 0).all() and matrix.cut_off.max() < 1e-3
    # At one temperature nothing flows.
    heat = hemicube.solve_heat(matrix, np.repeat([0.8, 0.8, 0.8, 0.3, 0.8, 0.8], 2), np.full(12, 300.0))
    assert np.abs(heat.flux).max() < 1e-5 * 459
    with pytest.raises(hemicube.InputError, match="at most 1"):
        hemicube.solve_heat(matrix, np.full(12, 0.8), np.full(12, 300.0))
    # The same in a store.
    stored = hemicube.compute(
        scene, tolerance=0.01, specular={"object": {"x1": {"specular": 0.5}}}, output=tmp_path / "room.hemicube"
    )
    assert np.array_equal(stored.to_scipy().toarray(), matrix.to_scipy().toarray())
    assert np.array_equal(stored.passed, matrix.passed)


def test_half_of_a_room_with_its_plane_of_symmetry(tmp_path: pathlib.Path) -> None:
    half = room(tmp_path, ["bottom", "top", "x0", "y0", "y1"])
    factors = of_quads(hemicube.compute(half, tolerance=0.01, symmetry={"x": 1.0}))
    # Floor and ceiling of a box of 2 x 1 x 1.
    assert abs(factors[0, 1] - 0.28587538485071) < 3e-3
    assert np.abs(factors.sum(axis=1) - 1).max() < 2e-2


def test_a_street_without_end(tmp_path: pathlib.Path) -> None:
    street = room(tmp_path, ["bottom", "x0", "x1"])
    matrix = hemicube.compute(street, tolerance=0.01, periodic={"y": (0, 1)})
    assert abs(matrix.escaped[:2].mean() - (2**0.5 - 1)) < 2e-3
    assert matrix.cut_off.max() < 2e-3


def test_what_does_not_fit_is_refused(tmp_path: pathlib.Path) -> None:
    scene = room(tmp_path)
    for wrong in (
        {"specular": {"object": {"x9": {"specular": 0.5}}}},
        {"specular": {"object": {"x1": {"specular": 0.7, "transmittance": 0.7}}}},
        {"specular": {"object": {"x1": {"shiny": 1}}}},
        {"specular": {"object": {"x1": {"specular": [0.1, 0.2]}}}},
        {"symmetry": {"w": 0}},
        {"symmetry": {"x": 0.5}},
        {"sector": ("z", 12)},
        {"periodic": {"x": (1, 0)}},
        {"specular": {"object": {"x1": {"specular": 0.5}}}, "specular_bound": 2},
    ):
        with pytest.raises(hemicube.InputError):
            hemicube.compute(scene, **wrong)
