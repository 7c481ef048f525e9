#!/bin/sh
# Runs the control part and, in a second process, what is beside it: run.sh [options of cotwin run for both]. See ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"

"$COTWIN" run "$here/beside.ssd" "$@" &
beside=$!
trap 'kill "$beside" 2>/dev/null || true' EXIT
"$COTWIN" run "$here/control.ssd" "$@"
wait "$beside"
trap - EXIT
