#!/usr/bin/env bash
# scripts/bare_machine.sh [--keep] [COMMAND]
# Tries Earshot as a new user meets it: installs the smallest Debian 12 into a folder, clones HEAD there (uncommitted changes are left out, and no
# test data lie beside the clone), and runs COMMAND in the clone as root.  Exit status: the command's; 2 if the root cannot be made.
# COMMAND defaults to the two commands of the README, with one minute of training.
#
#   --keep  continue in the root of the last run, with its installed packages and build outputs; the clone is moved to HEAD
#
# Needs root, debootstrap, and apt sources of Debian 12 on this machine: mirror, proxy and date checks are theirs.
# EARSHOT_BARE_CACHE (default /var/cache/earshot-bare) holds the fresh root as an archive, downloaded packages, and the root of the last run: 5 GB.
set -euo pipefail

fail() { echo "bare_machine: $*" >&2; exit 2; }

keep=
if [ "${1:-}" = --keep ]; then keep=1; shift; fi
command=${*:-"scripts/train.sh configs/train/quick.yaml max_minutes=1 && scripts/test.sh"}
release=bookworm
cache=${EARSHOT_BARE_CACHE:-/var/cache/earshot-bare}
archive=$cache/$release.tar
root=$cache/root
clone=$root/root/earshot

[ "$(id -u)" -eq 0 ] || fail "must run as root: it installs a system into a folder and mounts /proc there"
command -v debootstrap >/dev/null || fail "debootstrap is missing: apt-get install debootstrap"
sources=$(git -C "$(dirname "$0")" rev-parse --show-toplevel)
mkdir -p "$cache/packages/partial"
exec {lock}>"$cache/lock"
flock -n "$lock" || fail "another run uses $cache; set EARSHOT_BARE_CACHE to a second folder"

# Debian's own sources among those of this machine, one "deb" line each; a third party's packages must not fill a gap in setup.sh.
debian_sources() {
  apt-get indextargets --format 'deb $(REPO_URI) $(RELEASE) $(COMPONENT) #$(ORIGIN)' 'Created-By: Packages' |
    sed -nE "s/^(deb [^ ]+ $release[^ ]* [^ ]+) #Debian\$/\\1/p" | sort -u
}

make_archive() {
  local fresh=$cache/fresh mirror
  mirror=$(debian_sources | awk -v release=$release '$3 == release { print $2; exit }')
  [ -n "$mirror" ] || fail "this machine's apt has no Debian source of $release (apt-get update reads the lists)"
  echo "bare_machine: installing $release"
  rm -rf --one-file-system "$fresh"
  if ! debootstrap --variant=minbase $release "$fresh" "$mirror" >"$cache/debootstrap.log" 2>&1; then
    tail -n 5 "$cache/debootstrap.log" >&2
    fail "debootstrap failed; the whole log is $cache/debootstrap.log"
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

# How to reach the mirror comes from this machine, and nothing else does.
debian_sources >"$root/etc/apt/sources.list"
apt-config dump | grep -E '^Acquire::(https?|ftp|Check-|Retries|ForceIPv)' >"$root/etc/apt/apt.conf.d/90machine" || true
cp /etc/hosts /etc/resolv.conf "$root/etc/"

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
  exec chroot "$root" env -i HOME=/root LANG=C.UTF-8 TERM="${TERM:-dumb}" PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    bash -c "cd ~/earshot && eval \"\$1\"" - "$3"
' - "$root" "$cache/packages" "$command" {lock}>&- || status=$?
echo "bare_machine: exit status $status; the root stays in $root (--keep continues there)"
exit "$status"
