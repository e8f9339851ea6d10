"""hemicube beside View3D 4.0: `view3d.py HEMICUBE VIEW3D OUT.json [SCENE ...]`.

Scenes, closed or conforming, without crossing surfaces, which View3D does not take:

    36      a room with two boxes that float in it, 36 triangles
    300     the room in 192 triangles with nine boxes, 300 triangles
    room    the room in 768 triangles with six boxes of 48, 1,056 triangles
    city    70 buildings on ground that conforms to them, 2,500 triangles
    eps     `hemicube generate city --patches 600` and the room of 300, by View3D's `eps`: the file for View3D, by `hemicube view3d`
            as well; relative Frobenius errors against `hemicube view3d` with eps=1e-5

Each program writes the matrix of a scene, by turns, on one thread; figures are user and system seconds of the process (the least
of the turns), the largest |row sum - 1| (in the city: |row sum + escaped - 1|, View3D without escaped by the reference's), and
max |F - reference| over sampled rows. The reference is hemicube at a finer tolerance in f64, with its expected error; View3D's
file has single precision. HEMICUBE_REFERENCE names another program for the reference. OUT.json has all of it and the machine's processor.
"""

import json
import os
import pathlib
import random
import resource
import subprocess
import sys
import tempfile

import numpy as np

TURNS = int(os.environ.get("TURNS", 2))
SAMPLED = 12
FINE = {"1e-6": ["--form", "double"]}
REFERENCE = {"36": "1e-7", "300": "1e-7", "room": "3e-4", "city": "1e-3"}
OURS = {"36": ["1e-3", "1e-4", "1e-6"], "300": ["1e-3", "1e-4", "1e-6"], "room": ["1e-3"], "city": ["1e-2", "5e-3", "4e-3", "3e-3"]}
EPS = {"View3D": ["1e-4", "1e-5", "1e-6"], "hemicube": ["1e-4", "2e-4", "3e-4", "5e-4", "1e-3"]}


def quads(origin, edges, pieces):
    """The triangles of a parallelogram in pieces[0] x pieces[1] halved cells."""
    origin, (u, v) = np.array(origin, float), np.array(edges, float)
    (m, n), out = pieces, []
    at = lambda i, j: origin + u * i / m + v * j / n
    for i in range(m):
        for j in range(n):
            a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
            out += [(a, b, c), (a, c, d)]
    return out


def box(low, high, pieces, inward=False):
    """The six faces of a box, outward or inward."""
    low, high = np.array(low, float), np.array(high, float)
    out = []
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3], v[(axis + 2) % 3] = (high - low)[(axis + 1) % 3], (high - low)[(axis + 2) % 3]
        top = low.copy()
        top[axis] = high[axis]
        out += quads(top, (u, v), (pieces, pieces)) + quads(low, (v, u), (pieces, pieces))
    return [(a, c, b) for a, b, c in out] if inward else out


def room(cells, boxes, pieces, seed):
    """A closed room of 6 x 5 x 3 m with boxes that neither touch it nor each other."""
    dice, out = random.Random(seed), box((0, 0, 0), (6, 5, 3), cells, inward=True)
    places = [(x, y) for x in range(4) for y in range(3)]
    for x, y in dice.sample(places, boxes):
        low = (0.3 + 1.4 * x, 0.3 + 1.6 * y, 0.2 + 0.6 * dice.random())
        size = (0.4 + 0.6 * dice.random(), 0.4 + 0.8 * dice.random(), 0.5 + 1.2 * dice.random())
        out += box(low, np.add(low, size), pieces)
    return out


