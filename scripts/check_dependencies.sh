#!/usr/bin/env bash
# Fails if a header that the sources include by <...> belongs to no package of scripts/setup.sh, or a package that CMake names to the user is not
# in scripts/setup.sh.  nanobind, which python/ includes, comes from the Python package index (pyproject.toml), and Python.h from the Python of the
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
folders+=" /usr/include/recastnavigation /usr/include/torch/csrc/api/include /usr/include/hdf5/serial"

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
for header in $(git ls-files '*.h' '*.cpp' | xargs grep -hoE '^ *# *include *<[^>]+[./][^>]*>' | sed -E 's/.*<(.*)>/\1/' | grep -vE '^(nanobind/|Python\.h$|pyconfig\.h$)' | sort -u); do
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
exit "$failed"
