"""Refusals and warnings name keywords, not the program's options."""

import base64
import pathlib
import re
import struct
import zlib
from typing import Any

import pytest

import hemicube

CUBE = (
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
    "o low\nf 4 3 2 1\no other\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 4 1 5 8\n"
)


def load(folder: pathlib.Path, **keywords: Any) -> hemicube.Scene:
    path = folder / "cube.obj"
    path.write_text(CUBE)
    return hemicube.Scene.load(path, **{"flip": ["all"], **keywords})


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (
            ({}, {"correction": "pixel", "resolution": 64}),
            ({}, {"correction": "pixel", "resolution": 80}),
            "it was computed with resolution 64, and here it is with resolution 80",
        ),
        (({"split": 2}, {}), ({"split": 3}, {}), None),
                (
            ({}, {"rows": (0, 5)}),
            ({}, {"sample_rows": 3}),
            "with rows 0..5, and here it is with a sample of 3 rows (seed 1)",
        ),
        (({}, {"occluders": ["low"]}), ({}, {}), "with occluders low, and here it is without occluders"),
        (({}, {"rotation": False}), ({}, {}), "with rotation off, and here it is with rotation on"),
        (({}, {"correction": "pixel"}), ({}, {}), "with correction pixel, and here it is with correction tolerance"),
        (({}, {"min_factor": 0.01}), ({}, {}), "with min factor 0.01, and here it is without min factor"),
        (({}, {}), ({}, {"store": "compact"}), "its form is plain"),
    ],
)
def test_another_matrix_in_the_way(
    tmp_path: pathlib.Path,
    before: tuple[dict[str, Any], dict[str, Any]],
    after: tuple[dict[str, Any], dict[str, Any]],
    said: str | None,
) -> None:
    place = tmp_path / "f.hemicube"
    hemicube.compute(load(tmp_path, **before[0]), output=place, **before[1])
    with pytest.raises(hemicube.StoreError) as refused:
        hemicube.compute(load(tmp_path, **after[0]), output=place, **after[1])
    text = str(refused.value)
    assert "--" not in text, text
    assert "`overwrite=True` replaces it" in text
    if said is not None:
        assert said in text, text


def test_rows_that_a_solver_needs(tmp_path: pathlib.Path) -> None:
    scene = load(tmp_path)
    some = hemicube.compute(scene, rows=(0, 5), output=tmp_path / "some.hemicube")
    with pytest.raises(hemicube.Error) as refused:
        hemicube.solve(some, 0.5, 1.0)
    assert "--" not in str(refused.value), refused.value


def test_properties_that_are_missing(tmp_path: pathlib.Path) -> None:
    matrix = hemicube.compute(load(tmp_path))
    with pytest.raises(hemicube.InputError) as refused:
        hemicube.solve_heat(matrix, properties={"object": {}}, ambient=300.0)
    assert re.search(r"`properties` names (it|them): `'emissivity': 0.9`", str(refused.value)), refused.value
    assert "--" not in str(refused.value)


def test_warnings_of_a_file(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "two.vs3"
    path.write_text(
        "T two squares and what hides them\nC encl=0 list=0\nF 3\n"
        "V 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\nV 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\n"
        "V 9 .4 .4 .5\nV 10 .6 .4 .5\nV 11 .6 .6 .5\nV 12 .4 .6 .5\n"
        "S 1 1 2 3 4 0 0 .9 low\nS 2 8 7 6 5 0 0 .9 high\nO 3 9 10 11 12 0 0 0 between\nE\n"
    )
    with pytest.warns(UserWarning, match=re.escape("unless `obstruction*` are asked to occlude only")):
        hemicube.Scene.load(path)


def test_a_large_file_is_allowed(tmp_path: pathlib.Path) -> None:
    def array(name: str, kind: str, components: int, raw: bytes) -> str:
        packed = zlib.compress(raw)
        head = base64.b64encode(struct.pack("<4Q", 1, len(raw), 0, len(packed))).decode()
        return (
            f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="binary">'
            f"{head}{base64.b64encode(packed).decode()}</DataArray>"
        )

    # Points that nothing uses: megabytes of zeros in kilobytes.
    count = 200_000
    points = struct.pack("<9d", 0, 0, 0, 1, 0, 0, 0, 1, 0) + bytes(24 * (count - 3))
    path = tmp_path / "large.vtu"
    path.write_text(
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64" '
        f'compressor="vtkZLibDataCompressor"><UnstructuredGrid><Piece NumberOfPoints="{count}" NumberOfCells="1">'
        f"<Points>{array('Points', 'Float64', 3, points)}</Points><Cells>"
        f"{array('connectivity', 'Int64', 1, struct.pack('<3q', 0, 1, 2))}{array('offsets', 'Int64', 1, struct.pack('<q', 3))}"
        f"{array('types', 'UInt8', 1, bytes([5]))}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )
    with pytest.raises(hemicube.InputError, match=re.escape("`allow_large=True` lifts the limit")):
        hemicube.Scene.load(path)
    assert hemicube.Scene.load(path, allow_large=True).areas.tolist() == [0.5]
