"""Heat by the names of surfaces, and exchange between them, against closed forms and the program."""

from __future__ import annotations

import json
import pathlib
import pickle
from collections.abc import Callable

import numpy as np
import pytest

import hemicube

STEFAN = hemicube.STEFAN_BOLTZMANN


def room() -> hemicube.Scene:
    """A closed room of 6 x 5 x 2.7, six objects."""
    corners = np.array([[x, y, z] for z in (0, 2.7) for y in (0, 5) for x in (0, 6)], dtype=float)
    quads = {
        "floor": (0, 1, 3, 2),
        "ceiling": (4, 6, 7, 5),
        "south": (0, 4, 5, 1),
        "north": (2, 3, 7, 6),
        "west": (0, 2, 6, 4),
        "east": (1, 5, 7, 3),
    }
    triangles = [[q[a], q[b], q[c]] for q in quads.values() for a, b, c in ((0, 1, 2), (0, 2, 3))]
    names = list(quads)
    return hemicube.Scene(corners, triangles, object=np.repeat(range(6), 2), objects=names, split=3, up="z")


def test_objects_have_properties_and_heat_adds_up() -> None:
    """A heated floor is the textbook's two surfaces within a per cent, and nothing is lost."""
    matrix = hemicube.compute(room())
    tables = {
        "default": {"emissivity": np.float32(0.9), "temperature": "20 °C"},
        "object": {"floor": {"temperature": 303.15}},
    }
    heat = hemicube.solve_heat(matrix, properties=tables)
    surfaces = heat.by_surface(matrix)
    rest = 30 + 2 * 2.7 * 11
    resistance = 0.1 / (0.9 * 30) + 1 / 30 + 0.1 / (0.9 * rest)
    assert surfaces["floor"] == pytest.approx(STEFAN * (303.15**4 - 293.15**4) / resistance, rel=0.01)
    assert surfaces.heat.sum() == pytest.approx(surfaces.balance["error"], abs=1e-6)
    assert abs(surfaces.balance["error"]) < 1e-3 * surfaces["floor"]
    assert surfaces.names[0] == "floor" and surfaces.temperature[0] == pytest.approx(303.15)
    assert set(surfaces.to_dict()) >= {"name", "heat", "temperature"}
    again = pickle.loads(pickle.dumps(heat)).by_surface(matrix)
    assert np.array_equal(again.heat, surfaces.heat)
    with pytest.raises(KeyError, match="no surface `flor`"):
        surfaces["flor"]


