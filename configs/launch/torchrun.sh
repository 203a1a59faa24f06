#!/usr/bin/env bash
# Trains with torchrun, on each host alike:
#   configs/launch/torchrun.sh NUM_WORKERS_PER_HOST CONFIG [key=value]...
# On several hosts (docs/howto/hosts.md) set EARSHOT_NODES, EARSHOT_NODE (0 to EARSHOT_NODES - 1), MASTER_ADDR (host of node 0), MASTER_PORT, and EARSHOT_KEYS,
# a file of `earshot keys`; the workers meet at the port after MASTER_PORT, as torchrun's agent has that one.
# torchrun 1.13 starts nothing under Python 3.11 without --redirects and --tee.
set -euo pipefail

workers=${1:?usage: torchrun.sh NUM_WORKERS_PER_HOST CONFIG [key=value]...}
config=${2:?usage: torchrun.sh NUM_WORKERS_PER_HOST CONFIG [key=value]...}
shift 2
options=("$@")
if [ -n "${EARSHOT_KEYS:-}" ]; then options+=("network.curve_key_file=$EARSHOT_KEYS"); fi
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1} OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
exec torchrun --redirects 1 --tee 1 --no_python --nnodes "${EARSHOT_NODES:-1}" --node_rank "${EARSHOT_NODE:-0}" --nproc_per_node "$workers" \
  --master_addr "${MASTER_ADDR:-127.0.0.1}" --master_port "${MASTER_PORT:-29500}" "${EARSHOT:-earshot}" train "$config" "${options[@]}"
