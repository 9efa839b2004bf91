// Two results of the same units must be equal; another hash is an alarm that names both workers.

#include <gtest/gtest.h>

#include "common/wire/limits.h"
#include "common/wire/statistics_codec.h"
#include "coordinator/farm_job.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

class SecondResult : public testing::Test {
 protected:
  void SetUp() override {
    JobRecord record;
    record.id = "job-1";
    record.spec.job.name = "job";
    record.spec.scene.file = "scene.glb";
    record.spec.image.width = record.spec.image.height = 1;
    record.spec.stop.passes = 8;
    record.bundle = {std::string(64, 'a'), 1};
    auto job = FarmJob::create(record, {}, folder_.path(), around_);
    ASSERT_TRUE(job) << job.error().message;
    job_ = std::move(*job);
    ASSERT_TRUE(job_->next_task(2));  // PREPARE
    wire::ResultManifest prepared = manifest(wire::Task::PREPARE, 1);
    FilmOptions film;
    film.width = film.height = 1;
    *prepared.mutable_prepared()->mutable_film() = to_wire(film);
    send("a", prepared, {});
    ASSERT_TRUE(job_->next_task(2));  // sub-pass 0
  }

  wire::ResultManifest manifest(wire::Task::Kind kind, std::uint64_t result) {
    wire::ResultManifest m;
    m.set_version(kWireVersion);
    m.set_build_id("build");
    m.set_job_id("job-1");
    m.set_kind(kind);
    m.set_result_id(result);
    m.add_units()->set_attempt(1);
    if (kind == wire::Task::SUB_PASSES) m.mutable_units(0)->set_sub_passes(1);
    return m;
  }
  wire::ResultReply::Verdict send(const std::string& worker, wire::ResultManifest m,
                                  const std::vector<std::string>& chunks) {
    for (const std::string& chunk : chunks) m.add_chunk_xxh3(xxh3_64(std::string_view(chunk)));
    Answer answer = job_->on_manifest(worker, 1, m);
    for (std::size_t i = 0; i < chunks.size() && answer.reply && answer.reply->verdict() == wire::ResultReply::WANTED;
         ++i) {
      wire::ResultChunk chunk;
      chunk.set_result_id(m.result_id());
      chunk.set_index(static_cast<std::uint32_t>(i));
      chunk.set_data(chunks[i]);
      answer = job_->on_chunk(worker, 1, chunk);
    }
    return answer.reply ? answer.reply->verdict() : wire::ResultReply::VERDICT_UNSPECIFIED;
  }
  wire::ResultReply::Verdict send_sums(const std::string& worker, std::int64_t red) {
    Statistics sums(1, 1);
    sums.pixels[0].direct[0] = red;
    const PackedStatistics packed = pack_statistics(sums);
    wire::ResultManifest m = manifest(wire::Task::SUB_PASSES, 2);
    m.set_content(to_wire(packed.content));
    return send(worker, m, packed.chunks);
  }

  TempFolder folder_;
  FakeClock clock_{100.0};
  BlobStore blobs_ = std::move(*BlobStore::open(folder_ / "blobs", 0));
  std::string log_;
  Metrics metrics_;
  JobStore store_ = std::move(*JobStore::open(folder_ / "farm.sqlite"));
  JobSurroundings around_{store_,
                          blobs_,
                          clock_,
                          [] { return std::int64_t{1}; },
                          "build",
                          5.0,
                          [](const std::string&, const BlobId&) { return false; },
                          [this](const std::string&, std::string_view level, std::string_view, std::string_view text) {
                            log_.append(level).append(": ").append(text).append("\n");
                          },
                          metrics_};
  std::unique_ptr<FarmJob> job_;
};

TEST_F(SecondResult, WithAnotherHashIsRefusedAndBothWorkersAreNamed) {
  ASSERT_EQ(send_sums("worker-1", 5), wire::ResultReply::ACCEPTED);
  EXPECT_EQ(send_sums("worker-2", 6), wire::ResultReply::REFUSED);
  EXPECT_NE(log_.find("error: worker-1 and worker-2 returned different sums"), std::string::npos) << log_;
  EXPECT_EQ(job_->view().warnings.size(), 1u);
  EXPECT_EQ(job_->view().passes_done, 1u);
  EXPECT_EQ(job_->film()->sums().pixels[0].direct[0], 5) << "the first is kept";
}

TEST_F(SecondResult, WithTheSameHashIsRefusedWithoutAWord) {
  ASSERT_EQ(send_sums("worker-1", 5), wire::ResultReply::ACCEPTED);
  EXPECT_EQ(send_sums("worker-2", 5), wire::ResultReply::REFUSED);
  EXPECT_EQ(log_.find("error"), std::string::npos) << log_;
  EXPECT_EQ(job_->film()->sums().pixels[0].direct[0], 5);
}

}  // namespace
}  // namespace pf
