#!/usr/bin/env bash
# A TUIO client of other people receives strokes from a simulated wall: tuio.sh PROGRAM RIG. Skipped, on one line, where it cannot be installed.
set -euo pipefail
program=$(realpath "$1")
rig=$(realpath "$2")
cd "$(dirname "$0")"
environment=$(mktemp -d)
trap 'rm -rf "$environment"' EXIT
if ! { python3 -m venv "$environment" && "$environment/bin/pip" install -q --disable-pip-version-check --retries 1 --timeout 15 \
  python-tuio==0.0.9 python-osc==1.10.2; } >"$environment/log" 2>&1; then
  echo "skipped: the TUIO client python-tuio cannot be installed here: $(tail -n 1 "$environment/log")"
  exit 0
fi
"$environment/bin/python" tuio.py "$program" "$rig"
