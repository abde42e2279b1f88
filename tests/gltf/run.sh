#!/usr/bin/env bash
# Holds GLB files against the official glTF validator of the Khronos Group: tests/gltf/run.sh FILE.glb …
# FOVEATE_GLTF_VALIDATOR may name a folder with the npm package gltf-validator; otherwise npm installs it for this run.
# Says on one line that it was skipped where npm is not at hand or gives no package.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
if ! command -v npm >/dev/null || ! command -v node >/dev/null; then
  echo "skipped: the validator of GLB files needs npm and node"
  exit 0
fi
if [ -n "${FOVEATE_GLTF_VALIDATOR:-}" ]; then
  NODE_PATH="$FOVEATE_GLTF_VALIDATOR" exec node "$here/validate.mjs" "$@"
fi
packages=$(mktemp -d)
trap 'rm -rf "$packages"' EXIT
if ! npm install --silent --no-audit --no-fund --prefix "$packages" gltf-validator@2.0.0-dev.3.10 >/dev/null 2>&1; then
  echo "skipped: npm cannot install gltf-validator here"
  exit 0
fi
NODE_PATH="$packages/node_modules" node "$here/validate.mjs" "$@"
