"""While rows are computed: other threads go on, progress is told, and Ctrl-C ends it."""

import pathlib
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import hemicube


def test_another_thread_goes_on() -> None:
    scene = hemicube.Scene.generate("city", 4000)
    steps = []
    stop = threading.Event()

    def count() -> None:
        while not stop.wait(0.001):
            steps.append(time.monotonic())

    other = threading.Thread(target=count)
    other.start()
    started = time.monotonic()
    hemicube.compute(scene, correction="pixel", samples=16, threads=1)
    ended = time.monotonic()
    stop.set()
    other.join()
    within = [step for step in steps if started < step < ended]
    assert ended - started > 0.2, "too short to show anything"
    assert len(within) > 20
    # Nowhere was it kept waiting for long.
    assert max(np.diff([started, *within, ended])) < 0.5 * (ended - started)


def test_progress_is_told_on_the_calling_thread() -> None:
    seen: list[tuple[int, int]] = []
    threads = set()

    def progress(done: int, total: int) -> None:
        seen.append((done, total))
        threads.add(threading.get_ident())

    scene = hemicube.Scene.generate("city", 3000)
    matrix = hemicube.compute(scene, progress=progress)
    assert threads == {threading.get_ident()}
    assert seen == sorted(seen) and seen[-1] == (len(scene), len(scene)) and len(seen) > 1
    residuals: list[float] = []
    hemicube.solve(matrix, 0.9, 1.0, progress=lambda step, residual: residuals.append(residual))
    assert residuals and residuals[-1] <= 1e-6
    rows: list[int] = []
    hemicube.sky(scene, up="y", resolution=64, progress=lambda done, total: rows.append(done))
    assert rows[-1] == len(scene)


def test_what_a_callback_raises_ends_the_run() -> None:
    class Enough(Exception):
        pass

    def progress(done: int, total: int) -> None:
        if done > 0:
            raise Enough(done)

    with pytest.raises(Enough) as caught:
        hemicube.compute(hemicube.Scene.generate("city", 20_000), progress=progress)
    assert 0 < caught.value.args[0] < 20_000


INTERRUPTED = """
import os, pathlib, signal, sys, threading, time
import hemicube

# Whoever started the tests in the background had interrupts ignored, and Python leaves that as it is.
signal.signal(signal.SIGINT, signal.default_int_handler)
when, directory = sys.argv[1:]
scene = hemicube.Scene.generate("city", 30_000)
begun = threading.Event()
begun_rows = threading.Event()
sent = []

# An interrupted run has half a second to end the part under way: a slow machine may lose it, and what was written stays.
def has_part():
    return any(pathlib.Path(directory, "parts").glob("*.npz"))

def interrupt():
    (begun_rows if when == "rows" else begun).wait()
    if when == "settling":
        time.sleep(0.05)
    sent.append(time.monotonic())
    os.kill(os.getpid(), signal.SIGINT)

threading.Thread(target=interrupt, daemon=True).start()
begun.set()
try:
    if when == "sky":
        hemicube.sky(scene, up="y", resolution=512, samples=16)
    else:
        hemicube.compute(
            scene,
            tolerance=0.002 if when == "settling" else None,
            output=directory,
            progress=lambda done, total: has_part() and begun_rows.set(),
        )
except KeyboardInterrupt:
    print(time.monotonic() - sent[0])
    sys.exit(0)
sys.exit("it ended by itself")
"""


@pytest.mark.parametrize("when", ["rows", "settling", "sky"])
def test_an_interrupt_ends_it_soon_and_keeps_what_is_done(when: str, tmp_path: pathlib.Path) -> None:
    command = [sys.executable, "-c", INTERRUPTED, when, str(tmp_path / "store")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr
    # Half a second for the part under way, and what a loaded machine adds to it.
    assert float(ended.stdout) < 5
    if when != "rows":
        return
    matrix = hemicube.open(tmp_path / "store")
    kept = sum(1 for _ in matrix)
    assert not matrix.complete and 0 < kept < 30_000
    with pytest.raises(hemicube.StoreError, match="is incomplete"):
        matrix.to_scipy()


def test_an_interrupted_run_goes_on_to_the_same_bytes(tmp_path: pathlib.Path) -> None:
    scene = hemicube.Scene.generate("room", 3000)
    whole = hemicube.compute(scene, output=tmp_path / "whole")

    class Enough(Exception):
        pass

    def progress(done: int, total: int) -> None:
        if done > 0:
            raise Enough

    with pytest.raises(Enough):
        hemicube.compute(scene, output=tmp_path / "store", progress=progress, batch=16)
    kept = sum(1 for _ in hemicube.open(tmp_path / "store"))
    assert 0 < kept < len(scene)
    told: list[int] = []
    again = hemicube.compute(scene, output=tmp_path / "store", progress=lambda done, total: told.append(done))
    assert min(told) >= kept and told[-1] == len(scene)
    assert whole.path is not None and again.path is not None
    for path in pathlib.Path(whole.path).rglob("*.npz"):
        assert (pathlib.Path(again.path) / path.relative_to(whole.path)).read_bytes() == path.read_bytes(), path
