#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Is an include against the arrow found?  Runs the given check_layering.py on small trees: one in order, and that tree with one wrong include.
set -euo pipefail
check=$1
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT

make_tree() {  # one header per folder, one file that includes in order
  local folders=()
  for folder in sim/base/{text,charts} sim/scene/{mesh,readers} sim/audio/{transforms,measured,head} sim/{base,rays,scene,audio,vision,nav,reader,sofa} sim/acoustics/{core,geometry,model,paths,tracers,source_field,response,synthesis,metrics} \
                envs/{task,episodes,batch} include/earshot api api/{datasets,training} datasets python bench bench/{measure,accuracy,questions,training} policy trainer/{net,collective,run} evaluation/{results,replay} apps apps/{options,sound,board} tests; do
    folders+=("$root/tree/$folder")
  done
  mkdir -p "${folders[@]}"
  for folder in "${folders[@]}"; do
    echo '#pragma once' >"$folder/a.h"
    echo '# what it holds' >"$folder/README.md"
  done
  echo '#include "sim/acoustics/core/a.h"' > "$root/tree/sim/acoustics/metrics/b.cpp"
}
failures=0
# refuses WHAT: the check finds a fault in the tree, and says it.
refuses() {
  local status=0 said
  said=$("$check" "$root/tree" 2>&1) || status=$?
  if [ "$status" != 1 ] || ! grep -q '^layering: ' <<<"$said"; then echo "layering_test: $1: status $status: $said"; failures=1; fi
}
expect() {  # expect STATUS FILE INCLUDE: the tree with that line has that status
  local file=$root/tree/$2 before=""
  if [ -e "$file" ]; then before=$(<"$file"); fi
  echo "#include $3" >>"$file"
  if [ "$1" = 1 ]; then refuses "$3 in $2"
  elif ! "$check" "$root/tree" >/dev/null; then echo "layering_test: $3 in $2 is refused"; failures=1; fi
  if [ -n "$before" ]; then echo "$before" >"$file"; else rm "$file"; fi
}
make_tree
expect 0 sim/acoustics/metrics/b.cpp '"sim/acoustics/synthesis/a.h"'
expect 1 sim/acoustics/core/a.h '"sim/acoustics/geometry/a.h"'
expect 1 sim/acoustics/model/a.h '"sim/acoustics/paths/a.h"'
expect 1 sim/acoustics/source_field/a.h '"sim/acoustics/metrics/a.h"'
expect 1 sim/acoustics/core/a.h '"sim/vision/a.h"'
expect 1 sim/base/a.h '"sim/rays/a.h"'
expect 0 sim/base/charts/a.h '"sim/base/text/a.h"'
expect 0 sim/sofa/a.h '"sim/audio/measured/a.h"'
expect 1 sim/sofa/a.h '"sim/audio/head/a.h"'
expect 1 sim/base/a.h '"sim/base/text/a.h"'
expect 1 sim/base/text/a.h '"sim/base/charts/a.h"'
expect 0 sim/scene/a.h '"sim/scene/readers/a.h"'
expect 1 sim/scene/readers/a.h '"sim/scene/a.h"'
expect 1 sim/scene/mesh/a.h '"sim/scene/readers/a.h"'
expect 1 sim/audio/transforms/a.h '"sim/audio/head/a.h"'
expect 1 bench/measure/a.h '"bench/accuracy/a.h"'
expect 1 envs/task/a.h '"trainer/net/a.h"'
expect 0 envs/batch/a.h '"envs/task/a.h"'
expect 1 envs/task/a.h '"envs/episodes/a.h"'
expect 1 envs/task/a.h '"datasets/a.h"'
expect 1 python/a.h '"datasets/a.h"'
expect 0 python/a.h '"earshot/a.h"'
expect 1 include/earshot/a.h '"sim/base/a.h"'
expect 1 include/earshot/a.h '<glm/vec3.hpp>'
expect 0 include/earshot/a.h '<vector>'
expect 0 api/a.h '"envs/batch/a.h"'
expect 0 api/a.h '"earshot/a.h"'
expect 1 api/a.h '"datasets/a.h"'
expect 0 api/datasets/a.h '"datasets/a.h"'
expect 0 api/training/a.h '"trainer/run/a.h"'
expect 1 envs/task/a.h '"earshot/a.h"'
expect 1 envs/task/a.h '"api/a.h"'
expect 1 policy/a.h '"datasets/a.h"'
expect 0 trainer/run/a.h '"policy/a.h"'
expect 1 trainer/net/a.h '"policy/a.h"'
expect 1 trainer/net/a.h '"trainer/collective/a.h"'
expect 1 trainer/run/a.h '"evaluation/results/a.h"'
expect 1 evaluation/results/a.h '"evaluation/replay/a.h"'
expect 0 bench/training/a.h '"trainer/run/a.h"'
expect 1 apps/a.h '<zmq.hpp>'
expect 0 apps/sound/a.h '"apps/options/a.h"'
expect 1 apps/board/a.h '"apps/sound/a.h"'
expect 1 sim/nav/a.h '<embree3/rtcore.h>'
expect 0 bench/questions/learner_a_bench.cpp '"policy/a.h"'
expect 1 bench/questions/camera_bench.cpp '"policy/a.h"'
expect 0 bench/questions/learner_a_bench.cpp '<torch/types.h>'
expect 1 bench/questions/camera_bench.cpp '<torch/types.h>'
for i in {1..35}; do : >"$root/tree/envs/task/file_$i.cpp"; done
refuses "a folder of 36 sources"
rm "$root"/tree/envs/task/file_*.cpp
awk 'BEGIN { for (i = 0; i < 501; i++) print "// a line" }' >"$root/tree/tests/a_test.cpp"
refuses "a source of 501 lines"
rm "$root/tree/tests/a_test.cpp" "$root/tree/envs/task/README.md"
refuses "a folder without README.md"
echo '# what it holds' >"$root/tree/envs/task/README.md"
if ! "$check" "$root/tree" >/dev/null; then echo "layering_test: the tree in order is refused"; failures=1; fi
exit "$failures"
