"""Peers beside hemicube on the same scenes: `peers.py PROGRAM OUT.json [SCENE.obj ...]`; `scripts/peers` calls it.

Each setting runs in a process of its own, one thread, so that its memory is its own; what is compiled when first called is
called once before on a small part. Time is processor time. Errors are relative Frobenius errors over the same random rows, held
against hemicube's own rows at a tolerance of 0.1 %, whose error `compute --verify` measures by rays of another kind; what that
says is in OUT.json. Peers that compute whole matrices only are timed on the whole matrix, divided by its rows.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

THREADS = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
ROWS = 24
SEED = 1
LIMIT = 600  # seconds for one setting


def triangles(path):
    """Corners of an OBJ file's triangles."""
    import numpy

    vertices, faces = [], []
    for line in Path(path).read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(x) for x in words[1:4]])
        elif words[:1] == ["f"]:
            corners = [int(word.split("/")[0]) - 1 for word in words[1:]]
            faces.extend([corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1))
    return numpy.array(vertices)[numpy.array(faces)]


def cube(path, pieces):
    """The inside of a unit cube as a file, each face cut into pieces × pieces × 2 triangles."""
    corners, faces = {}, []

    def corner(*point):
        return corners.setdefault(point, len(corners) + 1)

    for axis in range(3):
        for side in (0, pieces):
            for i in range(pieces):
                for j in range(pieces):
                    square = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]]
                    ids = [corner(*(p[:axis] + [side] + p[axis:])) for p in square]
                    # Seen from the middle, counter-clockwise.
                    if (side == 0) == (axis == 1):
                        ids.reverse()
                    faces += [ids[:3], [ids[0], *ids[2:]]]
    lines = ["v " + " ".join(str(x / pieces) for x in point) for point in corners]
    lines += ["f " + " ".join(map(str, face)) for face in faces]
    Path(path).write_text("\n".join(lines) + "\n")
    return str(path)


def rows_of_store(store):
    """Which rows a store has, and these rows, dense."""
    import numpy
    import scipy.sparse

    store = Path(store)
    manifest = json.loads((store / "manifest.json").read_text())
    blocks, rows = [], []
    for part in manifest["parts"]:
        rows.append(numpy.load(store / part["file"])["rows"])
        blocks.append(scipy.sparse.load_npz(store / part["file"]))
    return numpy.concatenate(rows), scipy.sparse.vstack(blocks).toarray().astype(float)


def embree(scene, rows, setting):
    """Cosine-distributed rays from random points of a patch: the plain alternative to a hemicube."""
    import numpy
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    corners = triangles(scene)
    count = int(setting.removesuffix(" rays"))
    edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = numpy.cross(*edges)
    normals /= numpy.linalg.norm(normals, axis=1)[:, None]
    size = numpy.ptp(corners.reshape(-1, 3), axis=0).max()
    started = time.process_time()
    traced = rtcore_scene.EmbreeScene()
    TriangleMesh(traced, corners.astype(numpy.float32))
    loaded = time.process_time() - started
    random = numpy.random.default_rng(SEED)
    found = numpy.zeros((len(rows), len(corners)))
    started = time.process_time()
    for place, row in enumerate(rows):
        u, v, r, turn = random.random((4, count))
        root = numpy.sqrt(u)
        weights = numpy.stack([1 - root, root * (1 - v), root * v], axis=1)
        normal = normals[row]
        tangent = edges[0][row] / numpy.linalg.norm(edges[0][row])
        bitangent = numpy.cross(normal, tangent)
        radius, angle = numpy.sqrt(r), 2 * numpy.pi * turn
        directions = (
            (radius * numpy.cos(angle))[:, None] * tangent
            + (radius * numpy.sin(angle))[:, None] * bitangent
            + numpy.sqrt(1 - r)[:, None] * normal
        )
        origins = weights @ corners[row] + 1e-6 * size * normal
        hit = traced.run(origins.astype(numpy.float32), directions.astype(numpy.float32), query="INTERSECT")
        hit = numpy.asarray(hit)
        met = hit >= 0
        # What meets a back is blocked: patches have one side.
        met[met] = (normals[hit[met]] * directions[met]).sum(axis=1) < 0
        found[place] = numpy.bincount(hit[met], minlength=len(corners)) / count
    return found, time.process_time() - started, len(rows), loaded


