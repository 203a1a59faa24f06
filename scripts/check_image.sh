#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/check_image.sh DEB
# Makes a root of Debian 13, runs the steps of the Dockerfile's last stage in it with this .deb, and prints what the image would take and the seconds
# that the steps took.  Then the user of the image runs `earshot doctor` and a response there.  Fails if the root has 600 MB or more, or the user is root.
# Needs root and what scripts/bare_machine.sh needs; EARSHOT_BARE_CACHE as there.
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "check_image: $*" >&2; exit 1; }
refuse() { echo "check_image: $*" >&2; exit 2; }
max_mb=600
deb=${1:-}
[ -f "$deb" ] || refuse "takes the .deb of Debian 13 that scripts/build_deb.sh made there; '$deb' is no file"
[ "$(id -u)" -eq 0 ] || refuse "must run as root: it installs a system into a folder and mounts /proc there"
cache=${EARSHOT_BARE_CACHE:-/var/cache/earshot-bare}
archive=$cache/trixie.tar
# From the Dockerfile, so that what is checked is what it says: the last stage's steps, user and entry.
last=$(awk '/^FROM /{text = ""} {text = text $0 "\n"} END {printf "%s", text}' Dockerfile)
user=$(sed -n 's/^USER //p' <<<"$last")
steps=$(sed -n 's/^RUN //p' <<<"$last")
script=$(sed -nE 's/^COPY (scripts\/[^ ]+) .*/\1/p' <<<"$last")
folder=$(sed -nE 's/^COPY --from=build ([^ ]+) .*/\1/p' <<<"$last")
entry=$(sed -nE 's/^ENTRYPOINT \["([^"]+)"\]$/\1/p' <<<"$last")
[ -n "$user" ] && [ -n "$steps" ] && [ -f "$script" ] && [ -n "$folder" ] && [ -n "$entry" ] || fail "the Dockerfile's last stage is not as this script reads it"
[ "$user" != root ] && [ "$user" != 0 ] || fail "the Dockerfile's user is $user"

[ -f "$archive" ] || scripts/bare_machine.sh --release trixie true || refuse "no root of Debian 13"
root=$(mktemp -d "$cache/image.XXXXXX")
trap 'rm -rf --one-file-system "$root"' EXIT
tar -C "$root" --numeric-owner -xpf "$archive"
# What the slim image leaves out of the root that debootstrap makes.
find "$root/usr/share/doc" -type f ! -name copyright -delete
rm -rf "$root"/usr/share/{man,info,locale}/* "$root"/var/cache/apt/archives/*.deb "$root"/var/lib/apt/lists/* "$root"/var/log/*.log
base_mb=$(($(du -sx --block-size=1 "$root" | cut -f1) / 1000000))

# How to reach the mirror comes from this machine, and nothing else does.
apt-get indextargets --format 'deb $(REPO_URI) $(RELEASE) $(COMPONENT) #$(ORIGIN)' 'Created-By: Packages' |
  sed -nE "s/^(deb [^ ]+) [a-z]+((-updates|-security)? [^ ]+) #Debian\$/\\1 trixie\\2/p" | sort -u >"$root/etc/apt/sources.list"
apt-config dump | grep -E '^Acquire::(https?|ftp|Check-|Retries|ForceIPv)' >"$root/etc/apt/apt.conf.d/90machine" || true
cp /etc/hosts /etc/resolv.conf "$root/etc/"
# Packages that scripts/bare_machine.sh downloaded; the step removes what it does not need and the rest of them.
for package in "$cache"/packages-trixie/*.deb; do
  if [ -f "$package" ]; then ln "$package" "$root/var/cache/apt/archives/" || true; fi
done
mkdir -p "$root$folder"
cp "$script" "$deb" "$root$folder/"

# inside USER COMMAND: in name spaces of their own, which the kernel ends with the command.
inside() {
  unshare --mount --pid --fork --kill-child bash -c '
    set -e
    mount -t proc proc "$1/proc"
    mount -t devpts -o newinstance,ptmxmode=666 devpts "$1/dev/pts"
    mount -t tmpfs tmpfs "$1/dev/shm"
    exec chroot --userspec="$2" "$1" env -i HOME="/home/$2" LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin bash -c "cd ~ 2>/dev/null || cd /; $3"
  ' - "$root" "$1" "$2"
}
begin=$SECONDS
inside root "$steps" || fail "the step failed: $steps"
seconds=$((SECONDS - begin))
mb=$(($(du -sx --block-size=1 "$root" | cut -f1) / 1000000))
[ ! -e "$root$folder" ] || fail "$folder is still there"

id=$(inside "$user" 'id -u') || fail "the image has no user $user"
[ "$id" != 0 ] || fail "$user is root"
inside "$user" "$entry doctor" || fail "$entry doctor failed as $user"
inside "$user" "$entry rir house:7 --source 2,1.5,2 --listener 3.5,1.5,1.5 --out room.wav" || fail "$entry rir failed as $user"
size=$(stat -c %s "$root/home/$user/room.wav")
[ "$size" -gt 10000 ] || fail "room.wav has $size bytes"
echo "check_image: $mb MB (the base $base_mb MB), user $user ($id), steps in $seconds s, largest packages in MB:"
inside root "dpkg-query -Wf '\${Installed-Size} \${Package}\n' | sort -rn | head -n 8" | awk '{printf "  %5d %s\n", $1 / 1000, $2}'
[ "$mb" -lt "$max_mb" ] || fail "the root takes $mb MB, not less than $max_mb MB"
