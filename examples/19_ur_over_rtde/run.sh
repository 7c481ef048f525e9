#!/bin/sh
# Runs an emulated UR5e and a scenario that commands it over RTDE, as two processes: run.sh [OPTION…]; options are those of `cotwin run`.
# ADDRESS: address of this machine (default: 127.0.0.1). OUT: folder for the results. See ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
address=${ADDRESS:-127.0.0.1}
out=${OUT:-results/ur_over_rtde}

"$COTWIN" robot --rtde --robot ur5e --address "$address" --out "$out/robot" ${ROBOT_OPTIONS:-} &
robot=$!
trap 'kill $robot 2>/dev/null || true; wait $robot 2>/dev/null || true' EXIT
"$COTWIN" run "$here/twin.ssd" --out "$out/twin" --set "link.controller=$address" "$@"
