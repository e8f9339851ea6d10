"""Mirrors, panes, symmetry, sectors and periods: closed forms, and what a matrix tells of them."""

import pathlib
import subprocess
import sys
from collections.abc import Callable, Sequence

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


# Half of a street without end, as wide as high, of mirrors and a floor, under glass.
STREET = {
    "floor": [(0, 0, 0), (0.5, 0, 0), (0.5, 1, 0), (0, 1, 0)],
    "wall": [(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)],
    "roof": [(0, 0, 1), (0.5, 0, 1), (0.5, 1, 1), (0, 1, 1)],
    "roof_outside": [(0, 0, 1), (0, 1, 1), (0.5, 1, 1), (0.5, 0, 1)],
}
MIRROR, GLASS, BACK = 0.6, 0.7, 0.2
OPTICS = {"object": {"wall": {"specular": MIRROR}, "roof*": {"transmittance": GLASS, "specular": BACK}}}
IMAGES = {"symmetry": {"x": 0.5}, "periodic": {"y": (0, 1)}}
ORDERS = np.arange(-200, 201)


def street(split: int | None = None) -> hemicube.Scene:
    corners = np.array([corner for quad in STREET.values() for corner in quad], float)
    first = 4 * np.arange(len(STREET))[:, None]
    triangles = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]], axis=1).reshape(-1, 3)
    objects = np.repeat(np.arange(len(STREET)), 2)
    return hemicube.Scene(corners, triangles, object=objects, objects=list(STREET), split=split, up="z")


def of_strips(height: float) -> float:
    """Between strips of width 1 face to face, and the images of one in mirrors beside them: crossed strings."""
    strings = [np.hypot(ORDERS + step, height) for step in (-1, 0, 1)]
    return float((MIRROR ** np.abs(ORDERS) * (strings[0] + strings[2] - 2 * strings[1]) / 2).sum())


def test_mirrors_panes_symmetry_and_a_period_at_once() -> None:
    scene = street(split=2)
    matrix = hemicube.compute(scene, tolerance=0.001, specular=OPTICS, **IMAGES)
    floor, roof = scene.object == 0, scene.object >= 2
    areas, factors = scene.areas, matrix.to_scipy().toarray()
    mean = areas[floor] / areas[floor].sum()
    opening, back = of_strips(1), BACK * of_strips(2)
    assert abs(mean @ factors[np.ix_(floor, roof)].sum(axis=1) - opening) < 1e-3
    assert abs(mean @ factors[np.ix_(floor, floor)].sum(axis=1) - back) < 1e-3
    # What the last repeat hides is cut off.
    assert abs(mean @ (matrix.escaped + matrix.cut_off)[floor] - GLASS * opening) < 1e-3
    assert np.abs(matrix.closure).max() < 1e-3
    flow = areas[:, None] * factors
    assert np.linalg.norm(flow - flow.T) < 4e-3 * np.linalg.norm(flow)
    # A floor that emits 1 and reflects nothing: half of its light that leaves through the roof.
    light = hemicube.solve(matrix, np.where(floor, 0.0, 0.05), np.where(floor, 1.0, 0.0))
    balance = light.balance[0]
    assert balance["emitted"] == pytest.approx(0.5) and balance["escaped"] > 0.5 * GLASS * opening
    assert abs(balance["closure"]) < 1e-6
    # At one temperature nothing flows.
    heat = hemicube.solve_heat(matrix, np.where(roof, 0.1, 0.4), np.full(len(scene), 300.0), ambient=300.0)
    assert np.abs(heat.flux).max() < 1e-5 * 459


