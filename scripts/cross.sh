#!/usr/bin/env bash
# cross.sh PLATFORM [FOLDER] [--units NAMES] [--quick]: builds the libraries of all units, and of scenarios as one FMU, for another
# platform: win64 or aarch64-linux. They go to FOLDER/fmu (default build/cross/fmu), where `cotwin pack --platforms` finds them. Builds
# SUNDIALS from Debian's source package; does not change the system's package lists.
#   --units NAMES  only these, e.g. motion,drive_train,twin (twin: a scenario as one FMU)
#   --quick        half the compile time, slower libraries: for tests
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
usage() { sed -n '2,6s/^# //p' "$0" >&2; exit 2; }
platform= folder= units= flags=()
while [[ $# -gt 0 ]]; do
  case $1 in
    --units) [[ $# -ge 2 ]] || usage; units=$2; shift ;;
    --quick) flags=("-DCMAKE_C_FLAGS_RELEASE=-O1 -DNDEBUG" "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG") ;;
    -*) usage ;;
    *) if [[ -z $platform ]]; then platform=$1; elif [[ -z $folder ]]; then folder=$1; else usage; fi ;;
  esac
  shift
done
[[ -n $platform ]] || usage
toolchain=$here/toolchains/$platform.cmake
[[ -f $toolchain && $platform != common ]] || usage
folder=${folder:-$here/../build/cross}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
build=$folder/$platform
third_party=$build/third-party
log=$build/cross.log
mkdir -p "$build"
: >"$log"

fail() { echo "cross.sh: $*" >&2; exit 1; }
run() { "$@" >>"$log" 2>&1 || { tail -n 40 "$log" >&2; fail "failed: $* (all of it: $log)"; }; }
for program in $(sed -nE 's/^set\(CMAKE_(C|CXX)_COMPILER (.*)\)$/\2/p' "$toolchain") cmake ninja dpkg-source; do
  command -v "$program" >/dev/null || fail "no $program, expected the packages of: scripts/install.sh build cross"
done

# debian_source PACKAGE: unpacks the source package, with Debian's patches, into $folder/sources/PACKAGE. A package that is in
# $folder/sources already is not downloaded again.
debian_source() {
  local sources=$folder/sources apt=$folder/sources/apt
  [[ -d $sources/$1 ]] && return
  mkdir -p "$apt/lists/partial"
  if ! compgen -G "$sources/$1_*.dsc" >/dev/null; then
    # The system's sources.list, changed from binary to source packages.
    mkdir -p "$apt/parts"
    local file
    for file in /etc/apt/sources.list /etc/apt/sources.list.d/*.list; do
      if [[ -f $file ]]; then sed -nE 's/^deb /deb-src /p' "$file" >"$apt/parts/$(basename "$file" .list).list"; fi
    done
    for file in /etc/apt/sources.list.d/*.sources; do
      if [[ -f $file ]]; then sed 's/^Types:.*/Types: deb-src/' "$file" >"$apt/parts/$(basename "$file")"; fi
    done
    local options=(-o Dir::Etc::sourcelist=/dev/null -o Dir::Etc::sourceparts="$apt/parts" -o Dir::State::lists="$apt/lists"
                   -o Dir::Cache="$apt" -o APT::Sandbox::User=root)
    run apt-get "${options[@]}" update
    (cd "$sources" && run apt-get "${options[@]}" source --download-only "$1")
  fi
  rm -rf "$sources/$1.part"
  run dpkg-source --no-check -x "$sources/$1"_*.dsc "$sources/$1.part"
  mv "$sources/$1.part" "$sources/$1"
}

launcher=()
if command -v ccache >/dev/null; then
  export CCACHE_BASEDIR=$(cd "$here/.." && pwd) CCACHE_NOHASHDIR=1
  launcher=(-DCMAKE_C_COMPILER_LAUNCHER=ccache -DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi
configure() { run cmake --fresh -G Ninja -DCMAKE_TOOLCHAIN_FILE="$toolchain" -DCOTWIN_THIRD_PARTY="$third_party" -DCMAKE_BUILD_TYPE=Release "${launcher[@]}" "${flags[@]}" "$@"; }

if [[ ! -f $third_party/lib/libsundials_cvode.a ]]; then
  echo "SUNDIALS for $platform"
  debian_source sundials
  configure -S "$folder/sources/sundials" -B "$build/sundials" -DCMAKE_INSTALL_PREFIX="$third_party" -DCMAKE_INSTALL_LIBDIR=lib \
    -DBUILD_SHARED_LIBS=OFF -DBUILD_CVODES=OFF -DBUILD_IDA=OFF -DBUILD_IDAS=OFF -DBUILD_KINSOL=OFF -DCMAKE_POSITION_INDEPENDENT_CODE=ON \
    -DEXAMPLES_ENABLE_C=OFF -DEXAMPLES_ENABLE_CXX=OFF -DEXAMPLES_INSTALL=OFF
  run cmake --build "$build/sundials" --target install
  install -D -m 644 "$folder/sources/sundials/debian/copyright" "$third_party/share/doc/libsundials-dev/copyright"
fi

echo "libraries of FMUs for $platform"
configure -S "$here/.." -B "$build/cotwin" -DCOTWIN_FMU_FOLDER="$folder/fmu"
targets=(cotwin_fmu_libraries)
if [[ -n $units ]]; then IFS=, read -ra targets <<<"$units"; targets=("${targets[@]/#/cotwin_fmu_}"); fi
run cmake --build "$build/cotwin" --target "${targets[@]}" cotwin_player
tr , '\n' <<<"$units" >"$build/built"   # read by fmu_platforms_test; empty: all units
sed -n 's/^  \(unit .* is left out: .*\)$/\1/p' "$log"
