#!/usr/bin/env python3
"""Prints which packages are in what is given away, as CycloneDX 1.5 in JSON: name, version, licence, address of each.

  python3 scripts/sbom.py > hemicube-VERSION.cdx.json           Python 3.11 or newer

In it are the program, the backends for graphics cards and the Python package on every platform, what they depend on by
Cargo.lock, macros too, and the packages bundled into the viewer's page. Left out are tests and tools of the build. The same
Cargo.lock gives the same bytes: there is no time and no number of its own in it.

No cargo-cyclonedx, because it takes minutes to build and writes a file for each crate, without the viewer's packages.
"""

import json
import pathlib
import subprocess
import tomllib

REPOSITORY = pathlib.Path(__file__).resolve().parents[1]
GIVEN = ("hemicube-cli", "hemicube-backend-gl", "hemicube-backend-vulkan", "hemicube-backend-wgpu", "hemicube-python")


def component(kind, name, version, licence, checksum=None, algorithm="SHA-256"):
    """A package as CycloneDX has it; its address is its reference."""
    address = f"pkg:{kind}/{name}@{version}"
    made = {"type": "library", "bom-ref": address, "name": name, "version": version, "purl": address}
    if licence:
        # Older packages write `/` for OR.
        made["licenses"] = [{"expression": licence.replace(" / ", "/").replace("/", " OR ")}]
    if checksum:
        made["hashes"] = [{"alg": algorithm, "content": checksum}]
    return made


def crates():
    """Components and edges of what is reached from the crates that are given away."""
    words = ["cargo", "metadata", "--format-version", "1", "--locked"]
    told = json.loads(subprocess.run(words, check=True, stdout=subprocess.PIPE, cwd=REPOSITORY).stdout)
    packages = {package["id"]: package for package in told["packages"]}
    nodes = {node["id"]: node for node in told["resolve"]["nodes"]}
    lock = tomllib.loads((REPOSITORY / "Cargo.lock").read_text())
    sums = {(package["name"], package["version"]): package.get("checksum") for package in lock["package"]}

    def uses(node):
        # `kind` is null for what is part of it, `build` and `dev` for the rest.
        return [dep["pkg"] for dep in node["deps"] if any(kind["kind"] is None for kind in dep["dep_kinds"])]

    todo = [found for found, package in packages.items() if package["name"] in GIVEN and package["source"] is None]
    if len(todo) != len(GIVEN):
        raise SystemExit(f"error: the workspace lacks one of {', '.join(GIVEN)}; name in scripts/sbom.py what it has now")
    given, reached = list(todo), set(todo)
    while todo:
        for found in uses(nodes[todo.pop()]):
            if found not in reached:
                reached.add(found)
                todo.append(found)
    made = {}
    for found in reached:
        package = packages[found]
        name, version = package["name"], package["version"]
        made[found] = component("cargo", name, version, package["license"], sums.get((name, version)))
    edges = {made[found]["bom-ref"]: sorted(made[use]["bom-ref"] for use in uses(nodes[found])) for found in reached}
    return list(made.values()), edges, [made[found]["bom-ref"] for found in given]


def bundled():
    """The packages of npm in the page that `hemicube report` writes: those that esbuild, a tool, bundles."""
    viewer = REPOSITORY / "crates/cli/viewer"
    wanted = json.loads((viewer / "package.json").read_text())
    locked = json.loads((viewer / "package-lock.json").read_text())["packages"]
    for name in {**wanted.get("dependencies", {}), **wanted.get("devDependencies", {})}:
        if name != "esbuild":
            package = locked[f"node_modules/{name}"]
            yield component("npm", name, package["version"], package.get("license"))


def main():
    components, edges, given = crates()
    viewer = list(bundled())
    program = next(reference for reference in given if "/hemicube-cli@" in reference)
    edges[program] = sorted([*edges[program], *(package["bom-ref"] for package in viewer)])
    components += viewer
    components.sort(key=lambda package: package["bom-ref"])
    (version,) = {package["version"] for package in components if package["name"] == "hemicube-cli"}
    whole = {
        **component("generic", "hemicube", version, "MIT OR Apache-2.0"),
        "type": "application",
    }
    edges[whole["bom-ref"]] = sorted(given)
    bom = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": whole},
        "components": components,
        "dependencies": [{"ref": reference, "dependsOn": edges[reference]} for reference in sorted(edges)],
    }
    print(json.dumps(bom, indent=1))


if __name__ == "__main__":
    main()
