"""Rows of sensors: closed forms, sums, mean radiant temperatures, and what is refused."""

import math

import numpy as np
import pytest

import hemicube


def square(size: float, height: float) -> hemicube.Scene:
    """A square that looks down from a height, in two triangles."""
    half = size / 2
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    vertices = [(x, y, height) for x, y in corners]
    return hemicube.Scene(vertices, [[0, 2, 1], [0, 3, 2]], objects=["ceiling"], object=[0, 0], up="z")


def test_a_sphere_sees_the_solid_angle_of_a_square_and_the_sky_round_it() -> None:
    seen = hemicube.points(square(2.0, 1.0), [[0.0, 0.0, 0.0]])
    # One face of a cube: a sixth of the sphere.
    assert abs(seen.zones()[0, 0] - 1 / 6) < 1e-9
    assert abs(seen.sky[0] - 1 / 3) < 1e-9 and seen.ground[0] == 0.5 and seen.blocked[0] == 0
    assert abs(seen.to_scipy().sum() - 1 / 6) < 1e-9 and math.isnan(seen.changes[0]) and seen.settled.all()


def test_bodies_have_their_rows_and_sum_to_one() -> None:
    scene = square(2.0, 1.0)
    positions = [[0.1, 0.2, 0.3], [0.0, 0.0, -4.0]]
    for body, rows in [("sphere", 2), ("cube", 12), ("person", 2), ("cylinder", 2)]:
        seen = hemicube.points(scene, positions, body=body, tolerance=0.01)
        sums = np.asarray(seen.to_scipy().sum(axis=1)).ravel() + seen.sky + seen.ground + seen.blocked
        assert len(seen) == rows and abs(sums - 1).max() < 1e-12, body
    up = hemicube.points(scene, positions, normals=[[0, 0, 1]] * 2)
    cube = hemicube.points(scene, positions, body="cube")
    assert (up.zones()[:, 0] == cube.zones()[4::6, 0]).all()
    warm = up.mean_radiant_temperature(np.full(2, hemicube.STEFAN_BOLTZMANN * 310**4), sky=260)
    expected = (up.zones()[:, 0] * 310**4 + up.sky * 260**4) ** 0.25
    assert abs(warm - expected).max() < 1e-9


def test_temperatures_outside_are_kelvin_or_text() -> None:
    seen = hemicube.points(square(2.0, 1.0), [[0.0, 0.0, 0.0]])
    radiosity = np.zeros(2)
    kelvin = seen.mean_radiant_temperature(radiosity, sky=293.15, ground=300, backs=0)
    assert (seen.mean_radiant_temperature(radiosity, sky="20 °C", ground="26.85 °C", backs="0 K") == kelvin).all()
    for keywords, words in [
        ({"sky": [300]}, "`sky` is of the type list; a temperature in kelvin"),
        ({"sky": None}, "`sky` is of the type NoneType"),
        ({"sky": "warm"}, "`sky`: `warm` is no temperature"),
        ({"sky": -1}, "`sky` is -1; a temperature in kelvin, from 0 on, or text such as '20 °C' is needed"),
        ({"sky": 300, "ground": math.nan}, "`ground` is NaN"),
        ({"sky": 300, "backs": {}}, "`backs` is of the type dict"),
    ]:
        with pytest.raises(hemicube.InputError, match=words):
            seen.mean_radiant_temperature(radiosity, **keywords)


def test_what_cannot_be_is_refused() -> None:
    scene = square(2.0, 1.0)
    for keywords, words in [
        ({"body": "plane"}, "give `normals`"),
        ({"body": "cat"}, "`body` is `cat`"),
        ({"normals": [[0, 0, 0]]}, "no direction"),
        ({"normals": [[0, 0, 1]] * 2}, "as many are needed"),
        ({"tolerance": 2.0}, "`tolerance` is 2"),
        ({"resolution": 100}, "resolution"),
    ]:
        with pytest.raises(hemicube.InputError, match=words):
            hemicube.points(scene, [[0, 0, 0]], **keywords)
    with pytest.raises(hemicube.InputError, match="`by` is `cat`"):
        hemicube.points(scene, [[0, 0, 0]]).zones("cat")
