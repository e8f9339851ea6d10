"""Stores as an attacker sends them: an exception of the package or the right values, never a crash of the interpreter."""

import os
import pathlib
import subprocess
import sys

import hemicube

# `HEMICUBE_MUTANTS=20000` is the long run, of some minutes.
COUNT = int(os.environ.get("HEMICUBE_MUTANTS", "2000"))


def test_mutants_of_stores_are_refused(tmp_path: pathlib.Path) -> None:
    whole = tmp_path / "whole"
    scene = hemicube.Scene.generate("room", 160)
    assert hemicube.compute(scene, correction="pixel", output=whole).complete
    script = pathlib.Path(__file__).with_name("mutants.py")
    done = subprocess.run(
        [sys.executable, os.fspath(script), os.fspath(whole), str(COUNT), "1"], capture_output=True, text=True, check=False
    )
    last = "\n".join(done.stderr.splitlines()[-12:])
    assert done.returncode == 0, f"ended with {done.returncode}: {last}"
    assert "panicked" not in done.stderr, last
    assert int(done.stdout) * 2 > COUNT, f"{done.stdout.strip()} of {COUNT} refused: most mutants are none"
