#pragma once

#include <string>
#include <vector>

#include "common/film/progressive.h"
#include "common/film/statistics.h"
#include "common/wire/messages.h"

namespace pf::test {

/// A well-formed message of every kind, all fields set.
[[nodiscard]] wire::Task sample_task();
[[nodiscard]] wire::Task sample_prepare_task();
[[nodiscard]] wire::Bundle sample_bundle();
/// heartbeat, blob_request, result, prepare_result, chunk, failed, log
[[nodiscard]] wire::FromWorker sample_from_worker(const std::string& body);
/// blob_part, result_reply, welcome, job_ended
[[nodiscard]] wire::ToWorker sample_to_worker(const std::string& body);
[[nodiscard]] const std::vector<std::string>& from_worker_bodies();
[[nodiscard]] const std::vector<std::string>& to_worker_bodies();

/// Sums with all members in use, the same in every build. `seed` tells one from another.
[[nodiscard]] Statistics sample_statistics(int width, int height, bool features, std::uint64_t seed = 1);
[[nodiscard]] std::vector<ProgressivePixel> sample_state(std::size_t pixels);

}  // namespace pf::test
