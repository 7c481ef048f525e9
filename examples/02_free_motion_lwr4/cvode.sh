#!/bin/sh
# Runs the twin with the solver of the drive train that is its default, and with SUNDIALS' CVODE at small tolerances: cvode.sh [OPTION…]; options are
# those of `cotwin run`. OUT: folder for the results; see ../common.sh for COTWIN.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/free_motion_lwr4_cvode}
"$COTWIN" run "$here/twin.ssd" --record drive.q --out "$out/auto" "$@"
"$COTWIN" run "$here/twin.ssd" --record drive.q --record drive.substeps --out "$out/cvode" --set drive.method=cvode --set drive.rtol=1e-11 --set drive.atol=1e-12 \
  --set drive.atol_speed=1e-10 "$@"
