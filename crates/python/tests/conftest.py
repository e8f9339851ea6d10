"""What the tests need of the machine: the program to compare with, and the scenes of the repository."""

import os
import pathlib
import subprocess
from collections.abc import Callable

import pytest

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def cornell_box() -> pathlib.Path:
    """The measured Cornell box."""
    return REPOSITORY / "crates/scene/data/cornell-box.obj"


@pytest.fixture(scope="session")
def program() -> Callable[..., None]:
    """The program `hemicube`, which `HEMICUBE_PROGRAM` names."""
    path = os.environ.get("HEMICUBE_PROGRAM")
    if path is None:
        pytest.fail("HEMICUBE_PROGRAM names no program to compare with: run `./test`, or set it to target/release/hemicube")

    def run(*arguments: object) -> None:
        words = [path, *map(str, arguments)]
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HEMICUBE_")}
        subprocess.run(words, check=True, env=environment, stdout=subprocess.DEVNULL, timeout=300)

    return run
