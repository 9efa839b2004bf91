#include "worker/photon/irradiance_file.h"

#include <gtest/gtest.h>

#include <string>

#include "common/math/sampling.h"

namespace pf {
namespace {

IrradianceFile some_file(std::uint32_t records) {
  PathRng rng(1, Stream::kTest, 0, 0);
  IrradianceFile file;
  file.options = 0x123456789ABCDEF0u;
  file.seed = 77;
  file.next_id = records + 5;
  file.views = {3, 0xFFFFFFFFFFFFFFFFu};
  ScenePart part;
  part.hash = {1, 2};
  part.bounds = {{-1, -2, -3}, {1, 2, 3}};
  part.flux = {4, 5, 6};
  file.parts = {part, ScenePart{}};
  for (std::uint32_t i = 0; i < records; ++i) {
    IrradianceRecord record;
    record.position = sample_sphere(rng.next2()) * 3.0f;
    record.normal = sample_sphere(rng.next2());
    record.geometric_normal = sample_sphere(rng.next2());
    record.irradiance = {rng.next1(), rng.next1(), rng.next1()};
    for (Vec3f& g : record.translation) g = sample_sphere(rng.next2());
    for (Vec3f& g : record.rotation) g = sample_sphere(rng.next2());
    record.radius = 0.5f;
    record.least = 0.1f;
    record.most = 2.0f;
    record.id = i;
    record.rays = 16 + 8 * (i % 3);
    file.records.push_back(record);
    const HemisphereGrid grid = record.grid();
    HemisphereSamples samples{grid, std::vector<Rgb>(grid.cells(), Rgb{1, 2, 3}),
                              std::vector<float>(grid.cells(), 0.25f)};
    samples.distance[1] = kInfinity;
    file.reaches.emplace_back(samples);
  }
  return file;
}

TEST(IrradianceFile, GivesBackWhatWasWritten) {
  for (const std::uint32_t records : {0u, 1u, 40u}) {
    const IrradianceFile file = some_file(records);
    const std::string bytes = to_bytes(file);
    const auto read = parse_irradiance_file(bytes, "cache");
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(to_bytes(*read), bytes);
    ASSERT_EQ(read->records.size(), records);
    EXPECT_EQ(read->parts[0].bounds.max, file.parts[0].bounds.max);
    EXPECT_TRUE(read->parts[1].everywhere());
    if (records > 0) {
      EXPECT_EQ(read->records[0].position, file.records[0].position);
      EXPECT_EQ(read->reaches.back().distance, file.reaches.back().distance);
      EXPECT_EQ(read->records.back().rays, file.records.back().rays);
    }
  }
}

TEST(IrradianceFile, RefusesEveryFileThatIsCutOrChangedAnywhere) {
  const std::string bytes = to_bytes(some_file(2));
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::string changed = bytes;
    changed[i] = static_cast<char>(changed[i] ^ 0x10);
    for (const auto& broken :
         {parse_irradiance_file(changed, "cache"), parse_irradiance_file(bytes.substr(0, i), "cache")}) {
      ASSERT_FALSE(broken) << i;
      ASSERT_EQ(broken.error().message.rfind("cache: byte ", 0), 0u) << broken.error().message;
      ASSERT_NE(broken.error().message.find("; expected "), std::string::npos);
    }
  }
}

/// Writes a wrong value under a right checksum.
std::string message_of(const IrradianceFile& file) {
  const auto read = parse_irradiance_file(to_bytes(file), "cache");
  return read ? "" : read.error().message;
}

TEST(IrradianceFile, SaysWhatIsWrongBelowARightChecksum) {
  IrradianceFile file = some_file(2);
  file.records[1].position.x = kInfinity;
  EXPECT_NE(message_of(file).find("position of a record; expected a finite number"), std::string::npos)
      << message_of(file);
  file = some_file(2);
  file.records[0].normal *= 2.0f;
  EXPECT_NE(message_of(file).find("normal of a record; expected a unit vector"), std::string::npos);
  file = some_file(2);
  file.records[0].radius = 0.0f;
  EXPECT_NE(message_of(file).find("radius of a record; expected a number above 0"), std::string::npos);
  file = some_file(2);
  file.records[0].id = file.next_id;
  EXPECT_NE(message_of(file).find("id of a record; expected less than 7"), std::string::npos);
  file = some_file(2);
  for (const std::uint32_t rays : {0u, ~0u}) {
    file.records[1].rays = rays;
    EXPECT_NE(message_of(file).find("rays of a record; expected 1 to"), std::string::npos) << message_of(file);
  }
  file.records[1].rays = 100000;  // promises more cells than there are bytes
  EXPECT_NE(message_of(file).find("the file ends early; expected"), std::string::npos) << message_of(file);
}

TEST(IrradianceFile, RoundsReachesUpByLessThanAHundredth) {
  PathRng rng(2, Stream::kTest, 0, 0);
  for (int i = 0; i < 10000; ++i) {
    const float value = std::exp(40.0f * (rng.next1() - 0.5f));
    const float packed = unpack_half(pack_half_up(value));
    ASSERT_GE(packed, value);
    ASSERT_LE(packed, value * 1.01f);
  }
  EXPECT_EQ(unpack_half(pack_half_up(0.0f)), 0.0f);
  EXPECT_EQ(unpack_half(pack_half_up(kInfinity)), kInfinity);
}

}  // namespace
}  // namespace pf
