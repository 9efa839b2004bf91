#include "common/base/hash.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/support/temp_folder.h"

namespace pf {
namespace {

// FIPS 180-2, appendix B.
constexpr std::string_view kAbc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
constexpr std::string_view kMillionA = "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0";

TEST(Sha256, GivesThePublishedDigests) {
  EXPECT_EQ(sha256_hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256_hex("abc"), kAbc);
  EXPECT_EQ(sha256_hex(std::string(1'000'000, 'a')), kMillionA);
}

TEST(Sha256, DoesNotDependOnHowTheBytesAreCut) {
  Sha256 hash;
  for (int i = 0; i < 1000; ++i) hash.update(std::string(1000, 'a'));
  EXPECT_EQ(hash.hex(), kMillionA);
}

TEST(Sha256, GoesOnAfterItWasRead) {
  Sha256 hash;
  hash.update("ab");
  (void)hash.hex();
  hash.update("c");
  EXPECT_EQ(hash.hex(), kAbc);
  const Sha256 moved = std::move(hash);
  EXPECT_EQ(moved.hex(), kAbc);
}

TEST(Sha256, HashesAFileAndNamesTheOneThatItCannotRead) {
  const TempFolder folder;
  const auto file = folder / "million";
  std::ofstream(file) << std::string(1'000'000, 'a');
  EXPECT_EQ(sha256_hex_of_file(file).value_or("?"), kMillionA);
  std::filesystem::remove(file);
  const auto absent = sha256_hex_of_file(file);
  ASSERT_FALSE(absent);
  EXPECT_TRUE(absent.error().message.starts_with(file.string() + ": cannot read: ")) << absent.error().message;
  EXPECT_FALSE(sha256_hex_of_file(folder.path()));
}

TEST(Xxh3, GivesThePublishedDigestsOfNothing) {
  EXPECT_EQ(xxh3_64(""), 0x2d06800538d394c2u);
  EXPECT_EQ(xxh3_128("").hex(), "99aa06d3014798d86001c324468d497f");
}

TEST(Xxh3, TellsDifferentBytesApart) {
  EXPECT_EQ(xxh3_128("photon"), xxh3_128(std::as_bytes(std::span("photon", 6))));
  EXPECT_NE(xxh3_128("photon").hex(), xxh3_128("photom").hex());
  EXPECT_NE(xxh3_64("photon"), xxh3_64("photom"));
}

}  // namespace
}  // namespace pf