def pyviewfactor(scene, rows, setting):
    """Double contour integrals; of each pair one ray from centre to centre says whether it is seen."""
    import numpy
    import pyvista
    import pyviewfactor as peer

    def mesh_of(corners):
        points = corners.reshape(-1, 3)
        faces = numpy.arange(len(points)).reshape(-1, 3)
        return pyvista.PolyData(points, numpy.hstack([numpy.full((len(faces), 1), 3), faces]).ravel()).clean()

    corners = triangles(scene)
    warm = mesh_of(corners[:12])
    peer.compute_viewfactor_matrix(warm, obstacles=[warm])
    mesh = mesh_of(corners)
    assert mesh.n_cells == len(corners), "the mesh lost triangles"
    started = time.process_time()
    matrix = peer.compute_viewfactor_matrix(mesh, obstacles=[mesh])
    # Its matrix holds F[i, j] from j to i.
    return matrix.T[rows], time.process_time() - started, len(corners), 0.0


def raystrack(scene, rows, setting):
    """Quasi-Monte-Carlo rays; built for tens of large surfaces, here one surface a triangle."""
    import numpy
    import raystrack as peer

    corners = triangles(scene)
    density = int(setting.split("=")[1])
    meshes = {f"s{k}": peer.Mesh(c, numpy.array([[0, 1, 2]])) for k, c in enumerate(corners)}
    solver = peer.Solver(peer.Scene.from_meshes(meshes), device="cpu", bvh="builtin", auto_tune=False)
    options = peer.SolveOptions(
        peer.Sampling(density=density, rays_per_cell=128, seed=11),
        peer.Accuracy(max_replicates=2, min_replicates=2, tolerance=0),
    )
    names = tuple(f"s{row}" for row in rows)
    solver.solve(peer.Query.matrix(senders=names[:1]), options)
    started = time.process_time()
    result = solver.solve(peer.Query.matrix(senders=names), options)
    spent = time.process_time() - started
    found = numpy.zeros((len(rows), len(corners)))
    for place, name in enumerate(names):
        for key, value in receivers(result, name):
            found[place, int(key[1:])] += value
    return found, spent, len(rows), 0.0


def receivers(result, sender):
    """The fronts that a sender's row of a raystrack result has, with their values."""
    for channel in result.channels:
        if channel.kind == "surface" and channel.side == "front":
            value = result.value(sender, channel)
            if value:
                yield channel.surface_id, float(value)


