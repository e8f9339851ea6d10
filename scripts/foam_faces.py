"""The radiating faces of an OpenFOAM case as a scene: `foam_faces.py CASE FACES.obj`.

Faces of all patches, in the order of `constant/polyMesh/boundary`, turned to the fluid; an object a patch. Writes
`constant/finalAgglom` with each face as a cluster of its own, so that rows of `hemicube export --for openfoam` are
these faces. All patches must be in the group `viewFactorWall`. Meshes are read in ASCII.
"""

import re
import sys
from pathlib import Path


def write_obj(path, corners, faces):
    """Faces with their corners counter-clockwise from where they radiate to; `faces` has a name for each."""
    lines = ["v {:.17g} {:.17g} {:.17g}".format(*corner) for corner in corners]
    last = None
    for name, face in faces:
        if name != last:
            lines.append(f"o {name}")
            last = name
        lines.append("f " + " ".join(str(corner + 1) for corner in face))
    Path(path).write_text("\n".join(lines) + "\n")


def foam_list(text):
    """The entries of the first list in a text, by lines or in one."""
    count = re.search(r"(\d+)\s*\(", text)
    depth, start = 0, count.end() - 1
    for at in range(start, len(text)):
        depth += (text[at] == "(") - (text[at] == ")")
        if depth == 0:
            return text[start + 1 : at]
    raise ValueError("a list does not end")


def foam_boundary(folder):
    """Name, first face and number of faces of each patch, in order."""
    text = (Path(folder) / "constant/polyMesh/boundary").read_text()
    found = re.findall(r"(\w+)\s*\{[^}]*?nFaces\s+(\d+);\s*startFace\s+(\d+);", text)
    return [(name, int(first), int(count)) for name, count, first in found]


def foam_faces(folder, obj):
    """Faces of all patches as an OBJ that faces the fluid, their areas, and the identity agglomeration."""
    mesh = Path(folder) / "constant/polyMesh"

    def body(name):
        head, text = (mesh / name).read_text().split("}", 1)
        if "ascii" not in head:
            sys.exit(f"error: {mesh / name} is not ASCII; foamFormatConvert makes it that")
        return text

    points = [tuple(map(float, p.split())) for p in re.findall(r"\(([^()]+)\)", foam_list(body("points")))]
    faces = [tuple(map(int, f.split())) for f in re.findall(r"\d+\(([^()]+)\)", foam_list(body("faces")))]
    patches = foam_boundary(folder)
    radiating = [(name, faces[k][::-1]) for name, first, count in patches for k in range(first, first + count)]
    write_obj(obj, points, radiating)
    lists = "".join(f"{count}(" + " ".join(map(str, range(count))) + ")\n" for _, _, count in patches)
    head = "FoamFile { version 2.0; format ascii; class labelListList; object finalAgglom; }\n"
    (Path(folder) / "constant/finalAgglom").write_text(f"{head}{len(patches)}\n(\n{lists})\n")
    return patches, len(radiating)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: foam_faces.py CASE FACES.obj")
    found, count = foam_faces(sys.argv[1], sys.argv[2])
    print(f"{count} faces of {len(found)} patches: " + ", ".join(name for name, _, _ in found))
