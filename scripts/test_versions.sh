#!/usr/bin/env bash
# The fast tests with the lowest or the newest versions that pyproject.toml allows, in an environment
# of their own. uv resolves and installs: `pip install uv`.
# usage: scripts/test_versions.sh lowest|newest [pytest's arguments]
#   SEMSFM_PYTHON   the interpreter, or its version: python3.11
#   SEMSFM_VERSIONS where the environment is made, and left: build/lowest or build/newest
set -euo pipefail
cd "$(dirname "$0")/.."
which="${1:-}"
case "$which" in
    # what is asked for directly at its lowest; what that asks for at its newest
    lowest) resolution=lowest-direct ;;
    newest) resolution=highest ;;
    *)
        echo "give lowest or newest: see the head of scripts/test_versions.sh" >&2
        exit 2
        ;;
esac
shift
command -v uv >/dev/null || {
    echo "uv was not found: pip install uv" >&2
    exit 2
}
venv="${SEMSFM_VERSIONS:-build/$which}"
[ -x "$venv/bin/python" ] || uv venv --quiet --python "${SEMSFM_PYTHON:-python3.11}" "$venv"
uv pip install --quiet --python "$venv/bin/python" --resolution "$resolution" --upgrade \
    --editable ".[dev]"
uv pip check --quiet --python "$venv/bin/python"
"$venv/bin/python" --version
uv pip list --python "$venv/bin/python" --format freeze |
    grep -iE "^(numpy|scipy|numba|pycolmap|open3d(-cpu)?|opencv-python-headless|pillow|pydantic)=="
# old libraries complain about new ones that they ask for: that is not ours to mend
warnings=()
[ "$which" = lowest ] && warnings=(-W ignore::DeprecationWarning -W ignore::SyntaxWarning)
OMP_WAIT_POLICY=passive "$venv/bin/python" -m pytest -n 2 --dist loadfile \
    --no-loadscope-reorder ${warnings[@]+"${warnings[@]}"} "$@"
