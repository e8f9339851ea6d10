"""Scenes from arrays, files and nothing."""

import pathlib

import numpy as np
import pytest

import hemicube

VERTICES = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5]]
TRIANGLES = [[0, 1, 2], [0, 2, 3]]


def test_arrays_of_any_type_and_order() -> None:
    expected = hemicube.Scene(VERTICES, TRIANGLES).corners
    vertices = np.asarray(VERTICES, dtype=np.float32)
    for given in (vertices, np.asfortranarray(vertices), np.repeat(vertices, 2, axis=0)[::2]):
        for kind in (np.int8, np.uint16, np.int64, np.uint64):
            scene = hemicube.Scene(given, np.asarray(TRIANGLES, dtype=kind))
            assert np.array_equal(scene.corners, expected)
    assert np.array_equal(expected[0], np.asarray(VERTICES, dtype=float)[TRIANGLES[0]])


def test_patches_know_where_they_are_from() -> None:
    degenerate = [0, 1, 1]
    with pytest.warns(UserWarning, match="left out: 1 × triangle without area"):
        scene = hemicube.Scene(
            VERTICES,
            [TRIANGLES[0], degenerate, TRIANGLES[1]],
            object=[1, 0, 0],
            material=[0, 0, 2],
            objects=["floor", "door"],
            two_sided=[False, False, True],
            split=2,
            up="z",
        )
    assert len(scene) == 4 + 2 * 4
    assert scene.face.tolist() == [0] * 4 + [2] * 8
    assert scene.object.tolist() == [1] * 4 + [0] * 8
    assert scene.material.tolist() == [0] * 4 + [2] * 8
    assert scene.side.tolist() == [0] * 4 + [0, 1] * 4
    assert (scene.objects, scene.materials) == (["floor", "door"], ["0", "1", "2"])
    assert scene.up == "z"
    assert scene.areas.sum() == pytest.approx(1.5)
    assert np.allclose(scene.normals[:4], [0, 0, 1]) and np.allclose(scene.normals[4::2], -scene.normals[5::2])
    assert np.allclose(scene.centroids, scene.corners.mean(axis=1))


def test_a_file_and_its_arrays_are_the_same_scene(cornell_box: pathlib.Path) -> None:
    read = hemicube.Scene.load(cornell_box, split=2)
    whole = hemicube.Scene.load(cornell_box)
    made = hemicube.Scene(
        whole.corners.reshape(-1, 3),
        np.arange(3 * len(whole)).reshape(-1, 3),
        object=whole.object,
        material=whole.material,
        objects=whole.objects,
        materials=whole.materials,
        split=2,
    )
    assert np.array_equal(read.corners, made.corners)
    assert np.array_equal(read.object, made.object) and read.objects == made.objects
    halved = hemicube.Scene.load(str(cornell_box), scale=0.5, split=2, up="y", two_sided=True)
    assert len(halved) == 2 * len(read) and halved.up == "y"
    assert np.array_equal(halved.corners[::2], 0.5 * read.corners)


# What is left of a scene, if anything, is warned of before it is refused.
@pytest.mark.filterwarnings("ignore:left out")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"triangles": [[0, 1, 9]]}, "triangle 0 has the vertex 9, and there are 5"),
        ({"triangles": [[0, 1, -1]]}, "triangle 0 has the vertex -1"),
        ({"triangles": [[0, 1, 2.0]]}, "`triangles` is an array of float64; integers are needed"),
        ({"triangles": [[0, 1]]}, r"`triangles` has the shape \(1, 2\); \(n, 3\) is needed"),
        ({"triangles": []}, "shape"),
        ({"vertices": [["a", "b", "c"]]}, "`vertices` is an array of <U1; numbers are needed"),
        ({"vertices": np.full((5, 3), np.nan)}, "holds no triangle that can be used: of 2, 2 not finite"),
        ({"object": [0]}, r"`object` has the shape \(1,\); \(2,\) is needed"),
        ({"object": [0, -1]}, "`object` has the id -1"),
        ({"object": [0, 1], "objects": ["one"]}, "`object` has the id 1, and there are 1 names"),
        ({"two_sided": [1, 0]}, "`two_sided` is an array of int64; truth values are needed"),
        ({"up": "w"}, "`up` is `w`; x, y or z is needed"),
        ({"split": 0}, "`split` is 0"),
        ({"patch_size": -1.0}, "`patch_size` is -1"),
        ({"split": 2, "patch_size": 1.0}, "two ways to cut"),
    ],
)
def test_what_is_no_scene_is_refused_by_name(arguments: dict[str, object], message: str) -> None:
    given = {"vertices": VERTICES, "triangles": TRIANGLES} | arguments
    with pytest.raises(ValueError, match=message) as caught:
        hemicube.Scene(**given)  # type: ignore[arg-type]
    assert isinstance(caught.value, hemicube.InputError)


@pytest.mark.parametrize("cut", [{"split": 20_000}, {"patch_size": 1e-4}])
def test_more_patches_than_there_is_memory_for_are_refused_at_once(cut: dict[str, object]) -> None:
    with pytest.raises(hemicube.InputError, match=f"patches .* of memory.*`{next(iter(cut))}=.* surely fits"):
        hemicube.Scene(VERTICES, TRIANGLES[:1], **cut)  # type: ignore[arg-type]


def test_files_that_are_not_there_or_no_scene(tmp_path: pathlib.Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere.obj") as caught:
        hemicube.Scene.load(tmp_path / "nowhere.obj")
    assert isinstance(caught.value, hemicube.Error)
    broken = tmp_path / "broken.obj"
    broken.write_text("v 0 0 0\nf 1 2 3\n")
    with pytest.raises(hemicube.InputError, match="broken.obj:2: "):
        hemicube.Scene.load(broken)
    (tmp_path / "scene.xyz").write_text("")
    with pytest.raises(hemicube.InputError, match="names no scene format"):
        hemicube.Scene.load(tmp_path / "scene.xyz")
    with pytest.raises(hemicube.InputError, match="`castle` is no kind of generated scene"):
        hemicube.Scene.generate("castle", 100)
