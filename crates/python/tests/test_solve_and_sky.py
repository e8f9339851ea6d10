"""Light, heat and sky, against what can be said exactly."""

import math
import pathlib

import numpy as np
import pytest

import hemicube


def room() -> hemicube.Scene:
    return hemicube.Scene.generate("room", 1200)


def test_a_furnace_glows_alike_everywhere(tmp_path: pathlib.Path) -> None:
    """In a closed room of reflectance r that emits 1, every patch has the radiosity 1 / (1 − r)."""
    # A box without anything in it, seen from within: a tetrahedron's edges cannot be wound wrongly.
    vertices = [[0, 0, 0], [3, 0, 0], [0, 2, 0], [0, 0, 1]]
    inwards = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
    scene = hemicube.Scene(vertices, inwards, split=12)
    memory = hemicube.compute(scene, correction="pixel")
    store = hemicube.compute(scene, correction="pixel", output=tmp_path / "store")
    assert memory.escaped.max() == 0.0 and memory.blocked.max() == 0.0
    for matrix in (memory, store):
        for method in ("gmres", "gauss-seidel", "jacobi"):
            solution = hemicube.solve(matrix, 0.5, 1.0, method=method, tolerance=1e-9)  # type: ignore[arg-type]
            assert solution.converged and solution.residuals[0] <= 1e-9
            assert np.allclose(solution.radiosity, 2.0, rtol=1e-6)
    # Runs of rows differ between the two, and no sum does.
    of_memory, of_store = (hemicube.solve(matrix, 0.5, 1.0, method="jacobi") for matrix in (memory, store))
    assert np.allclose(of_memory.radiosity, of_store.radiosity, rtol=1e-12)


def test_solutions_are_scipys() -> None:
    scipy_sparse = pytest.importorskip("scipy.sparse")
    scene = hemicube.Scene.generate("city", 600)
    matrix = hemicube.compute(scene)
    random = np.random.default_rng(5)
    count = len(scene)
    reflectance, emission = random.random((count, 2)) * 0.9, random.random((count, 4))
    outside = random.random((count, 4))
    # Of the matrix as it is: by default both rows of a pair have one number.
    solution = hemicube.solve(matrix, reflectance, emission, outside=outside, tolerance=1e-10, as_stored=True)
    factors = matrix.to_scipy().astype(float).tocsc()
    # What rows lack of 1 and backs see exchanges nothing: it is given back.
    returned = 1.0 - np.asarray(factors.sum(axis=1)).ravel() - np.nan_to_num(matrix.escaped)
    factors = factors + scipy_sparse.diags(returned)
    for side in range(4):
        rho = reflectance[:, side % 2]
        system = (np.eye(count) - rho[:, None] * factors.toarray())
        expected = np.linalg.solve(system, emission[:, side] + rho * outside[:, side])
        assert np.allclose(solution.radiosity[:, side], expected, rtol=1e-7)
        assert np.allclose(solution.irradiance[:, side], factors @ expected + outside[:, side], rtol=1e-7)
        balance = solution.balance[side]
        put_in = balance.pop("emitted") + balance.pop("from_outside")
        # Of what rows lack of 1, or have beyond it.
        assert 0.0 < abs(balance.pop("returned")) < 0.02 * put_in
        assert sum(balance.values()) == pytest.approx(put_in, rel=1e-9)
    assert solution.radiosity.shape == (count, 4)


def test_what_does_not_converge_says_so() -> None:
    matrix = hemicube.compute(room())
    # Uneven, as a furnace is found at once.
    emission = np.linspace(0.0, 1.0, matrix.shape[0])
    with pytest.warns(RuntimeWarning, match="did not reach the tolerance"):
        solution = hemicube.solve(matrix, 0.99, emission, max_iterations=2)
    assert not solution.converged


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1.5, 1.0), "a reflectance is 1.5"),
        ((0.5, math.nan), "an emission is NaN"),
        ((0.5, [1.0, 2.0]), "`emission` has the shape"),
        ((1.0, 1.0), "adds up for ever, and no radiosity is finite"),
        (([[0.5, 0.5]] * 1200, [[1.0]] * 1200), "shape|bands"),
    ],
)
def test_what_cannot_be_solved_is_refused_by_name(arguments: tuple[object, object], message: str) -> None:
    matrix = hemicube.compute(room())
    with pytest.raises(hemicube.InputError, match=message):
        hemicube.solve(matrix, *arguments)  # type: ignore[arg-type]


def street(height: float) -> hemicube.Scene:
    """A long street between two walls: a floor of width 2, cut along it, and walls on both sides."""
    length = 400.0
    corners = [
        [[-1, -length, 0], [1, -length, 0], [1, length, 0], [-1, length, 0]],
        [[-1, -length, 0], [-1, length, 0], [-1, length, height], [-1, -length, height]],
        [[1, length, 0], [1, -length, 0], [1, -length, height], [1, length, height]],
    ]
    vertices = np.array(corners, dtype=float).reshape(-1, 3)
    quads = np.arange(12).reshape(3, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return hemicube.Scene(vertices, triangles, object=[0, 1, 2] * 2, objects=["floor", "left", "right"], up="z")


@pytest.mark.parametrize("height", [0.5, 1.0, 3.0])
def test_the_middle_of_a_street_sees_its_closed_form(height: float) -> None:
    """From the middle of a floor of half width 1, long as it is, the sky takes cos of the angle up to the walls' tops."""
    sky = hemicube.sky_of_points(street(height), [[0, 0, 0.0005]], [[0, 0, 1]], resolution=512)
    expected = 1 / math.sqrt(1 + height * height)
    assert sky.view_factors[0] == pytest.approx(expected, abs=3e-3)
    row = sky.to_scipy()
    assert row.shape == (1, 146) and float(row.sum()) == pytest.approx(float(sky.view_factors[0] + sky.ground[0]), rel=1e-12)
    seen = sky.patches_to_scipy()
    assert seen is not None and float(seen.sum() + row.sum()) == pytest.approx(1.0, abs=1e-9)


def test_a_level_plane_sees_the_whole_sky_and_a_wall_half_of_it() -> None:
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 5], [1, 0, 5], [1, 0, 6]]
    scene = hemicube.Scene(vertices, [[0, 1, 2], [3, 4, 5]])
    sky = hemicube.sky(scene, up="z")
    assert sky.view_factors[0] == pytest.approx(1.0, abs=2e-3)
    assert (sky.view_factors[1], sky.ground[1]) == pytest.approx((0.5, 0.5), abs=1e-2)
    assert sky.patches_to_scipy() is None and len(sky) == 2
    assert float(sky.solid_angles[1:].sum()) == pytest.approx(2 * math.pi)
    assert hemicube.sky(scene, up="z", division="reinhart:2").to_scipy().shape == (2, 578)
    with pytest.raises(hemicube.InputError, match="which axis points up"):
        hemicube.sky(scene)
    with pytest.raises(hemicube.InputError, match="`division` is `squares`"):
        hemicube.sky(scene, up="z", division="squares")


def test_a_tolerance_refines() -> None:
    scene = hemicube.Scene.generate("city", 100)
    sky = hemicube.sky(scene, up="y", tolerance=0.02, resolution=64)
    plain = hemicube.sky(scene, up="y", resolution=64)
    assert np.isnan(plain.changes).all() and np.nanmax(sky.changes) < 0.5
    assert np.abs(sky.view_factors - plain.view_factors).max() > 0
