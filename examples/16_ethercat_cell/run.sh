#!/bin/sh
# Runs the emulated cell and, in a second process, its twin: run.sh [options of cotwin run for the twin]. Both have a network namespace of their own
# with a pair of virtual interfaces, ecat0 and ecat1; nothing of the machine's network is touched. OUT: folder for the results. See ../common.sh for
# COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"

if [ -z "${ETHERCAT_CELL:-}" ]; then
  user=
  [ "$(id -u)" = 0 ] || user=--map-root-user
  export COTWIN ETHERCAT_CELL=1
  if ! unshare $user --net true 2>/dev/null; then
    echo "$0: no permission for a network namespace, expected root (or unprivileged user namespaces)" >&2
    exit 2
  fi
  exec unshare $user --net "$0" "$@"
fi

ip link add ecat0 type veth peer name ecat1
for interface in ecat0 ecat1; do
  sysctl -qw "net.ipv6.conf.$interface.disable_ipv6=1" 2>/dev/null || true   # no neighbour discovery on the bus
  ip link set "$interface" up
done
out=${OUT:-results/ethercat_cell}
start run "$here/cell.ssd" --out "$out/cell" --quiet
start run "$here/twin.ssd" --out "$out/twin" "$@"
finish $!
