#!/bin/sh
# Maps a cell: 31 × 31 places at the height of a table, 3000 motions to each. OUT: folder for the results. See ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/map}

mkdir -p "$out"
"$COTWIN" ask grow --from 0,0.6,0,-1.7,0,0.84,0 --with '{
  "to_grid": {"least_m": [-0.75, -0.75, 0.2], "most_m": [0.75, 0.75, 0.2], "counts": [31, 31, 1], "quaternion_wxyz": [0, 1, 0, 0]},
  "T_min_s": 0.3, "T_max_s": 4, "motions": 2883000, "cost": [{"name": "time"}, {"name": "energy"}]}' \
  --map "$out/map.csv" --map "$out/map.svg" > "$out/answer.json"
