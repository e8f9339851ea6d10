#!/usr/bin/env bash
# Makes web pages of docs/: the book, in `book` beside it, or in DIR.
#
#   scripts/book.sh [DIR]
#
# mdbook is taken from PATH, or built once into the target folder, without its server: about two minutes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
target=${CARGO_TARGET_DIR:-target}
mkdir -p "$target"
target=$(cd "$target" && pwd)
version=0.5.4
mdbook=$(command -v mdbook || true)
if [ -z "$mdbook" ]; then
    mdbook=$target/mdbook/bin/mdbook
    case $("$mdbook" --version 2>/dev/null) in
        *"$version") ;;
        *)
            . scripts/ensure.sh
            ensure_linker
            ensure_rust
            # A folder of its own for what it is built from: nothing of the workspace is built anew because of it.
            cargo install mdbook --version "$version" --locked --no-default-features --quiet \
                --root "$target/mdbook" --target-dir "$target/mdbook/build"
            rm -rf "$target/mdbook/build"
            ;;
    esac
fi
# A folder is as seen from `docs` otherwise.
case ${1:-} in
    "") book=$PWD/book ;;
    /*) book=$1 ;;
    *) book=$PWD/$1 ;;
esac
"$mdbook" build docs --dest-dir "$book"
