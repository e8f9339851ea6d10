"""Matrices, scenes and solutions through pickle; files for other programs; zones; heat."""

import copy
import csv
import json
import pathlib
import pickle
import struct
from collections.abc import Callable

import numpy as np
import pytest
import scipy.io
import scipy.sparse

import hemicube


def plates() -> hemicube.Scene:
    """A floor and a ceiling of unit squares at unit distance, and two walls."""
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    triangles = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], [0, 4, 1], [1, 4, 5]]
    objects = ["floor", "ceiling", "wall"]
    return hemicube.Scene(vertices, triangles, object=[0, 0, 1, 1, 2, 2], objects=objects, split=3, up="z")


def same(one: hemicube.Matrix, other: hemicube.Matrix) -> None:
    for of in ("areas", "row_sums", "escaped", "blocked", "unselected", "errors"):
        assert np.array_equal(getattr(one, of), getattr(other, of), equal_nan=True), of
    assert one.settings == other.settings and one.expected_error() == other.expected_error()
    ours, theirs = one.to_scipy(), other.to_scipy()
    for of in ("data", "indices", "indptr"):
        assert np.array_equal(getattr(ours, of), getattr(theirs, of)), of


@pytest.mark.parametrize(
    "keywords",
    [{}, {"tolerance": 0.02}, {"store": "compact", "min_factor": 1e-3}, {"rows": (3, 20)}, {"correction": "pixel"}],
)
def test_a_matrix_in_memory_comes_back_to_the_bit(keywords: dict[str, object]) -> None:
    matrix = hemicube.compute(plates(), **keywords)  # type: ignore[arg-type]
    kept = pickle.dumps(matrix)
    again = pickle.loads(kept)
    assert again.path is None
    same(matrix, again)
    assert pickle.dumps(again) == kept
    same(matrix, copy.deepcopy(matrix))


