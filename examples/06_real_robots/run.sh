#!/bin/sh
# Tunes real robots to their measured torques: run.sh [panda] [ur10] [kr300] (default: all).
# OUT: folder for the results; see ../common.sh for COTWIN and DATA.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/06_real_robots}

# Joint torque sensors behind the gears: the torques do not contain the motors. Settings are chosen on the training part.
panda() {
  need models/panda_franka_ros.urdf measurements/panda_unisa.csv
  "$COTWIN" tune --robot "$data/models/panda_franka_ros.urdf" --data "$data/measurements/panda_unisa.csv" \
    --torques joint --cross-validate --out "$out/panda" "$@"
}

# Efforts of the motors behind the gears.
ur10() {
  need measurements/ur10_unisa.csv
  "$COTWIN" tune --robot "$here/../../models/robots/ur10/robot.urdf" --data "$data/measurements/ur10_unisa.csv" \
    --cross-validate --out "$out/ur10" "$@"
}

# Motor torques before the gears: multiplied by the gear ratios, which the log's source gives. Links of axes 1 to 3 are measured by secondary
# encoders, all motors behind the gears. Positions count from A2 = -90, A3 = 90 degrees. The robot stands still for a second at both ends,
# where the friction torque is undetermined: --margin leaves these parts out. Trained on one motion, tested on another one.
kr300() {
  need measurements/kr300_A.csv measurements/kr300_B.csv
  "$COTWIN" tune --robot "$here/../../models/robots/kr300_r2500/robot.urdf" \
    --data "$data/measurements/kr300_A.csv" --held-out "$data/measurements/kr300_B.csv" \
    --q-columns q1,q2,q3,qmot4,qmot5,qmot6 --dq-columns none --motor-columns 'qmot{}' \
    --q-offset 0,-1.5707963267948966,1.5707963267948966,0,0,0 \
    --tau-scale 256.85714,267.42857,252.33333,221,239.61905,154.32313 \
    --margin 1.2 --load-friction --v-r 0.02 --harmonics 0,1,0,0,0,0 --prior-weight 1 --out "$out/kr300" "$@"
}

[ $# -gt 0 ] || set -- panda ur10 kr300
for robot in "$@"; do
  case $robot in
    panda | ur10 | kr300) $robot ;;
    *) echo "run.sh: no robot '$robot', expected panda, ur10 or kr300" >&2 && exit 2 ;;
  esac
done
