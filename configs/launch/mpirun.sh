#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains with Open MPI's mpirun:
#   configs/launch/mpirun.sh NUM_WORKERS CONFIG [key=value]...
# On several hosts (docs/howto/hosts.md) set
#   EARSHOT_HOSTS       host:slots,host:slots as for `mpirun --host`; rank 0 runs on the first
#   EARSHOT_RENDEZVOUS  tcp://FIRST HOST:PORT
#   EARSHOT_KEYS        a file of `earshot keys` that all hosts can read
# EARSHOT_MPIRUN has additional options of mpirun, for example --oversubscribe.
set -euo pipefail

workers=${1:?usage: mpirun.sh NUM_WORKERS CONFIG [key=value]...}
config=${2:?usage: mpirun.sh NUM_WORKERS CONFIG [key=value]...}
shift 2
read -r -a launch <<<"${EARSHOT_MPIRUN:-}"
launch+=(-n "$workers" --bind-to none)
options=("$@")
if [ -n "${EARSHOT_HOSTS:-}" ]; then launch+=(--host "$EARSHOT_HOSTS" -x "EARSHOT_RENDEZVOUS"); fi
if [ -n "${EARSHOT_KEYS:-}" ]; then options+=("network.curve_key_file=$EARSHOT_KEYS"); fi
# One thread per worker: docs/explanation/ppo.md, section 4.
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1} OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
exec mpirun "${launch[@]}" -x OMP_NUM_THREADS -x OPENBLAS_NUM_THREADS "${EARSHOT:-earshot}" train "$config" "${options[@]}"
