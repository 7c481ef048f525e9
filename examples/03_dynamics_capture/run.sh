#!/bin/sh
# Compares the twins of real robots with their measurements: run.sh [panda] [ur10] (default: both). See ../common.sh for COTWIN and DATA.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"

[ $# -gt 0 ] || set -- panda ur10
for robot in "$@"; do
  case $robot in
    panda)
      need models/panda_franka_ros.urdf measurements/panda_unisa.csv
      "$COTWIN" run "$here/panda.ssd" --set "robot=$data/models/panda_franka_ros.urdf" --set "recording.file=$data/measurements/panda_unisa.csv"
      ;;
    ur10)
      need measurements/ur10_unisa.csv
      "$COTWIN" run "$here/ur10.ssd" --set "recording.file=$data/measurements/ur10_unisa.csv"
      ;;
    *) echo "$0: no robot '$robot', expected panda or ur10" >&2 && exit 2 ;;
  esac
done