def city(cells, buildings, seed):
    """Buildings of 12 x 12 m on cells of 12 m of a square, no two side by side where chance allows; ground between."""
    dice, taken = random.Random(seed), set()
    places = [(x, y) for x in range(cells) for y in range(cells)]
    dice.shuffle(places)
    for apart in (1, 0):
        for x, y in places:
            if len(taken) < buildings and (x, y) not in taken and (
                not apart or not taken & {(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)}
            ):
                taken.add((x, y))
    out = []
    for x, y in sorted(places):
        if (x, y) not in taken:
            out += quads((12 * x, 12 * y, 0), ((12, 0, 0), (0, 12, 0)), (2, 2))
            continue
        low, height = np.array((12.0 * x, 12.0 * y, 0.0)), 6.0 + 3.0 * dice.randrange(9)
        out += quads(low + (0, 0, height), ((12, 0, 0), (0, 12, 0)), (1, 1))
        for start, along, beside in (
            ((0, 0), (12, 0), (x, y - 1)), ((12, 0), (0, 12), (x + 1, y)),
            ((12, 12), (-12, 0), (x, y + 1)), ((0, 12), (0, -12), (x - 1, y)),
        ):
            if beside not in taken:
                out += quads(low + (*start, 0), ((*along, 0), (0, 0, height)), (1, 2))
    return out


SCENES = {
    "36": lambda: room(1, 2, 1, 1),
    "300": lambda: room(4, 9, 1, 2),
    "room": lambda: room(8, 6, 2, 3),
    "city": lambda: city(15, 70, 4),
}


def write(scene, folder, eps=""):
    """The scene as OBJ and as View3D's file."""
    points, faces = {}, []
    for triangle in scene:
        keys = [tuple(round(float(x), 12) for x in p) for p in triangle]
        faces.append([points.setdefault(key, len(points) + 1) for key in keys])
    with open(folder / "scene.obj", "w") as obj:
        obj.writelines("v %.17g %.17g %.17g\n" % p for p in points)
        obj.writelines("f %d %d %d\n" % tuple(face) for face in faces)
    with open(folder / "scene.vs3", "w") as vs3:
        vs3.write(f"T scene\nC encl=0 list=0 out=1 {eps}\nF 3\n")
        vs3.writelines("V %d %.17g %.17g %.17g\n" % (number, *p) for p, number in points.items())
        vs3.writelines("S %d %d %d %d 0 0 0 0.5 s%d\n" % (k + 1, *face, k + 1) for k, face in enumerate(faces))
        vs3.write("End of data\n")


def run(words, folder):
    """User and system seconds of a process, and its output."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        sys.exit(f"error: {' '.join(map(str, words))}: {done.stderr or done.stdout}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done


def theirs(folder):
    """View3D's binary file as a matrix."""
    text = (folder / "out.vf").read_bytes()
    count = int(text[:30].split()[-1])
    numbers = np.frombuffer(text, "<f4", offset=len(text) - 4 * (count * (count + 2)))
    return numbers[count : count + count * count].reshape(count, count).astype(float)


def ours(program, store, folder):
    run([program, "export", store, "-o", "F.npy", "--overwrite", "-q"], folder)
    table = np.load(folder / store / "patches.npz")
    return np.load(folder / "F.npy").astype(float), table["escaped"] + table["blocked"]


def measure(program, view3d, name, folder):
    finer = os.environ.get("HEMICUBE_REFERENCE", program)
    scene = SCENES[name]()
    write(scene, folder)
    settings = [("View3D", [view3d, "scene.vs3", "out.vf"])]
    for tolerance in OURS[name]:
        store = f"t{tolerance}"
        words = [program, "compute", "scene.obj", "-o", store, "--tolerance", tolerance, "--threads", "1", "--overwrite", "-q"]
        settings.append((f"hemicube {tolerance}", words + FINE.get(tolerance, [])))
    found = {what: {"seconds": []} for what, _ in settings}
    for _ in range(TURNS):
        for what, words in settings:
            found[what]["seconds"].append(run(words, folder)[0])
    words = ["compute", "scene.obj", "-o", "reference", "--rows", str(SAMPLED), "--overwrite", "--form", "double"]
    seconds, done = run([finer, *words, "--tolerance", REFERENCE[name], "--json"], folder)
    reference, lost = ours(finer, "reference", folder)
    rows = np.flatnonzero(~np.isnan(lost))
    result = {
        "triangles": len(scene),
        "reference": {"tolerance": REFERENCE[name], "rows": len(rows), "seconds": seconds,
                      "expected_error": json.loads(done.stdout).get("expected_error", 0.0)},
        "programs": found,
    }
    for what, _ in settings:
        is_theirs = what == "View3D"
        F, gone = (theirs(folder), None) if is_theirs else ours(program, f"t{what.split()[1]}", folder)
        sums = F.sum(1)
        if name != "city":
            found[what]["row_sum"] = float(abs(sums - 1).max())
        else:
            off = abs(sums[rows] + lost[rows] - 1) if is_theirs else abs(sums + gone - 1)
            found[what]["row_sum"] = float(off.max())
        found[what]["entry"] = float(abs(F[rows] - reference[rows]).max())
        found[what]["row_of_reference"] = float(abs(sums[rows] - reference[rows].sum(1)).max())
    return result


