#!/usr/bin/env bash
# old_glibc.sh VERSION COMPILER READELF FOLDER: creates FOLDER with stub libraries of glibc VERSION for the linker: libc.so, libm.so,
# libpthread.so and libdl.so. The stubs have symbols but no code. They are made from the C library that COMPILER links and contain,
# of each symbol, the newest version that is not newer than VERSION. A program linked with them runs with glibc VERSION and later;
# use of a newer symbol is a linker error.
set -euo pipefail
[[ $# -eq 4 ]] || { sed -n '2,5s/^# //p' "$0" >&2; exit 2; }
version=$1 compiler=$2 readelf=$3 folder=$4
fail() { echo "old_glibc.sh: $*" >&2; exit 1; }

# library NAME: prints the path at which the compiler finds it.
library() {
  local path
  path=$("$compiler" -print-file-name="$1")
  [[ -f $path ]] || fail "$compiler has no $1"
  echo "$path"
}
libc=$(library libc.so.6)
loader=$("$readelf" --wide --dynamic "$libc" | sed -nE 's/.*\(NEEDED\).*\[(ld-linux.*)\]/\1/p')
[[ -n $loader ]] || fail "$libc does not name its loader"

rm -rf "$folder.part" && mkdir -p "$folder.part"

# symbols LIBRARY: prints "<library in glibc VERSION> <symbol> <its version> <type>" for each symbol of this machine's LIBRARY.
symbols() {
  "$readelf" --wide --dyn-syms "$(library "$1")" | LC_ALL=C awk -v limit="$version" -v library="$1" '
    function newer(a, b,   x, y, i) {  # whether version a is newer than b
      split(a, x, "."); split(b, y, ".")
      for (i = 1; i <= 4; ++i) if (x[i] + 0 != y[i] + 0) return x[i] + 0 > y[i] + 0
      return 0
    }
    $5 ~ /^(GLOBAL|WEAK)$/ && $7 != "UND" && $8 ~ /@GLIBC_[0-9]/ && $8 !~ /^GLIBC_/ {  # not the versions themselves
      split($8, part, /@+GLIBC_/); name = part[1]
      if (newer(part[2], limit)) { has_newer[name] = 1; next }
      if (!(name in best) || newer(part[2], best[name])) { best[name] = part[2]; type[name] = $4 }
    }
    END {
      for (name in best) {
        home = library
        if (library == "libc.so.6") {  # glibc 2.34 and later contain what were separate libraries
          if (name ~ /^(__)?pthread_|^sem_/) home = "libpthread.so.0"
          else if (name ~ /^dl(open|mopen|close|sym|vsym|addr1?|error|info)$/) home = "libdl.so.2"
          else if (name in has_newer) continue  # was in librt, libresolv, …, which are not needed here, or has changed its meaning
        }
        print home, name, best[name], type[name]
      }
    }'
}
for file in libc.so.6 libm.so.6 "$loader"; do symbols "$file"; done | LC_ALL=C sort >"$folder.part/symbols.txt"

for file in libc.so.6 libm.so.6 libpthread.so.0 libdl.so.2 "$loader"; do
  awk -v library="$file" '$1 == library {
    data = $4 == "OBJECT"
    print data ? ".data" : ".text"
    printf ".globl %s\n.type %s, %%%s\n%s: .zero 8\n.size %s, 8\n", $2, $2, data ? "object" : "function", $2, $2
  } END { print ".section .note.GNU-stack, \"\", %progbits" }' "$folder.part/symbols.txt" >"$folder.part/$file.s"
  awk -v library="$file" '$1 == library { in_version[$3] = in_version[$3] " " $2 ";" }
    END { for (v in in_version) printf "GLIBC_%s { global:%s };\n", v, in_version[v] }' "$folder.part/symbols.txt" >"$folder.part/$file.map"
  "$compiler" -shared -nostdlib -Wl,-soname,"$file" -Wl,--version-script="$folder.part/$file.map" -o "$folder.part/$file" "$folder.part/$file.s"
done

# A linker script like glibc's own libc.so: the static part of each program, and the other libraries as needed.
cat >"$folder.part/libc.so" <<END
GROUP ( "$folder/libc.so.6" "$(library libc_nonshared.a)" AS_NEEDED ( "$folder/libpthread.so.0" "$folder/libdl.so.2" "$folder/$loader" ) )
END
for name in m.so.6 pthread.so.0 dl.so.2; do echo "INPUT ( \"$folder/lib$name\" )" >"$folder.part/lib${name%%.*}.so"; done
rm -rf "$folder"
mv "$folder.part" "$folder"
