#!/usr/bin/env bash
# Set up, render the small example, reconstruct it and compare the result with the truth.
# usage: scripts/example.sh [folder]     default: out/example
set -euo pipefail
cd "$(dirname "$0")/.."
folder="${1:-out/example}"
bash scripts/setup.sh
semsfm="${SEMSFM_VENV:-.venv}/bin/semsfm"
[ -e "$folder/truth.json" ] || "$semsfm" synthesize "$folder" --example
"$semsfm" reconstruct "$folder/images" --output_path "$folder/project"
"$semsfm" evaluate "$folder/project" "$folder"
echo
echo "mesh:         $folder/project/mesh/mesh.ply (and mesh.glb, mesh.obj)"
echo "COLMAP model: $folder/project/sparse/0"
echo "report:       $folder/project/report/report.html"
