#!/usr/bin/env bash
# build.sh FOLDER[:TARGET,TARGET…] [cmake options…]: configures and builds into build/FOLDER. Prints nothing if everything is up to date.
# Uses ccache where it is installed, so that a second clone of the same sources need not be compiled again. With COTWIN_COMPILE_COST in the
# environment the processor time of each compilation is kept, for scripts/compile_cost.sh.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/.."
folder=build/${1%%:*}
targets=all
[[ $1 == *:* ]] && targets=${1##*:}
shift
log=$folder/build.log
mkdir -p "$folder"
if command -v ccache >/dev/null; then
  export CMAKE_C_COMPILER_LAUNCHER=ccache CMAKE_CXX_COMPILER_LAUNCHER=ccache CCACHE_BASEDIR=$PWD CCACHE_NOHASHDIR=1
  if [[ -n ${COTWIN_COMPILE_COST:-} ]]; then export CCACHE_PREFIX=$PWD/scripts/compile_seconds.sh; fi
elif [[ -n ${COTWIN_COMPILE_COST:-} ]]; then
  export CMAKE_C_COMPILER_LAUNCHER=$PWD/scripts/compile_seconds.sh CMAKE_CXX_COMPILER_LAUNCHER=$PWD/scripts/compile_seconds.sh
fi
if [[ ! -f $folder/build.ninja ]]; then echo "configuring $folder"; fi
if ! cmake -S . -B "$folder" -G Ninja "$@" >"$log" 2>&1; then
  cat "$log" >&2
  echo "failed: cmake -S . -B $folder $*" >&2
  exit 1
fi
# shellcheck disable=SC2086
scripts/progress.py "$folder" ${targets//,/ }
