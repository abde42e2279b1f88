#!/usr/bin/env bash
# What a library of nodes costs: how long it takes to open one, and a hop into one of its nodes beside the same node linked in.
# Usage: tests/plugins/measure.sh; builds a release program that has the example node, and a plugin with the same node.
set -euo pipefail
cd "$(dirname "$0")/../.."
cargo build --release --locked --quiet -p foveate-examples --bin own_program
program=$PWD/target/release/own_program
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

now() { date +%s%N; }
"$program" new plugin slow_only --role filter >/dev/null
began=$(now)
"$program" plugin build slow_only 2>/dev/null
echo "foveate plugin build: $(((($(now) - began)) / 1000000)) ms"

# Milliseconds of a command, the least of 100.
least() {
  local best=999999999999
  for _ in $(seq 100); do
    local from=$(now)
    "$@" >/dev/null
    local took=$(($(now) - from))
    if [ "$took" -lt "$best" ]; then best=$took; fi
  done
  echo "$best" | awk '{ printf "%.2f", $1 / 1e6 }'
}
library=$folder/slow_only/libslow_only.so
without=$(least "$program" nodes export.targets)
with=$(FOVEATE_PLUGINS=$folder/slow_only least "$program" nodes export.targets)
echo "foveate nodes: $without ms; with a library of $(stat -c %s "$library") bytes opened and checked: $with ms"

"$program" new rig hall --cameras 8 >/dev/null
# The rig with a chain of 32 filters of a type behind its targets.
chain() {
  cat hall.toml
  local before=targets.targets
  for i in $(seq 32); do
    printf '\n[scale.hall.node.f%s]\ntype = "%s"\nin = { targets = "%s" }\nmax_speed = 900\n' "$i" "$1" "$before"
    before=f$i.targets
  done
}
scale=$(grep -o '^\[scale\.[a-z]*\]' hall.toml | head -n 1 | tr -d '[]' | cut -d. -f2)
for kind in example.speed_limit slow_only.filter; do
  chain "$kind" | sed "s/scale\.hall\.node\.f/scale.$scale.node.f/" >"$kind.toml"
done
for round in 1 2 3 4 5; do
  for kind in hall example.speed_limit slow_only.filter; do
    FOVEATE_PLUGINS=$folder/slow_only "$program" run "$kind.toml" --duration 20 --workers 1 --quiet --out "out-$kind"
    awk -v kind="$kind" -F: '/"wall_s"/ { print kind, $2 + 0 }' "out-$kind/timing.json" >>walls
  done
done
messages=$(awk -F, '$1 ~ /f32.targets$/ { print $2 }' out-slow_only.filter/ledger.csv)
awk -v messages="$messages" '
  !($1 in least) || $2 < least[$1] { least[$1] = $2 }
  END {
    hops = 32 * messages
    printf "a hop with its work, linked in:    %.0f ns\n", (least["example.speed_limit"] - least["hall"]) / hops * 1e9
    printf "a hop with its work, in a library: %.0f ns\n", (least["slow_only.filter"] - least["hall"]) / hops * 1e9
  }' walls
