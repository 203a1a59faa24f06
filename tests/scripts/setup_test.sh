#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What the given setup.sh asks of apt on Debian 12, Debian 13, derivatives of Debian and other systems: apt-get, apt-cache and cmake are played by
# scripts, /etc/os-release by a file.
set -euo pipefail
setup=$1
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
mkdir -p "$root/bin" "$root/tree/scripts"
cp "$setup" "$root/tree/scripts/setup.sh"
table=$(sed -n "/^packages='/,/^'/p" "$setup" | awk 'NF == 3')

# apt-cache madison NAME: the versions of the file offered/NAME, one a line.  apt-get install: its packages go to the file installed.
cat >"$root/bin/apt-cache" <<E2
#!/bin/sh
[ -f "$root/offered/\$2" ] && sed "s/.*/\$2 | & | a mirror/" "$root/offered/\$2"
exit 0
E2
cat >"$root/bin/apt-get" <<E2
#!/bin/sh
[ "\$1" = install ] || exit 0
shift
for word; do case \$word in -*) ;; *) echo "\$word" >>"$root/installed" ;; esac; done
E2
printf '#!/bin/sh\nexec "$@"\n' >"$root/bin/sudo"
cat >"$root/bin/cmake" <<E2
#!/bin/sh
[ ! -f "$root/cmake_says" ] || { cat "$root/cmake_says"; exit 1; }
E2
printf '#!/bin/sh\n' | tee "$root/bin/ninja" "$root/bin/c++" >/dev/null
chmod +x "$root"/bin/*

# offer COLUMN: the mirror has every package of that column of the table, in its version there.
offer() {
  rm -rf "$root/offered"; mkdir "$root/offered"
  awk -v column="$1" '$column != "-" { print $1, ($column == "*" ? "1.0-1" : $column) }' <<<"$table" |
    while read -r name version; do echo "$version" >"$root/offered/$name"; done
}
# run STATUS NAME; the file os-release on standard input.
failures=0
complain() { echo "setup_test: $*"; failures=1; }
run() {
  local status=0
  cat >"$root/os-release"
  rm -f "$root/installed"; touch "$root/installed"
  PATH="$root/bin:$PATH" EARSHOT_OS_RELEASE="$root/os-release" bash "$root/tree/scripts/setup.sh" >"$root/output" 2>&1 || status=$?
  [ "$status" = "$1" ] || { complain "$2: status $status, expected $1"; cat "$root/output"; }
}
bookworm='ID=debian
PRETTY_NAME="Debian GNU/Linux 12 (bookworm)"
VERSION_CODENAME=bookworm'
trixie=${bookworm//bookworm/trixie}

for release in "2 $bookworm" "3 $trixie"; do
  column=${release%% *}
  offer "$column"
  run 0 "column $column" <<<"${release#* }"
  expected=$(awk -v column="$column" '$column == "*" { print $1 } $column != "-" && $column != "*" { print $1 "=" $column }' <<<"$table" | sort)
  [ "$(sort "$root/installed")" = "$expected" ] || { complain "column $column installs other packages"; diff <(sort "$root/installed") <(echo "$expected") || true; }
  # Versions that the mirror no longer has: three, drawn at random.
  for name in $(awk -v column="$column" '$column ~ /[0-9]/ { print $1 }' <<<"$table" | shuf -n 3); do
    echo "99:1-1" >"$root/offered/$name"
    run 0 "another $name" <<<"${release#* }"
    grep -qx "$name" "$root/installed" || complain "column $column: $name is not taken in the version offered"
    grep -q "taking the newest $name" "$root/output" || complain "column $column: the other version of $name is not said"
  done
done

# Derivatives take what they offer, by ID or by ID_LIKE, with one of the two compilers.
offer 3
for ids in 'ID=ubuntu
ID_LIKE=debian' 'ID=linuxmint
ID_LIKE="ubuntu debian"' 'ID=debian
VERSION_CODENAME=sid'; do
  run 0 "$ids" <<<"$ids"
  grep -q "is not tested" "$root/output" || complain "$ids: nothing says that it is not tested"
  grep -qx libembree-dev "$root/installed" || complain "$ids: libembree-dev is not installed in the version offered"
  ! grep -q = "$root/installed" || complain "$ids: asks for the versions of Debian"
  grep -qx clang-19 "$root/installed" && ! grep -qx clang-14 "$root/installed" || complain "$ids: takes another clang than the one offered"
done

# Other systems: nothing is installed; a line names the packages, unless the headers are there.
fedora='ID=fedora
PRETTY_NAME="Fedora Linux 43"'
echo "earshot: missing Recast.h: apt-get install librecast-dev" >"$root/cmake_says"
run 2 "headers missing" <<<"$fedora"
for word in Fedora "missing Recast.h" libtorch-dev; do grep -q "$word" "$root/output" || complain "headers missing: no word of $word"; done
[ ! -s "$root/installed" ] || complain "installs packages on Fedora"
rm "$root/cmake_says"
run 0 "headers there" <<<"$fedora"
run 0 "no os-release" </dev/null
exit "$failures"
