"""Radiation solvers with hemicube's form factors and with their own: `clients.py PROGRAM OUT.json`; `scripts/clients`
calls it.

Two cavities of black walls, in which one temperature is free and has a closed form:

    closed     2 × 1 × 1: floor (x to 2, y to 1) 1000 K, wall x = 0 300 K, the other four walls one body without heat:
               T⁴ (F_r1 + F_r2) = F_r1 T1⁴ + F_r2 T2⁴, A_r F_r1 = A_1 (1 − F_12), A_r F_r2 = A_2 − A_1 F_12;
               F_12 of perpendicular rectangles with a common edge (Siegel & Howell 2002, configuration C-14)
    occluded   1 × 1 × 1 with a square from 0 to 1/2 at half height: floor 1000 K, walls and square 300 K, the lid one
               body without heat: T⁴ = F T1⁴ + (1 − F) T3⁴, F = 0.1498686717738 from lid to floor past the square (exact by
               integration)

CalculiX solves for the free temperature. OpenFOAM is given it and tells the net heat q of the body, which is 0 with exact
form factors; its temperature is then the one at which the body would be in balance, T⁴ + q / (σ A_r (F_r1 + F_r2)). Time is
processor time, memory the largest resident set of a process, of all programs on the way from the mesh to the result.
"""

import json
import math
import os
import re
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

from foam_faces import foam_faces, foam_list, write_obj

SIGMA = 5.669e-8
HOT, COLD = 1000.0, 300.0
OCCLUDED = 0.1498686717738
THICKNESS = 2e-5


def perpendicular(width, depth, height):
    """F from a rectangle depth × width to one height × width that stands on its edge of this width."""
    h, w = height / width, depth / width
    square = h * h + w * w
    product = (
        ((1 + w * w) * (1 + h * h) / (1 + square))
        * (w * w * (1 + square) / ((1 + w * w) * square)) ** (w * w)
        * (h * h * (1 + square) / ((1 + h * h) * square)) ** (h * h)
    )
    root = math.sqrt(square)
    angles = w * math.atan(1 / w) + h * math.atan(1 / h) - root * math.atan(1 / root)
    return (angles + 0.25 * math.log(product)) / (math.pi * w)


def run(command, folder, measures, name):
    """Runs a program; adds its processor seconds and peak memory to `measures`."""
    with open(Path(folder) / f"log.{name}", "wb") as log:
        # OpenFOAM holds PWD against the working directory.
        environment = {**os.environ, "PWD": str(folder)}
        child = subprocess.Popen(command, cwd=folder, stdout=log, stderr=subprocess.STDOUT, env=environment)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode != 0:
        log = (Path(folder) / f"log.{name}").read_text(errors="replace")
        sys.exit(f"error: {command[0]} ended with {child.returncode}:\n{log[-3000:]}")
    measures["seconds"] = measures.get("seconds", 0.0) + usage.ru_utime + usage.ru_stime
    measures["megabytes"] = max(measures.get("megabytes", 0.0), usage.ru_maxrss / 1024)


def factors(program, folder, export, measures, tolerance="0.1%"):
    """hemicube's way from `faces.obj` to a solver's file."""
    for command in (
        ["compute", "faces.obj", "-o", "F", "--tolerance", tolerance],
        ["balance", "F", "-o", "B", "--closure"],
        ["export", "B", *export],
    ):
        run([program, *command, "--overwrite"], folder, measures, command[0])


def walls(size, cells):
    """Quads of a box seen from inside, and the name of each wall: corners as tuples."""
    found = []
    for axis in range(3):
        across, along = (axis + 1) % 3, (axis + 2) % 3
        for side, name in ((0.0, "xyz"[axis] + "0"), (size[axis], "xyz"[axis] + "1")):
            for i in range(cells[across]):
                for j in range(cells[along]):
                    quad = []
                    for a, b in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)):
                        corner = [0.0] * 3
                        corner[axis] = side
                        corner[across] = size[across] * a / cells[across]
                        corner[along] = size[along] * b / cells[along]
                        quad.append(tuple(corner))
                    # across × along is +axis, which is inwards on the first side.
                    found.append((name, quad if side == 0.0 else quad[::-1], axis, 1 if side == 0.0 else -1))
    return found


