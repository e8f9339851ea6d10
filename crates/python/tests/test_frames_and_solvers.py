"""Data frames with the names of surfaces, and solvers' files read back by readers of their own."""

import json
import pathlib

import numpy as np
import pytest

import hemicube


def room(**cut: int) -> hemicube.Scene:
    """A closed box of 3 by 2 by 1, its sides objects: areas differ, and so F[i, j] and F[j, i] do."""
    a, b, c = 3.0, 2.0, 1.0
    vertices = [[0, 0, 0], [a, 0, 0], [a, b, 0], [0, b, 0], [0, 0, c], [a, 0, c], [a, b, c], [0, b, c]]
    quads = [[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [3, 2, 6, 7], [0, 3, 7, 4], [1, 5, 6, 2]]
    names = ["floor", "ceiling", "south", "north", "west", "east"]
    triangles = [corners for p, q, r, s in quads for corners in ([p, q, r], [p, r, s])]
    twice = [side for side in range(6) for _ in range(2)]
    return hemicube.Scene(
        vertices, triangles, object=twice, face=twice, material=twice, objects=names, materials=names, up="z", **cut
    )


NAMES = ["floor", "ceiling", "south", "north", "west", "east"]


def surfaces(**keywords: object) -> hemicube.Matrix:
    return hemicube.compute(room(split=3), patches="object", tolerance=0.001, **keywords)  # type: ignore[arg-type]


def test_frames_have_the_names_of_surfaces() -> None:
    pytest.importorskip("pandas")
    matrix = surfaces()
    frame = matrix.to_pandas()
    assert list(frame.index) == NAMES and list(frame.columns) == NAMES
    assert np.array_equal(frame.to_numpy(), matrix.to_scipy().toarray())
    # From rows to columns: the larger side sees less of the smaller.
    assert frame.loc["floor", "west"] < frame.loc["west", "floor"]
    ratio = frame.loc["west", "floor"] / frame.loc["floor", "west"]
    assert abs(ratio / 3.0 - 1.0) < 1e-3
    assert np.allclose(frame.sum(axis=1), 1.0, atol=1e-3)

    some = surfaces(rows=(1, 3)).to_pandas()
    assert some.loc["ceiling"].sum() > 0.9 and some.loc["floor"].isna().all()
    triangles = hemicube.compute(room()).to_pandas()
    assert list(triangles.index) == list(range(12)) == list(triangles.columns)
    zones = hemicube.compute(room(split=2)).zones("object").to_pandas()
    assert zones.loc["floor", "floor"] == 0.0 and abs(zones.loc["floor"].sum() - 1.0) < 0.02

    properties = {"default": {"emissivity": 0.8, "temperature": 300.0}, "object": {"floor": {"temperature": 310.0}}}
    exchange = hemicube.exchange(matrix, {"default": {"emissivity": 0.8}})
    gebhart = exchange.to_pandas()
    assert list(gebhart.columns) == [*NAMES, "(surroundings)"]
    assert np.array_equal(gebhart.to_numpy(), exchange.gebhart)
    areas = exchange.to_pandas("exchange_areas")
    assert abs(areas.loc["floor", "west"] / areas.loc["west", "floor"] - 1.0) < 1e-3
    with pytest.raises(hemicube.InputError, match="conductances"):
        exchange.to_pandas("script")  # type: ignore[arg-type]

    solution = hemicube.solve_heat(matrix, properties=properties)
    heat = solution.by_surface(matrix).to_pandas()
    assert list(heat.index) == NAMES and heat.loc["floor", "heat"] > 0.0 and abs(heat["heat"].sum()) < 1e-2

    points = hemicube.points(room(), [[1.5, 1.0, 0.5]]).to_pandas()
    assert list(points.columns) == [*NAMES, "(sky)", "(ground)", "(blocked)"]
    assert abs(points.loc[0].sum() - 1.0) < 1e-9


def test_bands_are_named_in_frames() -> None:
    pytest.importorskip("pandas")
    properties = {"bands": ["thermal", "solar"], "default": {"emissivity": [0.9, 0.3]}}
    exchange = hemicube.exchange(surfaces(), properties)
    solar = exchange.to_pandas(band="solar")
    assert np.array_equal(solar.to_numpy(), exchange.gebhart[1])
    with pytest.raises(hemicube.InputError, match="thermal, solar"):
        exchange.to_pandas()


def elmer(path: pathlib.Path, rows: int) -> np.ndarray:
    """As ElmerSolver's RadiationFactors.F90 reads a ViewFactors.dat of text, list-directed: for each radiating element
    in turn the number of its entries, then as many of `i j F`, of which `i` is not used."""
    words = iter(path.read_text().split())
    found = np.zeros((rows, rows))
    for row in range(rows):
        for _ in range(int(next(words))):
            next(words)
            column, factor = int(next(words)) - 1, float(next(words))
            found[row, column] = factor
    assert next(words, None) is None
    return found


def energyplus(path: pathlib.Path) -> tuple[str, np.ndarray]:
    """By the names of EnergyPlus's schema from 22.1 on: `view_factors` are groups of three."""
    (model,) = json.loads(path.read_text())["ZoneProperty:UserViewFactors:BySurfaceName"].values()
    assert set(model) == {"zone_or_zonelist_or_space_or_spacelist_name", "view_factors"}
    found = np.full((6, 6), np.nan)
    for group in model["view_factors"]:
        assert set(group) == {"from_surface", "to_surface", "view_factor"}
        found[NAMES.index(group["from_surface"]), NAMES.index(group["to_surface"])] = group["view_factor"]
    return model["zone_or_zonelist_or_space_or_spacelist_name"], found


def test_solvers_files_hold_rows_from_the_first_to_the_second(tmp_path: pathlib.Path) -> None:
    matrix = hemicube.compute(room(split=2), tolerance=0.001)
    wanted = matrix.zones("object").factors
    assert np.abs(wanted - wanted.T).max() > 0.1, "a transposed file would show"

    size = matrix.export(tmp_path / "ViewFactors.dat", format="elmer")
    assert size == (tmp_path / "ViewFactors.dat").stat().st_size
    found = elmer(tmp_path / "ViewFactors.dat", 6)
    # Faces are one of each object, in the file's order.
    assert np.allclose(found, wanted, atol=1e-6) and not np.allclose(found.T, wanted, atol=0.05)
    assert np.allclose(found.sum(axis=1), 1.0, atol=1e-3)

    matrix.export(tmp_path / "factors.epJSON", format="energyplus", zone="Room")
    zone, found = energyplus(tmp_path / "factors.epJSON")
    assert zone == "Room" and not np.isnan(found).any()
    # Rows are made to sum to 1, and pairs to be reciprocal: EnergyPlus would else do that itself.
    assert np.allclose(found, wanted, atol=2e-3) and not np.allclose(found.T, wanted, atol=0.05)
    assert np.allclose(found.sum(axis=1), 1.0, atol=2e-3)

    # The same of a matrix whose patches are the surfaces, in memory as it is.
    surfaces().export(tmp_path / "surfaces.epJSON", format="energyplus", zone="Room")
    zone, found = energyplus(tmp_path / "surfaces.epJSON")
    assert zone == "Room" and np.allclose(found, wanted, atol=2e-3)


@pytest.mark.parametrize("solver", ["calculix", "openfoam", "petsc", "udales", "view3d", "view3d-binary"])
def test_every_solver_writes_from_python(solver: str, tmp_path: pathlib.Path) -> None:
    matrix = hemicube.compute(room(split=2), tolerance=0.005)
    path = tmp_path / {"calculix": "F.vwf", "openfoam": "constant", "udales": "vfsparse.inp.001"}.get(solver, "F.out")
    if solver == "openfoam":
        path.mkdir()
    try:
        assert matrix.export(path, format=solver) > 0  # type: ignore[arg-type]
    except hemicube.InputError as error:
        # OpenFOAM's files go beside a mesh, and without one the next step is said.
        assert solver == "openfoam" and "polyMesh" in str(error)


def test_what_is_asked_in_vain_is_said(tmp_path: pathlib.Path) -> None:
    matrix = hemicube.compute(room())
    for keywords, says in [
        ({"format": "fluent"}, "calculix"),
        ({"format": "elmer", "zone": "Room"}, "`zone` has no meaning"),
        ({"by": "face"}, "without a solver"),
        ({"format": "elmer", "by": "zone"}, "patch, face, object or material"),
        ({"format": "energyplus"}, "epJSON"),
        ({"format": "elmer", "patches": True}, "`patches` has no meaning"),
    ]:
        with pytest.raises(hemicube.InputError, match=says):
            matrix.export(tmp_path / "x.dat", **keywords)  # type: ignore[arg-type]
    assert not (tmp_path / "x.dat").exists()
