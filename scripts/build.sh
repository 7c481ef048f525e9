#!/usr/bin/env bash
# build.sh FOLDER[:TARGET] [cmake options…]: configures and builds into build/FOLDER. Prints nothing if everything is up to date.
# Uses ccache where it is installed, so that a second checkout of the same sources need not be compiled again.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/.."
folder=build/${1%%:*}
target=all
[[ $1 == *:* ]] && target=${1##*:}
shift
log=$folder/build.log
mkdir -p "$folder"
run() { "$@" >"$log" 2>&1 || { cat "$log" >&2; echo "failed: $*" >&2; exit 1; }; }
if command -v ccache >/dev/null; then
  export CMAKE_C_COMPILER_LAUNCHER=ccache CMAKE_CXX_COMPILER_LAUNCHER=ccache CCACHE_BASEDIR=$PWD CCACHE_NOHASHDIR=1
fi
run cmake -S . -B "$folder" -G Ninja "$@"
if ! ninja -C "$folder" -n "$target" | grep -q 'no work to do'; then
  echo "building into $folder (the first time takes a few minutes)"
  run cmake --build "$folder" --target "$target"
fi
