#!/bin/sh
# Compares the twins of real robots with their measurements: run.sh [panda] [ur10] (default: both). See ../common.sh for COTWIN and DATA.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"

[ $# -gt 0 ] || set -- panda ur10
for robot in "$@"; do
  case $robot in
    panda) model=panda_franka_ros ;;
    ur10) model=ur10 ;;
    *) echo "$0: no robot '$robot', expected panda or ur10" >&2 && exit 2 ;;
  esac
  need "models/$model.urdf" "measurements/${robot}_unisa.csv"
  "$COTWIN" run "$here/$robot.ssd" --set "robot=$data/models/$model.urdf" --set "recording.file=$data/measurements/${robot}_unisa.csv"
done
