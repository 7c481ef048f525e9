#!/usr/bin/env bash
# check_compilers.sh [FOLDER]: what the build in FOLDER (build/release) does not see and other parts of CI do, as syntax only and file by file:
#   all fuzz targets, with clang;
#   files that changed since the last turn, and tests that include a changed header of tests/support, with g++ and its warnings as errors. Without a
#   history these are the newest files; at most 50 are checked, and the others are named.
# Warnings that need optimisation, such as those of values that may be uninitialised, are left to the part that builds with g++.
# The last line is `N passed, N failed, 0 skipped`, in files.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/counts.sh
folder=${1:-build/release}
most=50   # 4 minutes on two cores

changed() {
  local last name
  last=$(scripts/last_turn.sh)
  if [[ -z $last ]]; then
    find models components fmu master tests -name '*.cpp' -printf '%T@ %p\n' | sort -rn | head -n "$most" | cut -d' ' -f2
    return
  fi
  { git diff --name-only --diff-filter=d "$last"; git ls-files --others --exclude-standard; } | while read -r name; do
    if [[ $name == tests/support/*.h ]]; then grep -rlF --include='*.cpp' "#include \"$name\"" tests || true; fi
    if [[ $name == *.cpp ]]; then echo "$name"; fi
  done | sort -u
}
# check COMMAND: adds one check, and what the compiler says where it fails.
check() {
  local said
  if said=$(eval "$1" 2>&1); then add_counts 1 0 0; else
    { echo "failed: ${1%% *} of ${1##* }"; head -n 20 <<<"$said"; } | add_failures
    add_counts 0 1 0
  fi
}
export -f check

database=$(ninja -C "$folder" -t compdb)
flags() { python3 scripts/compile_flags.py "$@" <<<"$database"; }
mapfile -t files < <(changed | { grep -v '^tests/fuzz/' || true; })
if ((${#files[@]} > most)); then
  echo "not checked, $most of ${#files[@]} are: ${files[*]:most}"
fi
{
  flags tests/fuzz/*_fuzz.cpp | sed 's/^/clang++-14 -fsyntax-only -std=c++20 /'
  flags "${files[@]:0:most}" | sed "s/^/g++ -fsyntax-only -std=c++20 -Werror $(<"$folder/gnu_warnings.txt") /"
} | xargs -d '\n' -P "$(nproc)" -n 1 bash -c 'check "$1"' check
