#!/bin/sh
# Searches the cheaper motion and runs it beside the quintic: run.sh [OPTION…]; options are those of `cotwin run`. OUT: folder for the results.
# See ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/cheaper_motion}

mkdir -p "$out"
cp "$here/twins.ssd" "$out/"
"$COTWIN" ask optimise --from 0,-0.9,0,1.2,0,0.6,0 --to 1.2,0.9,0,-1.2,0,-0.6,0 --duration 2.2 --detail verdict \
  --with '{"degree": 9, "cost": "energy", "particles": 64, "rounds": 120, "verify": true}' --motion "$out/cheaper.ssv" > "$out/answer.json"
"$COTWIN" ask jerk --from 0,-0.9,0,1.2,0,0.6,0 --to 1.2,0.9,0,-1.2,0,-0.6,0 --duration 2.2 --detail verdict > "$out/jerk.json"
"$COTWIN" run "$out/twins.ssd" --out "$out/twins" "$@"
