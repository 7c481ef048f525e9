#!/usr/bin/env bash
# bare_debian.sh COTWIN.deb [COTWIN-DEV.deb]: installs the packages on a bare Debian 12, made by debootstrap in a temporary folder, and tries them:
# a scenario, an FMU in both directions and, with the second package, the project consumer/. Needs root, debootstrap and Debian's packages.
# Not part of the tests, since it downloads some 100 MB (350 MB with the second package). BARE: an unpacked Debian 12 to be copied instead.
set -euo pipefail
[[ $# -ge 1 ]] || { sed -n '2,4s/^# //p' "$0" >&2; exit 2; }
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)
root=$(mktemp -d)
mounted=()
clean() {
  for folder in "${mounted[@]}"; do umount "$folder"; done
  rm -rf --one-file-system "$root"
}
trap clean EXIT

if [[ -n ${BARE:-} ]]; then
  cp -a "$BARE/." "$root"
else
  mirror=$(apt-cache policy base-files | grep -oE 'https?://[^ ]+' | head -n 1)
  debootstrap --variant=minbase bookworm "$root" "$mirror"
fi
for folder in proc dev; do
  mount --bind "/$folder" "$root/$folder"
  mounted+=("$root/$folder")
done
cp -L /etc/resolv.conf "$root/etc/"
cp -r /etc/apt/apt.conf.d/. "$root/etc/apt/apt.conf.d/"
inside() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive "$@"; }

mkdir "$root/packages"
cp "$@" "$root/packages"
inside apt-get -qq update
inside apt-get -qq -y --no-install-recommends install $(cd "$root" && printf '/%s ' packages/cotwin_*.deb)
inside cotwin --version
inside cotwin run /usr/share/cotwin/examples/02_free_motion_lwr4/twin.ssd --stop 2 --quiet --out /tmp/run
inside cotwin pack unit:drive_train?robot=lwr4 --fmi 3 -o /tmp/drive.fmu
inside cotwin run /tmp/drive.fmu --stop-time 0.1 --process own --output-file /tmp/drive.csv
inside cotwin pack /usr/share/cotwin/examples/01_joint_admittance/arm.ssd --as-fmu -o /tmp/arm.fmu
inside cotwin run /tmp/arm.fmu --stop-time 0.1 --output-file /tmp/arm.csv

if [[ $# -ge 2 ]]; then
  inside apt-get -qq -y --no-install-recommends install $(cd "$root" && printf '/%s ' packages/cotwin-dev_*.deb) g++ cmake make
  cp -r "$here/consumer" "$root/tmp/consumer"
  inside cmake -S /tmp/consumer -B /tmp/build -DCMAKE_BUILD_TYPE=Release
  inside cmake --build /tmp/build
  inside mkdir /tmp/api
  inside /tmp/build/use_api /usr/share/cotwin/examples/01_joint_admittance/arm.ssd /tmp/consumer/springs.ssd /tmp/build/units/spring.so /tmp/api
  inside cotwin run /tmp/consumer/springs.ssd --units /tmp/build/units/spring.so --quiet --out /tmp/springs
fi
echo "the packages work on a bare Debian $(cat "$root/etc/debian_version")"
