# Installs what a bare machine lacks. Sourced by ./run and ./test.

say() { printf '%s\n' "$*" >&2; }

# ensure_packages COMMAND:PACKAGE ... — Debian packages for commands that are not there.
ensure_packages() {
    local missing=() pair
    for pair in "$@"; do
        # A program, not a builtin of this shell: tests call them without one.
        type -P "${pair%%:*}" >/dev/null || missing+=("${pair#*:}")
    done
    [ ${#missing[@]} -eq 0 ] && return 0
    if ! command -v apt-get >/dev/null 2>&1; then
        say "error: missing: ${missing[*]}; this script can only install them with apt-get"
        say "hint: install them with this system's own tools and run it again"
        return 1
    fi
    local sudo=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null 2>&1 || { say "error: missing: ${missing[*]}; run as root, or install them"; return 1; }
        sudo=(sudo)
    fi
    say "installing ${missing[*]}"
    local log
    log=$(mktemp)
    if ! { "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq &&
        "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends "${missing[@]}"; } \
        >"$log" 2>&1; then
        cat "$log" >&2
        rm -f "$log"
        say "error: ${missing[*]} could not be installed"
        return 1
    fi
    rm -f "$log"
}

# tools_folder — names the folder of environments that are made once and kept, whatever clone asks: Python's, Node's modules,
# mdbook, what builds wheels. HEMICUBE_TOOLS names another one; it may be removed at any time between runs.
tools_folder() {
    local folder=${HEMICUBE_TOOLS:-${XDG_CACHE_HOME:-$HOME/.cache}/hemicube-tools}
    mkdir -p "$folder" && (cd "$folder" && pwd)
}

# python_environment NAME PIP_ARGUMENT ... — prints the Python of an environment that has these packages. One is made for each
# list of arguments, and each content of what `-r` names. With `--made` first, it fails where none was made.
python_environment() {
    local made= name folder key argument
    [ "$1" != --made ] || { made=1; shift; }
    name=$1
    shift
    command -v python3 >/dev/null || return 1
    key=$({ python3 -c 'import sys; print(sys.version, sys.executable)'
        for argument in "$@"; do if [ -f "$argument" ]; then cat "$argument"; else printf '%s\n' "$argument"; fi; done; } |
        sha256sum | cut -c1-12)
    folder=$(tools_folder)/$name-$key || return 1
    if ! [ -f "$folder/complete" ]; then
        [ -z "$made" ] || return 1
        rm -rf "$folder"
        python3 -m venv "$folder" >&2 && "$folder/bin/python" -m pip install -q --disable-pip-version-check "$@" >&2 || return 1
        touch "$folder/complete"
    fi
    printf '%s\n' "$folder/bin/python"
}

# ensure_linker — Rust links with the C compiler, which needs the C library's start-up files beside it.
ensure_linker() {
    if ! echo 'int main(void) { return 0; }' | cc -x c -o /dev/null - 2>/dev/null; then
        ensure_packages no-linker:gcc no-linker:libc6-dev
    fi
}

# ensure_rust — a Rust toolchain that is new enough, by rustup where there is none.
ensure_rust() {
    [ -f "${CARGO_HOME:-$HOME/.cargo}/env" ] && . "${CARGO_HOME:-$HOME/.cargo}/env"
    local wanted have
    wanted=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
    if ! command -v cargo >/dev/null 2>&1; then
        ensure_packages curl:curl
        [ -d /etc/ssl/certs ] && [ -n "$(ls /etc/ssl/certs 2>/dev/null)" ] || ensure_packages update-ca-certificates:ca-certificates
        say "installing Rust with rustup"
        curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh -s -- -y --profile minimal -c rustfmt -c clippy >&2
        . "${CARGO_HOME:-$HOME/.cargo}/env"
    fi
    have=$(rustc --version | cut -d' ' -f2)
    if [ "$(printf '%s\n%s\n' "$wanted" "$have" | sort -V | head -n1)" != "$wanted" ]; then
        say "error: Rust $have is older than the $wanted that hemicube needs"
        say "hint: run 'rustup update stable'"
        return 1
    fi
}

# ensure_target TRIPLE — Rust's standard library for another system, by rustup where it is not there.
ensure_target() {
    [ -d "$(rustc --print sysroot)/lib/rustlib/$1/lib" ] && return
    if ! { command -v rustup >/dev/null 2>&1 && rustup target add "$1" >&2; }; then
        say "error: Rust's standard library for $1 is not there, and rustup cannot bring it"
        return 1
    fi
}

# ensure_drivers — Mesa's drivers for OpenGL and Vulkan on the processor, and Vulkan's validation layer, for tests of the
# GPU backends without a GPU. Fails if they cannot be installed.
ensure_drivers() {
    local missing=() libraries
    libraries=$(/sbin/ldconfig -p 2>/dev/null || true)
    case $libraries in *libEGL.so.1*) ;; *) missing+=(none:libegl1) ;; esac
    case $libraries in *libvulkan.so.1*) ;; *) missing+=(none:libvulkan1) ;; esac
    compgen -G '/usr/share/vulkan/icd.d/lvp_icd*.json' >/dev/null || missing+=(none:mesa-vulkan-drivers)
    compgen -G '/usr/lib/*/dri/swrast_dri.so' >/dev/null || missing+=(none:libgl1-mesa-dri)
    compgen -G '/usr/share/vulkan/explicit_layer.d/VkLayer_khronos_validation.json' >/dev/null ||
        missing+=(none:vulkan-validationlayers)
    [ ${#missing[@]} -eq 0 ] || ensure_packages "${missing[@]}"
}

# ensure_browser — Chromium and its driver, for the pages that `hemicube report` writes.
ensure_browser() { ensure_packages chromium:chromium chromedriver:chromium-driver; }

# ensure_node — Node with npm, to bundle the viewer again and compare, and for the validator of glTF.
ensure_node() { ensure_packages node:nodejs npm:npm; }

# ensure_display — an X server without a screen, a program for pictures of it, and the library that opens windows.
ensure_display() {
    ensure_packages Xvfb:xvfb xwd:x11-apps
    case $(/sbin/ldconfig -p 2>/dev/null) in *libX11.so.6*) ;; *) ensure_packages none:libx11-6 ;; esac
    # minifb asks for these by name, too, and goes on only where it finds them.
    case $(/sbin/ldconfig -p 2>/dev/null) in *libXcursor.so.1*) ;; *) ensure_packages none:libxcursor1 ;; esac
}

