#include "tests/unit/wire/samples.h"

#include "common/wire/limits.h"

namespace pf::test {
namespace {

void fill(wire::Unit& unit, std::uint64_t first, std::uint64_t count, std::uint32_t attempt) {
  unit.set_first_sub_pass(first);
  unit.set_sub_passes(count);
  unit.set_attempt(attempt);
}

void fill(wire::Blob& blob, char byte, std::uint64_t bytes) {
  blob.set_sha256(std::string(32, byte));
  blob.set_bytes(bytes);
}

FilmOptions film() { return {640, 480, Estimator::kShared, {0x1p-24, 0x1p-30, 0x1p-16, 0x1p-18}, 0.6667, 0.25}; }

void fill_result(wire::ResultManifest& result, bool prepare) {
  result.set_version(kWireVersion);
  result.set_build_id("0.1.0-abc");
  result.set_job_id("job-1");
  result.set_result_id(7);
  result.set_kind(prepare ? wire::Task::PREPARE : wire::Task::SUB_PASSES);
  result.set_content("0123456789abcdef");
  result.add_chunk_xxh3(0x1122334455667788);
  result.add_chunk_xxh3(0x99aabbccddeeff00);
  result.set_largest_chunk_bytes(1000);
  result.set_trace_seconds(1.5);
  result.set_transfer_seconds(0.25);
  if (prepare) {
    fill(*result.add_units(), 0, 0, 1);
    *result.mutable_prepared()->mutable_film() = to_wire(film());
    result.mutable_prepared()->set_scene_hash(std::string(64, 'a'));
    result.mutable_prepared()->set_plan_line("sppm, because the scene has glass");
    result.mutable_prepared()->add_warnings("a texture is missing");
    return;
  }
  result.set_round_begin(16);
  fill(*result.add_units(), 16, 4, 1);
  fill(*result.add_units(), 24, 4, 2);
  result.set_photon_paths(4'000'000);
  result.set_photons_stored(9'000'000);
  result.set_rays(50'000'000);
  result.set_not_finite(1);
  result.set_overflow(0);
}

void fill_heartbeat(wire::Heartbeat& heartbeat) {
  heartbeat.set_host("host.example");
  heartbeat.set_process(1234);
  heartbeat.set_threads(8);
  heartbeat.set_build_id("0.1.0-abc");
  heartbeat.set_activity(wire::Heartbeat::TRACING);
  heartbeat.set_job_id("job-1");
  fill(*heartbeat.add_held(), 16, 4, 1);
  heartbeat.set_rays(123456789);
  heartbeat.set_photon_paths(1000000);
  heartbeat.set_sub_passes(3);
  heartbeat.set_trace_seconds(12.5);
  heartbeat.set_cache_bytes(1 << 20);
  heartbeat.set_held_passes_done(2);
}

std::uint64_t mixed(std::uint64_t x) {  // splitmix64
  x += 0x9e3779b97f4a7c15;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9;
  x = (x ^ (x >> 27)) * 0x94d049bb133111eb;
  return x ^ (x >> 31);
}

}  // namespace

wire::Task sample_task() {
  wire::Task task;
  task.set_version(kWireVersion);
  task.set_build_id("0.1.0-abc");
  task.set_job_id("job-1");
  task.set_kind(wire::Task::SUB_PASSES);
  fill(*task.mutable_unit(), 16, 4, 1);
  task.set_round_begin(16);
  fill(*task.mutable_bundle(), 'b', 500);
  fill(*task.mutable_state(), 's', 100000);
  task.set_timeout_seconds(600);
  task.set_width(640);
  task.set_height(480);
  return task;
}

wire::Task sample_prepare_task() {
  wire::Task task = sample_task();
  task.set_kind(wire::Task::PREPARE);
  fill(*task.mutable_unit(), 0, 0, 1);
  task.set_round_begin(0);
  task.clear_state();
  return task;
}

wire::Bundle sample_bundle() {
  wire::Bundle bundle;
  bundle.set_version(kWireVersion);
  bundle.set_spec_json(R"({"job":{"name":"sample"},"scene":{"file":"scenes/a.gltf"}})");
  for (const char* path : {"scenes/a.bin", "scenes/a.gltf", "textures/wood.png"}) {
    wire::Bundle::File& file = *bundle.add_files();
    file.set_path(path);
    fill(*file.mutable_content(), 'f', 42);
  }
  return bundle;
}

const std::vector<std::string>& from_worker_bodies() {
  static const std::vector<std::string> kBodies = {"heartbeat", "blob_request", "result", "prepare_result",
                                                   "chunk",     "failed",       "log"};
  return kBodies;
}

const std::vector<std::string>& to_worker_bodies() {
  static const std::vector<std::string> kBodies = {"blob_part", "result_reply", "welcome", "job_ended"};
  return kBodies;
}

wire::FromWorker sample_from_worker(const std::string& body) {
  wire::FromWorker message;
  message.set_version(kWireVersion);
  message.set_worker("worker-1");
  message.set_incarnation(0xfeedface);
  if (body == "heartbeat") {
    fill_heartbeat(*message.mutable_heartbeat());
  } else if (body == "blob_request") {
    fill(*message.mutable_blob_request()->mutable_blob(), 'b', 500);
    message.mutable_blob_request()->set_offset(100);
  } else if (body == "result" || body == "prepare_result") {
    fill_result(*message.mutable_result(), body == "prepare_result");
  } else if (body == "chunk") {
    message.mutable_chunk()->set_job_id("job-1");
    message.mutable_chunk()->set_result_id(7);
    message.mutable_chunk()->set_index(1);
    message.mutable_chunk()->set_data("not looked into here");
  } else if (body == "failed") {
    message.mutable_failed()->set_job_id("job-1");
    message.mutable_failed()->set_kind(wire::Task::SUB_PASSES);
    fill(*message.mutable_failed()->mutable_unit(), 16, 4, 1);
    message.mutable_failed()->set_error_kind(static_cast<std::uint32_t>(ErrorKind::kInvalidInput));
    message.mutable_failed()->set_message("scene.gltf: not glTF");
    message.mutable_failed()->set_permanent(true);
  } else {
    message.mutable_log()->set_level(wire::LogLine::WARNING);
    message.mutable_log()->set_job_id("job-1");
    message.mutable_log()->set_text("gr\xc3\xbc\xc3\x9f Gott");
  }
  return message;
}

wire::ToWorker sample_to_worker(const std::string& body) {
  wire::ToWorker message;
  message.set_version(kWireVersion);
  if (body == "blob_part") {
    fill(*message.mutable_blob_part()->mutable_blob(), 'b', 500);
    message.mutable_blob_part()->set_offset(100);
    message.mutable_blob_part()->set_data("bytes of the blob");
  } else if (body == "result_reply") {
    wire::ResultReply& reply = *message.mutable_result_reply();
    reply.set_job_id("job-1");
    reply.set_result_id(7);
    reply.set_verdict(wire::ResultReply::WANTED);
    reply.add_missing(0);
    reply.add_missing(3);
    reply.set_reason("two are lost");
  } else if (body == "welcome") {
    message.mutable_welcome()->set_accepted(true);
    message.mutable_welcome()->set_reason("hello");
    message.mutable_welcome()->set_ack_wait_seconds(30);
  } else {
    message.mutable_job_ended()->set_job_id("job-1");
  }
  return message;
}

Statistics sample_statistics(int width, int height, bool features, std::uint64_t seed) {
  Statistics sums(width, height, features);
  for (std::size_t i = 0; i < sums.pixels.size(); ++i) {
    const std::uint64_t r = mixed(seed * 1'000'003 + i);
    PixelSums& p = sums.pixels[i];
    for (std::size_t c = 0; c < 3; ++c) {
      p.direct[c] = (std::int64_t{1} << 28) + static_cast<std::int64_t>(r >> 44) - (1 << 19);
      p.flow[kIndirect][c] = static_cast<std::int64_t>(mixed(r + c) >> 40) - (1 << 23);  // some are negative
    }
    if (i % 5 == 0) p.flow[kCaustic][1] = static_cast<std::int64_t>(r >> 4);
    p.square = static_cast<std::int64_t>(r >> 30);
    p.photons = {static_cast<std::uint32_t>(r % 3), static_cast<std::uint32_t>(r >> 54)};
    if (!features) continue;
    FeatureSums& f = sums.features[i];
    for (std::size_t c = 0; c < 3; ++c) {
      f.albedo[c] = static_cast<std::int16_t>(mixed(r + c) >> 54);
      f.normal[c] = static_cast<std::int16_t>(static_cast<int>(mixed(r + c + 3) >> 52) - 2048);
    }
    f.add_depth(static_cast<double>(r >> 44));
  }
  return sums;
}

std::vector<ProgressivePixel> sample_state(std::size_t pixels) {
  std::vector<ProgressivePixel> state(pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const auto wiggle = static_cast<float>(mixed(i) >> 60);
    state[i][kCaustic].radius2 = 0.001f + 0.0001f * wiggle;
    state[i][kIndirect].radius2 = i % 7 == 0 ? 0.0f : 0.5f * wiggle;
    state[i].covered_radius = 1.0f / (1.0f + wiggle);
  }
  return state;
}

}  // namespace pf::test
