#!/usr/bin/env bash
# Fails on any include against the arrow  sim <- envs <- policy <- trainer <- apps,  on one between the stages inside sim against
# base <- rays <- scene <- {acoustics, vision, nav} (audio stands on base), on one between the stages inside sim/acoustics against
# core <- geometry <- model <- paths <- tracers <- source_field <- response <- synthesis <- metrics <- accuracy, and on a library header outside the
# folder that owns it.  A program bench/learner_*_bench.cpp, which nothing links, may use policy, trainer and torch.
# Usage: check_layering.sh [ROOT]     ROOT: the source tree, by default the one this script is in
set -euo pipefail
cd "${1:-$(dirname "$0")/..}"
failures=0

# allowed FOLDER "ALLOWED PREFIXES" [EXCEPTION]: every #include "..." in FOLDER must start with one of them, but in files with a name like EXCEPTION.
allowed() {
  local folder=$1 file line path prefix ok
  while IFS=: read -r file line path; do
    [ -n "$file" ] || continue
    path=${path#*\"}; path=${path%%\"*}
    [ -e "$path" ] || continue                      # a library's or a generated header
    ok=0
    for prefix in $2; do case "$path" in "$prefix"/*) ok=1 ;; esac; done
    if [ "$ok" = 0 ]; then echo "layering: $file:$line includes $path, but $folder may only use: $2"; failures=1; fi
  done < <(grep -rnE '^[[:space:]]*#[[:space:]]*include[[:space:]]*"' --include='*.h' --include='*.cpp' ${3:+--exclude="$3"} "$folder" || true)
}

# owned PATTERN "FOLDERS OR FILES": only they include headers that match PATTERN.
owned() {
  local hits
  hits=$(grep -rlE "#[[:space:]]*include[[:space:]]*<($1)" --include='*.h' --include='*.cpp' sim envs python bench policy trainer apps | grep -vE "^($2)" || true)
  if [ -n "$hits" ]; then echo "layering: <$1> is included outside $2: $hits"; failures=1; fi
}

allowed sim/base      "sim/base"
allowed sim/rays      "sim/base sim/rays"
allowed sim/scene     "sim/base sim/rays sim/scene"
allowed sim/audio     "sim/base sim/audio"
allowed sim/sofa      "sim/base sim/sofa"
allowed sim/acoustics "sim/base sim/rays sim/scene sim/audio sim/acoustics"
stages=""
for stage in core geometry model paths tracers source_field response synthesis metrics accuracy; do
  stages="$stages sim/acoustics/$stage"
  allowed "sim/acoustics/$stage" "sim/base sim/rays sim/scene sim/audio$stages"
done
allowed sim/vision    "sim/base sim/rays sim/scene sim/vision"
allowed sim/nav       "sim/base sim/rays sim/scene sim/nav"
allowed sim/reader    "sim/base sim/scene sim/audio sim/vision"
allowed envs          "sim envs"
allowed python        "sim envs python"
allowed bench         "sim envs bench" "learner_*_bench.cpp"
allowed policy        "sim envs policy"
allowed trainer       "sim envs policy trainer"
allowed apps          "sim envs bench policy trainer apps"

owned 'embree'            'sim/rays/'
owned 'assimp'            'sim/scene/'
owned 'Recast|Detour'     'sim/nav/'
owned 'sndfile|mysofa|libav|libsw|samplerate' 'sim/audio/'
owned 'hdf5'              'sim/sofa/'
owned 'yaml-cpp'         'sim/base/config_reader.cpp|trainer/effective_config.cpp'
owned 'zmq'               'trainer/'
owned 'torch'             'policy/|trainer/|bench/learner_[a-z_]*_bench.cpp'

[ "$failures" = 0 ] && echo "layering: every include follows the arrow"
exit "$failures"