def calculix_case(case, cells):
    """Faces of a cavity with inward normals, and which body each is of: `hot`, `cold`, `free`."""
    if case == "closed":
        bodies = {"z0": "hot", "x0": "cold"}
        return [(bodies.get(name, "free"), *rest) for name, *rest in walls((2.0, 1.0, 1.0), (2 * cells, cells, cells))]
    bodies = {"z0": "hot", "z1": "free"}
    found = [(bodies.get(name, "cold"), *rest) for name, *rest in walls((1.0, 1.0, 1.0), (cells, cells, cells))]
    half, step = cells // 2, 1.0 / cells
    for z, normal in ((0.5 - THICKNESS / 2, -1), (0.5 + THICKNESS / 2, 1)):
        for i in range(half):
            for j in range(half):
                quad = [(a * step, b * step, z) for a, b in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))]
                found.append(("cold", quad if normal > 0 else quad[::-1], 2, normal))
    return found


def calculix_deck(path, faces, view_factors):
    """A deck with an element behind each face, whose face 1 radiates; nodes of the free body have one temperature."""
    nodes, lines, elements = {}, [], []
    bodies = {"hot": [], "cold": [], "free": []}

    def node(body, *point):
        key = (body, *(round(x, 9) for x in point))
        if key not in nodes:
            nodes[key] = len(nodes) + 1
            bodies[body].append(nodes[key])
        return nodes[key]

    for body, quad, axis, normal in faces:
        # Half of the square's thickness, or a wall outside of the cavity.
        depth = THICKNESS / 4 if axis == 2 and abs(quad[0][2] - 0.5) < 0.01 else 0.05
        inner = quad[::-1]
        outer = [tuple(x - (normal * depth if k == axis else 0.0) for k, x in enumerate(p)) for p in inner]
        elements.append([node(body, *p) for p in inner] + [node(body, *p) for p in outer])
    lines.append("*NODE, NSET=ALL")
    lines += [f"{number},{key[1]:.9f},{key[2]:.9f},{key[3]:.9f}" for key, number in nodes.items()]
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=WALLS")
    lines += [f"{number}," + ",".join(map(str, corners)) for number, corners in enumerate(elements, 1)]
    for body, members in bodies.items():
        lines.append(f"*NSET, NSET={body.upper()}")
        lines += [f"{number}," for number in members]
    master, *others = bodies["free"]
    for other in others:
        lines += ["*EQUATION", "2", f"{other},11,1.,{master},11,-1."]
    lines += ["*MATERIAL, NAME=M", "*CONDUCTIVITY", "50.", "*SOLID SECTION, ELSET=WALLS, MATERIAL=M"]
    lines += [f"*PHYSICAL CONSTANTS, ABSOLUTE ZERO=0., STEFAN BOLTZMANN={SIGMA}"]
    # The first iteration's radiation is of these: with one temperature everywhere it would be none, and converged.
    lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", f"HOT,{HOT}", f"COLD,{COLD}", "FREE,600."]
    # What the body sends to itself is not in the tangent: iterations gain a third each, and more are allowed.
    lines += ["*STEP, INC=100", "*HEAT TRANSFER, STEADY STATE", "1.,1."]
    lines += ["*CONTROLS, PARAMETERS=TIME INCREMENTATION", "300,300,300,600,300,4,,300,,"]
    lines += ["*BOUNDARY", f"HOT,11,11,{HOT}", f"COLD,11,11,{COLD}"]
    # A negative temperature of the surroundings: an enclosure.
    lines += ["*RADIATE", "WALLS,R1CR,-1.,1.", view_factors, f"*NODE PRINT, NSET=FREE", "NT", "*END STEP"]
    Path(path).write_text("\n".join(lines) + "\n")


def calculix_temperature(path):
    """The last temperature of the free body's nodes, which is one."""
    return float(re.findall(r"^\s*\d+\s+([-+.\dE]+)\s*$", Path(path).read_text(), re.M)[-1])


def exact(case):
    if case == "occluded":
        return (OCCLUDED * HOT**4 + (1 - OCCLUDED) * COLD**4) ** 0.25
    # Floor 2 × 1, wall 1 × 1 on its edge of length 1.
    hot_area, cold_area = 2.0, 1.0
    exchanged = hot_area * perpendicular(1.0, 2.0, 1.0)
    from_hot, from_cold = hot_area - exchanged, cold_area - exchanged
    return ((from_hot * HOT**4 + from_cold * COLD**4) / (from_hot + from_cold)) ** 0.25


