#!/usr/bin/env bash
# Other people's clients drive `foveate sim head`: run.sh PROGRAM. Skipped, on one line, where they cannot be installed.
set -euo pipefail
program=$(realpath "$1")
cd "$(dirname "$0")"
environment=$(mktemp -d)
trap 'rm -rf "$environment"' EXIT
if ! { python3 -m venv "$environment" && "$environment/bin/pip" install -q --disable-pip-version-check --retries 1 --timeout 15 \
  visca-over-ip==0.5.2 pyvisca==0.1.9 pyserial; } >"$environment/log" 2>&1; then
  echo "skipped: clients of heads (visca-over-ip, pyvisca) cannot be installed here: $(tail -n 1 "$environment/log")"
  exit 0
fi
"$environment/bin/python" drive.py "$program"
