"""Matrices: right, the program's, whole, and never copied."""

import math
import pathlib
from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse

import hemicube


def parallel_squares(distance: float) -> float:
    """F between two unit squares opposite each other (Howell, configuration C-11)."""
    x = 1 / distance
    root = math.sqrt(1 + x * x)
    return (
        2
        / (math.pi * x * x)
        * (math.log(math.sqrt(root**4 / (1 + 2 * x * x))) + 2 * x * root * math.atan(x / root) - 2 * x * math.atan(x))
    )


def squares(distance: float, split: int) -> hemicube.Scene:
    """Two unit squares that look at each other, objects 0 and 1."""
    low = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    vertices = np.concatenate([low, low + [0, 0, distance]])
    triangles = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]
    return hemicube.Scene(vertices, triangles, object=[0, 0, 1, 1], split=split)


@pytest.mark.parametrize("distance", [0.25, 1.0, 4.0])
def test_parallel_squares_have_their_closed_form(distance: float) -> None:
    scene = squares(distance, 2)
    matrix = hemicube.compute(scene, tolerance=1e-3)
    below, above = scene.object == 0, scene.object == 1
    factors = matrix.to_scipy().astype(float)
    found = scene.areas[below] @ (factors[below] @ above.astype(float)) / scene.areas[below].sum()
    assert found == pytest.approx(parallel_squares(distance), rel=2e-3)
    assert parallel_squares(1.0) == pytest.approx(0.1998, abs=5e-5)


def files(directory: pathlib.Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in sorted(directory.rglob("*"))
        if path.is_file() and path.suffix in (".json", ".npz")
    }


@pytest.mark.parametrize(
    ("scene", "keywords", "flags"),
    [
        ({"split": 4}, {}, ["--split", 4]),
        (
            {"patch_size": 150.0, "up": "y", "scale": 2.0, "two_sided": True},
            {"correction": "pixel", "resolution": 64, "samples": 4, "min_factor": 1e-4},
            "--patch-size 150 --up y --scale 2 --two-sided on --correction pixel --resolution 64 --samples 4 "
            "--min-factor 1e-4".split(),
        ),
        (
            {"split": 4},
            {"tolerance": 0.03, "store": "compact", "occluders": ["*block*"]},
            "--split 4 --tolerance 3% --form compact --occluders *block*".split(),
        ),
        ({}, {"sample_rows": 20, "seed": 7, "engine": "depth"}, "--rows 20 --seed 7 --engine depth".split()),
        ({}, {"rows": (3, 17), "culling": False}, "--rows 3..17 --culling off".split()),
        ({"split": 2}, {"patches": "object", "rows": (2, 5)}, "--split 2 --by object --rows 2..5".split()),
    ],
)
def test_a_store_is_the_programs_to_the_byte(
    scene: dict[str, object],
    keywords: dict[str, object],
    flags: list[object],
    cornell_box: pathlib.Path,
    program: Callable[..., None],
    tmp_path: pathlib.Path,
) -> None:
    program("compute", cornell_box, "-o", tmp_path / "program", "--quiet", "--config=none", "--backend", "cpu", *flags)
    read = hemicube.Scene.load(cornell_box, **scene)  # type: ignore[arg-type]
    matrix = hemicube.compute(read, output=tmp_path / "python", threads=2, **keywords)  # type: ignore[arg-type]
    theirs, ours = files(tmp_path / "program"), files(tmp_path / "python")
    assert len(theirs) >= 3
    assert theirs.keys() == ours.keys()
    for name, content in theirs.items():
        assert ours[name] == content, name
    # And in memory, the same values.
    again = hemicube.compute(read, **(keywords | {"output": None}))  # type: ignore[arg-type]
    assert again.settings == matrix.settings
    for of in ("row_sums", "escaped", "blocked", "unselected", "errors", "closure", "areas"):
        assert np.array_equal(getattr(again, of), getattr(matrix, of), equal_nan=True), of
    difference = again.to_scipy() - matrix.to_scipy()
    assert again.nnz == matrix.nnz == again.to_scipy().nnz and difference.count_nonzero() == 0
    assert again.expected_error() == matrix.expected_error()
    assert (matrix.expected_error() is not None) == (keywords.get("correction") != "pixel")


