#!/usr/bin/env bash
# The one check: set up, format, lint, types, import layers, tests.
# usage: scripts/check.sh [--all]     --all: also the slow tests and those on development data
set -euo pipefail
cd "$(dirname "$0")/.."
bash scripts/setup.sh dev
bin="${SEMSFM_VENV:-.venv}/bin"
"$bin/ruff" format --check --quiet .
"$bin/ruff" check --quiet .
"$bin/mypy" --no-error-summary
"$bin/lint-imports" --no-logo >/dev/null || "$bin/lint-imports"
marker="not slow and not data"
[ "${1:-}" = "--all" ] && marker=""
"$bin/pytest" -n 2 --dist loadfile -m "$marker"
