#!/usr/bin/env bash
# The one check: set up, format, lint, types, import layers, changelog, licences, documentation,
# tests.
# usage: scripts/check.sh [--all] [PIECE ...]
#   --all   also the slow tests and those on development data
#   PIECE   format, lint, types, layers, changelog, licences, docs or tests: these alone
set -euo pipefail
cd "$(dirname "$0")/.."
bin="${SEMSFM_VENV:-.venv}/bin"
marker="not slow and not data"
if [ "${1:-}" = "--all" ]; then
    marker=""
    shift
fi
# one piece is for between two commits: what is set up is taken as it is
[ $# -gt 0 ] && [ -x "$bin/pytest" ] || bash scripts/setup.sh dev
[ $# -gt 0 ] || set -- format lint types layers changelog licences docs tests
for piece in "$@"; do
    case "$piece" in
        format) "$bin/ruff" format --check --quiet . ;;
        lint) "$bin/ruff" check --quiet . ;;
        types) "$bin/mypy" --no-error-summary ;;
        layers) "$bin/lint-imports" --no-logo >/dev/null || "$bin/lint-imports" ;;
        changelog) "$bin/python" scripts/check_changelog.py ;;
        # of what is installed by default: no GPL
        licences) "$bin/python" scripts/licences.py --check ;;
        # every link and anchor within the site, every page in its navigation; no network is asked
        # (--quiet would pass over all of them)
        docs) NO_MKDOCS_2_WARNING=1 "$bin/mkdocs" build --strict 2>&1 | sed '/^INFO/d' ;;
        # in the order of tests/conftest.py, not with the files of most tests first; threads that
        # wait leave the core to the other worker, where OpenMP's would spin on it
        tests)
            OMP_WAIT_POLICY=passive "$bin/pytest" -n 2 --dist loadfile --no-loadscope-reorder \
                -m "$marker"
            ;;
        *)
            echo "$piece is no piece of the check: see the head of scripts/check.sh" >&2
            exit 2
            ;;
    esac
done
