"""Costs of portals: `portal_costs.py PROGRAM [FOLDER]`; FOLDER (else a temporary one) gets the scenes and stores.

`portal_costs.py PROGRAM FOLDER profile` has only what a row of the facade spends its time on, by Linux's `perf`.
`portal_costs.py PROGRAM FOLDER errors` has only errors measured and expected in a city with facing mirrors: minutes.
`portal_costs.py PROGRAM FOLDER backends NAME ...` has only rows over these plugins, with passes on either side.

Scenes with images beside the whole: half a city, one of twelve sectors, a cell beside its 7 x 7 tiling; rows of the part are
held against those of the whole. A facade of glass and rooms of mirrors beside the same without. Tubes of facets as their number
grows. One thread; time is processor time without loading the scene (a run of one row), memory the program's own figure.
"""

import json
import math
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path


def run(program, folder, line):
    """The report of `compute`, with the processor time of its process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [program, "compute", *line, "--overwrite", "--threads", "1", "--json"]
    out = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if out.returncode:
        sys.exit(f"{' '.join(command)}\n{out.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    report = json.loads(out.stdout)
    report["seconds"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return report


def cost(program, folder, line, rows=()):
    """Milliseconds a row, megabytes, and the report."""
    one = run(program, folder, [*line, "-o", "one", "--rows", "1"])
    all_ = run(program, folder, [*line, "-o", "all", *rows])
    seconds = max(all_["seconds"] - one["seconds"], 0.0)
    return 1e3 * seconds / max(all_["rows"] - 1, 1), all_["peak_memory_bytes"] / 1e6, all_


def read(path):
    vertices, faces = [], []
    for line in Path(path).read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append(tuple(float(x) for x in words[1:4]))
        elif words[:1] == ["f"]:
            corners = [int(word.split("/")[0]) - 1 for word in words[1:]]
            faces.extend((corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1))
    return [tuple(vertices[k] for k in face) for face in faces]


def write(path, triangles, glass=()):
    """Triangles as a file; those numbered in `glass` are of that material, wound both ways."""
    lines = []
    for triangle in triangles:
        lines.extend("v {!r} {!r} {!r}".format(*corner) for corner in triangle)
    face = lambda k, turned: "f {} {} {}".format(*((3 * k + 1, 3 * k + 3, 3 * k + 2) if turned else range(3 * k + 1, 3 * k + 4)))
    lines.append("usemtl wall")
    lines.extend(face(k, False) for k in range(len(triangles)) if k not in glass)
    if glass:
        lines.append("usemtl glass")
        lines.extend(face(k, turned) for k in sorted(glass) for turned in (False, True))
    Path(path).write_text("\n".join(lines) + "\n")


def moved(triangles, motion, mirrored=False):
    out = [tuple(motion(corner) for corner in triangle) for triangle in triangles]
    return [(a, c, b) for a, b, c in out] if mirrored else out


def rows(program, folder, store, count, cell):
    """The first rows of a store, with columns added up by their place in the cell."""
    table = Path(folder) / "table.mtx"
    subprocess.run([program, "export", store, "-o", table, "--overwrite"], cwd=folder, check=True, capture_output=True)
    lines = (line.split() for line in table.read_text().splitlines() if not line.startswith("%"))
    next(lines)
    out = {}
    for row, column, factor in lines:
        if int(row) <= count:
            key = int(row), (int(column) - 1) % cell
            out[key] = out.get(key, 0.0) + float(factor)
    return out


def apart(one, other):
    """Relative Frobenius distance."""
    keys = one.keys() | other.keys()
    return math.sqrt(
        sum((one.get(k, 0.0) - other.get(k, 0.0)) ** 2 for k in keys) / sum(value**2 for value in other.values())
    )


def bounds(triangles):
    corners = [corner for triangle in triangles for corner in triangle]
    return [[pick(corner[k] for corner in corners) for k in range(3)] for pick in (min, max)]


def wedge():
    """A twelfth of a round place: its ground, and houses."""
    angle = math.tau / 12
    at = lambda r, part, z: (r * math.cos(angle * part), r * math.sin(angle * part), z)
    quads = []
    for near, far in ((1, 2), (2, 3), (3, 4), (4, 5)):
        quads.append((at(near, 0, 0), at(far, 0, 0), at(far, 1, 0), at(near, 1, 0)))
    for near, far, a, b, h in ((1.3, 1.7, 0.2, 0.5, 0.6), (2.3, 2.8, 0.3, 0.8, 1.1), (3.4, 4.2, 0.1, 0.6, 0.8)):
        low = [at(near, a, 0), at(far, a, 0), at(far, b, 0), at(near, b, 0)]
        high = [(x, y, h) for x, y, _ in low]
        quads.append(tuple(high))
        quads.extend((low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k]) for k in range(4))
    return [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]


def images(program, folder):
    """Parts beside wholes."""
    subprocess.run([program, "generate", "block-city", "--patches", "350", "-o", "city.obj", "--overwrite"], cwd=folder, check=True, capture_output=True)
    city = read(folder / "city.obj")
    low, high = bounds(city)
    mirror = moved(city, lambda p: (2 * high[0] - p[0], p[1], p[2]), True)
    width, depth = high[0] - low[0], high[1] - low[1]
    subprocess.run([program, "generate", "block-city", "--patches", "126", "-o", "block.obj", "--overwrite"], cwd=folder, check=True, capture_output=True)
    block = read(folder / "block.obj")
    low_b, high_b = bounds(block)
    w, d = high_b[0] - low_b[0], high_b[1] - low_b[1]
    steps = [0, 1, -1, 2, -2, 3, -3]
    tiling = [t for y in steps for x in steps for t in moved(block, lambda p: (p[0] + x * w, p[1] + y * d, p[2]))]
    sector = wedge()
    ring = []
    for k in range(12):
        sin, cos = math.sin(math.tau * k / 12), math.cos(math.tau * k / 12)
        ring += moved(sector, lambda p: (p[0] * cos - p[1] * sin, p[0] * sin + p[1] * cos, p[2]))
    cases = [
        ("half a city", city, city + mirror, ["--symmetry", f"x={high[0]!r}"]),
        ("one of 12 sectors", sector, ring, ["--sector", "z,12"]),
        ("one of 7 x 7 cells", block, tiling, ["--periodic", f"x={low_b[0]!r}..{high_b[0]!r},y={low_b[1]!r}..{high_b[1]!r}", "--repeats", "3"]),
    ]
    print("part | rows | ms a row | whole matrix, s | MB | apart at 1 %")
    for name, part, whole, options in cases:
        write(folder / "part.obj", part)
        write(folder / "whole.obj", whole)
        level = ["--tolerance", "1%"]
        each, memory, report = cost(program, folder, ["part.obj", *options, *level])
        mine = rows(program, folder, "all", len(part), len(part))
        each_w, memory_w, report_w = cost(program, folder, ["whole.obj", *level])
        theirs = rows(program, folder, "all", len(part), len(part))
        print(f"{name} | {report['rows']} | {each:.2f} | {report['seconds']:.2f} | {memory:.0f} | {apart(mine, theirs):.2%}")
        print(f"the whole | {report_w['rows']} | {each_w:.2f} | {report_w['seconds']:.2f} | {memory_w:.0f} |", flush=True)


LEVELS = (["--correction", "pixel"], [], ["--tolerance", "1%"])


def facade(folder, scene):
    """A city, 10 % of whose walls are glass."""
    walls = read(scene)
    kinds = {}
    for triangle in walls:
        kinds[tuple(sorted(triangle))] = kinds.get(tuple(sorted(triangle)), 0) + 1

    def size(triangle):
        a, b, c = triangle
        u, v = [[q[k] - a[k] for k in range(3)] for q in (b, c)]
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        return math.hypot(*n) / 2, n[2]

    upright = [k for k, t in enumerate(walls) if abs(size(t)[1]) < 0.2 * size(t)[0]]
    wanted = 0.1 * sum(size(walls[k])[0] for k in upright)
    random.Random(1).shuffle(upright)
    glass, area = set(), 0.0
    for k in upright:
        if area < wanted and kinds[tuple(sorted(walls[k]))] == 1:
            glass.add(k)
            area += size(walls[k])[0]
    write(folder / "facade.obj", walls, glass)
    (folder / "facade.toml").write_text("[material.glass]\nspecular = 0.1\ntransmittance = 0.7\n")


# What functions of the program do, by a part of their names.
STAGES = (
    ("the item buffer", ("write_items", "take_items")),
    ("what is seen directly", ("hemicube_backend_cpu", "hemicube_contract::row")),
    ("windows drawn", ("hemicube::portal::window",)),
    ("pixels found, handed on and summed", ("hemicube::portal",)),
)


def profile(program, folder, scene):
    """Shares of the time of a row by pixel, through the facade's glass."""
    facade(folder, scene)
    line = [program, *"compute facade.obj --specular facade.toml --correction pixel --rows 2000 -o all".split()]
    record = ["perf", "record", "-q", "-F", "1500", "-o", "perf.data", *line, "--overwrite", "--threads", "1", "-q"]
    try:
        subprocess.run(record, cwd=folder, check=True, capture_output=True)
    except FileNotFoundError:
        sys.exit("there is no `perf`; Debian has it in linux-perf")
    report = ["perf", "report", "-i", "perf.data", "--stdio", "-F", "overhead,sym", "--percent-limit", "0"]
    text = subprocess.run(report, cwd=folder, check=True, capture_output=True, text=True).stdout
    shares = dict.fromkeys([*(name for name, _ in STAGES), "the rest"], 0.0)
    for line in text.splitlines():
        share, _, symbol = line.strip().partition("%")
        if line.startswith("#") or not symbol:
            continue
        found = (name for name, words in STAGES if any(word in symbol for word in words))
        shares[next(found, "the rest")] += float(share)
    print("glass by pixel: share of the time")
    for name, share in shares.items():
        print(f"{name} | {share:.0f} %")


