#include "common/wire/messages.h"

#include <cmath>
#include <functional>
#include <limits>

#include <gtest/gtest.h>

#include "common/wire/limits.h"
#include "common/wire/message_scan.h"
#include "tests/unit/wire/samples.h"

namespace pf {
namespace {

using test::sample_from_worker;
using test::sample_to_worker;

/// The error of a message after `spoil` changed it; empty when it is still taken.
std::string task_error(const std::function<void(wire::Task&)>& spoil) {
  wire::Task task = test::sample_task();
  spoil(task);
  const auto parsed = parse_task(to_bytes(task));
  return parsed ? "" : parsed.error().message;
}
std::string from_worker_error(const std::string& body, const std::function<void(wire::FromWorker&)>& spoil) {
  wire::FromWorker message = sample_from_worker(body);
  spoil(message);
  const auto parsed = parse_from_worker(to_bytes(message));
  return parsed ? "" : parsed.error().message;
}
std::string result_error(const std::function<void(wire::ResultManifest&)>& spoil) {
  return from_worker_error("result", [&](wire::FromWorker& m) { spoil(*m.mutable_result()); });
}
std::string to_worker_error(const std::string& body, const std::function<void(wire::ToWorker&)>& spoil) {
  wire::ToWorker message = sample_to_worker(body);
  spoil(message);
  const auto parsed = parse_to_worker(to_bytes(message));
  return parsed ? "" : parsed.error().message;
}
std::string bundle_error(const std::function<void(wire::Bundle&)>& spoil) {
  wire::Bundle bundle = test::sample_bundle();
  spoil(bundle);
  const auto parsed = parse_bundle(to_bytes(bundle));
  return parsed ? "" : parsed.error().message;
}

#define EXPECT_NAMES(message, field) EXPECT_NE((message).find(field), std::string::npos) << "got: " << (message)

TEST(WireMessages, AreTakenAsTheyAre) {
  EXPECT_EQ(task_error([](auto&) {}), "");
  for (const std::string& body : test::from_worker_bodies())
    EXPECT_EQ(from_worker_error(body, [](auto&) {}), "") << body;
  for (const std::string& body : test::to_worker_bodies()) EXPECT_EQ(to_worker_error(body, [](auto&) {}), "") << body;
  EXPECT_EQ(bundle_error([](auto&) {}), "");
}

TEST(WireMessages, OfAnotherVersionAreNamed) {
  EXPECT_NAMES(task_error([](auto& t) { t.set_version(1); }), "Task.version: expected 2, got 1");
  EXPECT_NAMES(from_worker_error("log", [](auto& m) { m.set_version(0); }), "FromWorker.version");
  EXPECT_NAMES(to_worker_error("welcome", [](auto& m) { m.set_version(9); }), "ToWorker.version");
  EXPECT_NAMES(bundle_error([](auto& b) { b.set_version(1); }), "Bundle.version");
}

TEST(WireMessages, TasksAreCheckedFieldByField) {
  EXPECT_NAMES(task_error([](auto& t) { t.set_job_id("../up"); }), "Task.job_id");
  EXPECT_NAMES(task_error([](auto& t) { t.set_job_id(std::string(65, 'a')); }), "Task.job_id");
  EXPECT_NAMES(task_error([](auto& t) { t.clear_build_id(); }), "Task.build_id");
  EXPECT_NAMES(task_error([](auto& t) { t.set_kind(wire::Task::KIND_UNSPECIFIED); }), "Task.kind");
  EXPECT_NAMES(task_error([](auto& t) { t.clear_unit(); }), "Task.unit");
  EXPECT_NAMES(task_error([](auto& t) { t.mutable_unit()->set_attempt(0); }), "Task.unit.attempt");
  EXPECT_NAMES(task_error([](auto& t) { t.mutable_unit()->set_sub_passes(0); }), "Task.unit.sub_passes");
  EXPECT_NAMES(task_error([](auto& t) { t.mutable_unit()->set_sub_passes(std::numeric_limits<std::uint64_t>::max()); }),
               "Task.unit.sub_passes");
  EXPECT_NAMES(
      task_error([](auto& t) { t.mutable_unit()->set_first_sub_pass(std::numeric_limits<std::uint64_t>::max() - 2); }),
      "Task.unit.first_sub_pass");
  EXPECT_NAMES(task_error([](auto& t) { t.set_round_begin(17); }), "Task.round_begin");
  EXPECT_NAMES(task_error([](auto& t) { t.mutable_bundle()->set_sha256("short"); }), "Task.bundle.sha256");
  EXPECT_NAMES(task_error([](auto& t) { t.mutable_bundle()->set_bytes(kMaxBundleBytes + 1); }), "Task.bundle.bytes");
  EXPECT_NAMES(task_error([](auto& t) { t.mutable_state()->set_bytes(kMaxBlobBytes + 1); }), "Task.state.bytes");
  EXPECT_NAMES(task_error([](auto& t) { t.set_kind(wire::Task::PREPARE); }), "Task.state");
  EXPECT_NAMES(task_error([](auto& t) { t.set_timeout_seconds(std::nan("")); }), "Task.timeout_seconds");
  EXPECT_NAMES(task_error([](auto& t) { t.set_width(0); }), "Task.width");
  EXPECT_NAMES(task_error([](auto& t) { t.set_width(65536), t.set_height(65536); }), "Task.width");
}

TEST(WireMessages, HeartbeatsAndSmallOnesAreChecked) {
  EXPECT_NAMES(from_worker_error("heartbeat", [](auto& m) { m.set_worker("a.b"); }), "FromWorker.worker");
  EXPECT_NAMES(from_worker_error("heartbeat", [](auto& m) { m.clear_heartbeat(); }), "FromWorker.body");
  EXPECT_NAMES(from_worker_error(
                   "heartbeat",
                   [](auto& m) { m.mutable_heartbeat()->set_activity(static_cast<wire::Heartbeat::Activity>(77)); }),
               "heartbeat.activity");
  EXPECT_NAMES(from_worker_error(
                   "heartbeat",
                   [](auto& m) { m.mutable_heartbeat()->set_trace_seconds(std::numeric_limits<double>::infinity()); }),
               "heartbeat.trace_seconds");
  EXPECT_NAMES(from_worker_error("heartbeat", [](auto& m) { m.mutable_heartbeat()->mutable_held(0)->set_attempt(0); }),
               "heartbeat.held[0].attempt");
  EXPECT_NAMES(from_worker_error("blob_request", [](auto& m) { m.mutable_blob_request()->set_offset(501); }),
               "blob_request.offset");
  EXPECT_NAMES(from_worker_error("chunk", [](auto& m) { m.mutable_chunk()->set_index(kMaxChunks); }), "chunk.index");
  EXPECT_NAMES(
      from_worker_error("chunk", [](auto& m) { m.mutable_chunk()->set_data(std::string(kMaxChunkBytes + 1, 'x')); }),
      "chunk.data");
  EXPECT_NAMES(from_worker_error("failed", [](auto& m) { m.mutable_failed()->set_error_kind(99); }),
               "failed.error_kind");
  EXPECT_NAMES(
      from_worker_error("log", [](auto& m) { m.mutable_log()->set_text(std::string(kMaxTextBytes + 1, 'x')); }),
      "log.text");
}

TEST(WireMessages, ResultsAreChecked) {
  EXPECT_NAMES(result_error([](auto& r) { r.clear_units(); }), "result.units");
  EXPECT_NAMES(result_error([](auto& r) { r.mutable_units(1)->set_first_sub_pass(19); }),
               "result.units[1].first_sub_pass");
  EXPECT_NAMES(result_error([](auto& r) { r.mutable_units(0)->set_first_sub_pass(15); }),
               "result.units[0].first_sub_pass");
  EXPECT_NAMES(result_error([](auto& r) { r.set_content("short"); }), "result.content");
  EXPECT_NAMES(result_error([](auto& r) { r.set_largest_chunk_bytes(kMaxChunkBytes + 1); }),
               "result.largest_chunk_bytes");
  EXPECT_NAMES(result_error([](auto& r) { r.set_trace_seconds(-1); }), "result.trace_seconds");
  EXPECT_NAMES(result_error([](auto& r) { r.mutable_prepared(); }), "result.prepared");
  EXPECT_NAMES(result_error([](auto& r) {
                 for (std::size_t i = 0; i <= kMaxChunks; ++i) r.add_chunk_xxh3(i);
               }),
               "result.chunk_xxh3");
  const auto prepared_error = [](const std::function<void(wire::ResultManifest&)>& spoil) {
    return from_worker_error("prepare_result", [&](wire::FromWorker& m) { spoil(*m.mutable_result()); });
  };
  EXPECT_NAMES(prepared_error([](auto& r) { r.mutable_prepared()->mutable_film()->set_alpha(0); }),
               "prepared.film.alpha");
  EXPECT_NAMES(prepared_error([](auto& r) { r.mutable_prepared()->mutable_film()->set_flow_step(-1); }),
               "prepared.film.flow_step");
  EXPECT_NAMES(prepared_error([](auto& r) { r.mutable_prepared()->mutable_film()->set_estimator(3); }),
               "prepared.film.estimator");
  EXPECT_NAMES(prepared_error([](auto& r) {
                 r.mutable_prepared()->mutable_film()->set_width(8);
                 r.mutable_prepared()->mutable_film()->set_height(8);
               }),
               "result.chunk_xxh3")
      << "64 pixels are one tile, not two chunks";
}

TEST(WireMessages, AnswersAreChecked) {
  EXPECT_NAMES(to_worker_error("blob_part", [](auto& m) { m.mutable_blob_part()->set_offset(490); }),
               "blob_part.offset");
  EXPECT_NAMES(to_worker_error("result_reply", [](auto& m) { m.mutable_result_reply()->clear_verdict(); }),
               "result_reply.verdict");
  EXPECT_NAMES(to_worker_error("result_reply", [](auto& m) { m.mutable_result_reply()->set_missing(1, 0); }),
               "missing[1]");
  EXPECT_NAMES(to_worker_error("welcome", [](auto& m) { m.mutable_welcome()->set_ack_wait_seconds(-1); }),
               "ack_wait_seconds");
  EXPECT_NAMES(to_worker_error("job_ended", [](auto& m) { m.mutable_job_ended()->clear_job_id(); }),
               "job_ended.job_id");
}

TEST(WireMessages, BundlesKeepInsideTheirFolder) {
  for (const char* path : {"", "/etc/passwd", "../a", "a/../b", "a//b", "a/", "./a", "a\\b", "a\nb"}) {
    EXPECT_FALSE(is_bundle_path(path)) << path;
    EXPECT_NAMES(bundle_error([&](auto& b) { b.mutable_files(0)->set_path(path); }), "files[0].path");
  }
  EXPECT_FALSE(is_bundle_path(std::string_view("a\0b", 3)));
  EXPECT_FALSE(is_bundle_path(std::string(1025, 'a')));
  for (const char* path : {"a", "a/b.c", "..a/b..", "%2e%2e", "\xc3\xbc"}) EXPECT_TRUE(is_bundle_path(path)) << path;
  EXPECT_NAMES(bundle_error([](auto& b) { b.mutable_files(1)->set_path("scenes/a.bin"); }), "files[1].path") << "twice";
  EXPECT_NAMES(bundle_error([](auto& b) { b.mutable_files(0)->set_path("zzz"); }), "files[1].path") << "not ascending";
  EXPECT_NAMES(bundle_error([](auto& b) { b.mutable_files(0)->set_path("scenes"); }), "the folder of another");
}

TEST(WireMessages, CostNoMoreThanAFewTimesTheirBytes) {
  // 2 bytes each on the wire, some 50 in memory.
  std::string units;
  for (int i = 0; i < 100'000; ++i) units += std::string("\x3a\x00", 2);  // Heartbeat.held
  EXPECT_TRUE(scan_message(*wire::Heartbeat::descriptor(), units));
  EXPECT_TRUE(scan_message(*wire::Heartbeat::descriptor(), std::string(3000, '\xfb'))) << "groups";
  std::string unknown;
  for (int i = 0; i < 65; ++i) unknown += std::string("\xf8\x07\x01", 3);
  EXPECT_TRUE(scan_message(*wire::Heartbeat::descriptor(), unknown));
  EXPECT_FALSE(scan_message(*wire::Heartbeat::descriptor(), unknown.substr(3)));
  EXPECT_FALSE(parse_task(std::string(5000, '\0')));
  EXPECT_FALSE(parse_from_worker(std::string(kMaxMessageBytes + 1, '\0')));
}

TEST(WireMessages, FieldsOfLaterBuildsAreIgnored) {
  const std::string later = to_bytes(test::sample_task()) + std::string("\xf8\x07\x01", 3);
  const auto parsed = parse_task(later);
  ASSERT_TRUE(parsed) << parsed.error().message;
  EXPECT_EQ(to_bytes(*parsed), to_bytes(test::sample_task()));
}

TEST(WireMessages, EveryTruncationAndFlippedBitIsSurvived) {
  for (const std::string& body : test::from_worker_bodies()) {
    const std::string bytes = to_bytes(sample_from_worker(body));
    // Cut between two fields, what is left may still be a message.
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      const auto parsed = parse_from_worker(bytes.substr(0, size));
      EXPECT_TRUE(!parsed || parsed->body_case() != wire::FromWorker::BODY_NOT_SET);
    }
    for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      std::string broken = bytes;
      broken[bit / 8] = static_cast<char>(broken[bit / 8] ^ (1 << bit % 8));
      const auto parsed = parse_from_worker(broken);
      EXPECT_TRUE(!parsed || parsed->version() == kWireVersion);
    }
  }
}

TEST(WireMessages, TextIsUtf8) {
  for (const char* good : {"", "abc", "\xc3\xbc", "\xe2\x82\xac", "\xf0\x9f\x98\x80", "\xf4\x8f\xbf\xbf"})
    EXPECT_TRUE(is_utf8(good));
  for (const char* bad :
       {"\x80", "\xc3", "\xc0\x80", "\xe0\x80\x80", "\xed\xa0\x80", "\xf4\x90\x80\x80", "\xff", "a\xe2\x82"}) {
    EXPECT_FALSE(is_utf8(bad)) << bad;
  }
  std::string bytes = to_bytes(sample_from_worker("log"));
  bytes[bytes.find('\xc3')] = '\xff';
  const auto parsed = parse_from_worker(bytes);
  ASSERT_FALSE(parsed);
  EXPECT_NAMES(parsed.error().message, "log.text: is not valid UTF-8");
}

TEST(WireMessages, HashesAndFilmOptionsComeBack) {
  EXPECT_EQ(sha256_hex_of_bytes(to_wire(Hash128{0x0102030405060708, 0x1112131415161718})),
            "08070605040302011817161514131211");
  const std::string hex = sha256_hex(std::string_view("x"));
  EXPECT_EQ(sha256_bytes(hex).size(), 32u);
  EXPECT_EQ(sha256_hex_of_bytes(sha256_bytes(hex)), hex);
  const FilmOptions options{7, 5, Estimator::kIndependent, {0x1p-20, 0x1p-30, 0x1p-10, 0x1p-12}, 0.5, 2.0};
  const auto back = from_wire(to_wire(options));
  ASSERT_TRUE(back);
  EXPECT_EQ(to_bytes(to_wire(*back)), to_bytes(to_wire(options)));
  EXPECT_EQ(back->estimator, Estimator::kIndependent);
  EXPECT_EQ(back->scale.depth, 0x1p-12);
  wire::FilmOptions broken = to_wire(options);
  broken.set_square_step(0);
  EXPECT_FALSE(from_wire(broken));
}

}  // namespace
}  // namespace pf
