#!/usr/bin/env bash
# Installs every package that Earshot needs on a bare Debian 12 machine.  Run as root, or with sudo available.  Safe to run again.
set -euo pipefail

# name=version: the versions Earshot is tested with.  A point release of Debian may have replaced one of them by a security fix;
# then the newest of the same package is taken, with a message.
packages=(
  g++ cmake ninja-build ccache git ca-certificates
  libembree-dev=3.13.5+dfsg-2
  libassimp-dev=5.2.5~ds0-1+b1
  librecast-dev=1.5.1+git20210215.e75adf8-1+b1
  libmeshoptimizer-dev=0.18+dfsg-2
  libglm-dev=0.9.9.8+ds-6
  libegl-dev=1.6.0-1
  libgles-dev=1.6.0-1
  libegl-mesa0=22.3.6-1+deb12u2
  libgl1-mesa-dri=22.3.6-1+deb12u2
  libtorch-dev=1.13.1+dfsg-4
  libgloo-dev=0.0~git20220518.5b14351-3
  libopenblas0-pthread=0.3.21+ds-4
  libzmq3-dev=4.3.4-6
  cppzmq-dev=4.9.0-1
  libmsgpack-cxx-dev=4.1.3-1
  libtbb-dev=2021.8.0-2+deb12u1
  libmysofa-dev=1.3.1~dfsg0-1
  libsndfile1-dev=1.2.0-1+deb12u1
  libavutil-dev=7:5.1.9-0+deb12u1
  libswresample-dev=7:5.1.9-0+deb12u1
  libsamplerate0-dev=0.2.2-3
  libyaml-cpp-dev=0.7.0+dfsg-8+b1
  nlohmann-json3-dev=3.11.2-2
  libcli11-dev=2.1.2+ds-1
  libfmt-dev=9.1.0+ds1-2
  libspdlog-dev=1:1.10.0+ds-0.4
  libxxhash-dev=0.8.1-1
  zlib1g-dev
  libpng-dev=1.6.39-2+deb12u6
  libturbojpeg0-dev=1:2.1.5-2
  libhdf5-dev=1.10.8+repack1-1
  libjs-three=111+dfsg1-3
  libgtest-dev=1.12.1-0.2
  libgmock-dev=1.12.1-0.2
  iproute2=6.1.0-3
  openmpi-bin=4.1.4-3+b1
  slurm-wlm=22.05.8-4+deb12u3
  libbenchmark-dev=1.7.1-1
  clang-14=1:14.0.6-12
  libclang-rt-14-dev=1:14.0.6-12
  clang-format-14=1:14.0.6-12
  mold=1.10.1+dfsg-1
  python3-dev python3-venv
)

as_root() { if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi; }
export DEBIAN_FRONTEND=noninteractive

as_root apt-get update -qq
wanted=()
for package in "${packages[@]}"; do
  name=${package%%=*}
  offered=$(apt-cache madison "$name")
  if [ "$name" != "$package" ] && [[ "$offered" != *" ${package#*=} "* ]]; then
    echo "setup: ${package} is not offered here; taking the newest ${name}" >&2
    package=$name
  fi
  wanted+=("$package")
done
as_root apt-get install -y -qq --no-install-recommends --allow-downgrades "${wanted[@]}" >/dev/null

# libtorch alone pulls the reference BLAS, which trains several times slower: the optimized one must be the one in use.
blas=$(readlink -f /usr/lib/*/libblas.so.3 | head -n 1)
case "$blas" in
  *openblas*) ;;
  *) echo "setup: BLAS is $blas, not OpenBLAS: choose it with 'update-alternatives --config libblas.so.3-$(uname -m)-linux-gnu'" >&2; exit 1 ;;
esac
echo "setup: done (BLAS: $blas)"
