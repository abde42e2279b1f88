#!/usr/bin/env bash
# How long a newcomer waits, in a fresh clone with an empty target folder: until the first results, until a test runs after an edit, and until all
# tests have run. Crates are fetched before the clock starts. With KEEP=1 the clone stays, with what was built.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
clone=$(mktemp -d)
[ -n "${KEEP:-}" ] || trap 'rm -rf "$clone"' EXIT
unset CARGO CARGO_MANIFEST_DIR RUSTC_WRAPPER CARGO_TARGET_DIR FOVEATE_DATA

# `timed WORDS COMMAND …` prints the seconds that the command takes.
timed() {
  local words=$1 began=$SECONDS
  shift
  "$@" >"$clone/said" 2>&1 || { tail -n 40 "$clone/said" >&2; return 1; }
  printf '%s: %d s\n' "$words" $((SECONDS - began))
}
first_results() { git clone --quiet "$root" "$clone/foveate" && cd "$clone/foveate" && cargo run --locked --release -- run graphs/face_body.toml; }
edited() { echo '// One more line.' >>framework/rig/src/lib.rs && cargo test --locked -p foveate-rig --lib; }

(cd "$root" && cargo fetch --quiet --locked)
timed "clone to first results" first_results
cd "$clone/foveate"
mv target ../first
timed "cargo test --workspace" cargo test --locked --workspace
timed "an edit in rig to a running test" edited
