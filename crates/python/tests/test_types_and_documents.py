"""The stubs say what there is, types are checked strictly, and what is documented runs."""

import doctest
import inspect
import os
import pathlib
import re
import subprocess
import sys

import pytest

import hemicube

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]


def run(*words: object, at: pathlib.Path) -> None:
    ended = subprocess.run(
        [sys.executable, *map(str, words)], capture_output=True, text=True, timeout=300, check=False, cwd=at
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr


def test_the_stubs_are_the_modules(tmp_path: pathlib.Path) -> None:
    # Private names of the stub are types, which are not there when it runs.
    run("-m", "mypy.stubtest", "hemicube", "--ignore-missing-stub", at=tmp_path)


def test_typed_programs_are_checked_strictly(tmp_path: pathlib.Path) -> None:
    right = tmp_path / "right.py"
    right.write_text(
        "import hemicube\n"
        "from scipy.sparse import csr_matrix\n"
        "scene = hemicube.Scene([[0.0, 0.0, 0.0]], [[0, 0, 0]], up='z')\n"
        "matrix: hemicube.Matrix = hemicube.compute(scene, tolerance=0.01, progress=lambda done, total: None)\n"
        "factors: csr_matrix = matrix.to_scipy()\n"
        "for patch, columns, values in matrix:\n"
        "    print(patch + 1, columns.dtype, values.sum())\n"
        "bands: dict[str, hemicube.Matrix] = hemicube.compute(scene, band=['light', 'heat'])\n"
        "print(bands['light'].passed, hemicube.compute(scene, band='light').passed)\n"
        "print(hemicube.solve(matrix, 0.5, 1.0).radiosity.mean(), hemicube.sky(scene).view_factors)\n"
    )
    run("-m", "mypy", "--strict", "--disable-error-code=import-untyped", right, at=tmp_path)
    wrong = tmp_path / "wrong.py"
    wrong.write_text("import hemicube\nhemicube.sky(3, tolerance='1%')\nhemicube.compute(3, tolerance='1%')\n")
    ended = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", wrong], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert ended.returncode == 1 and ended.stdout.count("[arg-type]") == 2, ended.stdout
    assert ended.stdout.count("[call-overload]") == 1, ended.stdout


def test_everything_public_is_documented() -> None:
    for name in hemicube.__all__:
        thing = getattr(hemicube, name)
        if not callable(thing):
            continue
        assert inspect.getdoc(thing), name
        members = vars(thing) if inspect.isclass(thing) else {}
        for member, value in members.items():
            if not member.startswith("_"):
                assert inspect.getdoc(value), f"{name}.{member}"


@pytest.mark.parametrize("document", ["docs/python.md"])
def test_what_is_documented_runs(document: str, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = REPOSITORY / document
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    (tmp_path / "cornell-box.obj").write_bytes((REPOSITORY / "crates/scene/data/cornell-box.obj").read_bytes())
    text = path.read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    test = doctest.DocTestParser().get_doctest("\n".join(blocks), {}, document, str(path), 0)
    assert len(test.examples) > 15
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    runner.run(test, out=said.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(said)
    # The picture of sky view factors, in eight lines.
    picture = (tmp_path / "sky.png").read_bytes()
    assert picture.startswith(b"\x89PNG") and len(picture) > 10_000
    first = blocks[0]
    assert "sky.png" in first and len([line for line in first.splitlines() if line.startswith(">>> ")]) <= 8
    assert os.listdir(tmp_path)


def test_the_page_of_the_api_is_the_packages() -> None:
    script = REPOSITORY / "scripts/python_api.py"
    made = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True).stdout
    path = REPOSITORY / "docs/python-api.md"
    if "BLESS" in os.environ:
        path.write_text(made)
    assert made == path.read_text(), "docs/python-api.md is old: BLESS=1 writes it"
    for name in hemicube.__all__:
        assert name.startswith("__") or name in made, name


def test_the_readmes_lines_run() -> None:
    readme = (REPOSITORY / "README.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", readme, flags=re.DOTALL)
    # A floor and a ceiling.
    names = {
        "vertices": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1]],
        "triangles": [[0, 1, 2], [3, 5, 4]],
    }
    exec(block, names)
    assert names["F"].shape == (2, 2) and 0.05 < names["F"][0, 1] < 0.3
    assert 0.7 < names["svf"][0] < 0.95 and names["svf"][1] == 0


def test_the_packages_own_examples_run() -> None:
    assert doctest.testmod(hemicube).attempted > 2
    assert doctest.testmod(hemicube).failed == 0
