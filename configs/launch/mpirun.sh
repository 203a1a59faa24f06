#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains with Open MPI's mpirun, and starts the workers again when one is lost:
#   configs/launch/mpirun.sh NUM_WORKERS CONFIG [key=value]...
# The run continues from its last whole update, or above 64 workers and with network.collective=mpi from its last periodic checkpoint
# (docs/howto/elastic.md).  NUM_WORKERS is a number, or a file that holds the number and is read at each start.
# On several hosts (docs/howto/hosts.md) set
#   EARSHOT_HOSTS       host:slots,host:slots as for `mpirun --host`, or a file that holds this; rank 0 runs on the first
#   EARSHOT_RENDEZVOUS  tcp://FIRST HOST:PORT
#   EARSHOT_KEYS        a file of `earshot keys` that all hosts can read
# EARSHOT_RESTARTS is the number of restarts (default 10).  EARSHOT_MPIRUN has additional options of mpirun, for example --oversubscribe.
set -euo pipefail

workers=${1:?usage: mpirun.sh NUM_WORKERS CONFIG [key=value]...}
config=${2:?usage: mpirun.sh NUM_WORKERS CONFIG [key=value]...}
shift 2
options=("$@")
if [ -n "${EARSHOT_KEYS:-}" ]; then options+=("network.curve_key_file=$EARSHOT_KEYS"); fi
# One thread per worker: docs/explanation/ppo.md, section 4.
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1} OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
# One name for all starts, by which a start waits until the run folder of the one before is free.
export EARSHOT_RUN_ID=${EARSHOT_RUN_ID:-mpirun.sh $(hostname) $$}
contents() { if [ -f "$1" ]; then cat "$1"; else echo "$1"; fi; }

child=
end_by() { # mpirun passes these signals on
  ends=yes
  kill "-$1" "$child" 2>/dev/null || true
}
ends=
trap 'end_by TERM' TERM
trap 'end_by INT' INT
trap 'end_by USR1' USR1
restarts=${EARSHOT_RESTARTS:-10}
while true; do
  read -r -a launch <<<"${EARSHOT_MPIRUN:-}"
  launch+=(-n "$(contents "$workers")" --bind-to none)
  if [ -n "${EARSHOT_HOSTS:-}" ]; then launch+=(--host "$(contents "$EARSHOT_HOSTS")" -x EARSHOT_RENDEZVOUS); fi
  mpirun "${launch[@]}" -x EARSHOT_RUN_ID -x OMP_NUM_THREADS -x OPENBLAS_NUM_THREADS "${EARSHOT:-earshot}" train "$config" --elastic "${options[@]}" &
  child=$!
  status=0
  while true; do
    status=0
    wait "$child" || status=$?
    kill -0 "$child" 2>/dev/null || break # a signal ends wait, not mpirun
  done
  # 3: a worker lost the others.  128 and more: a worker was killed by a signal.
  if [ -n "$ends" ] || { [ "$status" -ne 3 ] && [ "$status" -lt 128 ]; } || [ "$restarts" -le 0 ]; then exit "$status"; fi
  restarts=$((restarts - 1))
  echo "mpirun.sh: ended with code $status; starting again with $(contents "$workers") workers" >&2
done
