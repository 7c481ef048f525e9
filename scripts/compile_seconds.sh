#!/usr/bin/env bash
# compile_seconds.sh COMPILER ARGUMENTS…: runs the compiler and appends `SECONDS OBJECT SOURCE` to compile_seconds.txt in the current folder, which is
# the build folder: processor seconds of the compiler and its children. scripts/build.sh has it in front of the compiler with COTWIN_COMPILE_COST.
set -uo pipefail
source='' object='' previous=''
for argument; do
  if [[ $previous == -o ]]; then object=$argument; fi
  if [[ $argument != -* && $argument =~ \.(c|cc|cpp|cxx)$ ]]; then source=$argument; fi
  previous=$argument
done
TIMEFORMAT='%3U %3S'
code=0
{ seconds=$({ time "$@" >&3 2>&4; } 2>&1) || code=$?; } 3>&1 4>&2
if [[ $code == 0 && -n $source ]]; then
  awk -v object="$object" -v source="$source" '{print $1 + $2, object, source}' <<<"$seconds" >>compile_seconds.txt
fi
exit "$code"