def calculix(program, case, cells, folder):
    faces = calculix_case(case, cells)
    ours, own = {}, {}
    corners = [p for _, quad, _, _ in faces for p in quad]
    write_obj(folder / "faces.obj", corners, [(body, range(4 * k, 4 * k + 4)) for k, (body, *_) in enumerate(faces)])
    factors(program, folder, ["--for", "calculix", "-o", "ours.vwf"], ours)
    calculix_deck(folder / "ours.inp", faces, "*VIEWFACTOR, READ, INPUT=ours.vwf")
    calculix_deck(folder / "own.inp", faces, "*VIEWFACTOR, WRITE")
    one = {"OMP_NUM_THREADS": "1", "CCX_NPROC_VIEWFACTOR": "1"}
    for name, measures in (("ours", ours), ("own", own)):
        run(["ccx", name], folder, measures, name, **one)
        measures["temperature"] = calculix_temperature(folder / f"{name}.dat")
        measures["error_kelvin"] = measures["temperature"] - exact(case)
        measures["by_factors"] = balance(folder / f"{name}.vwf", faces)
    return {"solver": "CalculiX", "case": case, "faces": len(faces), "exact": exact(case), "ours": ours, "own": own}


def vwf(path):
    """Diagonal, entries below and above it, and shares outside."""
    data, at, records = Path(path).read_bytes(), 0, []
    while at < len(data):
        (length,) = struct.unpack_from("<i", data, at)
        records.append(data[at + 4 : at + 4 + length])
        at += length + 8
    return [struct.unpack(f"<{len(record) // 8}d", record) for record in records[1:]]


def matrix(path):
    """The rows of a CalculiX file."""
    diagonal, others, _ = vwf(path)
    count = len(diagonal)
    half, place = count * (count - 1) // 2, 0
    rows = [[0.0] * count for _ in range(count)]
    for column in range(count):
        rows[column][column] = diagonal[column]
        for row in range(column + 1, count):
            rows[row][column], rows[column][row] = others[place], others[half + place]
            place += 1
    return rows


def area(quad):
    """Of a rectangle."""
    return math.dist(quad[0], quad[1]) * math.dist(quad[1], quad[2])


def balance(path, faces):
    """The free body's temperature by the form factors of a file: what it sends beyond itself is what arrives."""
    sent = arrives = 0.0
    for row, (body, quad, *_) in zip(matrix(path), faces):
        if body != "free":
            continue
        to = {"hot": 0.0, "cold": 0.0, "free": 0.0}
        for factor, (other, *_) in zip(row, faces):
            to[other] += factor
        sent += area(quad) * (1.0 - to["free"])
        arrives += area(quad) * (to["hot"] * HOT**4 + to["cold"] * COLD**4)
    return (arrives / sent) ** 0.25



FOAM = "FoamFile {{ version 2.0; format ascii; class {}; object {}; }}\n"
SCHEMES = (
    "ddtSchemes { default steadyState; } gradSchemes { default Gauss linear; } divSchemes { default Gauss linear; }\n"
    "laplacianSchemes { default Gauss linear corrected; } interpolationSchemes { default linear; }\n"
    "snGradSchemes { default corrected; }\n"
)
SOLUTION = (
    "solvers { p_rgh { solver PCG; preconditioner DIC; tolerance 1e-8; relTol 0.1; }\n"
    "\".*\" { solver PBiCGStab; preconditioner DILU; tolerance 1e-8; relTol 0.1; } }\n"
    "SIMPLE { nNonOrthogonalCorrectors 0; pRefCell 0; pRefValue 1e5; }\n"
    "relaxationFactors { fields { \".*\" 0.3; } equations { \".*\" 0.3; } }\n"
)
THERMO = (
    "thermoType { type heRhoThermo; mixture pureMixture; transport const; thermo hConst; equationOfState perfectGas;\n"
    "specie specie; energy sensibleEnthalpy; }\n"
    "mixture { specie { molWeight 28.9; } thermodynamics { Cp 1000; Hf 0; } transport { mu 1.8e-5; Pr 0.7; } }\n"
)
RADIATION = (
    "radiation on; radiationModel viewFactor; solverFreq 1; absorptionEmissionModel none; scatterModel none;\n"
    "sootModel none; transmissivityModel none;\n"
    "viewFactorCoeffs {{ smoothing {}; constantEmissivity true; nBands 1; useDirectSolver true; }}\n"
)
OPAQUE = (
    "\".*\" { type opaqueDiffusive; wallAbsorptionEmissionModel "
    "{ type multiBandAbsorption; absorptivity (1); emissivity (1); } }\n"
)
# The patches of a block's sides, by the side's name, as `walls` has them.
SIDES = dict(zip(("x0", "x1", "y0", "y1"), ("(0 4 7 3)", "(1 2 6 5)", "(0 1 5 4)", "(3 7 6 2)")))
SIDES |= {"z0": "(0 3 2 1)", "z1": "(4 5 6 7)"}


