#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fails if a header that the sources include by <...> belongs to no package of scripts/setup.sh, or a package that CMake names to the user is not
# in scripts/setup.sh, or docs/dependencies.md lacks a package of scripts/setup.sh or has another version or licence.  nanobind, which python/ includes, comes from the Python package index (pyproject.toml), and Python.h from the Python of the
# build.  Ends with 77 (skipped) where dpkg is not the package manager.
set -euo pipefail
cd "$(dirname "$0")/.."
command -v dpkg-query >/dev/null || exit 77

# Packages that setup.sh names, and those that g++ brings.
listed=$(sed -n "/^packages='/,/^'/p" scripts/setup.sh | awk 'NF == 3 { print $1 }' | sort -u)
compiler='^(libc6-dev|linux-libc-dev|libstdc\+\+-[0-9]+-dev|libgcc-[0-9]+-dev)$'
failed=0
complain() { echo "check_dependencies: $*" >&2; failed=1; }

for package in $(sed -nE '/^set\(EARSHOT_HEADERS_/,/\)$/p; /list\(APPEND headers/p' cmake/EarshotDependencies.cmake cmake/dependencies.cmake |
                 grep -oE '[a-z0-9+-]+-dev' | sort -u); do
  grep -qx "$package" <<<"$listed" || complain "cmake names $package, which scripts/setup.sh does not install"
done

# Where the compiler looks, and the folders that CMake adds.
folders=$(LC_ALL=C g++ -xc++ -E -v /dev/null 2>&1 >/dev/null | sed -n '/^#include </,/^End/s/^ //p')
folders+=" /usr/include/recastnavigation /usr/include/torch/csrc/api/include /usr/include/hdf5/serial $(echo /usr/include/*/mpi)"

find_header() {
  local folder
  for folder in $folders; do if [ -f "$folder/$1" ]; then realpath "$folder/$1"; return; fi; done
  return 1
}
# Headers of which a machine has one or another, as cmake names them: a|b.
alternatives=$(grep -oE '[^ ]+\|[^ ]+' cmake/EarshotDependencies.cmake | grep '\.h' || true)
has_alternative() {
  local names name
  names=$(grep -E "(^|\|)$1(\||\$)" <<<"$alternatives") || return 1
  for name in ${names//|/ }; do if find_header "$name" >/dev/null; then return 0; fi; done
  return 1
}

declare -A header_of  # by the file's path
# Headers of the C++ library have neither folder nor ending.
for header in $(git ls-files '*.h' '*.cpp' | xargs grep -hoE '^ *# *include *<[^>]+[./][^>]*>' | sed -E 's/.*<(.*)>/\1/' | grep -vE '^(earshot/|nanobind/|Python\.h$|pyconfig\.h$)' | sort -u); do
  if file=$(find_header "$header"); then
    header_of[$file]=$header
  elif ! has_alternative "$header"; then
    complain "no installed package has <$header>"
  fi
done
while IFS=: read -r package file; do
  package=${package%%:*} file=${file##* }
  grep -qxE "$compiler" <<<"$package" || grep -qxF "$package" <<<"$listed" ||
    complain "<${header_of[$file]:-$file}> is in $package, which scripts/setup.sh does not install"
done < <(dpkg-query -S "${!header_of[@]}" | grep -v '^diversion' | sed -E 's/^([^:]+)(:[a-z0-9]+)?: /\1:/')

# The page: versions as in setup.sh, without epoch and Debian revision; licences as in library_licences.txt, of what is installed here.
upstream() {
  case $1 in
    \*) echo any ;;
    -) echo none ;;
    *) sed -E 's/^[0-9]+://; s/-[^-]*$//; s/[+~](dfsg|ds|repack).*$//' <<<"$1" ;;
  esac
}
page=${EARSHOT_DEPENDENCIES_PAGE:-docs/dependencies.md}
declare -A licence_of source_of
while read -r name licence; do licence_of[$name]=$licence; done < <(grep -v '^#' scripts/library_licences.txt)
while IFS=$'\t' read -r name source; do source_of[$name]=$source; done < <(
  xargs dpkg-query -W -f '${Package}\t${source:Package}\n' <<<"$listed" 2>/dev/null || true)
while read -r name bookworm trixie; do
  row=$(awk -F ' *\\| *' -v name="$name" 'NF == 9 { count = split($2, names, /, */); for (i = 1; i <= count; i++) if (names[i] == name) print $3 "|" $4 "|" $5 }' "$page")
  versions="$(upstream "$bookworm")|$(upstream "$trixie")"
  if [ -z "$row" ]; then complain "$page has no row of $name, which scripts/setup.sh installs"; continue; fi
  [ "${row%|*}" = "$versions" ] || complain "$page has $name in the versions ${row%|*}, scripts/setup.sh in $versions"
  licence=${licence_of[${source_of[$name]:-none}]:-}
  [ -z "$licence" ] || [ "${row##*|}" = "$licence" ] || complain "$page has $name under '${row##*|}', scripts/library_licences.txt under '$licence'"
done < <(sed -n "/^packages='/,/^'/p" scripts/setup.sh | awk 'NF == 3')
# Rows of packages that setup.sh no longer installs.
for name in $(awk -F ' *\\| *' 'NF == 9 && $2 !~ /^(package|-+)$/ { gsub(/,/, " ", $2); print $2 }' "$page"); do
  grep -qxF "$name" <<<"$listed" || complain "$page has a row of $name, which scripts/setup.sh does not install"
done
exit "$failed"
