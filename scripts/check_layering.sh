#!/usr/bin/env bash
# Fails on any include against the arrows, on a library header outside the folder that owns it, and on a folder of sources without a README.md that
# says what it holds.
#   all              sim <- envs <- {datasets, policy};  policy <- trainer <- evaluation <- bench <- apps;  python over sim, envs and datasets
#   in sim           base <- rays <- scene <- {acoustics, vision, nav}; audio stands on base
#   in sim/base      its own files <- text <- process <- charts
#   in sim/scene     mesh <- materials <- generators <- readers <- its own files
#   in sim/audio     transforms <- dry_sounds <- head <- stream
#   in sim/acoustics core <- geometry <- model <- paths <- tracers <- source_field <- response <- synthesis <- metrics <- accuracy
#   in envs          task <- episodes <- sensors <- scenes <- config <- hearing <- batch <- baselines
#   in trainer       net <- launch <- collective <- learner <- rollout <- checkpoint <- curves <- run; the first three use of the rest sim/base alone
#   in evaluation    results <- leaderboard <- replay
#   in bench         measure <- accuracy <- speed <- soak; questions is programs that nothing links
#   in apps          options <- {sound, scene, dataset, training, board, bench}
# Of bench only training/ and the programs questions/learner_*_bench.cpp use policy and trainer.
# Usage: check_layering.sh [ROOT]     ROOT: the source tree, by default the one this script is in
set -euo pipefail
cd "${1:-$(dirname "$0")/..}"
failures=0

# allowed FOLDER "ALLOWED PREFIXES" [GREP OPTION...]: every #include "..." in FOLDER must be or lie in one of them, but in files that an option leaves
# out.
allowed() {
  local folder=$1 file line path prefix ok
  while IFS=: read -r file line path; do
    [ -n "$file" ] || continue
    path=${path#*\"}; path=${path%%\"*}
    [ -e "$path" ] || continue                      # a library's or a generated header
    ok=0
    for prefix in $2; do case "$path" in "$prefix" | "$prefix"/*) ok=1 ;; esac; done
    if [ "$ok" = 0 ]; then echo "layering: $file:$line includes $path, but $folder may only use: $2"; failures=1; fi
  done < <(grep -srnE '^[[:space:]]*#[[:space:]]*include[[:space:]]*"' --include='*.h' --include='*.cpp' "${@:3}" "$folder" || true)
}

# owned PATTERN "FOLDERS OR FILES": only they include headers that match PATTERN.
owned() {
  local hits
  hits=$(grep -rlE "#[[:space:]]*include[[:space:]]*<($1)" --include='*.h' --include='*.cpp' sim envs datasets python bench policy trainer evaluation apps | grep -vE "^($2)" || true)
  if [ -n "$hits" ]; then echo "layering: <$1> is included outside $2: $hits"; failures=1; fi
}

# chain FOLDER "ROOMS" "ALLOWED PREFIXES": each room of FOLDER may use those before it, and what is allowed to all.
chain() {
  local room rooms=""
  for room in $2; do
    rooms="$rooms $1/$room"
    allowed "$1/$room" "$3$rooms"
  done
}

allowed sim/base      "sim/base"
allowed sim/base      "$(echo sim/base/*.h)" --exclude-dir={text,process,charts}
chain   sim/base      "text process charts" "$(echo sim/base/*.h)"
allowed sim/rays      "sim/base sim/rays"
allowed sim/scene     "sim/base sim/rays sim/scene"
chain   sim/scene     "mesh materials generators readers" "sim/base sim/rays"
allowed sim/audio     "sim/base sim/audio"
chain   sim/audio     "transforms dry_sounds head stream" "sim/base"
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
chain envs "task episodes sensors scenes config hearing batch baselines" "sim"
allowed envs          "sim envs"
allowed datasets      "sim envs datasets"
allowed python        "sim envs datasets python"
allowed policy        "sim envs policy"
chain trainer "net launch collective" "sim/base"
chain trainer "net launch collective learner rollout checkpoint curves run" "sim envs policy"
allowed trainer       "sim envs policy trainer"
chain evaluation "results leaderboard replay" "sim envs policy trainer"
allowed evaluation    "sim envs policy trainer evaluation"
allowed bench         "sim envs bench" --exclude-dir=training --exclude='learner_*_bench.cpp'
chain bench "measure accuracy speed soak" "sim envs"
allowed bench         "sim envs policy trainer evaluation bench"
for room in options sound scene dataset training board; do allowed "apps/$room" "sim envs datasets policy trainer evaluation apps/commands.h apps/options apps/$room"; done
allowed apps/bench    "sim envs datasets policy trainer evaluation bench apps/commands.h apps/options apps/bench"
allowed apps          "sim envs datasets policy trainer evaluation bench apps"

owned 'embree'            'sim/rays/'
owned 'assimp'            'sim/scene/'
owned 'Recast|Detour'     'sim/nav/'
owned 'sndfile|mysofa|libav|libsw|samplerate' 'sim/audio/'
owned 'hdf5'              'sim/sofa/'
owned 'yaml-cpp'         'sim/base/text/config_reader.cpp|trainer/run/effective_config.cpp'
owned 'zmq'               'trainer/net/|trainer/collective/|bench/training/'
owned 'torch'             'policy/|trainer/|bench/questions/learner_[a-z_]*_bench.cpp'

while read -r folder; do
  [ -f "$folder/README.md" ] || { echo "layering: $folder has no README.md that says what it holds"; failures=1; }
done < <(find sim envs datasets policy trainer evaluation bench apps \( -name '*.cpp' -o -name '*.h' \) -printf '%h\n' | sort -u)

[ "$failures" = 0 ] && echo "layering: every include follows the arrow"
exit "$failures"