def hemicube(scene, rows, setting, program):
    """The program itself, from its start to its end, on these rows."""
    import numpy

    with tempfile.TemporaryDirectory() as place:
        store = Path(place) / "m.hemicube"
        words = [program, "compute", scene, "-o", str(store), "-q", "--config=none", "--threads", "1", *setting.split()]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(words, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        there, found = rows_of_store(store)
        order = {row: k for k, row in enumerate(there)}
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return found[[order[row] for row in rows]], spent, len(there), 0.0


PEERS = {"Embree rays": embree, "pyviewfactor": pyviewfactor, "hemicube": hemicube, "raystrack": raystrack}
MODULES = {"Embree rays": "embreex", "pyviewfactor": "pyviewfactor", "raystrack": "raystrack"}


def one(program, scene, reference, peer, setting):
    """Runs a setting here, and prints what came of it."""
    import numpy

    kept = numpy.load(reference)
    rows, exact = kept["rows"], kept["values"]
    extra = (program,) if peer == "hemicube" else ()
    found, spent, computed, loaded = PEERS[peer](scene, rows, setting, *extra)
    who = resource.RUSAGE_CHILDREN if peer == "hemicube" else resource.RUSAGE_SELF
    print(
        json.dumps(
            {
                "scene": Path(scene).stem,
                "peer": peer,
                "setting": setting,
                "milliseconds": 1e3 * spent / computed,
                "rows": int(computed),
                "error": float(numpy.linalg.norm(found - exact) / numpy.linalg.norm(exact)),
                "row_sum_error": float(numpy.sqrt(((found.sum(1) - exact.sum(1)) ** 2).mean())),
                "bytes": 1024 * resource.getrusage(who).ru_maxrss,
                "load_seconds": loaded,
            }
        )
    )


def reference_of(program, scene, place):
    """Rows at a tolerance of 0.1 %, which rows they are, and the error that the run measured of itself."""
    import numpy

    store = place / f"{Path(scene).stem}.hemicube"
    report = place / "report.json"
    words = [program, "compute", scene, "-o", str(store), "-q", "--config=none", "--tolerance", "0.1%"]
    words += ["--rows", str(ROWS), "--seed", str(SEED), "--verify", "8", f"--json={report}"]
    # Exit 1 says that the tolerance was not kept: the report then says by how much, and so does this.
    ran = subprocess.run(words, check=False)
    if ran.returncode not in (0, 1):
        sys.exit(f"error: hemicube could not compute the reference of `{scene}`")
    rows, values = rows_of_store(store)
    file = place / f"{Path(scene).stem}.npz"
    numpy.savez(file, rows=rows, values=values)
    return file, json.loads(report.read_text()).get("verification")


def settings(peer, count):
    """What a peer is tried at on a scene of so many triangles."""
    if peer == "Embree rays":
        return [f"{rays} rays" for rays in (1024, 4096, 16384, 65536, 262144)]
    if peer == "pyviewfactor":
        return ["default"] if count <= 4000 else []
    if peer == "raystrack":
        return ["density=1"] if count <= 1500 else []
    return ["--tolerance 2%", "--tolerance 1%", "--tolerance 0.3%"]


def main():
    program, out, *scenes = sys.argv[1:]
    environment = {**os.environ, **{name: "1" for name in THREADS}}
    measured, without, references = [], [], {}
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        if not scenes:
            for kind, count in (("room", 1000), ("city", 1000)):
                scene = place / f"{kind}-1k.obj"
                words = [program, "generate", kind, "--patches", str(count), "-o", str(scene), "-q"]
                subprocess.run(words, check=True)
                scenes.append(str(scene))
            # Nothing is in the way here: what closed forms are for.
            scenes.append(cube(place / "cube-768.obj", 8))
        missing = set()
        for peer, module in MODULES.items():
            tried = subprocess.run([sys.executable, "-c", f"import {module}"], capture_output=True, text=True, check=False)
            if tried.returncode != 0:
                missing.add(peer)
                reason = (tried.stderr.strip().splitlines() or ["it does not say why"])[-1]
                without.append(f"{peer}: `{module}` cannot be used here: {reason}")
        for scene in scenes:
            file, verified = reference_of(program, scene, place)
            references[Path(scene).stem] = verified
            count = len(triangles(scene))
            for peer in PEERS:
                for setting in [] if peer in missing else settings(peer, count):
                    print(f"{Path(scene).stem}: {peer}, {setting}", file=sys.stderr)
                    words = [sys.executable, __file__, "--one", program, scene, str(file), peer, setting]
                    try:
                        ran = subprocess.run(
                            words, capture_output=True, text=True, env=environment, timeout=LIMIT, check=True
                        )
                        measured.append(json.loads(ran.stdout.splitlines()[-1]))
                    except subprocess.TimeoutExpired:
                        without.append(f"{peer}, {setting}, on {Path(scene).stem}: not done after {LIMIT} s")
                    except (subprocess.CalledProcessError, IndexError, ValueError) as error:
                        said = (getattr(error, "stderr", "") or "").strip().splitlines() or [str(error)]
                        without.append(f"{peer}, {setting}, on {Path(scene).stem}: {said[-1]}")
                    # As it is measured: raystrack takes minutes.
                    kept = {"peers": measured, "without": without, "references": references}
                    Path(out).write_text(json.dumps(kept, indent=1) + "\n")
    print(f"{'scene':10} {'peer':14} {'setting':20} {'ms a row':>10} {'error':>9} {'row sums':>9} {'memory':>9}")
    for m in measured:
        print(
            f"{m['scene']:10} {m['peer']:14} {m['setting']:20} {m['milliseconds']:10.3f} {m['error']:9.2%} "
            f"{m['row_sum_error']:9.1e} {m['bytes'] / 1e6:6.0f} MB"
        )
    for scene in references:
        ours = [m for m in measured if m["scene"] == scene and m["peer"] == "hemicube"]
        for m in measured:
            if m["scene"] == scene and m["peer"] != "hemicube":
                as_good = [o["milliseconds"] for o in ours if o["error"] <= m["error"]]
                if not as_good:
                    print(f"{scene}: {m['peer']}, {m['setting']} is more accurate than all settings of hemicube tried here")
                elif min(as_good) > m["milliseconds"]:
                    print(f"{scene}: {m['peer']}, {m['setting']} wins, {min(as_good) / m['milliseconds']:.1f} times as fast")
                else:
                    times = m["milliseconds"] / min(as_good)
                    print(f"{scene}: {m['peer']}, {m['setting']} loses, {times:.1f} times as slow at no less an error")
    for line in without:
        print(f"without {line}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        one(*sys.argv[2:])
    else:
        main()
