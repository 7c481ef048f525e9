# For the scripts of the examples, which set `here` to their own folder: finds the program and public data, or reports where they come from.
# COTWIN: the program; DATA: a folder with models/ and measurements/ as examples/public_data.md describes them.
top=$(cd "$here/../.." && pwd)   # of the repository, or share/cotwin where Cotwin is installed
data=${DATA:-$top/../shared/data}

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
  echo "These are public measurements and models, not part of Cotwin. $top/examples/public_data.md lists where each comes from and which" >&2
  echo "form is expected; put them into one folder and name it by DATA=FOLDER." >&2
  exit 2
}
