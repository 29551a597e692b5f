#!/usr/bin/env bash
# Renew constraints.txt: the newest versions that pyproject.toml allows, of everything that the
# tests and checks need. They are resolved for the oldest Python that the program runs on.
# usage: scripts/lock.sh
set -euo pipefail
cd "$(dirname "$0")/.."
python="${SEMSFM_LOCK_PYTHON:-python3.11}"
command -v "$python" >/dev/null || {
    echo "$python was not found: install it, or name another one in SEMSFM_LOCK_PYTHON." >&2
    exit 2
}
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
"$python" -m venv "$folder/venv"
pip=("$folder/venv/bin/python" -m pip --disable-pip-version-check)
"${pip[@]}" install --quiet ".[dev]"
{
    echo "# What scripts/setup.sh installs, made by scripts/lock.sh. On platforms other than Linux on"
    echo "# x86_64 open3d-cpu is not needed and open3d is free."
    "${pip[@]}" freeze --exclude semsfm-colmap
} >"$folder/constraints.txt"
cp "$folder/constraints.txt" .constraints.txt.part
mv .constraints.txt.part constraints.txt
echo "constraints.txt is renewed: run scripts/check.sh --all, then commit it." >&2
