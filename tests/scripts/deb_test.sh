#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# deb_test.sh SOURCES BUILD: the .deb of a build, unpacked into a folder, holds a program that runs there with its reader, and what belongs to it.
set -euo pipefail
sources=$1 build=$2
for tool in dpkg-deb dpkg-shlibdeps file; do
  command -v $tool >/dev/null || { echo "deb_test: skipped: $tool is not installed"; exit 77; }
done
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
failures=0
complain() { echo "deb_test: $*"; failures=1; }

"$sources/scripts/build_deb.sh" "$build"
deb=$(echo "$build"/deb/*.deb)
dpkg-deb -x "$deb" "$root"
version=$("$sources/scripts/check_version.sh" --print)
[ "$("$root/usr/bin/earshot" --version)" = "earshot $version" ] || complain "the program says $("$root/usr/bin/earshot" --version), not $version"
"$root/usr/bin/earshot" doctor >"$root/doctor" || true  # whether this machine is fit is not asked here
grep -q "^ok *reader *$root/usr/libexec/earshot/earshot_reader" "$root/doctor" || complain "the program does not find the reader of the package: $(grep reader "$root/doctor")"
cmp -s "$root/usr/share/earshot/configs/train/quick.yaml" "$sources/configs/train/quick.yaml" || complain "quick.yaml of the package is another one"
cmp -s <("$root/usr/bin/earshot" completion bash) "$root/usr/share/bash-completion/completions/earshot" || complain "completion for bash is not that of the program"
cmp -s <("$root/usr/bin/earshot" completion zsh) "$root/usr/share/zsh/vendor-completions/_earshot" || complain "completion for zsh is not that of the program"
cmp -s <("$root/usr/bin/earshot" completion man) <(gzip -dc "$root/usr/share/man/man1/earshot.1.gz") || complain "the manual page is not that of the program"
for words in "Apache-2.0" "GPL" "three.js"; do grep -q "$words" "$root/usr/share/doc/earshot/copyright" || complain "copyright does not name $words"; done
for field in Package Version Section Maintainer Description Depends; do
  [ -n "$(dpkg-deb -f "$deb" $field)" ] || complain "the package has no field $field"
done
odd=$(find "$root/usr" -type d ! -perm 755 -o -type f -perm /022)
[ -z "$odd" ] || complain "others may write, or not read: $odd"
exit "$failures"
