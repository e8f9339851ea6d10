#!/usr/bin/env bash
# Makes web pages of docs/: the book, in `book` beside it, or in DIR.
#
#   scripts/book.sh [DIR]
#   scripts/book.sh --mdbook      only says where mdbook is, which it brings
#
# mdbook is taken from PATH, or built once into the folder of tools (scripts/ensure.sh): without its server and without optimisation, in a minute.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/ensure.sh
tools=$(tools_folder)
version=0.5.4

mdbook=$(command -v mdbook || true)
case $([ -n "$mdbook" ] && "$mdbook" --version) in
    "mdbook v${version%.*}."*) ;;
    *)
        mdbook=$tools/mdbook/bin/mdbook
        if [ "$("$mdbook" --version 2>/dev/null)" != "mdbook v$version" ]; then
            ensure_linker
            ensure_rust
            # A folder of its own for what it is built from: nothing of the workspace is built anew because of it.
            CARGO_PROFILE_DEV_DEBUG=0 cargo install mdbook --version "$version" --locked --no-default-features --debug --quiet \
                --root "$tools/mdbook" --target-dir "$tools/mdbook/build" >&2
            rm -rf "$tools/mdbook/build"
        fi
        ;;
esac
# A folder that is not absolute would be one beneath `docs`.
case ${1:-} in
    --mdbook) printf '%s\n' "$mdbook"; exit ;;
    "") book=$PWD/book ;;
    /*) book=$1 ;;
    *) book=$PWD/$1 ;;
esac
"$mdbook" build docs --dest-dir "$book"
