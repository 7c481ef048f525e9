#!/usr/bin/env bash
# build.sh FOLDER[:TARGET] [cmake options…]: configures and builds into build/FOLDER. Prints nothing if everything is up to date.
# Uses ccache where it is installed, so that a second checkout of the same sources need not be compiled again. With COTWIN_COMPILE_COST in the
# environment the processor time of each compilation is kept, for scripts/compile_cost.sh.
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
  if [[ -n ${COTWIN_COMPILE_COST:-} ]]; then export CCACHE_PREFIX=$PWD/scripts/compile_seconds.sh; fi
elif [[ -n ${COTWIN_COMPILE_COST:-} ]]; then
  export CMAKE_C_COMPILER_LAUNCHER=$PWD/scripts/compile_seconds.sh CMAKE_CXX_COMPILER_LAUNCHER=$PWD/scripts/compile_seconds.sh
fi
run cmake -S . -B "$folder" -G Ninja "$@"
if ! ninja -C "$folder" -n "$target" | grep -q 'no work to do'; then
  echo "building $target into $folder (the first time takes a few minutes)"
  # Ninja's lines begin with [done/all]. On a terminal they become one line that counts; elsewhere one line per tenth.
  if ! cmake --build "$folder" --target "$target" 2>&1 | tee "$log" | awk -v terminal="$([ -t 1 ] && echo 1 || echo 0)" '
    match($0, /^\[[0-9]+\/[0-9]+\]/) {
      split(substr($0, 2, RLENGTH - 2), step, "/")
      if (terminal) printf "\r%d of %d steps", step[1], step[2]
      else if (int(10 * step[1] / step[2]) > tenth) { tenth = int(10 * step[1] / step[2]); printf "%d of %d steps\n", step[1], step[2] }
      fflush()
    }
    END { if (terminal) printf "\n" }'; then
    cat "$log" >&2
    echo "failed: the build of $target in $folder" >&2
    exit 1
  fi
fi
