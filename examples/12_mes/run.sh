#!/bin/sh
# Starts the gateway and both clients: run.sh [OPTION…]; options are those of `cotwin serve`. OUT: folder for the results; PORT: of the gateway.
# See ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/mes}

rm -f "$out/serve/url.txt"
start serve --port "${PORT:-0}" --out "$out/serve" "$@"
gateway=$!
while [ ! -s "$out/serve/url.txt" ]; do
  kill -0 "$gateway" 2>/dev/null || wait "$gateway"
  sleep 0.1
done
url=$(cat "$out/serve/url.txt")
python3 "$here/client.py" "$url" --program "$COTWIN" --out "$out"
"$here/client.sh" "$url"
