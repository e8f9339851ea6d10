"""Rows whose sum of form factors or whose shares are off: `shares.py PROGRAM SCENE... [--rows N]`.

400 rows of each scene by default and at 1 %, held against the same rows at 0.1 %. Per scene and level: seconds of
processor time, rows of which ΣF, escaped and blocked are off by more than the tolerance (2 % by default), the largest
differences and their root mean squares, and the largest |ΣF + escaped + blocked + unselected - 1|.
"""

import argparse
import csv
import resource
import subprocess
import tempfile
from pathlib import Path

SHARES = ["row_sum", "escaped", "blocked", "unselected"]
LEVELS = [("default", [], 0.02), ("1 %", ["--tolerance", "1%"], 0.01)]
REFERENCE = ["--tolerance", "0.1%"]


def rows_of(program, scene, options, rows, folder):
    """ΣF and the shares of each row computed, by its patch, and the seconds taken."""
    store, table = folder / "store", folder / "rows.csv"
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    line = ["compute", scene, "-o", store, "--rows", str(rows), *options]
    subprocess.run([program, *line, "--overwrite", "--quiet"], check=True)
    seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    line = ["export", store, "-o", table, "--overwrite", "--quiet", "--allow-incomplete"]
    subprocess.run([program, *line], check=True)
    with table.open() as file:
        found = [row for row in csv.DictReader(file) if row["row_sum"]]
    return {row["patch"]: [float(row[share]) for share in SHARES] for row in found}, seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--rows", type=int, default=400)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for scene in chosen.scenes:
            arguments = (chosen.rows, Path(folder))
            reference, _ = rows_of(chosen.program, scene, REFERENCE, *arguments)
            for level, options, permitted in LEVELS:
                found, seconds = rows_of(chosen.program, scene, options, *arguments)
                differences = [[abs(a - b) for a, b in zip(found[patch], reference[patch])] for patch in reference]
                off = [sum(difference > permitted for difference in column) for column in zip(*differences)][:3]
                most = [f"{max(column):.3f}" for column in zip(*differences)][:3]
                roots = [f"{(sum(d * d for d in column) / len(column)) ** 0.5:.4f}" for column in zip(*differences)][:3]
                sums = max(abs(sum(row) - 1.0) for row in found.values())
                line = f"{scene.stem:24} {level:8} {seconds:6.1f} s  off {off}  at most {most}  root {roots}  sums {sums:.4f}"
                print(line, flush=True)


if __name__ == "__main__":
    main()
