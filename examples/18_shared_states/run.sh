#!/bin/sh
# Runs the control part and, in a second process, what is beside it: run.sh [OPTION…]; options are those of `cotwin run` for both. PORT: the
# UDP port of the control part, the other one has the next (default: 30200). OUT: folder for the results. See ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
control=127.0.0.1:${PORT:-30200} beside=127.0.0.1:$((${PORT:-30200} + 1))
out=${OUT:-results}

start run "$here/beside.ssd" --out "$out/beside" --set "control.listen=$beside" --set "control.peer=$control" "$@"
first=$!
start run "$here/control.ssd" --out "$out/control" --set "beside.listen=$control" --set "beside.peer=$beside" "$@"
finish $first $!
