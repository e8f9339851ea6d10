#!/usr/bin/env bash
# Compares the public API of the library crates with a release: a change that breaks embedders needs a new version.
#
#   scripts/semver.sh REVISION    against a revision of git, such as the newest tag
#   scripts/semver.sh --bring     only brings cargo-semver-checks
#   scripts/semver.sh --proves    only shows that the check sees a function that is gone, on copies of one crate
#
# cargo-semver-checks is taken from PATH, or built once into the target folder: six minutes of a processor.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
libraries=(hemicube-spatial hemicube-scene hemicube-contract hemicube-store hemicube-solve hemicube-weather hemicube hemicube-abi hemicube-export hemicube-backend-cpu)
version=0.51.0
[ $# -eq 1 ] || { printf 'usage: scripts/semver.sh REVISION | --bring | --proves\n' >&2; exit 2; }

target=${CARGO_TARGET_DIR:-target}
mkdir -p "$target"
target=$(cd "$target" && pwd)
if ! cargo semver-checks --version >/dev/null 2>&1; then
    PATH=$target/semver/bin:$PATH
    if ! cargo semver-checks --version >/dev/null 2>&1; then
        . scripts/ensure.sh
        ensure_linker
        ensure_rust
        # Its own release profile is linked as one unit, for many minutes that no check takes.
        CARGO_PROFILE_RELEASE_LTO=off CARGO_PROFILE_RELEASE_CODEGEN_UNITS=16 CARGO_PROFILE_RELEASE_OPT_LEVEL=1 \
            cargo install cargo-semver-checks --version "$version" --locked --quiet \
            --root "$target/semver" --target-dir "$target/semver/build" >&2
        rm -rf "$target/semver/build"
    fi
fi

[ "$1" != --bring ] || exit 0
if [ "$1" != --proves ]; then
    packages=()
    for library in "${libraries[@]}"; do packages+=(-p "$library"); done
    cargo semver-checks "${packages[@]}" --baseline-rev "$1"
    exit
fi

# Copies as they would be published stand outside of the workspace.
copies=$(mktemp -d)
trap 'rm -rf "$copies"' EXIT
cargo package -p hemicube-spatial --no-verify --allow-dirty --locked --quiet --target-dir "$copies/package"
for copy in before after; do
    mkdir "$copies/$copy"
    tar -xzf "$copies"/package/package/hemicube-spatial-*.crate -C "$copies/$copy" --strip-components 1
done
check() {
    cargo semver-checks --manifest-path "$copies/after/Cargo.toml" --baseline-root "$copies/before/Cargo.toml" 2>&1
}
if ! said=$(check); then
    printf '%s\nerror: two copies of hemicube-spatial are said to differ\n' "$said" >&2
    exit 1
fi
gone=order_by_position
sed -i "/^pub use/s/\b$gone\b,\?//" "$copies/after/src/lib.rs"
cmp -s "$copies/before/src/lib.rs" "$copies/after/src/lib.rs" &&
    { printf 'error: hemicube-spatial has no `%s` to take away; name another function in scripts/semver.sh\n' "$gone" >&2; exit 1; }
if said=$(check); then
    printf '%s\nerror: `%s` was taken away from a copy of hemicube-spatial, and the check has passed\n' "$said" "$gone" >&2
    exit 1
fi
case $said in
    *function_missing*"$gone"*) printf 'a function that is gone is seen: %s\n' "$gone" ;;
    *)
        printf '%s\nerror: the check failed, and not for the function that was taken away\n' "$said" >&2
        exit 1
        ;;
esac
