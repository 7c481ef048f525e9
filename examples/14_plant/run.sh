#!/bin/sh
# Builds the FMUs of the plant and runs it in five forms, which give the same bits: run.sh [OPTION…]; options are those of `cotwin run`.
# OUT: folder for FMUs and results; CC: the C compiler; see ../common.sh for COTWIN and DATA.
set -eu
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
. "$here/../common.sh"
out=${OUT:-results/plant}
cc=${CC:-cc}
if ! command -v "$cc" >/dev/null; then
  echo "$0: no C compiler '$cc', expected one for conveyor.c and cell.c (Debian's package gcc), or its name in CC" >&2
  exit 2
fi
platform=linux64   # of FMI 2
[ "$(uname -m)" = x86_64 ] || platform=$(uname -m)-linux

# c_fmu NAME DESCRIPTION ARGUMENT…: compiles an FMU with these arguments of the compiler.
c_fmu() {
  name=$1 folder=$out/$1
  mkdir -p "$folder/binaries/$platform"
  cp "$2" "$folder/modelDescription.xml"
  shift 2
  "$cc" -std=c11 -O2 -fPIC -shared "$@" -o "$folder/binaries/$platform/$name.so" -lm
  rm -f "$folder.fmu"
  (cd "$folder" && python3 -m zipfile -c "../$name.fmu" modelDescription.xml binaries)
}

# run NAME SCENARIO TEXT OPTION…: runs the scenario and compares its results with those of the first one.
run() {
  name=$1 scenario=$2 text=$3
  shift 3
  "$COTWIN" run "$out/$scenario" --quiet --out "$out/$name" "$@"
  if ! cmp "$out/in_process/signals.csv" "$out/$name/signals.csv"; then
    echo "$0: $text gives other results than the units of robot.ssd" >&2
    exit 1
  fi
  echo "$text: $out/$name/signals.csv"
}

mkdir -p "$out"
cp "$here/robot.ssd" "$here/plant.ssd" "$out"
c_fmu conveyor "$here/conveyor.xml" -fvisibility=hidden "$here/conveyor.c"
c_fmu cell "$here/cell.xml" -fvisibility=hidden "$here/cell.c"

sed -e 's|source="robot.fmu"|source="robot.ssd" type="application/x-ssp-definition"|' -e '/name="robot" stage/d' "$here/plant.ssd" >"$out/in_process.ssd"
run in_process in_process.ssd "robot.ssd as units beside both FMUs" "$@"
for fmi in 3 2; do   # the last one stays
  "$COTWIN" pack "$here/robot.ssd" --as-fmu --fmi $fmi -o "$out/robot.fmu"
  run fmi$fmi plant.ssd "the same with robot.fmu of FMI $fmi" "$@"
done
"$COTWIN" pack "$out/plant.ssd" -o "$out/plant.ssp"
run package plant.ssp "the same as plant.ssp" "$@"

# The light barrier's signal through somebody else's FMU, as through a coupler of a field bus.
reference=$data/reference_fmus
if [ -f "$reference/Feedthrough/FMI2.xml" ]; then
  c_fmu Feedthrough "$reference/Feedthrough/FMI2.xml" -w -D_DEFAULT_SOURCE -DFMI_VERSION=2 -DDISABLE_PREFIX -I"$reference/include" \
    -I"$reference/Feedthrough" "$reference/Feedthrough/model.c" "$reference/src/fmi2Functions.c" "$reference/src/cosimulation.c"
  sed -e 's|<ssd:Elements>|&<ssd:Component name="coupler" source="Feedthrough.fmu" implementation="CoSimulation"/>|' \
    -e 's|endElement="cell" endConnector="at_station"/>|endElement="coupler" endConnector="Boolean_input"/><ssd:Connection startElement="coupler" startConnector="Boolean_output" endElement="cell" endConnector="at_station"/>|' \
    -e 's|<cotwin:Component name="robot"|<cotwin:Component name="coupler" stage="1"/>&|' "$here/plant.ssd" >"$out/coupler.ssd"
  run coupler coupler.ssd "the same with a Reference FMU in between" "$@"
else
  echo "without a Reference FMU in between: $top/scripts/fetch_logs.py --fmu fetches it"
fi
