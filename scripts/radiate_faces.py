"""The radiating faces of a CalculiX deck as a scene: `radiate_faces.py DECK SCENE.inp [CAVITY]`.

Writes the nodes and elements of the deck, and a surface of the faces that its `*RADIATE` names with labels `R1CR` to `R6CR`,
in CalculiX's order: by element, of one element the last named first. So rows of `hemicube export --for calculix` are these
faces. Read: CalculiX 2.20, and what FreeCAD wrote in August 2026 (a line for each face, `*RADIATE, CAVITY=NAME`).

A `.vwf` is of one cavity: of a deck with several, CAVITY names the one.
"""

import re
import sys
from pathlib import Path


class Refused(Exception):
    """The deck has not what is asked for."""


def keyword(line):
    """Name and parameters of a keyword line, in capitals; nothing of a comment or of data."""
    if not line.startswith("*") or line.startswith("**"):
        return None
    name, *parameters = (part.strip() for part in line.upper().split(","))
    return name, dict((*map(str.strip, part.split("=", 1)), "")[:2] for part in parameters)


def members(lines):
    """The elements of each set: by `*ELEMENT, ELSET=` and `*ELSET`, which may name sets and `GENERATE`."""
    sets, name, kind, parameters = {}, None, None, {}
    # The numbers that still belong to an element whose line went on.
    goes_on = False
    for line in lines:
        if found := keyword(line):
            kind, parameters = found
            name = parameters.get("ELSET") if kind in ("*ELEMENT", "*ELSET") else None
            goes_on = False
            continue
        if line.startswith("**") or name is None:
            continue
        words = [word.strip().upper() for word in line.split(",") if word.strip()]
        to = sets.setdefault(name, [])
        if kind == "*ELEMENT":
            if not goes_on and words:
                to.append(int(words[0]))
            goes_on = line.rstrip().endswith(",")
        elif "GENERATE" in parameters:
            first, last, *step = map(int, words)
            to.extend(range(first, last + 1, *step))
        else:
            for word in words:
                to.extend([int(word)] if word.isdigit() else sets.get(word, []))
    return sets


def faces(lines, cavity=None):
    """Element and face of each radiating face of one cavity, in CalculiX's order."""
    sets, of, found = members(lines), None, {}
    for line in lines:
        if word := keyword(line):
            of = word[1].get("CAVITY", "") if word[0] == "*RADIATE" else None
        elif of is not None and not line.startswith("**"):
            words = [word.strip().upper() for word in line.split(",")]
            label = re.fullmatch(r"R([1-6])CR", words[1]) if len(words) > 1 else None
            if label:
                elements = [int(words[0])] if words[0].isdigit() else sets.get(words[0])
                if not elements:
                    raise Refused(f"`*RADIATE` names the set `{words[0]}`, which has no elements")
                found.setdefault(of, []).extend((element, int(label[1])) for element in elements)
    if cavity is not None and cavity.upper() not in found:
        raise Refused(f"no cavity `{cavity}`; the deck has {', '.join(map(repr, found)) or 'none'}")
    if not found:
        raise Refused("no face radiates in a cavity: `*RADIATE` needs lines with labels R1CR to R6CR")
    if cavity is None and len(found) > 1:
        raise Refused(f"a file is of one cavity: name one of {', '.join(found)} as the third argument")
    chosen = found[cavity.upper()] if cavity is not None else next(iter(found.values()))
    # A face that is named again is the same face.
    return sorted(reversed(list(dict.fromkeys(chosen))), key=lambda face: face[0])


def main(deck, scene, cavity=None):
    lines = Path(deck).read_text(encoding="utf-8", errors="replace").splitlines()
    radiating = faces(lines, cavity)
    begin = next((at for at, line in enumerate(lines) if (word := keyword(line)) and word[0] == "*STEP"), len(lines))
    made = [*lines[:begin], "*SURFACE, NAME=CAVITY", *(f"{element}, S{face}" for element, face in radiating)]
    Path(scene).write_text("\n".join(made) + "\n", encoding="utf-8")
    print(f"{len(radiating)} faces of {len({element for element, _ in radiating})} elements")


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit("usage: radiate_faces.py DECK SCENE.inp [CAVITY]")
    try:
        main(*sys.argv[1:])
    except (OSError, Refused, ValueError) as error:
        sys.exit(f"error: `{sys.argv[1]}`: {error}")