# ensure_solvers — CalculiX, OpenFOAM and PETSc's Python, which read the files that `export --for` writes.
ensure_solvers() {
    local missing=(ccx:calculix-ccx viewFactorsGen:openfoam)
    compgen -G '/usr/lib/petscdir/*/*/lib/python3/dist-packages/petsc4py' >/dev/null && [ -e /usr/lib/python3/dist-packages/petsc4py.pth ] ||
        missing+=(none:python3-petsc4py)
    ensure_packages "${missing[@]}"
}

# ensure_wine FOLDER — MinGW, and Wine with a folder of its own in FOLDER, 0.7 GB. `$wine` runs a program of Windows;
# Rust's want FOLDER/bcryptprimitives.dll beside them. Fails if they cannot be installed.
ensure_wine() {
    local folder=$1
    wine=/usr/lib/wine/wine64
    ensure_packages x86_64-w64-mingw32-gcc:gcc-mingw-w64-x86-64-posix $wine:wine64 || return 1
    # Rust's standard library asks Windows for random numbers by a function that Wine has from 9 on.
    cat >"$folder/prng.c" <<'C'
#include <windows.h>
#include <ntsecapi.h>
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T length) { return RtlGenRandom(data, length); }
C
    x86_64-w64-mingw32-gcc -O2 -s -shared -o "$folder/bcryptprimitives.dll" "$folder/prng.c" -ladvapi32
    export WINEPREFIX=$folder/wine WINEARCH=win64 WINEDEBUG=-all LC_ALL=C.UTF-8
    export WINEDLLOVERRIDES="mscoree,mshtml=;bcryptprimitives=n,b"
    if ! [ -d "$WINEPREFIX/drive_c/windows" ] && ! $wine wineboot -i >"$folder/wine.log" 2>&1; then
        say "error: Wine does not start: $(tail -n3 "$folder/wine.log")"
        exit 1
    fi
}