def test_cold_temperatures_and_an_open_scene_are_questioned() -> None:
    """Two plates of which 80 % of the view escapes, and temperatures that are degrees Celsius as a rule."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    matrix = hemicube.compute(hemicube.Scene(corners, [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7]], split=3, up="z"))
    with pytest.warns(UserWarning, match="% of the view leaves the scene.*`ambient`"):
        hemicube.solve_heat(matrix, 0.9, 300.0)
    with pytest.warns(UserWarning, match="20 K of `temperature`: below 100 K"):
        hemicube.solve_heat(matrix, 0.9, 20.0, ambient=300.0)
    with pytest.warns(UserWarning, match="20 K of `ambient`: below 100 K"):
        hemicube.solve_heat(matrix, 0.9, 300.0, ambient=20)
    with pytest.warns(UserWarning, match="20 K of faces without a material: below 100 K"):
        hemicube.solve_heat(matrix, properties={"default": {"emissivity": 0.9, "temperature": 20}}, ambient=300)
    # Warnings are errors here: cold space, degrees Celsius and a closed room are none.
    hemicube.solve_heat(matrix, 0.9, 300.0, ambient=0)
    hemicube.solve_heat(matrix, properties={"default": {"emissivity": 0.9, "temperature": "20 °C"}}, ambient="20 °C")
    hemicube.solve_heat(hemicube.compute(room()), 0.9, 300.0)


def test_a_closed_room_without_a_temperature_is_refused() -> None:
    matrix = hemicube.compute(room())
    with pytest.raises(hemicube.InputError, match="nothing determines the temperatures"):
        hemicube.solve_heat(matrix, 0.9, np.nan)
    emissivity, kelvin = np.full(matrix.shape[0], 0.9), np.full(matrix.shape[0], np.nan)
    emissivity[0], kelvin[0] = 0.0, 300.0
    with pytest.raises(hemicube.InputError, match="nothing determines the temperatures"):
        hemicube.solve_heat(matrix, emissivity, kelvin)
    kelvin[1] = 300.0
    assert np.allclose(hemicube.solve_heat(matrix, emissivity, kelvin).temperature, 300.0)



def test_mixed_conditions_are_kept() -> None:
    """Fluxes, totals and floating bodies; the rest of the heat is what the only temperature takes."""
    matrix = hemicube.compute(room())
    tables = {
        "default": {"emissivity": 0.9},
        "object": {
            "floor": {"flux": 40},
            "ceiling": {"adiabatic": True},
            "east": {"temperature": "5C"},
            "*st": {"isothermal": True},
            "*th": {"isothermal": True, "heat": -50},
        },
    }
    surfaces = hemicube.solve_heat(matrix, properties=tables).by_surface(matrix)
    for name, wanted in {"floor": 1200, "ceiling": 0, "north": -50, "south": -50, "west": 0, "east": -1100}.items():
        assert surfaces[name] == pytest.approx(wanted, abs=1), name
    west = surfaces.names.index("west")
    assert surfaces.least_temperature[west] == surfaces.greatest_temperature[west] > 278.15


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"object": {"flor": {}}}, "`flor` matches no object; the matrix has .*`floor`"),
        ({"object": {"floor": {"flus": 3}}}, "no dictionary of properties.*flus"),
        ({"default": {"emissivity": 0.9, "flux": 3}}, "closed, no surface of it that emits has a temperature"),
        ({"default": {"emissivity": 0.9, "temperature": "20 F"}}, "20 F"),
        ({"default": {"emissivity": 0.9}}, "no temperature is known"),
    ],
)
def test_what_does_not_fit_is_refused(tables: dict[str, object], message: str) -> None:
    """By the name, the reason and what there is."""
    matrix = hemicube.compute(room())
    with pytest.raises(hemicube.InputError, match=message):
        hemicube.solve_heat(matrix, properties=tables)


def test_arguments_that_exclude_each_other_are_refused() -> None:
    """Arrays or names, not both, and not neither."""
    matrix = hemicube.compute(room())
    with pytest.raises(hemicube.InputError, match="`properties`, or both"):
        hemicube.solve_heat(matrix)
    with pytest.raises(hemicube.InputError, match="`properties`, or both"):
        hemicube.solve_heat(matrix, 0.9, 300.0, properties={})
    with pytest.raises(hemicube.InputError, match="go together"):
        hemicube.solve_heat(matrix, properties={}, ground=300)
    light = hemicube.solve(matrix, 0.5, 1.0)
    with pytest.raises(hemicube.InputError, match="one state of heat"):
        light.by_surface(matrix)


def test_exchange_is_conserved_and_the_programs(program: Callable[..., None], tmp_path: pathlib.Path) -> None:
    """Rows add up to 1, areas are reciprocal, and the program finds the same numbers."""
    scene = room()
    matrix = hemicube.compute(scene, output=tmp_path / "room")
    tables = {"default": {"emissivity": 0.8}, "object": {"floor": {"emissivity": 0.3}}}
    exchange = hemicube.exchange(matrix, tables)
    assert np.abs(exchange.gebhart.sum(axis=1) - 1).max() < 1e-8
    areas = exchange.exchange_areas[:, :-1]
    assert np.allclose(areas, areas.T, rtol=0.01, atol=1e-6)
    assert np.array_equal(exchange.conductances, STEFAN * exchange.exchange_areas)
    (tmp_path / "m.toml").write_text("[default]\nemissivity = 0.8\n[object.floor]\nemissivity = 0.3\n")
    out = tmp_path / "x.npz"
    program("exchange", tmp_path / "room", "--materials", tmp_path / "m.toml", "-o", out, "--quiet")
    theirs = np.load(out)
    assert np.array_equal(theirs["gebhart"][0], exchange.gebhart)
    assert json.loads(theirs["names"].tobytes())["surfaces"] == exchange.names
    bands = {"bands": ["a", "b"], "default": {"emissivity": [0.8, 0.2]}}
    assert hemicube.exchange(hemicube.compute(scene), bands, by="patch").gebhart.shape == (2, len(scene), len(scene) + 1)


def test_heat_that_patches_take_up_leaves_again() -> None:
    """A black plate of two sides alone in space, one of them in the sun."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    scene = hemicube.Scene(square, np.array([[0, 1, 2], [0, 2, 3]]), two_sided=True)
    matrix = hemicube.compute(scene)
    properties = {"default": {"emissivity": 0.8, "adiabatic": True}}
    load = np.array([400.0, 0.0, 400.0, 0.0])
    found = hemicube.solve_heat(matrix, properties=properties, ambient=0.0, load=load)
    assert found.flux == pytest.approx(load, abs=1e-6)
    sigma = 5.670374419e-8
    assert found.temperature[[0, 2]] == pytest.approx((400 / (0.8 * sigma)) ** 0.25, abs=0.01)
    with pytest.raises(hemicube.InputError, match="load"):
        hemicube.solve_heat(matrix, properties=properties, ambient=0.0, load=load[:2])
