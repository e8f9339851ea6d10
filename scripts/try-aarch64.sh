#!/usr/bin/env bash
# Imports a wheel for aarch64 and computes a matrix with it, under QEMU: `scripts/try-aarch64.sh WHEEL FOLDER`.
#
# QEMU (a static program), Python and its libraries are Debian's packages, unpacked into FOLDER: nothing is installed, and apt's
# own lists are left alone. NumPy comes from PyPI. Where they cannot be had, a line `SKIP: the reason` and status 3.
set -euo pipefail
[ $# -eq 2 ] || { printf 'usage: scripts/try-aarch64.sh WHEEL FOLDER\n' >&2; exit 2; }
wheel=$(realpath "$1")
export PIP_ROOT_USER_ACTION=ignore
mkdir -p "$2"
folder=$(realpath "$2")
skip() { printf 'SKIP: %s\n' "$1"; exit 3; }

for tool in apt-get dpkg-deb python3; do command -v "$tool" >/dev/null 2>&1 || skip "$tool is not here"; done
python3 -m pip --version >/dev/null 2>&1 || skip "pip is not here"

# bring PROCESSOR PACKAGE ... - downloads packages of a processor, by lists of their own.
bring() {
    local processor=$1 state=$folder/apt-$1
    shift
    mkdir -p "$state/lists/partial" "$state/cache/archives/partial"
    : >"$state/status"
    local apt=(apt-get -qq -o APT::Architecture="$processor" -o APT::Architectures="$processor" -o Dir::State="$state"
        -o Dir::Cache="$state/cache" -o Dir::State::status="$state/status" -o Acquire::Languages=none -o APT::Sandbox::User=root)
    (cd "$folder" && "${apt[@]}" update && "${apt[@]}" download "$@") >"$folder/apt.log" 2>&1
}

qemu=$folder/qemu/usr/bin/qemu-aarch64-static
root=$folder/root
if ! [ -x "$qemu" ]; then
    bring "$(dpkg --print-architecture)" qemu-user-static || skip "Debian's qemu-user-static could not be fetched"
    mkdir -p "$folder/qemu"
    # One program of fifty.
    dpkg-deb --fsys-tarfile "$folder"/qemu-user-static_*.deb | tar -x -C "$folder/qemu" ./usr/bin/qemu-aarch64-static
fi
if ! compgen -G "$root/usr/bin/python3.[0-9]*" >/dev/null; then
    # The version is the one of this Debian.
    version=$(apt-cache depends python3-minimal 2>/dev/null | sed -n 's/.*Depends: python\(3\.[0-9]*\)-minimal$/\1/p' | head -n1)
    [ -n "$version" ] || skip "apt knows no Python"
    bring arm64 libc6 libgcc-s1 libstdc++6 zlib1g libexpat1 libffi8 libssl3 libbz2-1.0 liblzma5 \
        "python$version-minimal" "libpython$version-minimal" "libpython$version-stdlib" ||
        skip "Debian's Python for arm64 could not be fetched"
    mkdir -p "$root"
    for package in "$folder"/*_arm64.deb; do dpkg-deb -x "$package" "$root"; done
fi
python=$(compgen -G "$root/usr/bin/python3.[0-9]*" | head -n1)
version=${python##*/python}
# Of the library here: a wheel that was tried before is replaced.
rm -rf "$folder/site"
python3 -m pip install -q --disable-pip-version-check --target "$folder/site" --only-binary=:all: --python-version "$version" \
    --platform manylinux_2_28_aarch64 --platform manylinux_2_27_aarch64 --platform manylinux2014_aarch64 'numpy>=1.26,<3' ||
    skip "NumPy for aarch64 could not be fetched"
python3 -m pip install -q --disable-pip-version-check --target "$folder/site" --no-deps --no-index --python-version "$version" \
    --only-binary=:all: --platform manylinux2014_aarch64 "$wheel"

PYTHONHOME=$root/usr PYTHONPATH=$folder/site "$qemu" -L "$root" "$python" - <<'PY'
import platform

import hemicube
import numpy as np

assert platform.machine() == "aarch64", platform.machine()
corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
scene = hemicube.Scene(corners, triangles)
normals = np.cross(corners[triangles[:, 1]] - corners[triangles[:, 0]], corners[triangles[:, 2]] - corners[triangles[:, 0]])
inward = np.einsum("ij,ij->i", normals, 0.5 - corners[triangles[:, 0]]) > 0
if not inward.all():
    scene = hemicube.Scene(corners, np.where(inward[:, None], triangles, triangles[:, ::-1]))
F = hemicube.compute(scene, tolerance=1e-3)
sums = F @ np.ones(12)
assert abs(sums - 1).max() < 2e-3, sums
# Between opposite squares of a cube: 0.199825 (Howell's catalogue, C-11).
opposite = (F @ np.isin(np.arange(12), (2, 3)).astype(float))[:2].mean()
assert abs(opposite - 0.199825) < 1e-4, opposite
print(f"{platform.machine()}: hemicube {hemicube.__version__} computes a cube: {opposite:.6f} between opposite faces")
PY
