#!/usr/bin/env bash
# Bundles the 3-D view of `hemicube report`: crates/cli/viewer/src and three.js into crates/cli/viewer/viewer.js. That is
# committed, so that building hemicube needs no Node. scripts/viewer.sh [--check | --bring]
#
#   --check   compare with the committed file, and change nothing
#   --bring   only bring three.js and esbuild, which is done once for each package-lock.json
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../crates/cli/viewer"
if ! cmp -s package-lock.json node_modules/brought-for.json; then
    npm ci --ignore-scripts --no-audit --no-fund --loglevel=error >&2
    cp package-lock.json node_modules/brought-for.json
fi
[ "${1:-}" != --bring ] || exit 0
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
node node_modules/esbuild/bin/esbuild src/main.js --bundle --minify --format=esm --target=es2022 --charset=utf8 \
    --legal-comments=none --log-level=warning --outfile="$out/viewer.js"
# The licences go with the bundle, in the repository and in each page.
{
    printf 'three.js %s, https://threejs.org, is part of viewer.js and of each page that `hemicube report` writes.\n\n' \
        "$(node -p 'require("./node_modules/three/package.json").version')"
    cat node_modules/three/LICENSE
} >"$out/THIRD_PARTY.txt"
for file in viewer.js THIRD_PARTY.txt; do
    if [ "${1:-}" != --check ]; then
        cp "$out/$file" "$file"
    elif ! cmp -s "$out/$file" "$file"; then
        printf 'error: crates/cli/viewer/%s is not what its sources make; run scripts/viewer.sh and commit it\n' "$file" >&2
        exit 1
    fi
done
