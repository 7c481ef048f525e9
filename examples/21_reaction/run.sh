#!/bin/sh
# Runs the three twins, and asks the service what their motions do to the base: run.sh [OPTION…]; options are those of `cotwin run`.
# OUT: folder for the results; see ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/reaction}
"$COTWIN" run "$here/reaction.ssd" --out "$out/run" "$@"
for joints in motion.q_d rigid.q elastic.q world.q; do
  "$COTWIN" ask reaction --robot "$here/satellite.urdf" --series "$out/run/signals.csv" --q-columns "${joints}[{}]" --detail verdict >"$out/$joints.json"
  echo "prediction from $joints: $out/$joints.json"
done
