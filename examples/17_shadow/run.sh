#!/bin/sh
# Runs robot and twin as two processes that talk FRI over UDP: run.sh [OPTION…]; options are those of `cotwin run` for both. PORT: the
# twin's UDP port (default: 49938). OUT: folder for the results. See ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
port=${PORT:-49938}
out=${OUT:-results/shadow}

# The client is started first, as with a real robot.
start run "$here/twin.ssd" --out "$out/twin" --set "link.port=$port" "$@"
twin=$!
start run "$here/robot.ssd" --out "$out/robot" --set "fri.client=127.0.0.1:$port" "$@"
finish $twin $!
