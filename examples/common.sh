# For the scripts of the examples, which set `here` to their own folder: finds the program and public data, or says where they come from.
# COTWIN: the program; DATA: a folder with models/ and measurements/ as examples/public_data.md describes them.
repository=$(cd "$here/../.." && pwd)
data=${DATA:-$repository/../shared/data}

if [ -z "${COTWIN:-}" ]; then
  if [ -x "$repository/build/release/bin/cotwin" ]; then
    COTWIN=$repository/build/release/bin/cotwin
  else
    COTWIN=$(command -v cotwin || ls -t "$repository"/build/*/bin/cotwin 2>/dev/null | head -n 1)
  fi
fi
if [ -z "$COTWIN" ] || ! command -v "$COTWIN" >/dev/null; then
  echo "$0: no program '${COTWIN:-cotwin}', expected it in build/release/bin (run $repository/run.sh once), in the PATH, or named by COTWIN" >&2
  exit 2
fi

# need FILE...: ends with a message where a file of public data is missing.
need() {
  missing=
  for file in "$@"; do [ -f "$data/$file" ] || missing="$missing $file"; done
  [ -z "$missing" ] && return
  echo "$0: not in $data:$missing" >&2
  echo "These are public measurements and models, not part of Cotwin. $repository/examples/public_data.md says where each comes from and in" >&2
  echo "which form it is expected; put them into one folder and name it by DATA=FOLDER." >&2
  exit 2
}
