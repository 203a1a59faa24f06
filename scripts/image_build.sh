#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# scripts/image_build.sh FOLDER
# First stage of the Dockerfile: installs what a build needs, builds the program, and puts its .deb into FOLDER.
set -euo pipefail
cd "$(dirname "$0")/.."

[ $# = 1 ] || { echo "image_build: takes the folder for the .deb" >&2; exit 2; }
mkdir -p "$1"
scripts/setup.sh
scripts/build.sh release --target earshot
scripts/build_deb.sh
cp build/release/deb/earshot_*.deb "$1/"
