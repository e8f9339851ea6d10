#!/usr/bin/env bash
# Builds the wheels of the Python package for Linux: one a processor, for every Python from 3.10 on (abi3).
#
#   scripts/wheels.sh FOLDER [PROCESSOR ...]           PROCESSOR: x86_64 or aarch64; both without any
#   scripts/wheels.sh --quick FOLDER [PROCESSOR ...]   with little optimisation, in a fraction of the time: to be tried, not kept
#
# maturin and Zig come from PyPI into the folder of tools (scripts/ensure.sh), Rust's standard library for the other processor from rustup.
# Zig links against glibc 2.17 on any machine (manylinux2014). A processor whose wheel cannot be built has a line
# `SKIP PROCESSOR: the reason`, and the script ends with 3.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
usage() { printf 'usage: scripts/wheels.sh [--quick] FOLDER [x86_64|aarch64 ...]\n' >&2; exit 2; }
if [ "${1:-}" = --quick ]; then
    shift
    export CARGO_PROFILE_RELEASE_OPT_LEVEL=1 CARGO_PROFILE_RELEASE_DEBUG=false
fi
case "${1:-}" in "" | -*) usage ;; esac
folder=$1
shift
[ $# -gt 0 ] || set -- x86_64 aarch64
for processor in "$@"; do
    case $processor in
        x86_64 | aarch64) ;;
        *) printf 'error: no wheel is built for `%s`; x86_64 or aarch64 is needed\n' "$processor" >&2; exit 2 ;;
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
    for processor in "$@"; do skip "$processor" "maturin and ziglang could not be installed from PyPI"; done
    set --
fi
tools=${tools%/bin/python}

for processor in "$@"; do
    triple=$processor-unknown-linux-gnu
    if ! ensure_target "$triple"; then
        skip "$processor" "Rust's standard library for $triple is not there, and rustup cannot bring it"
        continue
    fi
    # The linker comes from the tools' own packages: `--zig` finds `ziglang` beside maturin.
    if ! PATH=$tools/bin:$PATH "$tools/bin/maturin" build --release --locked --zig --target "$triple" \
        --compatibility manylinux2014 --manifest-path crates/python/Cargo.toml --out "$folder" >&2; then
        printf 'error: the wheel for %s could not be built\n' "$processor" >&2
        exit 1
    fi
    wheel=$(ls -t "$folder"/hemicube-*"$processor".whl | head -n1)
    # What is in it is for that processor, and for every Python.
    case $wheel in *-abi3-*manylinux*_"$processor".whl) ;; *)
        printf 'error: `%s` is not named as a wheel for every Python on %s\n' "$wheel" "$processor" >&2
        exit 1 ;;
    esac
    python3 - "$wheel" "$processor" <<'PY'
import struct, sys, zipfile
wheel, processor = sys.argv[1:]
machine = {"x86_64": 62, "aarch64": 183}[processor]
with zipfile.ZipFile(wheel) as archive:
    (name,) = [name for name in archive.namelist() if name.endswith(".so")]
    head = archive.open(name).read(20)
found = struct.unpack("<H", head[18:20])[0]
sys.exit(None if head[:4] == b"\x7fELF" and found == machine else f"error: {name} is for machine {found}, not {machine}")
PY
    printf '%s\n' "$wheel"
done
[ -z "$skipped" ] || exit 3
