"""The package has the program: `python -m hemicube` and the command `hemicube` are it, and give its bytes and exit codes."""

import importlib.metadata
import os
import pathlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import pytest

import hemicube
from hemicube import __main__

COMMAND = [sys.executable, "-m", "hemicube"]
# As the command `hemicube` does, it looks for no module in the working folder.
INSTALLED = [sys.executable, __main__.__file__]


def environment() -> dict[str, str]:
    """That of this process without hemicube's settings; paths of Python hold from any folder."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("HEMICUBE_")}
    if "PYTHONPATH" in kept:
        kept["PYTHONPATH"] = os.pathsep.join(map(os.path.abspath, kept["PYTHONPATH"].split(os.pathsep)))
    return kept


def run(*words: object, at: pathlib.Path, command: list[str] = COMMAND) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*command, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        cwd=at,
        env=environment(),
    )


def files(folder: pathlib.Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_it_is_of_the_packages_version(tmp_path: pathlib.Path) -> None:
    ended = run("--version", at=tmp_path)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, f"hemicube {hemicube.__version__}\n", "")
    assert "Usage: hemicube " in run("--help", at=tmp_path).stdout


def test_a_store_has_the_bytes_of_the_programs(
    program: Callable[..., None], cornell_box: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    words = ["compute", cornell_box, "--config", "none", "--quiet", "--split", 2]
    program(*words, "-o", tmp_path / "program")
    ended = run(*words, "-o", "package", at=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith("matrix "), ended.stdout
    stores = [files(tmp_path / name) for name in ("program", "package")]
    assert len(stores[0]) > 2 and stores[0] == stores[1]


def test_exit_codes_are_the_programs(tmp_path: pathlib.Path) -> None:
    for words in [("compute", "none.obj"), ("compute", "--no-such-option"), ("no-such-command",)]:
        ended = run(*words, at=tmp_path)
        assert ended.returncode == 2 and ended.stderr.startswith("error: "), ended


def test_it_starts_itself_and_nothing_of_the_folder(tmp_path: pathlib.Path) -> None:
    # Each case is a process of its own.
    (tmp_path / "hemicube.py").write_text("raise SystemExit('not this one')\n")
    ended = run("backends", "check", "cpu", "--only", "room/*", at=tmp_path, command=INSTALLED)
    assert ended.returncode == 0 and "room/" in ended.stdout, ended


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT is sent as Unix sends it")
def test_ctrl_c_ends_it(cornell_box: pathlib.Path, tmp_path: pathlib.Path) -> None:
    words = ["compute", cornell_box, "--split", 8, "--tolerance", "1%", "--threads", 1, "--config", "none", "-o", "box"]
    child = subprocess.Popen(
        [*COMMAND, *map(str, words)], cwd=tmp_path, env=environment(), stderr=subprocess.PIPE, text=True
    )
    until = time.monotonic() + 120
    while not (tmp_path / "box/parts/part-00002.npz").exists():
        assert child.poll() is None and time.monotonic() < until, "it has made no part"
        time.sleep(0.02)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    assert child.returncode == 130 and "interrupted: " in said, said


def test_the_command_is_installed() -> None:
    try:
        entries = importlib.metadata.distribution("hemicube").entry_points
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the package is not installed, but found beside the library of the build")
    (command,) = [entry for entry in entries if entry.group == "console_scripts"]
    assert command.name == "hemicube" and command.load() is __main__.main
