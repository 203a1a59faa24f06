// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace earshot {

/// A model of what more workers are worth (docs/explanation/ppo.md, section 8): each update waits for the slowest rollout, then sums
/// gradients.  It says nothing of learning: a larger batch is not worth as many small ones.

/// Expected k-th smallest of n draws from the standard normal distribution, k = 1 ... n; k = n is the largest.  By integration, to 1e-6.
double expected_normal_order(int k, int n);

/// Between two workers, each with a core of its own.
struct LinkSpeed {
  double exchange_s = 0;   ///< a small message each way, all of it: one hop of a small sum
  double step_s = 0;       ///< of a step of the ring, without its bytes
  double bytes_per_s = 0;  ///< of the ring
  double message_s = 0;    ///< processor time of a worker, all its threads, for a small message
  double byte_s = 0;       ///< the same for a byte that it sends round the ring
};
/// From the times of sums over two workers: one below 64 KiB, which is one hop, and two larger ones, which go round the ring in two steps.
struct TimedSum {
  std::size_t bytes = 0;
  double seconds = 0;
};
/// Throws RunError if the larger sum was no slower.
LinkSpeed link_from_sums(double small_s, const TimedSum& ring, const TimedSum& larger_ring);

/// Work of a worker in an update.
struct UpdateWork {
  double rollout_s = 0;            ///< mean
  double rollout_deviation_s = 0;  ///< from update to update and from worker to worker, taken as independent and normal
  double learn_s = 0;              ///< computation between the sums, of all minibatches; the same in each update
  int sums = 0;                    ///< of gradients
  std::size_t bytes = 0;           ///< of one
  int exchanges = 0;               ///< small calls
};

struct WorkerLayout {
  int workers = 1;
  int per_host = 1;  ///< workers that share the cores of a host
  int cores_per_host = 1;
  double preempt_fraction = 0;  ///< PpoConfig's; 0: all are waited for
};

/// Expected seconds of the parts of an update.
struct ScalingPrediction {
  double collect_s = 0;  ///< until enough rollouts are there
  double learn_s = 0, reduce_s = 0;
  double steps = 1;  ///< of all workers, in those that one makes alone: less than their number where rollouts are cut short
  [[nodiscard]] double update_s() const { return collect_s + learn_s + reduce_s; }
};

/// - Waiting: the expected largest of the rollouts' times; with preemption the expected k-th; later workers lose the steps that it
///   would have made then.
/// - A sum: 2 (P - 1) steps of the ring and 2 (P - 1) / P of the bytes over the slowest link, or, where that is longer, the processor time
///   for those bytes of all workers of a host, over its cores.
/// - A small call: an exchange, and for each worker beyond two the processor time of another message, times the workers that share a core,
///   up to 64 workers; beyond (MPI), rank 0 hears from all and answers all, and a sum is such a call and two exchanges of P - 1 messages
///   with the same bytes (trainer/collective/worker_exchange.h).
ScalingPrediction predict_update(const UpdateWork& work, const LinkSpeed& link, const WorkerLayout& layout);

/// Steps per second and worker, in those of one worker alone.
double scaling_efficiency(const UpdateWork& work, const LinkSpeed& link, const WorkerLayout& layout);

}  // namespace earshot