def test_points_the_sky_and_suns_at_once() -> None:
    scene = street(split=2)
    seen = hemicube.points(scene, [[0.25, 0.5, 0]], normals=[[0, 0, 1]], tolerance=0.003, specular=OPTICS, **IMAGES)
    ends = np.arctan2(ORDERS + 1 - 0.25, 1), np.arctan2(ORDERS - 0.25, 1)
    opening = (MIRROR ** np.abs(ORDERS) * (np.sin(ends[0]) - np.sin(ends[1])) / 2).sum()
    assert abs(seen.sky[0] + seen.cut_off[0] - GLASS * opening) < 3e-3
    sums = np.asarray(seen.to_scipy().sum(axis=1)).ravel()
    assert np.abs(sums - seen.passed + seen.sky + seen.ground + seen.blocked + seen.cut_off - 1).max() < 1e-9

    suns = np.array([[0.3, 0, 1], [-0.3, 0, 1], [0, 0, 2], [0, 0, -1]])
    sky = hemicube.sky(scene, suns=suns, specular=OPTICS, **IMAGES)
    floor = scene.object == 0
    mean = scene.areas[floor] / scene.areas[floor].sum()
    assert abs(mean @ sky.view_factors[floor] - GLASS * of_strips(1)) < 6e-3
    # Three fifths of the floor see the first sun in the mirror, too, two fifths the second past the wall.
    light, slant = sky.sunlight, 1 / np.hypot(0.3, 1)
    assert light is not None and light.shape == (len(scene), 4)
    lit = [GLASS * slant * (1 + 0.6 * MIRROR), GLASS * slant * 0.4, GLASS, 0]
    assert np.abs(mean @ light[floor] - lit).max() < 0.02
    # Without portals the roof is opaque, and the first sun shines in beside it.
    bare = hemicube.sky(scene, suns=suns)
    assert bare.sunlight is not None
    assert np.abs(mean @ bare.sunlight[floor] - [0.6 * slant, 0, 0, 0]).max() < 0.03
    assert hemicube.sky(scene).sunlight is None
    with pytest.raises(hemicube.InputError, match="`samples` or `resolution`"):
        hemicube.sky(scene, tolerance=0.01, specular=OPTICS)
    with pytest.raises(hemicube.InputError, match="sun 1 of `suns`"):
        hemicube.sky(scene, suns=[[0, 0, 1], [0, 0, 0]])


def test_a_matrix_a_band(tmp_path: pathlib.Path, program: Callable[..., None]) -> None:
    scene = street()
    tables = {
        "bands": ["light", "heat"],
        "object": {"wall": {"specular": [MIRROR, 0.9]}, "roof*": {"transmittance": [GLASS, 0]}},
    }
    both = hemicube.compute(scene, specular=tables, band=["light", "heat"], **IMAGES)
    assert list(both) == ["light", "heat"]
    stored = hemicube.compute(
        scene, specular=tables, band=["heat", "light"], output=tmp_path / "street.hemicube", **IMAGES
    )
    for name, matrix in both.items():
        alone = hemicube.compute(scene, specular=tables, band=name, **IMAGES)
        for other in (matrix, stored[name], hemicube.open(tmp_path / f"street-{name}.hemicube")):
            assert np.array_equal(other.to_scipy().toarray(), alone.to_scipy().toarray())
            assert np.array_equal(other.passed, alone.passed)
    assert both["heat"].transmittance.max() == 0 and both["light"].transmittance.max() == GLASS
    assert hemicube.points(scene, [[0.2, 0.5, 0.5]], specular=tables, band="heat", **IMAGES).sky[0] == 0
    assert hemicube.sky(scene, specular=tables, band="heat", **IMAGES).view_factors[0] == 0
    # As the program computes them.
    (tmp_path / "optics.toml").write_text(
        'bands = ["light", "heat"]\n[object.x0]\nspecular = [0.6, 0.9]\n[object.top]\nspecular = [0.2, 0]\n'
    )
    room(tmp_path)
    program("compute", tmp_path / "room.obj", "--specular", tmp_path / "optics.toml", "-o", tmp_path / "room.hemicube")
    tables = {
        "bands": ["light", "heat"],
        "object": {"x0": {"specular": [0.6, 0.9]}, "top": {"specular": [0.2, 0]}},
    }
    ours = hemicube.compute(hemicube.Scene.load(tmp_path / "room.obj"), specular=tables, band=["light", "heat"])
    for name, matrix in ours.items():
        theirs = hemicube.open(tmp_path / f"room-{name}.hemicube")
        assert np.array_equal(theirs.to_scipy().toarray(), matrix.to_scipy().toarray())
    for band, said in (
        (None, "`band='light'` takes one"),
        ("warm", "the bands light, heat"),
        (["light", "light"], "twice"),
        ([], "empty list"),
    ):
        with pytest.raises(hemicube.InputError, match=said):
            hemicube.compute(scene, specular={**tables, "object": {"wall": {"specular": [0.1, 0.2]}}}, band=band)
    with pytest.raises(hemicube.InputError, match="which is not given"):
        hemicube.compute(scene, band="light")


