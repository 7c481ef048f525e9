#!/usr/bin/env bash
# install.sh GROUP…: installs the missing Debian packages of the groups (packages.txt). Prints nothing if none is missing. A program npm that is there
# already, for example from a later nodejs that brings its own, counts as the package npm.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)

missing=()
for group in "$@"; do
  while read -r package; do
    if [ "$package" = npm ] && command -v npm >/dev/null; then continue; fi
    dpkg-query -W -f='${db:Status-Abbrev}' "$package" 2>/dev/null | grep -q '^ii' || missing+=("$package")
  done < <(awk -v group="$group" '$1 == group {print $2}' "$here/packages.txt")
done
[ ${#missing[@]} -eq 0 ] && exit 0

sudo=""
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || { echo "install.sh: missing packages: ${missing[*]}; run as root, or install sudo" >&2; exit 1; }
  sudo=sudo
fi
echo "installing ${#missing[@]} Debian packages: ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
fail() { cat "$log" >&2; echo "install.sh: failed: $*" >&2; rm -f "$log"; exit 1; }
$sudo apt-get update -qq >"$log" 2>&1 || fail apt-get update

# Each package, with those that it needs, is downloaded, unpacked and set up. On a terminal one line that counts, elsewhere one line each half minute.
progress() {
  local line all=0 steps=0 printed=$SECONDS
  while read -r line; do
    echo "$line" >>"$log"
    case $line in
      *" newly installed, "*) all=$(awk '{print $1 + $3}' <<<"$line") ;;
      Get:* | Unpacking\ * | Setting\ up\ *) steps=$((steps + 1)) ;;
      *) continue ;;
    esac
    if [ -t 1 ]; then printf '\r%d of %d steps\033[K' "$steps" $((3 * all))
    elif ((SECONDS - printed >= 30)); then printed=$SECONDS; echo "  $steps of $((3 * all)) steps"; fi
  done
  if [ -t 1 ]; then printf '\n'; fi
}
$sudo apt-get install -y -q --no-install-recommends "${missing[@]}" 2>&1 | progress || fail apt-get install "${missing[*]}"
rm -f "$log"