def backends(program, folder, scene, names):
    """Rows by pixel through the facade's glass and through a mirrored wall, over plugins: passes by the processor and by the device."""
    facade(folder, scene)
    room = [program, *"generate room --patches 3000 -o room.obj --overwrite --quiet".split()]
    subprocess.run(room, cwd=folder, check=True)
    (folder / "room.toml").write_text("[object.right_wall]\nspecular = 0.9\n")
    print("scene | N | backend | ms a row without | composed | device | composed and device off the CPU backend's rows")
    for name in ("facade", "room"):
        for resolution in ("128", "256"):
            line = [f"{name}.obj", "--correction", "pixel", "--resolution", resolution, "--rows", "800"]
            through = [*line, "--specular", f"{name}.toml"]
            for backend in ("cpu", *names):
                of = ["--backend", backend]
                on_the_device = [] if backend == "cpu" else [(through, ["--backend-option", "passes=on"])]
                ways = [(line, []), *on_the_device, (through, [])]
                times, off = [], []
                for k, (rows, option) in enumerate(ways):
                    store = "cpu" if backend == "cpu" and k == 1 else "all"
                    times.append(1e3 / run(program, folder, [*rows, *of, *option, "-o", store])["rows_per_second"])
                    if backend != "cpu" and k > 0:
                        out = subprocess.run([program, "compare", store, "cpu", "--json"], cwd=folder, capture_output=True, text=True)
                        off.append(json.loads(out.stdout)["relative_frobenius"])
                cells = [times[0], *reversed(times[1:])]
                shown = " | ".join(f"{cell:.2f}" for cell in cells) + (" |" if backend == "cpu" else "")
                print(f"{name} | {resolution} | {backend} | {shown} | {', '.join(f'{x:.2%}' for x in reversed(off))}", flush=True)


