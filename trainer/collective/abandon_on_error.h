// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <zmq.hpp>

#include "sim/base/errors.h"
#include "trainer/collective/collective.h"

namespace earshot {

/// Runs the body of a collective call.  Any failure in it ends the run for all workers: mesh.abandon(reason) tells them and takes lent
/// memory back before the caller sees the exception, ZeroMQ's as RunError.  A change of members is not an error.
template <class Mesh, class Body>
void abandon_on_error(Mesh& mesh, Body&& body) {
  try {
    body();
  } catch (const MembershipChange&) {
    throw;
  } catch (const RunError& error) {
    mesh.abandon(error.what());
    throw;
  } catch (const zmq::error_t& error) {
    mesh.abandon(error.what());
    throw RunError("ZeroMQ", error.what());
  } catch (...) {
    mesh.abandon("an internal error");
    throw;
  }
}

}  // namespace earshot
