// SPDX-License-Identifier: Apache-2.0
#include "trainer/held_out/held_out_config.h"

#include "sim/base/text/config_reader.h"

namespace earshot {

void read(ConfigReader& reader, HeldOutConfig& config) {
  reader.read("every_updates", config.every_updates, Allowed::at_least(0),
              "Updates from one evaluation on data.held_out to the next; the best one is best.ckpt. 0: none.");
  reader.read("max_fraction", config.max_fraction, Allowed::above(0).up_to(1),
              "Largest part of the evaluations in all environment steps, with schedule: minutes in the wall time.");
  reader.read("patience", config.patience, Allowed::at_least(0),
              "Evaluations in a row without a better one after which the run ends. 0: any number.");
}

void validate(const HeldOutConfig& config) {
  check_values(config, "held_out");
  require(config.patience == 0 || config.is_on(), "held_out.patience", config.patience,
          "has no effect without held_out.every_updates: there is no evaluation");
}

}  // namespace earshot
