// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "sim/scene/annotations/annotations.h"

namespace earshot {

/// Reads Replica's `info_semantic.json`: `objects`, a list of {id, class_id, class_name}, and `classes`, a list of {id, name} for objects
/// without a class_name.  Without `objects` ids are those of the classes (ReplicaCAD).  A negative class_id: no category.  Other keys are
/// skipped.
/// Source: the data set's own files.  Throws InputError naming `where` and the key.
Annotations parse_replica_info(std::string_view text, const std::string& where);

}  // namespace earshot
