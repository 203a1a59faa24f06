#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs every package that Earshot needs on Debian 12 and 13.  Run as root, or with sudo available.  Safe to run again.
# On a derivative of Debian (ID_LIKE in /etc/os-release) it installs the same packages in the versions offered there.  On other systems it installs
# nothing: it names the headers that are missing, if any, and the Debian packages that hold them.
set -euo pipefail
cd "$(dirname "$0")/.."

# package, and the version that Earshot is tested with on Debian 12 and 13.  `*` takes the version offered, `-` leaves the package out.  Where the
# mirror has another version than the tested one (a security fix), setup takes that version and says so.
packages='
  g++                      *                          *
  cmake                    *                          *
  ninja-build              *                          *
  ccache                   *                          *
  git                      *                          *
  dpkg-dev                 *                          *
  file                     *                          *
  ca-certificates          *                          *
  libembree-dev            3.13.5+dfsg-2              4.3.3+dfsg-1
  librecast-dev            1.5.1+git20210215.e75adf8-1+b1 1.5.1+git20210215.e75adf8-1+b2
  libmeshoptimizer-dev     0.18+dfsg-2                0.22+dfsg-1
  libglm-dev               0.9.9.8+ds-6               0.9.9.8+ds-9
  libegl-dev               1.6.0-1                    1.7.0-1+b2
  libgles-dev              1.6.0-1                    1.7.0-1+b2
  libegl-mesa0             22.3.6-1+deb12u2           25.0.7-2+deb13u1
  libgl1-mesa-dri          22.3.6-1+deb12u2           25.0.7-2+deb13u1
  libtorch-dev             1.13.1+dfsg-4              2.6.0+dfsg-7
  libgloo-dev              0.0~git20220518.5b14351-3  0.0~git20231202.5354032-3+b2
  libopenblas0-pthread     0.3.21+ds-4                0.3.29+ds-3
  libzmq3-dev              4.3.4-6                    4.3.5-1+b3
  cppzmq-dev               4.9.0-1                    4.10.0-1+b2
  libmsgpack-cxx-dev       4.1.3-1                    7.0.0-1+b1
  libtbb-dev               2021.8.0-2+deb12u1         2022.1.0-1+deb13u1
  libmysofa-dev            1.3.1~dfsg0-1              1.3.3+dfsg-1
  libsndfile1-dev          1.2.0-1+deb12u1            1.2.2-2+deb13u1
  libavutil-dev            7:5.1.9-0+deb12u1          7:7.1.5-0+deb13u1
  libswresample-dev        7:5.1.9-0+deb12u1          7:7.1.5-0+deb13u1
  libsamplerate0-dev       0.2.2-3                    0.2.2-4+b2
  libyaml-cpp-dev          0.7.0+dfsg-8+b1            0.8.0+dfsg-7
  libyaml-dev              0.2.5-1                    0.2.5-2
  nlohmann-json3-dev       3.11.2-2                   3.11.3-2.1
  libcli11-dev             2.1.2+ds-1                 2.4.1+ds-2
  libfmt-dev               9.1.0+ds1-2                10.1.1+ds1-4
  libspdlog-dev            1:1.10.0+ds-0.4            1:1.15.2+ds-2
  libxxhash-dev            0.8.1-1                    0.8.3-2
  zlib1g-dev               *                          *
  libpng-dev               1.6.39-2+deb12u6           1.6.48-1+deb13u6
  libturbojpeg0-dev        1:2.1.5-2                  1:2.1.5-4
  libhdf5-dev              1.10.8+repack1-1           1.14.5+repack-3
  libjs-three              111+dfsg1-3                111+dfsg1-3
  libgtest-dev             1.12.1-0.2                 1.16.0-1
  libgmock-dev             1.12.1-0.2                 1.16.0-1
  iproute2                 6.1.0-3                    6.15.0-1
  openmpi-bin              4.1.4-3+b1                 5.0.7-1
  libopenmpi-dev           4.1.4-3+b1                 5.0.7-1
  slurm-wlm                22.05.8-4+deb12u3          24.11.5-4+deb13u1
  python3-torch            1.13.1+dfsg-4              2.6.0+dfsg-7
  libbenchmark-dev         1.7.1-1                    1.9.1-1
  clang-14                 1:14.0.6-12                -
  libclang-rt-14-dev       1:14.0.6-12                -
  clang-format-14          1:14.0.6-12                -
  clang-tidy-14            1:14.0.6-12                -
  llvm-14                  1:14.0.6-12                -
  clang-19                 -                          1:19.1.7-3+b1
  libclang-rt-19-dev       -                          1:19.1.7-3+b1
  mold                     1.10.1+dfsg-1              2.37.1+dfsg-1
  python3-dev              *                          *
  doxygen                  1.9.4-4                    1.9.8+ds-2.1
  python3-venv             *                          *
