#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/build_deb.sh [BUILD FOLDER]
# Makes a .deb with the program of a build (default build/release) for the distribution of this machine, in BUILD FOLDER/deb, and prints its path and size.
# It holds the programs, configs, documents, the manual page, completion for bash and zsh, and the licence.  What it depends on is what
# dpkg-shlibdeps finds.  Builds the program first where it is not up to date.
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "build_deb: $*" >&2; exit 1; }
for tool in cpack:cmake dpkg-shlibdeps:dpkg-dev file:file; do
  command -v "${tool%:*}" >/dev/null || { echo "build_deb: ${tool%:*} is missing: apt-get install ${tool#*:}" >&2; exit 2; }
done
build=${1:-build/release}
[ -f "$build/CPackConfig.cmake" ] || cmake "$build" >/dev/null 2>&1 || { echo "build_deb: $build is no folder of a build; run scripts/build.sh" >&2; exit 2; }
targets=(earshot shell_files)
if cmake --build "$build" --target help | grep -q '^sbom:'; then targets+=(sbom); fi
cmake --build "$build" --target "${targets[@]}" -- -j "${EARSHOT_JOBS:-$(nproc)}" >"$build/deb.log" || { tail -n 20 "$build/deb.log" >&2; fail "the program does not build"; }
[ -f "$build/CPackConfig.cmake" ] || fail "$build has no CPackConfig.cmake: it was configured without EARSHOT_BUILD_TRAINING"
rm -rf "$build/deb"
cpack -G DEB --config "$build/CPackConfig.cmake" -B "$build/deb" >"$build/deb.log" 2>&1 || { tail -n 20 "$build/deb.log" >&2; fail "cpack failed"; }
rm -rf "$build/deb/_CPack_Packages"

# What is in it.
deb=$(echo "$build"/deb/*.deb)
[ -f "$deb" ] || fail "cpack made another number of packages than one: $deb"
contents=$(dpkg-deb --contents "$deb" | awk '{print $6}')
for path in bin/earshot libexec/earshot/earshot_training libexec/earshot/earshot_reader share/earshot/configs/train/quick.yaml share/man/man1/earshot.1.gz \
  share/bash-completion/completions/earshot share/zsh/vendor-completions/_earshot share/doc/earshot/copyright share/doc/earshot/README.md; do
  grep -qx "./usr/$path" <<<"$contents" || fail "$deb has no /usr/$path"
done
if extra=$(grep -E '\.(h|a|cmake)$' <<<"$contents"); then fail "$deb has files of developers: $(head -n 3 <<<"$extra" | tr '\n' ' ')"; fi
[ "$(dpkg-deb -f "$deb" Version | cut -d- -f1)" = "$(scripts/check_version.sh --print)" ] || fail "$deb has the version $(dpkg-deb -f "$deb" Version)"
depends=$(dpkg-deb -f "$deb" Depends)
for library in libc6 libtorch libembree libopenblas0-pthread; do
  [[ "$depends" == *$library* ]] || fail "$deb does not depend on $library: $depends"
done
echo "$deb: $(stat -c %s "$deb") bytes, $(dpkg-deb -f "$deb" Installed-Size) KiB installed"