def foam_file(folder, name, body, kind="dictionary"):
    path = Path(folder) / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(FOAM.format(kind, path.name) + body)


def foam_field(folder, name, kind, dimensions, value, patches, every):
    body = f"dimensions [{dimensions}];\ninternalField uniform {value};\nboundaryField {{\n"
    body += "".join(f"{patch} {{ {text} }}\n" for patch, text in patches.items()) + f"\".*\" {{ {every} }}\n}}\n"
    foam_file(folder, f"0/{name}", body, kind)


def foam_case(folder, case, cells, free):
    """A case of the cavity, whose free body has the temperature `free`: its mesh, fields and dictionaries."""
    x = 2 if case == "closed" else 1
    bodies = {"z0": "hot", "x0": "cold"} if case == "closed" else {"z0": "hot", "z1": "free"}
    other = "free" if case == "closed" else "cold"
    patches = {}
    for side, corners in SIDES.items():
        patches.setdefault(bodies.get(side, other), []).append(corners)
    blocks = f"convertToMeters 1;\nvertices ((0 0 0)({x} 0 0)({x} 1 0)(0 1 0)(0 0 1)({x} 0 1)({x} 1 1)(0 1 1));\n"
    blocks += f"blocks (hex (0 1 2 3 4 5 6 7) ({x * cells} {cells} {cells}) simpleGrading (1 1 1));\n"
    blocks += "edges ();\nboundary (\n"
    group = "type wall; inGroups (viewFactorWall);"
    blocks += "".join(f"{name} {{ {group} faces ({''.join(faces)}); }}\n" for name, faces in patches.items()) + ");\n"
    foam_file(folder, "system/blockMeshDict", blocks)
    control = "application buoyantSimpleFoam; startFrom startTime; startTime 0; stopAt endTime; endTime 1; deltaT 1;\n"
    control += "writeControl timeStep; writeInterval 1; writeFormat ascii; writePrecision 12; timeFormat general;\n"
    foam_file(folder, "system/controlDict", control)
    foam_file(folder, "system/fvSchemes", SCHEMES)
    foam_file(folder, "system/fvSolution", SOLUTION)
    if case == "occluded":
        # Faces of the square at half height become two patches.
        zone = "box (-1 -1 {:.9f}) (0.5 0.5 {:.9f}); ".format(0.5 - 0.01, 0.5 + 0.01)
        foam_file(
            folder,
            "system/topoSetDict",
            "actions (\n{ name square; type faceSet; action new; source boxToFace; " + zone + "}\n"
            "{ name square; type faceZoneSet; action new; source setToFaceZone; faceSet square; }\n);\n",
        )
        foam_file(
            folder,
            "system/createBafflesDict",
            "internalFacesOnly true;\nbaffles { square { type faceZone; zoneName square; patches {\n"
            f"master {{ name above; {group} }}\nslave {{ name below; {group} }} }} }} }}\n",
        )
    foam_file(folder, "constant/viewFactorsDict", "writeViewFactorMatrix true; writeFacesAgglomeration false; "
              "writePatchViewFactors false; writeViewFactors false; dumpRays false; maxDynListLength 20000000;\n")
    foam_file(folder, "constant/boundaryRadiationProperties", OPAQUE)
    foam_file(folder, "constant/thermophysicalProperties", THERMO)
    foam_file(folder, "constant/turbulenceProperties", "simulationType laminar;\n")
    foam_file(folder, "constant/g", "dimensions [0 1 -2 0 0 0 0];\nvalue (0 0 0);\n", "uniformDimensionedVectorField")
    temperatures = {"hot": HOT, "free": free}
    fixed = {name: f"type fixedValue; value uniform {t:.12g};" for name, t in temperatures.items()}
    foam_field(folder, "T", "volScalarField", "0 0 0 1 0 0 0", free, fixed, f"type fixedValue; value uniform {COLD};")
    foam_field(folder, "qr", "volScalarField", "1 0 -3 0 0 0 0", 0, {},
               "type greyDiffusiveRadiationViewFactor; qro uniform 0; value uniform 0;")
    foam_field(folder, "U", "volVectorField", "0 1 -1 0 0 0 0", "(0 0 0)", {}, "type noSlip;")
    foam_field(folder, "p", "volScalarField", "1 -1 -2 0 0 0 0", 1e5, {}, "type calculated; value uniform 1e5;")
    foam_field(folder, "p_rgh", "volScalarField", "1 -1 -2 0 0 0 0", 1e5, {},
               "type fixedFluxPressure; value uniform 1e5;")