def specular(program, folder, scene):
    """A facade of glass, and a cube with a mirror, beside the same of walls."""
    facade(folder, scene)
    print("glass, 10 % of the walls | ms a row without | with | times")
    for level in LEVELS:
        sample = ["--rows", "400"]
        plain, _, _ = cost(program, folder, ["facade.obj", *level], sample)
        through, _, _ = cost(program, folder, ["facade.obj", "--specular", "facade.toml", *level], sample)
        print(f"{' '.join(level) or 'default'} | {plain:.2f} | {through:.2f} | {through / plain:.2f}", flush=True)
    bands = 'bands = ["light", "heat"]\n[material.glass]\nspecular = [0.1, 0.15]\ntransmittance = [0.7, 0.2]\n'
    (folder / "bands.toml").write_text(bands)
    print("two bands | s of one | of both | times")
    for level in LEVELS:
        rows = ["facade.obj", *level, "--rows", "400", "-o", "bands"]
        seconds = []
        for file in ("facade.toml", "bands.toml"):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            line = [program, "compute", *rows, "--specular", file, "--overwrite", "--threads", "1", "--quiet"]
            subprocess.run(line, cwd=folder, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        one, both = seconds
        print(f"{' '.join(level) or 'default'} | {one:.2f} | {both:.2f} | {both / one:.2f}", flush=True)


def tube(folder, facets, rings):
    """A tube of radius 1 and length 2 of mirrors, each facet cut along the tube; its ends are black."""
    at = lambda k, z: (math.cos(math.tau * k / facets), math.sin(math.tau * k / facets), z)
    lines, count = [], 0

    def polygon(corners):
        nonlocal count
        lines.extend("v {!r} {!r} {!r}".format(*corner) for corner in corners)
        lines.append("f " + " ".join(str(count + k + 1) for k in range(len(corners))))
        count += len(corners)

    lines.append("o low")
    polygon([at(k, 0) for k in range(facets)])
    lines.append("o high")
    polygon([at(-k, 2) for k in range(facets)])
    lines.append("o wall")
    for k in range(facets):
        for ring in range(rings):
            low, high = 2 * ring / rings, 2 * (ring + 1) / rings
            polygon([at(k, low), at(k, high), at(k + 1, high), at(k + 1, low)])
    (folder / "tube.obj").write_text("\n".join(lines) + "\n")


def facets(program, folder):
    print("facets of a specular tube | disk to disk | off 0.446882 | ms a row")
    before = None
    for count in (6, 12, 24, 48, 96):
        tube(folder, count, 1)
        (folder / "tube.toml").write_text("[object.wall]\nspecular = 0.5\n")
        line = ["tube.obj", "--specular", "tube.toml", "--tolerance", "0.1%", "--emitters", "low"]
        report = run(program, folder, [*line, "-o", "all"])
        table = folder / "zones.csv"
        subprocess.run([program, "export", "all", "-o", table, "--by", "object", "--overwrite"], cwd=folder, check=True, capture_output=True)
        head, *body = [line.split(",") for line in table.read_text().splitlines()]
        value = next(float(line[head.index("high")]) for line in body if line[0] == "low")
        off = value - 0.44688230485222
        slope = "" if before is None else f", slope {math.log2(abs(before / off)):.2f}"
        before = off
        print(f"{count} | {value:.5f} | {off:+.5f}{slope} | {1e3 * report['seconds'] / report['rows']:.1f}", flush=True)


def errors(program, folder):
    """The error measured by rays on 24 rows, beside the one expected of the matrix, in a city of facing mirrors."""
    subprocess.run([program, "generate", "city", "--patches", "600", "-o", "city.obj", "--overwrite"], cwd=folder, check=True, capture_output=True)
    mirrors = '[object."building_0_0*"]\nspecular = 0.3\n[object."building_1*"]\nspecular = 0.6\n'
    (folder / "mirrors.toml").write_text(mirrors)
    print("facing mirrors, tolerance | measured, % | expected, %")
    for tolerance in ("1%", "0.3%"):
        line = ["city.obj", "--specular", "mirrors.toml", "--tolerance", tolerance, "--verify", "24", "-o", "all"]
        report = run(program, folder, line)
        measured = report["verification"]["measured"]["relative_frobenius"]
        print(f"{tolerance} | {100 * measured:.2f} | {100 * report['expected_error']:.2f}", flush=True)


def main():
    program = str(Path(shutil.which(sys.argv[1]) or sys.argv[1]).resolve())
    place = tempfile.TemporaryDirectory() if len(sys.argv) < 3 else None
    folder = Path(place.name if place else sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    scene = Path(os.environ.get("HEMICUBE_SCENES", "../shared/scenes")) / "city/denhaag-8897.obj"
    if "profile" in sys.argv[3:]:
        profile(program, folder, scene.resolve())
        return
    if "backends" in sys.argv[3:]:
        backends(program, folder, scene.resolve(), sys.argv[sys.argv.index("backends") + 1 :])
        return
    if "errors" in sys.argv[3:]:
        errors(program, folder)
        return
    images(program, folder)
    specular(program, folder, scene.resolve())
    facets(program, folder)


if __name__ == "__main__":
    main()
