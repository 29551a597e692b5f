#!/usr/bin/env bash
# Set up, render the small example, reconstruct it and compare the result with the truth.
# usage: scripts/example.sh [folder]     default: out/example
set -euo pipefail
cd "$(dirname "$0")/.."
folder="${1:-out/example}"
bash scripts/setup.sh
exec "${SEMSFM_VENV:-.venv}/bin/semsfm" example --output_path "$folder"