INTERRUPTED = """
import os, signal, sys, threading
import hemicube, numpy as np

signal.signal(signal.SIGINT, signal.default_int_handler)
scene = hemicube.Scene.generate("city", 2_000)
keywords = {
    "specular": {"bands": ["light", "heat"], "material": {"*": {"specular": [0.2, 0.1]}}},
    "band": ["light", "heat"],
    "correction": "pixel",
    "rows": (0, 700),
    "symmetry": {"x": float(scene.corners[..., 0].min())},
    "output": sys.argv[2],
}
if sys.argv[1] == "whole":
    hemicube.compute(scene, **keywords)
    sys.exit(0)
resumed = []
try:
    hemicube.compute(
        scene,
        **keywords,
        progress=lambda done, total: done > 0 and os.kill(os.getpid(), signal.SIGINT),
    )
except KeyboardInterrupt:
    names = ["light", "heat"]
    stem = sys.argv[2].removesuffix(".hemicube")
    kept = [sum(1 for _ in hemicube.open(f"{stem}-{name}.hemicube")) for name in names]
    hemicube.compute(scene, **keywords, progress=lambda done, total: resumed.append(done))
    print(kept, resumed[0])
    sys.exit(0)
sys.exit("it ended by itself")
"""


def test_an_interrupted_run_through_portals_is_resumed_to_the_same_bytes(tmp_path: pathlib.Path) -> None:
    def run(what: str, name: str) -> str:
        command = [sys.executable, "-c", INTERRUPTED, what, str(tmp_path / f"{name}.hemicube")]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    print(run("interrupted", "once"))
    run("whole", "at-once")
    for band in ("light", "heat"):
        once, at_once = (tmp_path / f"{name}-{band}.hemicube" for name in ("once", "at-once"))
        files = sorted(path.relative_to(once) for path in once.rglob("*") if path.is_file())
        assert len(files) > 3
        for file in files:
            assert (once / file).read_bytes() == (at_once / file).read_bytes(), file


SLOW_SKY = """
import os, signal, threading, time
import hemicube

signal.signal(signal.SIGINT, signal.default_int_handler)
scene = hemicube.Scene.generate("city", 6_000)
sent = []

def interrupt():
    time.sleep(1)
    sent.append(time.monotonic())
    os.kill(os.getpid(), signal.SIGINT)

threading.Thread(target=interrupt, daemon=True).start()
try:
    mirrors = {"material": {"*": {"specular": 0.3}}}
    hemicube.sky(scene, up="y", resolution=512, samples=16, specular=mirrors)
except KeyboardInterrupt:
    print(time.monotonic() - sent[0])
"""


def test_an_interrupt_ends_a_row_of_the_sky_in_mirrors() -> None:
    ended = subprocess.run([sys.executable, "-c", SLOW_SKY], capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    # A row takes half a minute.
    assert float(ended.stdout) < 5


def test_another_matrix_of_portals_in_the_way_is_named(tmp_path: pathlib.Path) -> None:
    place = tmp_path / "street.hemicube"
    keywords = {"specular": OPTICS, **IMAGES, "repeats": 2, "correction": "pixel", "resolution": 64}
    hemicube.compute(street(), **keywords, output=place)
    other = {"object": {**OPTICS["object"], "wall": {"specular": 0.5}}}
    for change, said in (
        ({"repeats": 3}, "with repeats 2, and here it is with repeats 3"),
        ({"specular": other}, "with other mirrors and panes, of `object wall`"),
        ({"symmetry": {}}, "with symmetry x=0.5, and here it is without symmetry"),
        ({"specular": None}, "with mirrors and panes, and here it is without"),
        ({"specular_bound": 0.1}, "and here it is with specular bound 0.1"),
        ({"specular": None, "symmetry": {}, "periodic": {}, "repeats": None}, "with periodic y=0..1"),
    ):
        with pytest.raises(hemicube.StoreError) as refused:
            hemicube.compute(street(), **{**keywords, **change}, output=place)
        assert said in str(refused.value), refused.value
        assert "--" not in str(refused.value)


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
        {"specular": "mirror.toml"},
        {"specular_bound": 0.01},
        {"repeats": 3},
    ):
        with pytest.raises(hemicube.InputError):
            hemicube.compute(scene, **wrong)
