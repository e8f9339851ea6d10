"""Mutants of a matrix's store, sealed again as an attacker seals them, and what Python makes of them.

A process of its own: `python mutants.py WHOLE COUNT SEED` ends with 0 if every mutant was refused by an exception of the
package or gave the whole store's values. `test_mutants.py` runs it.
"""

import io
import json
import pathlib
import random
import resource
import shutil
import sys
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np
from blake3 import blake3

import hemicube

# Bytes of address space: a claim that no file backs is larger.
ADDRESS_SPACE = 4_000_000_000

# A file of a matrix, and its arrays that no matrix can hold with nonsense in them.
FILES: list[tuple[str, list[str]]] = [
    ("parts/part-00000.npz", ["data", "indices", "rows"]),
    ("parts/part-00001.npz", ["data", "indices", "rows"]),
    ("patches.npz", ["area", "object", "material", "side"]),
    ("manifest.json", []),
]


def solved(matrix: hemicube.Matrix) -> Any:
    emission = np.linspace(0.0, 1.0, len(matrix))
    return hemicube.solve(matrix, 0.5, emission).radiosity


def middle(matrix: hemicube.Matrix) -> Any:
    row = matrix.row(len(matrix) // 2)
    return np.zeros(0) if row is None else row[-1]


# Each gives an array that a matrix of the same numbers gives, too.
USES: dict[str, Callable[[hemicube.Matrix], Any]] = {
    "to_scipy": lambda matrix: matrix.to_scipy() @ np.ones(len(matrix)),
    "csr": lambda matrix: matrix.csr.data,
    "multiply": lambda matrix: matrix.multiply(np.ones(len(matrix))),
    "rows": lambda matrix: np.array([row[-1].sum() for row in matrix]),
    "row": middle,
    "areas": lambda matrix: matrix.areas,
    "row_sums": lambda matrix: matrix.row_sums,
    "shares": lambda matrix: np.concatenate([matrix.escaped, matrix.blocked, matrix.unselected, matrix.closure]),
    "errors": lambda matrix: matrix.errors,
    "settings": lambda matrix: np.array([len(str(matrix.settings)) > 0, matrix.complete]),
    "solve": solved,
}


def seal(manifest: dict[str, Any]) -> bytes:
    """A manifest's bytes with the checksum of what it says."""
    manifest.pop("blake3", None)
    text = json.dumps(manifest, indent=2).removesuffix("\n}")
    return f'{text},\n  "blake3": "{blake3(text.encode()).hexdigest()}"\n}}\n'.encode()


def agree(store: pathlib.Path) -> None:
    """Has the manifest agree with the files."""
    path = store / "manifest.json"
    manifest = json.loads(path.read_bytes())
    manifest["patches"]["blake3"] = blake3((store / "patches.npz").read_bytes()).hexdigest()
    for part in manifest["parts"]:
        part["blake3"] = blake3((store / part["file"]).read_bytes()).hexdigest()
    path.write_bytes(seal(manifest))


def nonsense(content: bytes, chance: random.Random) -> bytes:
    """An array with one element that is no index and no share."""
    array = np.load(io.BytesIO(content)).copy()
    if array.size:
        at = chance.randrange(array.size)
        if array.dtype.kind == "f":
            array.flat[at] = chance.choice([np.nan, np.inf, -1.0, -1e30])
        elif array.dtype.itemsize == 1:
            array.flat[at] = 0xFE if array.dtype.kind == "u" else -2
        else:
            array.flat[at] = chance.choice([np.iinfo(array.dtype).max, 1 << 24])
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def scramble(content: bytes, chance: random.Random) -> bytes:
    """Flips, cuts or repeats bytes."""
    changed = bytearray(content)
    for _ in range(chance.randint(1, 3)):
        at = chance.randrange(max(len(changed), 1))
        kind = chance.randrange(4)
        if kind == 0 and changed:
            changed[at] ^= 1 << chance.randrange(8)
        elif kind == 1:
            del changed[at:]
        elif kind == 2:
            changed[at:at] = changed[at : at + chance.randint(1, 16)]
        else:
            changed[at : at + 8] = b"\xff" * len(changed[at : at + 8])
    return bytes(changed)


def change_number(value: Any, chance: random.Random) -> Any:
    """A JSON value with one of its scalars replaced by a wild number."""
    if isinstance(value, dict) and value:
        key = chance.choice(sorted(value))
        value[key] = change_number(value[key], chance)
    elif isinstance(value, list) and value:
        at = chance.randrange(len(value))
        value[at] = change_number(value[at], chance)
    else:
        return chance.choice([0, 1, 41, 1 << 31, (1 << 32) - 1, 1 << 40, (1 << 64) - 1])
    return value


def mutate(store: pathlib.Path, chance: random.Random) -> tuple[str, bool]:
    """Changes a store: the change in words, and whether no matrix can hold it."""
    name, never = chance.choice(FILES)
    path = store / name
    if chance.randrange(5) == 0:
        path.write_bytes(scramble(path.read_bytes(), chance))
        return f"{name}, not sealed", True
    if name.endswith(".json"):
        path.write_bytes(seal(change_number(json.loads(path.read_bytes()), chance)))
        return name, False
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    is_never = chance.randrange(3) > 0
    member = chance.choice([f"{array}.npy" for array in never if f"{array}.npy" in members] if is_never else sorted(members))
    members[member] = nonsense(members[member], chance) if is_never else scramble(members[member], chance)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for each, content in members.items():
            archive.writestr(each, content)
    agree(store)
    return f"{name}: {member}{', nonsense' if is_never else ''}", is_never


def run(whole: pathlib.Path, count: int, seed: int) -> int:
    """Refused mutants of `count`. An exception that is not the package's passes through."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    warnings.simplefilter("ignore")
    wanted = {name: np.asarray(use(hemicube.open(whole))) for name, use in USES.items()}
    chance = random.Random(seed)
    refused = 0
    with tempfile.TemporaryDirectory() as folder:
        store = pathlib.Path(folder) / "m"
        for number in range(count):
            shutil.copytree(whole, store)
            change, is_never = mutate(store, chance)
            name = chance.choice(sorted(USES))
            # Read by whoever finds the process ended by a signal.
            print(f"mutant {number} of seed {seed} ({change}): {name}", file=sys.stderr, flush=True)
            try:
                found = np.asarray(USES[name](hemicube.open(store)))
            except hemicube.Error:
                refused += 1
            else:
                if is_never and not np.array_equal(found, wanted[name], equal_nan=found.dtype.kind == "f"):
                    raise AssertionError(f"mutant {number} ({change}): {name} differs, and nothing was raised")
            shutil.rmtree(store)
    return refused


if __name__ == "__main__":
    print(run(pathlib.Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])))