def test_an_update_is_the_programs_and_takes_rows_over(
    cornell_box: pathlib.Path, program: Callable[..., None], tmp_path: pathlib.Path
) -> None:
    whole = hemicube.Scene.load(cornell_box, split=4)
    hemicube.compute(whole, output=tmp_path / "whole")
    without = {"split": 4, "exclude": ["short_block"]}
    scene = hemicube.Scene.load(cornell_box, **without)  # type: ignore[arg-type]
    ours = hemicube.compute(scene, output=tmp_path / "python", update=tmp_path / "whole")
    flags = ["--split", 4, "--exclude", "short_block", "--update", tmp_path / "whole"]
    program("compute", cornell_box, "-o", tmp_path / "program", "--quiet", "--config=none", *flags)
    assert files(tmp_path / "program") == files(tmp_path / "python")
    assert "update" in ours.settings
    in_memory = hemicube.compute(scene, update=tmp_path / "whole")
    assert (in_memory.to_scipy() - ours.to_scipy()).count_nonzero() == 0
    with pytest.raises(hemicube.InputError, match="tolerance"):
        hemicube.compute(scene, update=tmp_path / "whole", tolerance=0.01)


def address(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])


def test_nothing_is_copied_on_the_way_to_scipy() -> None:
    matrix = hemicube.compute(hemicube.Scene.generate("room", 3000))
    first, second = matrix.to_scipy(), matrix.csr
    assert isinstance(first, scipy.sparse.csr_matrix) and first is not second
    assert (first.dtype, first.indices.dtype, first.indptr.dtype) == (np.float32, np.int32, np.int32)
    for of in ("data", "indices", "indptr"):
        ours = getattr(first, of)
        assert address(ours) == address(getattr(second, of)), of
        # Its memory is a vector of the extension's, not NumPy's.
        owner = ours
        while isinstance(owner, np.ndarray):
            assert not owner.flags.owndata
            owner = owner.base
        assert type(owner).__name__ == "PySliceContainer"
        assert not ours.flags.writeable
    columns, factors = matrix.row(7) or (None, None)
    assert columns is not None and factors is not None
    assert address(factors) == address(first.data) + 4 * int(first.indptr[7])
    with pytest.raises(ValueError, match="read-only"):
        first.data[0] = 2.0
    changed = first.copy()
    changed.data[:] = 1.0
    assert matrix.to_scipy().data.max() < 1.0
    # The arrays outlive the matrix.
    total = first.sum()
    del matrix, second, columns, factors
    assert first.sum() == total


def test_rows_one_by_one_are_the_matrix(tmp_path: pathlib.Path) -> None:
    scene = hemicube.Scene.generate("city", 800)
    memory = hemicube.compute(scene)
    store = hemicube.compute(scene, output=tmp_path / "store")
    assert store.path == tmp_path / "store" and memory.path is None
    whole = memory.to_scipy()
    for matrix in (memory, store, hemicube.open(tmp_path / "store")):
        rows = matrix.rows()
        assert rows.__length_hint__() == len(scene)
        for expected, (patch, columns, factors) in enumerate(rows):
            assert patch == expected
            assert np.array_equal(columns, whole[patch].indices) and np.array_equal(factors, whole[patch].data)
        assert sum(len(factors) for _, _, factors in matrix) == whole.nnz
        with pytest.raises(IndexError, match="there is no row 99999"):
            matrix.row(99999)
    stored = [patch for patch, _, _ in store.rows(stored_order=True)]
    assert sorted(stored) == list(range(len(scene))) and stored != sorted(stored)
    x = np.random.default_rng(1).random(len(scene))
    for matrix in (memory, store):
        assert np.allclose(matrix @ x, whole.astype(float) @ x, rtol=1e-12)
        assert np.array_equal(matrix @ x, matrix.multiply(x, threads=1))


def test_what_rows_come_to_adds_up() -> None:
    scene = hemicube.Scene.generate("room", 2000)
    matrix = hemicube.compute(scene, correction="pixel", resolution=64)
    assert np.abs(matrix.closure).max() < 1e-6
    assert np.allclose(matrix.row_sums, np.asarray(matrix.to_scipy().sum(axis=1)).ravel(), rtol=1e-5)
    assert np.array_equal(matrix.areas, scene.areas) and matrix.escaped.max() < 1e-6
    assert np.isnan(matrix.errors).all() and matrix.expected_error() is None
    assert matrix.settings["resolution"] == 64 and matrix.complete and matrix.shape == (len(scene),) * 2


