#include "common/wire/blob_store.h"

#include <fstream>
#include <iterator>

#include <gtest/gtest.h>

#include "common/base/hash.h"
#include "tests/support/temp_folder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

BlobStore open(const TempFolder& folder, std::uint64_t max_bytes = 0) {
  auto store = BlobStore::open(folder / "blobs", max_bytes);
  EXPECT_TRUE(store) << store.error().message;
  return std::move(*store);
}

BlobId id_of(const std::string& bytes) { return {sha256_hex(std::string_view(bytes)), bytes.size()}; }

std::size_t files_in(const fs::path& folder) {
  return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

TEST(BlobStore, KeepsContentUnderItsHash) {
  const TempFolder folder;
  BlobStore store = open(folder);
  const auto id = store.put("hello");
  ASSERT_TRUE(id);
  EXPECT_EQ(*id, id_of("hello"));
  EXPECT_EQ(store.path_of(*id), folder / "blobs" / id->sha256.substr(0, 2) / id->sha256);
  EXPECT_TRUE(store.has(*id));
  EXPECT_FALSE(store.has({id->sha256, 4})) << "another size is another blob";
  EXPECT_EQ(bytes_of(store.path_of(*id)), "hello");
  EXPECT_EQ(store.read(*id, 1, 3).value(), "ell");
  EXPECT_EQ(store.read(*id, 3, 1'000'000'000'000).value(), "lo");
  EXPECT_EQ(store.read(*id, 9, 5).value(), "");
  EXPECT_FALSE(store.read(id_of("other"), 0, 1));
  EXPECT_TRUE(store.put("hello"));
  EXPECT_EQ(store.bytes(), 5u);
  EXPECT_TRUE(store.put(""));
  EXPECT_TRUE(store.has(id_of("")));
  EXPECT_EQ(files_in(folder / "blobs" / "incoming"), 0u);
}

TEST(BlobStore, TakesFilesAndStreams) {
  const TempFolder folder;
  BlobStore store = open(folder);
  const std::string large(3'000'000, 'x');
  std::ofstream(folder / "file") << large;
  EXPECT_EQ(store.put_file(folder / "file").value(), id_of(large));
  const auto streamed = store.put_stream([](const BlobStore::Sink& sink) -> Result<void> {
    if (auto a = sink("ab"); !a) return a;
    return sink("cd");
  });
  EXPECT_EQ(streamed.value(), id_of("abcd"));
  EXPECT_FALSE(store.put_file(folder / "absent"));
  EXPECT_FALSE(store.put_file(folder.path()));
  const auto given_up = store.put_stream([](const BlobStore::Sink& sink) -> Result<void> {
    if (auto a = sink("ab"); !a) return a;
    return fail(ErrorKind::kInvalidInput, "no more");
  });
  ASSERT_FALSE(given_up);
  EXPECT_EQ(given_up.error().message, "no more");
  EXPECT_EQ(files_in(folder / "blobs" / "incoming"), 0u);
}

TEST(BlobStore, FetchesInPartsAndGoesOnAfterARestart) {
  const TempFolder folder;
  const BlobId id = id_of("abcdefgh");
  {
    BlobStore store = open(folder);
    EXPECT_EQ(store.partial_bytes(id), 0u);
    ASSERT_TRUE(store.append_partial(id, 0, "abc"));
    EXPECT_FALSE(store.append_partial(id, 0, "abc")) << "again";
    EXPECT_FALSE(store.append_partial(id, 5, "f")) << "with a gap";
    EXPECT_FALSE(store.append_partial(id, 3, "defghi")) << "beyond the end";
    EXPECT_FALSE(store.has(id));
  }
  BlobStore store = open(folder);
  ASSERT_EQ(store.partial_bytes(id), 3u);
  ASSERT_TRUE(store.append_partial(id, 3, "defgh"));
  ASSERT_TRUE(store.finish_partial(id));
  EXPECT_EQ(store.read(id, 0, 100).value(), "abcdefgh");
  EXPECT_EQ(store.partial_bytes(id), 0u);
  EXPECT_TRUE(store.finish_partial(id)) << "another process was faster";
}

TEST(BlobStore, RefusesAndRemovesContentThatDoesNotFitItsName) {
  const TempFolder folder;
  BlobStore store = open(folder);
  const BlobId id = id_of("abcdefgh");
  ASSERT_TRUE(store.append_partial(id, 0, "abcdefgX"));
  const auto finished = store.finish_partial(id);
  ASSERT_FALSE(finished);
  EXPECT_EQ(finished.error().kind, ErrorKind::kInvalidInput);
  EXPECT_FALSE(store.has(id));
  EXPECT_EQ(store.partial_bytes(id), 0u);
  ASSERT_TRUE(store.append_partial(id, 0, "abcd"));
  EXPECT_FALSE(store.finish_partial(id)) << "too short";
  for (const char* bad : {"", "../../etc/passwd", "ABCDEF"}) {
    EXPECT_FALSE(store.append_partial({bad, 4}, 0, "abcd"));
    EXPECT_FALSE(store.finish_partial({bad, 4}));
    EXPECT_FALSE(store.has({bad, 4}));
    EXPECT_TRUE(store.path_of({bad, 4}).empty());
  }
}

TEST(BlobStore, RemovesTheLeastRecentlyUsedAndNeverPinnedOnes) {
  const TempFolder folder;
  const BlobId a = id_of("aaaa"), b = id_of("bbbb"), c = id_of("cccc"), d = id_of("dddd");
  {
    BlobStore store = open(folder, 12);
    for (const char* text : {"aaaa", "bbbb", "cccc"}) ASSERT_TRUE(store.put(text));
    ASSERT_TRUE(store.read(a, 0, 1));  // b is the oldest now
    store.pin(b);
    ASSERT_TRUE(store.put("dddd"));
    EXPECT_TRUE(store.has(a) && store.has(b) && !store.has(c) && store.has(d));
    EXPECT_EQ(store.bytes(), 12u);
    store.pin(b);
    store.unpin(b);
    ASSERT_TRUE(store.put("eeee"));
    EXPECT_TRUE(store.has(b)) << "pinned twice, unpinned once";
    store.unpin(b);
    ASSERT_TRUE(store.put("ffff"));
    EXPECT_FALSE(store.has(b));
    ASSERT_TRUE(store.put("larger than the bound"));
    EXPECT_EQ(store.bytes(), 21u) << "what was just put stays";
  }
  BlobStore store = open(folder, 12);
  EXPECT_EQ(store.bytes(), 0u);
}

TEST(BlobStore, KnowsTheOrderOfUseAfterARestart) {
  const TempFolder folder;
  const BlobId a = id_of("aaaa"), b = id_of("bbbb");
  {
    BlobStore store = open(folder);
    ASSERT_TRUE(store.put("aaaa"));
    ASSERT_TRUE(store.put("bbbb"));
    const auto now = fs::last_write_time(store.path_of(a));
    fs::last_write_time(store.path_of(a), now - std::chrono::hours(2));
    fs::last_write_time(store.path_of(b), now - std::chrono::hours(1));
    ASSERT_TRUE(store.read(a, 0, 1));
  }
  BlobStore store = open(folder, 4);
  EXPECT_TRUE(store.has(a));
  EXPECT_FALSE(store.has(b));
}

TEST(BlobStore, CleansUpAfterAWriterThatDied) {
  const TempFolder folder;
  fs::create_directories(folder / "blobs" / "incoming");
  const auto abandoned = folder / "blobs" / "incoming" / "abandoned";
  std::ofstream(abandoned) << "half";
  fs::last_write_time(abandoned, fs::file_time_type::clock::now() - std::chrono::minutes(2));
  BlobStore store = open(folder);
  EXPECT_EQ(files_in(folder / "blobs" / "incoming"), 0u);
  const auto stored = store.put_stream([&](const BlobStore::Sink& sink) -> Result<void> {
    EXPECT_TRUE(BlobStore::open(folder / "blobs", 0));  // another process starts while this one writes
    return sink("whole");
  });
  ASSERT_TRUE(stored) << stored.error().message;
  EXPECT_EQ(bytes_of(store.path_of(*stored)), "whole");
}

}  // namespace
}  // namespace pf
