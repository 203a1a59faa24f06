#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/release.sh [--check] [--debs FOLDER]
# Checks that this checkout can be released, and builds what a release consists of into build/dist: the source distribution, wheels, the .deb of this
# distribution, the bill of materials of the program (SBOM) and SHA256SUMS.  Uploads nothing and sets no tag; it prints how.
#   --check        only checks: no uncommitted change, the version in all places (scripts/check_version.sh), a dated section in CHANGELOG.md, a free tag
#   --debs FOLDER  takes further .deb files, of other distributions, from FOLDER; they must have the same version
# EARSHOT_PYTHONS: the Pythons whose wheels are built (default: "python3.11 python3.12").
set -euo pipefail
scripts=$(cd "$(dirname "$0")" && pwd)
cd "${EARSHOT_TREE:-$scripts/..}"  # EARSHOT_TREE: another checkout, for tests

check_only= debs=
while [ $# -gt 0 ]; do
  case $1 in
    --check) check_only=1; shift ;;
    --debs) debs=${2:-}; [ -d "$debs" ] || { echo "release: --debs takes a folder; '$debs' is none" >&2; exit 2; }; shift 2 ;;
    *) echo "release: unknown argument '$1' (--check, --debs FOLDER)" >&2; exit 2 ;;
  esac
done

failed=0
complain() { echo "release: $*" >&2; failed=1; }
version=$(EARSHOT_TREE=$PWD "$scripts/check_version.sh" --print)
EARSHOT_TREE=$PWD "$scripts/check_version.sh" >/dev/null || complain "the version is not the same in all places; see the lines above"
if grep -qE "^## \[${version//./\\.}\] - Unreleased\$" CHANGELOG.md; then complain "the section of $version in CHANGELOG.md is Unreleased; write the date there and into CITATION.cff"; fi
changes=$(git status --porcelain)
[ -z "$changes" ] || complain "$(wc -l <<<"$changes") files differ from the commit, the first is $(head -n 1 <<<"$changes" | cut -c4-); commit or remove them"
if git rev-parse -q --verify "refs/tags/v$version" >/dev/null; then complain "the tag v$version exists; raise the version in CMakeLists.txt"; fi
for file in LICENSE README.md SECURITY.md; do [ -f "$file" ] || complain "$file is missing"; done
for deb in ${debs:+"$debs"/*.deb}; do
  [ "$(dpkg-deb -f "$deb" Version | cut -d- -f1)" = "$version" ] || complain "$deb has version $(dpkg-deb -f "$deb" Version), not $version"
done
[ "$failed" = 0 ] || exit 1
echo "release: $version can be released from $(git rev-parse --short HEAD)"
if [ -n "$check_only" ]; then exit 0; fi

dist=$PWD/build/dist
rm -rf "$dist"
mkdir -p "$dist"
read -ra pythons <<<"${EARSHOT_PYTHONS:-python3.11 python3.12}"

scripts/build_wheel.sh "${pythons[@]}"
cp build/wheel/*.whl "$dist/"
# The tools of build_wheel.sh are there by now.
build/wheel_tools/bin/pip install -q --disable-pip-version-check -c python/tests/tested_versions.txt build
build/wheel_tools/bin/python -m build --sdist --outdir "$dist" . >/dev/null

scripts/build.sh release --target earshot
scripts/build_deb.sh
cp build/release/deb/*.deb "$dist/"
for deb in ${debs:+"$debs"/*.deb}; do cp "$deb" "$dist/"; done
cp build/release/earshot.cdx.json "$dist/earshot-$version.cdx.json"

for pattern in "earshot_rl-$version-*.whl" "earshot_rl-$version.tar.gz" "earshot_$version-*.deb" "earshot-$version.cdx.json"; do
  compgen -G "$dist/$pattern" >/dev/null || { echo "release: build/dist has no $pattern" >&2; exit 1; }
done
(cd "$dist" && sha256sum -- * >SHA256SUMS && sha256sum -c --quiet SHA256SUMS)
[ -z "$(git status --porcelain)" ] || { echo "release: the build has changed tracked files, or left others beside them" >&2; exit 1; }
ls -l "$dist"
echo "release: next: git tag -a v$version -m 'Earshot $version' && git push origin v$version; then upload build/dist"
