#!/bin/sh
# Runs the robot with its operator and the twin as two processes that talk FRI over UDP: over_fri.sh [OPTION…]; options are those of `cotwin run`
# for both. PORT: the twin's UDP port (default: 49938). OUT: folder for the results. See ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
port=${PORT:-49938}
out=${OUT:-results/cooperation_over_fri}

# The client is started first, as with a real robot.
start run "$here/over_fri_twin.ssd" --out "$out/twin" --set "link.port=$port" "$@"
twin=$!
start run "$here/over_fri_robot.ssd" --out "$out/robot" --set "controller.client=127.0.0.1:$port" "$@"
finish $twin $!
