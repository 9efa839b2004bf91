#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace pf::engine {

// Names in the engine; the permissions of farm_permissions.h are made of the same ones.
//
//   photonfarm.task                 work queue (stream PHOTONFARM_TASKS, durable pull consumer "workers")
//   photonfarm.coordinator.WORKER   worker -> coordinator
//   photonfarm.worker.WORKER        coordinator -> one worker
//   photonfarm.workers              coordinator -> all of them
//   _INBOX.NAME.>                   answers to NAME's requests
inline constexpr const char* kStream = "PHOTONFARM_TASKS";
inline constexpr const char* kConsumer = "workers";
inline constexpr const char* kTaskSubject = "photonfarm.task";
inline constexpr const char* kAllWorkers = "photonfarm.workers";
inline constexpr const char* kFromWorkers = "photonfarm.coordinator.*";
inline constexpr const char* kNextTask = "$JS.API.CONSUMER.MSG.NEXT.PHOTONFARM_TASKS.workers";
inline constexpr std::string_view kAckPrefix = "$JS.ACK.PHOTONFARM_TASKS.workers.";

[[nodiscard]] inline std::string to_coordinator(std::string_view worker) {
  return std::string("photonfarm.coordinator.").append(worker);
}
[[nodiscard]] inline std::string to_worker(std::string_view worker) {
  return std::string("photonfarm.worker.").append(worker);
}
[[nodiscard]] inline std::string inbox_prefix(std::string_view name) { return std::string("_INBOX.").append(name); }

/// [A-Za-z0-9_-]{1,64}: what may be one token of a subject (wire/limits.h has the same rule for names of workers).
[[nodiscard]] constexpr bool is_token(std::string_view name) {
  if (name.empty() || name.size() > 64) return false;
  for (const char c : name) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
    if (!letter && !(c >= '0' && c <= '9') && c != '_' && c != '-') return false;
  }
  return true;
}

}  // namespace pf::engine
