#!/usr/bin/env bash
# Builds the wheels of the Python package, with the program in them: one a platform, for Python from 3.10 on (abi3).
#
#   scripts/wheels.sh FOLDER [PLATFORM ...]           all platforms without any
#   scripts/wheels.sh --quick FOLDER [PLATFORM ...]   with little optimisation, in less time: to be tried, not kept
#
#   x86_64, aarch64   Linux with glibc 2.17 or newer (manylinux2014)
#   musl              Linux with musl 1.2 on x86-64 (musllinux_1_2), as Alpine has it
#   windows           Windows on x86-64
#   source            no wheel, but the source distribution, of which pip builds one with Rust
#
# maturin and Zig, which links for Linux, come from PyPI into the folder of tools (scripts/ensure.sh), MinGW from Debian,
# Rust's standard library from rustup. A wheel must not name a folder of this machine: the same sources are to give the
# same bytes, wherever they lie. A platform whose wheel cannot be built has a line `SKIP PLATFORM: the reason`, and the
# script ends with 3.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
usage() { printf 'usage: scripts/wheels.sh [--quick] FOLDER [x86_64|aarch64|musl|windows|source ...]\n' >&2; exit 2; }
if [ "${1:-}" = --quick ]; then
    shift
    export CARGO_PROFILE_RELEASE_OPT_LEVEL=1
fi
case "${1:-}" in "" | -*) usage ;; esac
folder=$1
shift
[ $# -gt 0 ] || set -- x86_64 aarch64 musl windows source
for platform in "$@"; do
    case $platform in
        x86_64 | aarch64 | musl | windows | source) ;;
        *) printf 'error: no wheel is built for `%s`; x86_64, aarch64, musl, windows or source is needed\n' "$platform" >&2; exit 2 ;;
    esac
done

. scripts/ensure.sh
ensure_linker
ensure_rust
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)

skipped=
skip() {
    skipped=1
    printf 'SKIP %s: %s\n' "$1" "$2"
}

python3 -c 'import ensurepip' 2>/dev/null || ensure_packages ensurepip:python3-venv
if ! tools=$(python_environment wheels 'maturin>=1.9,<2' 'ziglang>=0.13'); then
    for platform in "$@"; do skip "$platform" "maturin and ziglang could not be installed from PyPI"; done
    set --
fi
tools=${tools%/bin/python}

# Neither paths in messages of panics, nor times in the archive, which begin with 1980.
export SOURCE_DATE_EPOCH=315532800
CARGO_ENCODED_RUSTFLAGS=$(printf -- '--remap-path-prefix=%s=\x1f--remap-path-prefix=%s=' "${CARGO_HOME:-$HOME/.cargo}/registry/src" "$PWD")
export CARGO_ENCODED_RUSTFLAGS
# No Python of this machine is one of theirs, and none is needed.
export PYO3_NO_PYTHON=1
unset PYO3_PYTHON PYO3_ENVIRONMENT_SIGNATURE

for platform in "$@"; do
    rm -rf "$folder/made"
    case $platform in
        source)
            "$tools/bin/maturin" sdist --manifest-path crates/python/Cargo.toml --out "$folder/made" >&2
            source=$(ls "$folder"/made/*.tar.gz)
            mv "$source" "$folder"
            rmdir "$folder/made"
            printf '%s\n' "$folder/${source##*/}"
            continue
            ;;
        x86_64 | aarch64) triple=$platform-unknown-linux-gnu tag="manylinux*_$platform" options=(--zig --compatibility manylinux2014) ;;
        musl) triple=x86_64-unknown-linux-musl tag='musllinux_1_2_x86_64' options=(--zig --compatibility musllinux_1_2) ;;
        # Symbols of MinGW are of no use to backtraces there.
        windows) triple=x86_64-pc-windows-gnu tag=win_amd64 options=(--strip) ;;
    esac
    if ! ensure_target "$triple"; then
        skip "$platform" "Rust's standard library for $triple is not there, and rustup cannot bring it"
        continue
    fi
    if [ "$platform" = windows ] && ! ensure_packages x86_64-w64-mingw32-gcc:gcc-mingw-w64-x86-64-posix; then
        skip "$platform" "MinGW could not be installed"
        continue
    fi
    # The linker comes from the tools' own packages: `--zig` finds `ziglang` beside maturin.
    if ! PATH=$tools/bin:$PATH "$tools/bin/maturin" build --release --locked --target "$triple" "${options[@]+"${options[@]}"}" \
        --manifest-path crates/python/Cargo.toml --out "$folder/made" >&2; then
        printf 'error: the wheel for %s could not be built\n' "$platform" >&2
        exit 1
    fi
    wheel=$(ls "$folder"/made/*.whl)
    # What is in it is for that processor, and for every Python; it needs no library but the system's.
    case ${wheel##*/} in hemicube-*-abi3-$tag.whl) ;; *)
        printf 'error: `%s` is not named as a wheel for every Python on %s\n' "$wheel" "$platform" >&2
        exit 1 ;;
    esac
    python3 - "$wheel" "$platform" "$PWD" "${CARGO_HOME:-$HOME/.cargo}" <<'PY'
import os, struct, sys, zipfile

wheel, platform, *folders = sys.argv[1:]
with zipfile.ZipFile(wheel) as archive:
    names = archive.namelist()
    (name,) = [name for name in names if name.endswith((".so", ".pyd"))]
    head = archive.open(name).read(4096)
    for file in names:
        content = archive.read(file)
        for folder in folders:
            if folder.encode() + b"/" in content:
                sys.exit(f"error: {file} of {wheel} names `{folder}`, a folder of this machine")
    (entries,) = [archive.read(name).decode() for name in names if name.endswith("entry_points.txt")]
if platform == "windows":
    at = struct.unpack("<I", head[60:64])[0]
    good, found = head[at : at + 4] == b"PE\0\0", struct.unpack("<H", head[at + 4 : at + 6])[0]
else:
    good, found = head[:4] == b"\x7fELF", struct.unpack("<H", head[18:20])[0]
machine = {"x86_64": 62, "aarch64": 183, "musl": 62, "windows": 0x8664}[platform]
if not good or found != machine:
    sys.exit(f"error: {name} of {wheel} is for machine {found}, not {machine}")
if "hemicube=hemicube.__main__:main" not in entries.replace(" ", ""):
    sys.exit(f"error: {wheel} has no command `hemicube`: {entries}")
size = os.path.getsize(wheel)
if size > 15_000_000:
    sys.exit(f"error: {wheel} has {size / 1e6:.1f} MB, and may have 15 MB; look for what was linked in")
PY
    mv "$wheel" "$folder"
    rmdir "$folder/made"
    printf '%s\n' "$folder/${wheel##*/}"
done
[ -z "$skipped" ] || exit 3
