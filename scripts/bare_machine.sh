#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/bare_machine.sh [--release NAME] [--keep] [COMMAND]
# Tries Earshot as a new user meets it: installs the smallest Debian into a folder, clones HEAD there (uncommitted changes are left out, and no
# test data lie beside the clone), and runs COMMAND in the clone as root.  Exit status: the command's; 2 if the root cannot be made.
# COMMAND defaults to the two commands of the README, with one minute of training.
#
#   --release NAME  bookworm (Debian 12, the default) or trixie (Debian 13)
#   --keep          continue in the root of the last run of this release, with its installed packages and build outputs; the clone is moved to HEAD
#
# Needs root, debootstrap, and apt sources of a Debian release on this machine: mirror, proxy and date checks are theirs.  PIP_CERT: certificates
# of the Python package index, where those of Debian do not know it.
# EARSHOT_BARE_CACHE (default /var/cache/earshot-bare) holds the fresh roots as archives, downloaded packages, and the root of the last run of each
# release: 5 GB each.
# EARSHOT_BARE_CCACHE: a folder that the root uses as the store of ccache; without it every run compiles everything.
set -euo pipefail

fail() { echo "bare_machine: $*" >&2; exit 2; }

keep=
release=bookworm
while [[ "${1:-}" == --* ]]; do
  case $1 in
    --keep) keep=1; shift ;;
    --release) release=${2:-}; shift 2 || fail "--release needs a name: bookworm or trixie" ;;
    *) fail "unknown option $1 (--release, --keep)" ;;
  esac
done
case $release in bookworm | trixie) ;; *) fail "unknown release '$release': bookworm or trixie" ;; esac
command=${*:-"scripts/train.sh configs/train/quick.yaml max_minutes=1 && scripts/test.sh"}
cache=${EARSHOT_BARE_CACHE:-/var/cache/earshot-bare}
archive=$cache/$release.tar
root=$cache/root-$release
clone=$root/root/earshot

[ "$(id -u)" -eq 0 ] || fail "must run as root: it installs a system into a folder and mounts /proc there"
command -v debootstrap >/dev/null || fail "debootstrap is missing: apt-get install debootstrap"
sources=$(git -C "$(dirname "$0")" rev-parse --show-toplevel)
packages=$cache/packages-$release
mkdir -p "$packages/partial"
exec {lock}>"$cache/lock-$release"
flock -n "$lock" || fail "another run uses the root of $release in $cache; set EARSHOT_BARE_CACHE to a second folder"

# Debian's own sources among those of this machine, one "deb" line each, with the release in place of this machine's; a third party's packages must
# not fill a gap in setup.sh.
debian_sources() {
  apt-get indextargets --format 'deb $(REPO_URI) $(RELEASE) $(COMPONENT) #$(ORIGIN)' 'Created-By: Packages' |
    sed -nE "s/^(deb [^ ]+) [a-z]+((-updates|-security)? [^ ]+) #Debian\$/\\1 $release\\2/p" | sort -u
}

make_archive() {
  local fresh=$cache/fresh-$release mirror
  mirror=$(debian_sources | awk -v release=$release '$3 == release { print $2; exit }')
  [ -n "$mirror" ] || fail "this machine's apt has no source of Debian (apt-get update reads the lists)"
  echo "bare_machine: installing $release"
  rm -rf --one-file-system "$fresh"
  if ! debootstrap --variant=minbase $release "$fresh" "$mirror" >"$cache/debootstrap-$release.log" 2>&1; then
    tail -n 5 "$cache/debootstrap-$release.log" >&2
    fail "debootstrap failed; the whole log is $cache/debootstrap-$release.log"
  fi
  rm -f "$fresh"/var/cache/apt/archives/*.deb
  tar -C "$fresh" --numeric-owner -cf "$archive.part" .
  mv "$archive.part" "$archive"
  rm -rf --one-file-system "$fresh"
}

[ -f "$archive" ] || make_archive
if [ -z "$keep" ] || [ ! -d "$clone" ]; then
  rm -rf --one-file-system "$root"
  mkdir -p "$root"
  tar -C "$root" --numeric-owner -xpf "$archive"
  git clone -q --no-hardlinks --no-checkout "$sources" "$clone" || fail "cannot clone $sources"
fi
git -C "$clone" fetch -q "$sources" HEAD || fail "cannot fetch HEAD of $sources"
git -C "$clone" checkout -q --force --detach FETCH_HEAD

# How to reach the mirror and the Python package index comes from this machine, and nothing else does.
debian_sources >"$root/etc/apt/sources.list"
apt-config dump | grep -E '^Acquire::(https?|ftp|Check-|Retries|ForceIPv)' >"$root/etc/apt/apt.conf.d/90machine" || true
cp /etc/hosts /etc/resolv.conf "$root/etc/"
if [ -f "${PIP_CERT:-}" ]; then
  cp "$PIP_CERT" "$root/etc/pip-certificates.crt"
  printf '[global]\ncert = /etc/pip-certificates.crt\n' >"$root/etc/pip.conf"
fi

echo "bare_machine: $(git -C "$clone" rev-parse --short HEAD) in $root: $command"
# Mounts and processes live in name spaces of their own: the kernel ends both with the command, however it ends.
status=0
unshare --mount --pid --fork --kill-child bash -c '
  set -e
  root=$1 packages=$2
  mount -t proc proc "$root/proc"
  mount -t sysfs -o ro sysfs "$root/sys"
  mount -t devpts -o newinstance,ptmxmode=666 devpts "$root/dev/pts"
  mount -t tmpfs tmpfs "$root/dev/shm"
  mount --bind "$packages" "$root/var/cache/apt/archives"
  if [ -n "$4" ]; then mkdir -p "$root/root/.cache/ccache"; mount --bind "$4" "$root/root/.cache/ccache"; fi
  exec chroot "$root" env -i HOME=/root LANG=C.UTF-8 TERM="${TERM:-dumb}" PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    bash -c "cd ~/earshot && eval \"\$1\"" - "$3"
' - "$root" "$packages" "$command" "${EARSHOT_BARE_CCACHE:-}" {lock}>&- || status=$?
echo "bare_machine: exit status $status; the root stays in $root (--keep continues there)"
exit "$status"