'

as_root() { if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi; }
export DEBIAN_FRONTEND=noninteractive

# EARSHOT_OS_RELEASE: another file in place of /etc/os-release, for tests.
os_release=${EARSHOT_OS_RELEASE:-/etc/os-release}
field() { sed -nE "s/^$1=\"?([^\"]*)\"?\$/\\1/p" "$os_release" 2>/dev/null | head -n 1; }
id=$(field ID) like=" $(field ID) $(field ID_LIKE) " codename=$(field VERSION_CODENAME)
case "$id $codename" in
  "debian bookworm") system=debian column=2 ;;
  "debian trixie") system=debian column=3 ;;
  *) case $like in *" debian "* | *" ubuntu "*) system=derivative column= ;; *) system=other column= ;; esac ;;
esac

# Without apt: the packages by their Debian names, unless all that a build reads is there.
if [ "$system" = other ]; then
  echo "setup: $(field PRETTY_NAME) is no Debian and no derivative of it; nothing is installed" >&2
  names=$(awk 'NF { print $1 }' <<<"$packages" | tr '\n' ' ')
  for tool in cmake ninja c++; do
    command -v "$tool" >/dev/null || { echo "setup: $tool is missing; install what these packages of Debian hold: $names" >&2; exit 2; }
  done
  probe=$(mktemp -d)
  trap 'rm -rf "$probe"' EXIT
  if ! cmake -S . -B "$probe" -G Ninja >"$probe/log" 2>&1; then
    grep -m 1 'earshot: missing' "$probe/log" >&2 || tail -n 5 "$probe/log" >&2
    echo "setup: install what these packages of Debian hold: $names" >&2
    exit 2
  fi
  echo "setup: every header is there; going on"
  exit 0
fi

as_root apt-get update -qq
wanted=()
while read -r name bookworm trixie; do
  [ -n "$name" ] || continue
  case $column in 2) version=$bookworm ;; 3) version=$trixie ;; *) version=any ;; esac
  [ "$version" != - ] || continue
  offered=$(apt-cache madison "$name")
  # A derivative has one of the compilers that the two releases name.
  if [ "$version" = any ] && [ -z "$offered" ]; then
    case $name in *-14* | *-19*) continue ;; esac
  fi
  case $version in
    \* | any) wanted+=("$name") ;;
    *)
      if [[ "$offered" == *" $version "* ]]; then
        wanted+=("$name=$version")
      else
        echo "setup: $name=$version is not offered here; taking the newest $name" >&2
        wanted+=("$name")
      fi ;;
  esac
done <<<"$packages"
if [ "$system" = derivative ]; then
  echo "setup: $(field PRETTY_NAME) is not tested; taking the versions of each package that it offers" >&2
fi
as_root apt-get install -y -qq --no-install-recommends --allow-downgrades "${wanted[@]}" >/dev/null

# libtorch alone pulls the reference BLAS, which trains several times slower: the optimized one must be the one in use.
blas=$(readlink -f /usr/lib/*/libblas.so.3 | head -n 1)
case "$blas" in
  *openblas*) ;;
  *) echo "setup: BLAS is $blas, not OpenBLAS: choose it with 'update-alternatives --config libblas.so.3-$(uname -m)-linux-gnu'" >&2; exit 1 ;;
esac
echo "setup: done (BLAS: $blas)"
