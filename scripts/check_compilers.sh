#!/usr/bin/env bash
# check_compilers.sh [FOLDER]: what the build in FOLDER (build/release) does not see and other parts of CI do, as syntax only and file by file:
#   all fuzz targets, with clang;
#   files that changed since the last turn, those beside a changed header of the same name, and tests that include a changed header of tests/support, with
#   g++ and its warnings as errors. Without a history these are the newest files. At most 40 are checked; the others, and what the build does not
#   compile, are named.
# Warnings that need optimisation, such as those of values that may be uninitialised, are left to the part that builds with g++.
# The last line is `N passed, N failed, 0 skipped`, in files.
set -euo pipefail
shopt -s inherit_errexit
cd "$(dirname "$0")/.."
source scripts/counts.sh
folder=${1:-build/release}
most=40   # 4 minutes on two cores

changed() {
  local last name names
  last=$(scripts/last_turn.sh)
  if [[ -z $last ]]; then
    echo "no history: the $most newest files" >&2
    find models components fmu master tests -name '*.cpp' -printf '%T@ %p\n' | sort -srn -k 1,1 | cut -d' ' -f2- | sed -n "1,${most}p"
    return
  fi
  names=$(git diff --name-only --diff-filter=d "$last" && git ls-files --others --exclude-standard)
  while read -r name; do
    if [[ $name == tests/support/*.h ]]; then grep -rlF --include='*.cpp' "#include \"$name\"" tests || true; fi
    if [[ -f ${name%.h}.cpp ]]; then echo "${name%.h}.cpp"; fi
    if [[ $name == *.cpp ]]; then echo "$name"; fi
  done <<<"$names" | sort -u
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
warnings=$(<"$folder/gnu_warnings.txt")
flags() { sed '/./!d' <<<"$1" | xargs -r -d '\n' python3 scripts/compile_flags.py 3<<<"$database"; }
files=$(changed)
files=$(flags "$(grep -v '^tests/fuzz/' <<<"$files" || true)")
if (($(wc -l <<<"$files") > most)); then echo "not checked, because $most are: $(sed "1,${most}d; s/.* //" <<<"$files" | tr '\n' ' ')"; fi
{
  flags "$(ls tests/fuzz/*_fuzz.cpp)" | sed 's/^/clang++-14 -fsyntax-only -std=c++20 /'
  sed "/./!d; ${most}q" <<<"$files" | sed "s/^/g++ -fsyntax-only -std=c++20 -fvisibility=hidden -Werror $warnings /"
} | xargs -d '\n' -P "$(nproc)" -n 1 bash -c 'check "$1"' check
