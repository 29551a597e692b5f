#!/usr/bin/env bash
# Make a virtual environment with semsfm_colmap in it, and what open3d needs from the system.
# usage: scripts/setup.sh [extra]     extra: mesh, which is what the example needs (default), or
#                                     dev, for the tests and checks
# The environment is .venv in the repository, or the folder in SEMSFM_VENV; the versions are those
# of constraints.txt, which scripts/lock.sh renews.
set -euo pipefail
cd "$(dirname "$0")/.."
venv="${SEMSFM_VENV:-.venv}"
extra="${1:-mesh}"

# python3-venv is a package of its own on Debian; the rest are libraries that open3d loads
system_packages=(python3-venv libusb-1.0-0 libegl1 libgl1 libx11-6 libudev1 libidn2-0 libgomp1)
# COLMAP's own programs, which the tests show our models to, and a browser, which they open the
# report in; those tests are skipped without
[ "$extra" = dev ] && system_packages+=(colmap chromium)

install_system_packages() {
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        echo "installing system libraries: ${system_packages[*]}" >&2
        { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
            --no-install-recommends "${system_packages[@]}"; } >/dev/null
    else
        echo "Some system libraries are missing: install ${system_packages[*]} (Debian's names)" \
            "and run this again." >&2
        exit 2
    fi
}

python=python3
for candidate in python3.13 python3.12 python3.11; do
    if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        command -v "$candidate" >/dev/null && python="$candidate"
    fi
done
if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    echo "Python 3.11 or newer is needed and was not found: install it and run this again." >&2
    exit 2
fi
"$python" -c 'import venv, ensurepip' 2>/dev/null || install_system_packages
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
stamp="$venv/.semsfm-$extra"
if [ ! -e "$stamp" ] || [ pyproject.toml -nt "$stamp" ] || [ constraints.txt -nt "$stamp" ]; then
    echo "installing semsfm_colmap and its libraries into $venv" >&2
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check \
        --constraint constraints.txt --editable ".[$extra]"
    touch "$stamp"
fi
"$venv/bin/python" -c 'import open3d' 2>/dev/null || install_system_packages
if [ "$extra" = dev ] && [ "$(id -u)" = 0 ]; then
    { command -v colmap && command -v chromium; } >/dev/null || install_system_packages
fi
"$venv/bin/python" -c 'import open3d' || {
    echo "open3d still does not load: install ${system_packages[*]} (Debian's names)." >&2
    exit 2
}
