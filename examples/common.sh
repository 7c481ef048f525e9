# For the scripts of the examples, which set `here` to their own folder: finds the program and public data, or reports where they come from, and
# runs several processes.
# COTWIN: the program; DATA: a folder with models/ and measurements/ as examples/public_data.md describes them.
top=$(cd "$here/../.." && pwd)   # of the repository, or share/cotwin where Cotwin is installed
data=${DATA:-$top/build/public_data}

# The program: COTWIN, else that of the tree that the example is in (installed or built), else the one in the PATH, else another build.
if [ -z "${COTWIN:-}" ]; then
  installed=
  case $top in */share/cotwin) installed=$top/../../bin/cotwin ;; esac
  for program in "$installed" "$top/build/release/bin/cotwin" "$(command -v cotwin || true)" "$top"/build/*/bin/cotwin; do
    if [ -f "$program" ] && [ -x "$program" ]; then
      COTWIN=$program
      break
    fi
  done
fi
if [ -z "${COTWIN:-}" ] || ! command -v "$COTWIN" >/dev/null; then
  echo "$0: no program '${COTWIN:-cotwin}', expected it in $top/build/release/bin (run $top/run.sh once), in the PATH, or named by COTWIN" >&2
  exit 2
fi

# need FILE...: ends with a message where a file of public data is missing.
need() {
  missing=
  for file in "$@"; do [ -f "$data/$file" ] || missing="$missing $file"; done
  [ -z "$missing" ] && return
  echo "$0: not in $data:$missing" >&2
  echo "These are public measurements and models, not part of Cotwin. $top/scripts/fetch_logs.py fetches those of Panda and UR10;" >&2
  echo "$top/examples/public_data.md lists where each comes from and which form is expected in the folder DATA." >&2
  exit 2
}

# start ARGUMENT...: starts the program with these arguments beside the script; $! is its process. However the script ends (Ctrl-C, SIGTERM, an
# error), the processes that still run get SIGTERM, and the script waits until they have written their results.
started=
start() {
  if [ -z "$started" ]; then
    trap end_started EXIT
    trap 'exit 129' HUP
    trap 'exit 130' INT
    trap 'exit 143' TERM
  fi
  "$COTWIN" "$@" &
  started="$started $!"
}

# finish PROCESS...: waits for the end of these. If any started process fails, the script ends with its exit code.
finish() {
  while true; do
    running=
    for process in $started; do
      if kill -0 "$process" 2>/dev/null; then
        running="$running $process"
      else
        wait "$process" || exit $?
      fi
    done
    started=$running
    left=
    for process in "$@"; do
      case " $started " in *" $process "*) left=1 ;; esac
    done
    [ -n "$left" ] || return 0
    sleep 0.1
  done
}

end_started() {
  code=$?
  trap - EXIT HUP INT TERM
  for process in $started; do kill "$process" 2>/dev/null || true; done
  for process in $started; do wait "$process" || true; done
  exit "$code"
}