def test_some_rows_only() -> None:
    scene = hemicube.Scene.generate("room", 500)
    whole = hemicube.compute(scene).to_scipy()
    some = hemicube.compute(scene, rows=(10, 20))
    assert [patch for patch, _, _ in some] == list(range(10, 20))
    assert (some.to_scipy()[10:20] != whole[10:20]).nnz == 0 and some.nnz == whole[10:20].nnz
    assert np.isnan(some.row_sums[9]) and some.row(9) is None
    with pytest.raises(hemicube.InputError, match="no rows of"):
        hemicube.solve(some, 0.5, 1.0)


@pytest.mark.parametrize(
    ("keywords", "kind", "message"),
    [
        ({"tolerance": 2.0}, hemicube.InputError, "`tolerance` is 2"),
        ({"tolerance": 0.01, "resolution": 64}, hemicube.InputError, "a tolerance chooses its hemicubes"),
        ({"tolerance": 1e-4, "store": "compact"}, hemicube.InputError, "the compact form rounds"),
        ({"correction": "pixel", "resolution": 63}, hemicube.InputError, "a multiple of 16"),
        ({"correction": "pixel", "samples": 3}, hemicube.InputError, "a perfect square"),
        ({"correction": "best"}, hemicube.InputError, "tolerance or pixel"),
        ({"rows": (5, 5)}, hemicube.InputError, r"`rows` is \(5, 5\)"),
        ({"rows": (0, 1), "sample_rows": 3}, hemicube.InputError, "exclude each other"),
        ({"emitters": ["no such*"]}, hemicube.InputError, "`emitters`: `no such\\*` matches no object"),
        ({"min_factor": 1.5}, hemicube.InputError, "`min_factor` is 1.5"),
        ({"backend": "nonesuch"}, hemicube.BackendError, "no backend named `nonesuch`"),
        ({"backend_options": {"device": "1"}}, hemicube.InputError, "has no options"),
        ({"engine": "steam"}, hemicube.InputError, "auto, depth, order or claims"),
    ],
)
def test_settings_are_refused_by_name(keywords: dict[str, object], kind: type[Exception], message: str) -> None:
    with pytest.raises(kind, match=message):
        hemicube.compute(squares(1.0, 1), **keywords)  # type: ignore[arg-type]


def test_stores_that_are_something_else(tmp_path: pathlib.Path) -> None:
    scene = squares(1.0, 2)
    matrix = hemicube.compute(scene, output=tmp_path / "store")
    with pytest.raises(hemicube.StoreError, match="tolerance 0.02.*tolerance 0.05.*`overwrite=True` replaces it"):
        hemicube.compute(scene, output=tmp_path / "store", tolerance=0.05)
    other = hemicube.compute(scene, output=tmp_path / "store", tolerance=0.05, overwrite=True)
    assert (matrix.settings["tolerance"], other.settings["tolerance"]) == (0.02, 0.05)
    (tmp_path / "full").mkdir()
    (tmp_path / "full/thesis.tex").write_text("")
    with pytest.raises(ValueError, match="full"):
        hemicube.compute(scene, output=tmp_path / "full")
    with pytest.raises(hemicube.StoreError, match="is no store"):
        hemicube.open(tmp_path / "full")
    manifest = tmp_path / "store/manifest.json"
    manifest.write_text(manifest.read_text().replace("128", "129").replace("64", "63"))
    with pytest.raises(hemicube.StoreError, match="has changed since it was written"):
        hemicube.open(tmp_path / "store")


def test_double_stores_are_float64(tmp_path: pathlib.Path) -> None:
    scene = hemicube.Scene.generate("room", 60)
    single = hemicube.compute(scene, tolerance=5e-4)
    double = hemicube.compute(scene, tolerance=5e-4, store="double")
    stored = hemicube.compute(scene, tolerance=5e-4, store="double", output=tmp_path / "double")
    for matrix in (double, stored):
        F = matrix.to_scipy()
        assert F.dtype == np.float64 and matrix.csr.dtype == np.float64
        columns, factors = matrix.row(3) or (None, None)
        assert factors is not None and factors.dtype == np.float64
        assert (F != double.to_scipy()).nnz == 0
        # f32 and f64 of one row differ in the eighth digit, and closed forms in the fourth.
        assert 0 < abs(F - single.to_scipy()).max() < 1e-3
    ours = scipy.sparse.vstack([scipy.sparse.load_npz(part) for part in sorted((tmp_path / "double/parts").iterdir())])
    assert ours.dtype == np.float64 and ours.nnz == stored.nnz
    with pytest.raises(ValueError, match="double"):
        hemicube.compute(scene, tolerance=1e-7)
    with pytest.raises(ValueError, match="plain, compact or double"):
        hemicube.compute(scene, store="wide")
