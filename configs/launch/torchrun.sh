#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains with torchrun, which starts the workers again when one is lost, or when a host is lost or added:
#   configs/launch/torchrun.sh NUM_WORKERS_PER_HOST CONFIG [key=value]...
# The run continues from its last whole update with the workers that are there (docs/howto/elastic.md).
# On several hosts run the same command on each host, with
#   EARSHOT_NODES   number of hosts, or MIN:MAX
#   EARSHOT_NODE    index of this host from 0
#   MASTER_ADDR     address of host 0, and MASTER_PORT, a port of it at which the agents of torchrun meet
#   EARSHOT_RUN_ID  a name of this run
#   EARSHOT_KEYS    a file of `earshot keys`
# EARSHOT_RESTARTS is the number of restarts after failures (default 10).  EARSHOT_TORCHRUN has additional options of torchrun, for example
# --monitor_interval 1.  Under Python 3.11 torchrun 1.13 needs --redirects and --tee.
set -euo pipefail

workers=${1:?usage: torchrun.sh NUM_WORKERS_PER_HOST CONFIG [key=value]...}
config=${2:?usage: torchrun.sh NUM_WORKERS_PER_HOST CONFIG [key=value]...}
shift 2
options=("$@")
if [ -n "${EARSHOT_KEYS:-}" ]; then options+=("network.curve_key_file=$EARSHOT_KEYS"); fi
read -r -a launch <<<"${EARSHOT_TORCHRUN:-}"
nodes=${EARSHOT_NODES:-1}
# The store of the agents: of this process on one host, of host 0 on several.
endpoint=localhost:0
conf=last_call_timeout=10
if [ "$nodes" != 1 ]; then
  endpoint=${MASTER_ADDR:?is not set: name host 0}:${MASTER_PORT:-29500}
  conf+=,is_host=$([ "${EARSHOT_NODE:?is not set: number this host from 0}" = 0 ] && echo true || echo false)
fi
run=${EARSHOT_RUN_ID:-earshot-$$}
unset EARSHOT_RUN_ID MASTER_ADDR MASTER_PORT # a name of all restarts, of which the workers have one each
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1} OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
exec torchrun --redirects 1 --tee 1 --no_python --nnodes "$nodes" --nproc_per_node "$workers" --max_restarts "${EARSHOT_RESTARTS:-10}" \
  --rdzv_backend c10d --rdzv_endpoint "$endpoint" --rdzv_id "$run" --rdzv_conf "$conf" "${launch[@]}" \
  "${EARSHOT:-earshot}" train "$config" --elastic "${options[@]}"
