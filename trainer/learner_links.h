#pragma once

#include "trainer/collective.h"
#include "trainer/ppo.h"

namespace earshot {

/// What a PpoLearner does together with the other workers, over their Collective; for one worker alone all are the identity.  The
/// collective must outlive them.
AverageGradients average_over(Collective& collective);
SumStatistics sum_over(Collective& collective);
/// Throws RunError if a peer's verdict is none.
ExchangeVerdicts exchange_over(Collective& collective);

}  // namespace earshot
