#!/bin/sh
# Scans the cell, lets a motion be refused and another one run with the monitor beside it; then scans with a robot that bends. OUT: folder for the
# results. See ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/scan_the_cell}

mkdir -p "$out"
"$COTWIN" scan "$here/profile.ssd" --at 3.14,-1.7,1.4,-1.27,-1.57,-3.1 --step 0.0524 --count 61 --settle 0.1 --set scanner.sigma=0.001 \
  --set scanner.opening=2.6 --out "$out/scan"
# From one side of the post to the other: straight, and drawing back before (example 29).
"$COTWIN" ask feasibility --robot ur5e --from 2.5,-1.2,1.4,-1.8,-1.57,0 --to 3.8,-1.2,1.4,-1.8,-1.57,0 \
  --with "{\"clear_of\": {\"cloud\": {\"name\": \"$out/scan/cloud.pcd\"}, \"base\": {\"p_m\": [0, 0, 0.6]}}}" > "$out/refused.json"
"$COTWIN" check "$here/../29_scanned_cell/cell.ssd" --clear-of "$out/scan/cloud.pcd"
"$COTWIN" run "$here/../29_scanned_cell/cell.ssd" --set monitor.cloud="$out/scan/cloud.pcd" --set monitor.cloud.r=0.0171 --out "$out/run" "$@"
# The same cell by an LWR 4+: points where the links are, where its motors are, and with a scanner that is turned by 1 degree.
"$COTWIN" scan "$here/elastic.ssd" --step 0.1 --count 31 --out "$out/links"
"$COTWIN" scan "$here/elastic.ssd" --step 0.1 --count 31 --posture drive.theta --out "$out/motors"
"$COTWIN" scan "$here/elastic.ssd" --step 0.1 --count 31 --mounting '0 0 0.1 0 0.0174533 0' --out "$out/turned"
