#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains with torchrun.  Run the same command on each host:
#   configs/launch/torchrun.sh NUM_WORKERS_PER_HOST CONFIG [key=value]...
# On several hosts (docs/howto/hosts.md) set
#   EARSHOT_NODES, EARSHOT_NODE  number of hosts, and the index of this host from 0
#   MASTER_ADDR, MASTER_PORT     host of node 0, and a port; workers use the next port, because torchrun's agent uses this one
#   EARSHOT_KEYS                 a file of `earshot keys`
# Under Python 3.11 torchrun 1.13 needs --redirects and --tee.
set -euo pipefail

workers=${1:?usage: torchrun.sh NUM_WORKERS_PER_HOST CONFIG [key=value]...}
config=${2:?usage: torchrun.sh NUM_WORKERS_PER_HOST CONFIG [key=value]...}
shift 2
options=("$@")
if [ -n "${EARSHOT_KEYS:-}" ]; then options+=("network.curve_key_file=$EARSHOT_KEYS"); fi
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1} OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
exec torchrun --redirects 1 --tee 1 --no_python --nnodes "${EARSHOT_NODES:-1}" --node_rank "${EARSHOT_NODE:-0}" --nproc_per_node "$workers" \
  --master_addr "${MASTER_ADDR:-127.0.0.1}" --master_port "${MASTER_PORT:-29500}" "${EARSHOT:-earshot}" train "$config" "${options[@]}"