def test_a_stored_matrix_comes_back_by_its_path(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    matrix = hemicube.compute(plates(), output="plates.hemicube")
    kept = pickle.dumps(matrix)
    assert len(kept) < 1000
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    again = pickle.loads(kept)
    assert again.path == tmp_path / "plates.hemicube"
    monkeypatch.chdir(tmp_path)
    same(matrix, again)
    hemicube.compute(plates(), output=tmp_path / "plates.hemicube", tolerance=0.05, overwrite=True)
    with pytest.raises(hemicube.StoreError, match="other settings than when it was pickled"):
        pickle.loads(kept)


def test_a_pickle_is_read_like_a_file_of_a_stranger() -> None:
    make, (files,) = hemicube.compute(plates()).__reduce__()
    (part,) = [name for name in files if name.startswith("parts/")]
    changed = bytearray(files[part])
    changed[len(changed) // 2] ^= 1
    with pytest.raises(hemicube.StoreError):
        make(files | {part: bytes(changed)})
    with pytest.raises(hemicube.StoreError, match="which no store has"):
        make(files | {"../../evil": b""})
    make, (state,) = plates().__reduce__()
    for wrong in ({"ids": state["ids"] + 7}, {"corners": state["corners"][:5]}, {"up": "w"}, {"scale": "1"}):
        with pytest.raises((hemicube.Error, TypeError)):
            make(state | wrong)
    solution = hemicube.solve(hemicube.compute(plates()), 0.5, 1.0)
    make, arguments = solution.__reduce__()
    with pytest.raises(hemicube.Error):
        make(arguments[0], arguments[1][:-1], *arguments[2:])


@pytest.mark.parametrize(
    "keywords",
    [
        {},
        {"split": 2, "up": "y", "scale": 0.3},
        {"patch_size": 150.0, "two_sided": True, "keep_duplicates": True},
        {"split": 3, "flip": ["*block*"]},
    ],
)
def test_a_scene_comes_back_to_the_bit(keywords: dict[str, object], cornell_box: pathlib.Path) -> None:
    scene = hemicube.Scene.load(cornell_box, **keywords)  # type: ignore[arg-type]
    again = pickle.loads(pickle.dumps(scene))
    for of in ("corners", "areas", "normals", "face", "object", "material", "side"):
        assert np.array_equal(getattr(scene, of), getattr(again, of)), of
    assert (scene.objects, scene.materials, scene.up) == (again.objects, again.materials, again.up)
    assert repr(scene) == repr(again)
    # The same scene for a store, too: its hash and settings are.
    kept = [pickle.dumps(hemicube.compute(of, rows=(0, 5))) for of in (scene, again)]
    assert kept[0] == kept[1]


def test_a_solution_comes_back_to_the_bit() -> None:
    matrix = hemicube.compute(plates())
    count = matrix.shape[0]
    for solution in (
        hemicube.solve(matrix, 0.3, np.linspace(0, 1, count)),
        hemicube.solve(matrix, 0.3, np.linspace(0, 1, 2 * count).reshape(count, 2)),
        hemicube.solve_heat(matrix, 0.9, np.linspace(280, 300, count), ambient=270.0),
    ):
        again = pickle.loads(pickle.dumps(solution))
        for of in ("radiosity", "irradiance", "flux", "temperature"):
            ours, theirs = getattr(solution, of), getattr(again, of)
            assert (ours is None) == (theirs is None) and (ours is None or np.array_equal(ours, theirs)), of
        for of in ("residuals", "iterations", "converged", "balance"):
            assert getattr(solution, of) == getattr(again, of), of


def test_every_format_is_the_programs_to_the_byte(
    cornell_box: pathlib.Path, program: Callable[..., None], tmp_path: pathlib.Path
) -> None:
    """A matrix in memory and one in a store are exported alike, and like the program's."""
    scene = hemicube.Scene.load(cornell_box, split=2)
    stored, memory = hemicube.compute(scene, output=tmp_path / "box"), hemicube.compute(scene)
    for ending in ("npz", "mtx", "txt", "dat", "npy", "parquet"):
        program("export", tmp_path / "box", "-o", tmp_path / f"theirs.{ending}", "--quiet")
        for name, matrix in (("stored", stored), ("memory", memory)):
            size = matrix.export(tmp_path / f"{name}.{ending}")
            content = (tmp_path / f"{name}.{ending}").read_bytes()
            assert content == (tmp_path / f"theirs.{ending}").read_bytes() and len(content) == size, ending
    assert (scipy.sparse.load_npz(tmp_path / "memory.npz") != memory.to_scipy()).nnz == 0
    # `.mtx` names its program, not the machine.
    assert scipy.io.mmread(tmp_path / "memory.mtx").shape == memory.shape
    shown = ["--scene", cornell_box, "--show", "seen"]
    flags = {"vtp": shown[:2], "vtu": shown[:2], "glb": shown, "ply": shown, "csv": []}
    for ending, words in flags.items():
        program("export", tmp_path / "box", "-o", tmp_path / f"theirs.{ending}", "--quiet", *words)
        for name, matrix in (("stored", stored), ("memory", memory)):
            matrix.export(tmp_path / f"{name}.{ending}", scene=scene if words else None)
            content = (tmp_path / f"{name}.{ending}").read_bytes()
            assert content == (tmp_path / f"theirs.{ending}").read_bytes(), ending
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_results_of_ones_own_are_exported(tmp_path: pathlib.Path) -> None:
    scene, values = plates(), np.arange(54.0)
    matrix = hemicube.compute(scene)
    matrix.export(tmp_path / "plates.csv", values={"temperature": values})
    with (tmp_path / "plates.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["temperature"]) for row in rows] == list(values)
    matrix.export(tmp_path / "plates.npz", patches=True, values={"temperature": values})
    assert np.array_equal(np.load(tmp_path / "plates.npz")["temperature"], values)
    matrix.export(tmp_path / "plates.glb", scene=scene, values={"temperature": values})
    content = (tmp_path / "plates.glb").read_bytes()
    (length,) = struct.unpack("<I", content[12:16])
    assert "temperature" in json.dumps(json.loads(content[20 : 20 + length]))


@pytest.mark.parametrize(
    ("name", "keywords", "kind", "message"),
    [
        ("F.h5", {}, hemicube.InputError, "does not say which format is wanted.*`.npz`.*of patches.*`.vtp`"),
        ("F.mtx", {"show": "seen"}, hemicube.InputError, "`show` has no meaning for `.*F.mtx`"),
        ("F.vtp", {}, hemicube.InputError, "`scene=` has them"),
        ("F.glb", {"scene": hemicube.Scene.generate("room", 100)}, hemicube.InputError, "`scene` is another"),
        ("F.glb", {"scene": plates(), "show": "beauty"}, hemicube.InputError, "`show` is `beauty`; one of patch, "),
        ("F.csv", {"show": "seen"}, hemicube.InputError, "has no colours"),
        ("F.csv", {"values": {"area": np.ones(54)}}, hemicube.InputError, "which the matrix has too"),
        ("F.csv", {"values": {"mine": [1.0]}}, hemicube.InputError, "has the shape"),
        ("there.mtx", {}, hemicube.StoreError, "exists; `overwrite=True` replaces it"),
        ("no/folder/F.mtx", {}, hemicube.FileError, "no/folder"),
    ],
)
def test_exports_are_refused_by_name(
    name: str, keywords: dict[str, object], kind: type[Exception], message: str, tmp_path: pathlib.Path
) -> None:
    (tmp_path / "there.mtx").write_text("")
    with pytest.raises(kind, match=message):
        hemicube.compute(plates()).export(tmp_path / name, **keywords)  # type: ignore[arg-type]


def test_zones_are_the_programs(cornell_box: pathlib.Path, program: Callable[..., None], tmp_path: pathlib.Path) -> None:
    scene = hemicube.Scene.load(cornell_box, split=2)
    stored, memory = hemicube.compute(scene, output=tmp_path / "box"), hemicube.compute(scene)
    program("export", tmp_path / "box", "-o", tmp_path / "zones.csv", "--by", "object", "--quiet")
    with (tmp_path / "zones.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for zones in (stored.zones(), memory.zones("object")):
        assert zones.names == [row["zone"] for row in rows] and len(zones) == len(rows)
        assert list(zones.areas) == [float(row["area"]) for row in rows]
        assert list(zones.patches) == [int(row["patches"]) for row in rows]
        for of in ("escaped", "blocked", "unselected"):
            assert list(getattr(zones, of)) == [float(row[of]) for row in rows]
        assert zones.factors.tolist() == [[float(row[to]) for to in zones.names] for row in rows]
    assert zones["floor", "ceiling"] == zones.factors[zones.names.index("floor"), zones.names.index("ceiling")]
    exchange = zones.areas[:, None] * zones.factors
    assert np.allclose(exchange, exchange.T, rtol=0.1, atol=1e-3 * exchange.max())
    with pytest.raises(KeyError, match="no zone `attic`"):
        zones["floor", "attic"]
    with pytest.raises(hemicube.InputError, match="object, material or face"):
        memory.zones("colour")  # type: ignore[arg-type]
    assert len(memory.zones("face")) == len({(face, side) for face, side in zip(scene.face, scene.side)})


def test_heat_is_the_programs(cornell_box: pathlib.Path, program: Callable[..., None], tmp_path: pathlib.Path) -> None:
    scene = hemicube.Scene.load(cornell_box, split=2)
    matrix = hemicube.compute(scene, output=tmp_path / "box")
    names = [scene.materials[place] for place in scene.material]
    first, second, *_ = dict.fromkeys(names)
    (tmp_path / "oven.toml").write_text(
        "[default]\nemissivity = 0.8\ntemperature = 290\n"
        f'[material."{first}"]\nemissivity = 0.95\ntemperature = 700\n[material."{second}"]\nadiabatic = true\n'
    )
    program(
        "solve", tmp_path / "box", "--thermal", "--materials", tmp_path / "oven.toml", "--sky-temperature", 280,
        "-o", tmp_path / "theirs.npz", "--quiet",
    )  # fmt: skip
    theirs = np.load(tmp_path / "theirs.npz")
    emissivity = np.array([{first: 0.95}.get(name, 0.8) for name in names])
    kelvin = np.array([{first: 700.0, second: np.nan}.get(name, 290.0) for name in names])
    heat = hemicube.solve_heat(matrix, emissivity, kelvin, ambient=280.0)
    for of in ("radiosity", "irradiance", "flux", "temperature"):
        assert np.array_equal(getattr(heat, of), np.ravel(theirs[of])), of
    adiabatic = np.isnan(kelvin)
    assert heat.temperature is not None and np.abs(heat.flux[adiabatic]).max() < 1e-2
    assert 290 < heat.temperature[adiabatic].min() < heat.temperature[adiabatic].max() < 700
    # Several states at once are each as alone.
    both = hemicube.solve_heat(matrix, emissivity, np.stack([kelvin, np.full(len(scene), 300.0)], axis=1), ambient=280.0)
    assert both.temperature is not None and both.temperature.shape == (len(scene), 2)
    assert np.allclose(both.flux[:, 0], heat.flux, rtol=1e-4, atol=1e-2 * np.abs(heat.flux).mean())
    # Light has a flux, and no temperature.
    light = hemicube.solve(matrix, 0.5, 1.0)
    assert light.temperature is None and np.array_equal(light.flux, light.radiosity - light.irradiance)


@pytest.mark.parametrize(
    ("emissivity", "kelvin", "ambient", "message"),
    [
        (1.5, 300.0, 0.0, "an emissivity is 1.5"),
        (0.9, -3.0, 0.0, "a temperature is -3"),
        (0.9, 300.0, float("nan"), "`ambient` is NaN"),
        (0.9, [300.0], 0.0, "`temperature` has the shape"),
        ([0.9], 300.0, 0.0, "`emissivity` has the shape"),
    ],
)
def test_heat_is_refused_by_name(emissivity: object, kelvin: object, ambient: float, message: str) -> None:
    with pytest.raises(hemicube.InputError, match=message):
        hemicube.solve_heat(hemicube.compute(plates()), emissivity, kelvin, ambient=ambient)  # type: ignore[arg-type]