def foam_heat(folder, patches, cells):
    """Net heat of the free body in W: positive if it takes more than it sends."""
    text = (Path(folder) / "1/qr").read_text()
    entry = re.search(r"free\s*\{(.*?)\n    \}", text, re.S).group(1)
    value = re.search(r"value\s+nonuniform List<scalar>\s*(.*)", entry, re.S).group(1)
    return sum(map(float, foam_list(value).split())) / cells**2


def openfoam(program, case, cells, folder):
    wanted = exact(case)
    foam_case(folder, case, cells, wanted)
    mesh = {}
    run(["blockMesh"], folder, mesh, "blockMesh")
    if case == "occluded":
        run(["topoSet"], folder, mesh, "topoSet")
        run(["createBaffles", "-overwrite"], folder, mesh, "createBaffles")
        # It has given the fields values for the new patches.
        foam_case(folder, case, cells, wanted)
    patches, count = foam_faces(folder, folder / "faces.obj")
    found = {}
    for name in ("own", "ours"):
        measures = found[name] = {}
        # Its own factors need smoothing to sum to 1; ours are to be used as they are.
        foam_file(folder, "constant/radiationProperties", RADIATION.format("true" if name == "own" else "false"))
        if name == "own":
            run(["viewFactorsGen"], folder, measures, "viewFactorsGen")
        else:
            factors(program, folder, ["--for", "openfoam", "-o", "constant"], measures)
        run(["buoyantSimpleFoam"], folder, measures, f"solver-{name}")
        heat = foam_heat(folder, patches, cells)
        # What the body exchanges with the two others, per T⁴: A_r (F_r1 + F_r2).
        exchange = 3.0 - 2 * 2.0 * perpendicular(1.0, 2.0, 1.0) if case == "closed" else 1.0
        measures["heat_watts"] = heat
        measures["temperature"] = (wanted**4 + heat / SIGMA / exchange) ** 0.25
        measures["error_kelvin"] = measures["temperature"] - wanted
    return {"solver": "OpenFOAM", "case": case, "faces": count, "exact": wanted, **found}


def faults(result):
    """What does not hold of a result."""
    ours, own = result["ours"], result["own"]
    found = []
    if abs(ours["error_kelvin"]) >= abs(own["error_kelvin"]):
        found.append("our temperature is not nearer to the closed form")
    for name in ("ours", "own"):
        # CalculiX prints seven digits.
        if "by_factors" in result[name] and abs(result[name]["by_factors"] - result[name]["temperature"]) > 2e-3:
            found.append(f"the temperature by {name} is not what the form factors say")
    return [f"{result['solver']}, {result['case']}: {fault}" for fault in found]


def table(results):
    """Lines of Markdown."""
    yield "| solver, cavity | faces | closed form K | ours K | its own K | ours s, MB | its own s, MB |"
    yield "|---|---|---|---|---|---|---|"
    for result in results:
        ours, own = result["ours"], result["own"]
        cost = lambda of: f"{of['seconds']:.1f}, {of['megabytes']:.0f}"
        yield (
            f"| {result['solver']}, {result['case']} | {result['faces']} | {result['exact']:.4f} "
            f"| {ours['error_kelvin']:+.4f} | {own['error_kelvin']:+.4f} | {cost(ours)} | {cost(own)} |"
        )


def main():
    # Debian's OpenFOAM finds its defaults by this.
    os.environ.setdefault("WM_PROJECT_DIR", "/usr/share/openfoam")
    program, out = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
    results = []
    with tempfile.TemporaryDirectory() as place:
        for case in ("closed", "occluded"):
            for solver, cells in ((calculix, 8), (openfoam, 12)):
                folder = Path(place) / f"{solver.__name__}-{case}"
                folder.mkdir()
                results.append(solver(str(program), case, cells, folder))
    out.write_text(json.dumps(results, indent=1) + "\n")
    print("\n".join(table(results)))
    wrong = [fault for result in results for fault in faults(result)]
    if wrong:
        sys.exit("error: " + "; ".join(wrong))


if __name__ == "__main__":
    main()
