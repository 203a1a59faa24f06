// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/env_state.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "envs/task/action_digits.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/json_depth.h"
#include "sim/base/text/json_number.h"
#include "sim/base/text/schema_version.h"

namespace earshot {
namespace {

using nlohmann::json;

constexpr int kStateVersion = 2;

[[noreturn]] void fail(const std::string& problem) { throw InputError("environment state", problem, "use another checkpoint"); }

std::uint64_t hash_of(const json& hexadecimal) { return std::stoull(hexadecimal.get<std::string>(), nullptr, 16); }

}  // namespace

std::string encode(const EnvState& state) {
  json envs = json::array();
  for (const EnvCursor& env : state.envs) {
    envs.push_back({{"active", env.active},
                    {"ended", env.ended},
                    {"void", env.is_void},
                    {"seed", env.seed},
                    {"stream", env.stream},
                    {"episode_index", env.episode_index},
                    {"episode_count", env.episode_count},
                    {"scene", hex64(env.scene)}});
    write_actions(envs.back(), env.actions, env.others);
  }
  json body = {{"set_hash", hex64(state.set_hash)}, {"seed", state.seed},       {"first_env", state.first_env},
               {"total_envs", state.total_envs},    {"started", state.started}, {"envs", envs}};
  for (const auto& [name, hash] : state.heard) body["heard"][name] = hex64(hash);
  const json document = {{"earshot_env_state", kStateVersion}, {"checksum", hex64(hash64(json_text_of_any_bytes(body)))}, {"body", body}};
  return json_text_of_any_bytes(document);
}

EnvState decode_env_state(std::string_view text) {
  EnvState state;
  check_json_depth(text, "environment state");
  try {
    const json document = parse_json(text);
    check_schema_version("environment state", "a state", whole_number<std::int64_t>(document, "earshot_env_state"),
                         {kStateVersion, kStateVersion});
    const json& body = document.at("body");
    if (document.at("checksum").get<std::string>() != hex64(hash64(json_text(body)))) fail("is corrupted: its checksum does not match");
    state.set_hash = hash_of(body.at("set_hash"));
    if (body.contains("heard"))
      for (const auto& [name, hash] : body.at("heard").items()) state.heard[name] = hash_of(hash);
    state.seed = whole_number<std::uint64_t>(body, "seed");
    state.first_env = whole_number<int>(body, "first_env");
    state.total_envs = whole_number<int>(body, "total_envs");
    state.started = body.at("started").get<bool>();
    for (const json& env : body.at("envs")) {
      EnvCursor cursor{.active = env.at("active").get<bool>(),
                       .ended = env.at("ended").get<bool>(),
                       .is_void = env.at("void").get<bool>(),
                       .seed = whole_number<std::uint64_t>(env, "seed"),
                       .stream = whole_number<std::uint32_t>(env, "stream"),
                       .episode_index = whole_number<std::uint64_t>(env, "episode_index"),
                       .episode_count = whole_number<int>(env, "episode_count"),
                       .actions = {}};
      if (env.contains("scene")) cursor.scene = hash_of(env.at("scene"));
      read_actions(env, cursor.actions, cursor.others, fail);
      if (cursor.episode_count < 0) fail("contains a negative episode count");
      state.envs.push_back(std::move(cursor));
    }
  } catch (const json::exception& error) {
    fail(std::string("cannot be read: ") + error.what());
  } catch (const std::logic_error&) {  // std::stoull
    fail("cannot be read: a hash is not a hexadecimal number");
  }
  return state;
}

std::vector<std::string> snapshots_of(std::string_view batch_state) {
  EnvState batch = decode_env_state(batch_state);
  if (!batch.started) fail("is of a batch in which no episode has started");
  std::vector<std::string> snapshots;
  for (EnvCursor& cursor : batch.envs)
    snapshots.push_back(encode({.set_hash = batch.set_hash,
                                .seed = batch.seed,
                                .first_env = 0,
                                .total_envs = 1,
                                .started = true,
                                .envs = {std::move(cursor)},
                                .heard = batch.heard}));
  return snapshots;
}

}  // namespace earshot
