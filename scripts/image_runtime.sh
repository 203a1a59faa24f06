#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/image_runtime.sh FOLDER
# Last stage of the Dockerfile: installs the .deb of FOLDER with the libraries that it needs, adds the user earshot, and removes FOLDER and the lists
# and packages of apt.
set -euo pipefail

[ $# = 1 ] || { echo "image_runtime: takes the folder with the .deb" >&2; exit 2; }
debs=("$1"/earshot_*.deb)
[ ${#debs[@]} = 1 ] && [ -f "${debs[0]}" ] || { echo "image_runtime: $1 holds another number of files earshot_*.deb than one: ${debs[*]}" >&2; exit 2; }
export DEBIAN_FRONTEND=noninteractive
# As in the slim images of Debian: no documents and translations but licences.  Mesa's driver and its compiler (170 MB) draw on the CPU, slower than
# Embree does: the image leaves them out.  A driver of a graphics card comes from the host.  libtorch asks for Open MPI, that for AMD's run time, which
# opens its compiler of kernels (190 MB with an LLVM of its own) only for a card of theirs.
cat >/etc/dpkg/dpkg.cfg.d/earshot <<'EXCLUDE'
path-exclude /usr/share/doc/*
path-include /usr/share/doc/*/copyright
path-exclude /usr/share/info/*
path-exclude /usr/share/locale/*
path-exclude /usr/share/man/*
path-exclude /usr/lib/*/libLLVM*
path-exclude /usr/lib/*/libgallium-*
path-exclude /usr/lib/llvm-*
path-exclude /usr/lib/*/libamd_comgr*
EXCLUDE
apt-get update -qq
apt-get install -y -qq --no-install-recommends "$(realpath "${debs[0]}")" >/dev/null
useradd --create-home --uid 1000 --shell /bin/bash earshot
apt-get clean
rm -rf "$1" /var/lib/apt/lists/* /var/cache/debconf/*-old /var/log/apt /var/log/dpkg.log