def triangles_of(path):
    """The triangles of an OBJ file, polygons as fans."""
    points, out = [], []
    for line in path.read_text().splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            points.append(np.array(words[:3], float))
        elif kind == "f":
            corners = [points[int(word.split("/")[0]) - 1] for word in words]
            out += [(corners[0], b, c) for b, c in zip(corners[1:], corners[2:])]
    return out


def by_eps(program, view3d, folder):
    """Seconds and errors of both programs by View3D's `eps`, a scene after the other."""
    run([program, "generate", "city", "--patches", "600", "-o", "city.obj", "-q"], folder)
    found = {}
    for name, scene in (("city of 600", triangles_of(folder / "city.obj")), ("300", SCENES["300"]())):
        def matrix(who, eps):
            write(scene, folder, f"eps={eps}")
            words = [view3d] if who == "View3D" else [program, "view3d"]
            seconds, _ = run([*words, "scene.vs3", "out.vf"], folder)
            return seconds, theirs(folder)

        _, reference = matrix("hemicube", "1e-5")
        for who, each in EPS.items():
            for eps in each:
                seconds, F = matrix(who, eps)
                error = float(np.linalg.norm(F - reference) / np.linalg.norm(reference))
                off = int((abs(F - reference) > 1e-3).sum())
                found[f"{name}, {who} {eps}"] = {"seconds": seconds, "error": error, "off": off}
                print(f"| {name}, {len(scene)} | {who}, eps={eps} | {seconds:.2f} | {100 * error:.3f} % | {off} off by 1e-3 |", flush=True)
    return found


def main():
    program, view3d, out, *names = sys.argv[1:]
    program, view3d = (str(pathlib.Path(path).resolve()) for path in (program, view3d))
    model = [line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    all_found = {"processor": model[0] if model else "?", "cores": os.cpu_count(), "scenes": {}}
    print("| scene | | seconds | largest row sum error | largest entry error, row sum against the reference |")
    print("|---|---|---|---|---|")
    for name in names or [*SCENES, "eps"]:
        if name == "eps":
            with tempfile.TemporaryDirectory() as folder:
                all_found["eps"] = by_eps(program, view3d, pathlib.Path(folder))
            pathlib.Path(out).write_text(json.dumps(all_found, indent=2) + "\n")
            continue
        with tempfile.TemporaryDirectory() as folder:
            found = measure(program, view3d, name, pathlib.Path(folder))
        all_found["scenes"][name] = found
        for what, of in found["programs"].items():
            print(f"| {name}, {found['triangles']} | {what} | {min(of['seconds']):.2f} | {of['row_sum']:.1e} | "
                  f"{of['entry']:.1e}, {of['row_of_reference']:.1e} |", flush=True)
        print(f"|  | reference, {found['reference']['rows']} rows at {found['reference']['tolerance']} | "
              f"{found['reference']['seconds']:.2f} | | {found['reference']['expected_error']:.1e} expected |", flush=True)
        pathlib.Path(out).write_text(json.dumps(all_found, indent=2) + "\n")


if __name__ == "__main__":
    main()
