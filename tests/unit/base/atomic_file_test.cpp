#include "common/base/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <thread>
#include <vector>

#include "tests/support/temp_folder.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

class AtomicFile : public testing::Test {
 protected:
  [[nodiscard]] std::ptrdiff_t files_in_folder() const {
    return std::distance(fs::directory_iterator(folder_), fs::directory_iterator());
  }
  [[nodiscard]] std::string content(const fs::path& file) const { return read_file(file, 1 << 20).value_or("?"); }

  TempFolder temp_;
  const fs::path& folder_ = temp_.path();
};

TEST_F(AtomicFile, WritesBytesAndLeavesNothingElseBehind) {
  const std::string bytes("a\0b\xff", 4);
  ASSERT_TRUE(write_file_atomically(folder_ / "x.bin", bytes));
  EXPECT_EQ(content(folder_ / "x.bin"), bytes);
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(AtomicFile, ReplacesAnOldFile) {
  ASSERT_TRUE(write_file_atomically(folder_ / "x", "old and longer"));
  const std::vector<std::byte> bytes = {std::byte{'n'}, std::byte{'e'}, std::byte{'w'}};
  ASSERT_TRUE(write_file_atomically(folder_ / "x", bytes));
  EXPECT_EQ(content(folder_ / "x"), "new");
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(AtomicFile, GivesACallbackATemporaryPathInTheSameFolderWithTheSameExtension) {
  const fs::path file = folder_ / "image.exr";
  fs::path seen;
  const FileWriter write = [&](const fs::path& temporary) -> Result<void> {
    seen = temporary;
    std::ofstream(temporary) << "pixels";
    EXPECT_FALSE(fs::exists(file));
    return {};
  };
  ASSERT_TRUE(write_file_atomically(file, write));
  EXPECT_EQ(seen.parent_path(), folder_);
  EXPECT_EQ(seen.extension(), ".exr");
  EXPECT_EQ(content(file), "pixels");
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(AtomicFile, KeepsTheOldFileWhenTheCallbackFailsOrThrows) {
  ASSERT_TRUE(write_file_atomically(folder_ / "x", "old"));
  const FileWriter failing = [](const fs::path& temporary) -> Result<void> {
    std::ofstream(temporary) << "half";
    return fail(ErrorKind::kInternal, "no more");
  };
  const auto failed = write_file_atomically(folder_ / "x", failing);
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().message, "no more");
  const FileWriter throwing = [](const fs::path&) -> Result<void> { throw std::runtime_error("bad"); };
  EXPECT_THROW((void)write_file_atomically(folder_ / "x", throwing), std::runtime_error);
  EXPECT_EQ(content(folder_ / "x"), "old");
  EXPECT_EQ(files_in_folder(), 1);
}

/// No file of this process may grow beyond `bytes` while this lives: what a full disk looks like to write().
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    ::getrlimit(RLIMIT_FSIZE, &old_);
    previous_handler_ = std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{bytes, old_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &old_);
    std::signal(SIGXFSZ, previous_handler_);
  }

 private:
  rlimit old_{};
  void (*previous_handler_)(int) = nullptr;
};

TEST_F(AtomicFile, KeepsTheOldFileWhenTheDiskIsFull) {
  const fs::path file = folder_ / "x";
  ASSERT_TRUE(write_file_atomically(file, "old"));
  const std::string large(100'000, 'n');
  Result<void> written;
  {
    const FileSizeLimit limit(50'000);
    written = write_file_atomically(file, large);
  }
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().kind, ErrorKind::kInternal);
  EXPECT_TRUE(written.error().message.starts_with(file.string() + ": cannot write: ")) << written.error().message;
  EXPECT_EQ(content(file), "old");
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(AtomicFile, FailsWhereThereIsNoFolderOrNoName) {
  const auto missing = write_file_atomically(folder_ / "absent" / "x", "bytes");
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("No such file or directory"), std::string::npos);
  EXPECT_FALSE(write_file_atomically(folder_ / "", "bytes"));
  ASSERT_TRUE(fs::create_directory(folder_ / "taken"));
  EXPECT_FALSE(write_file_atomically(folder_ / "taken", "bytes"));
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(AtomicFile, AcceptsTheLongestNameOfAFile) {
  const fs::path file = folder_ / (std::string(250, 'n') + ".json");
  ASSERT_TRUE(write_file_atomically(file, "bytes"));
  EXPECT_EQ(content(file), "bytes");
}

TEST_F(AtomicFile, MakesSecretsReadableToTheOwnerAlone) {
  ASSERT_TRUE(write_file_atomically(folder_ / "token", "secret", FileAccess::kOwnerOnly));
  struct ::stat status = {};
  ASSERT_EQ(::stat((folder_ / "token").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
}

TEST_F(AtomicFile, RemovesWhatAKilledWriterLeft) {
  const fs::path file = folder_ / "x.json";
  const pid_t child = ::fork();
  if (child == 0) {
    const FileWriter dying = [](const fs::path& temporary) -> Result<void> {
      std::ofstream(temporary) << "half";
      ::raise(SIGKILL);
      return {};
    };
    (void)write_file_atomically(file, dying);
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  ASSERT_EQ(files_in_folder(), 1);
  ASSERT_TRUE(write_file_atomically(folder_ / "y.json", "of another file"));
  ASSERT_EQ(files_in_folder(), 2);
  ASSERT_TRUE(write_file_atomically(file, "whole"));
  EXPECT_EQ(content(file), "whole");
  EXPECT_EQ(files_in_folder(), 2);
}

TEST_F(AtomicFile, LeavesFilesAloneThatOnlyLookLikeItsOwn) {
  const std::vector<std::string> names = {".x.tmp", ".x.0123456789abcde.tmp", ".x.0123456789abcdeg.tmp",
                                          ".y.0123456789abcdef.tmp", ".x.0123456789abcdef.tmp.json"};
  for (const std::string& name : names) std::ofstream(folder_ / name) << "mine";
  ASSERT_TRUE(fs::create_directory(folder_ / ".x.0123456789abcdef.tmp"));
  ASSERT_TRUE(write_file_atomically(folder_ / "x", "bytes"));
  EXPECT_EQ(files_in_folder(), static_cast<std::ptrdiff_t>(names.size()) + 2);
}

TEST_F(AtomicFile, WritersOfOneFileDoNotRemoveEachOthersWork) {
  const fs::path file = folder_ / "x";
  const FileWriter slow = [&](const fs::path& temporary) -> Result<void> {
    std::ofstream(temporary) << "slow";
    EXPECT_TRUE(write_file_atomically(file, "quick"));
    EXPECT_EQ(content(temporary), "slow");
    return {};
  };
  ASSERT_TRUE(write_file_atomically(file, slow));
  EXPECT_EQ(content(file), "slow");
  std::vector<std::thread> writers;
  for (int t = 0; t < 4; ++t) {
    writers.emplace_back([&] {
      for (int i = 0; i < 50; ++i) EXPECT_TRUE(write_file_atomically(file, "bytes"));
    });
  }
  for (std::thread& writer : writers) writer.join();
  EXPECT_EQ(files_in_folder(), 1);
}

TEST_F(AtomicFile, ReadersNeverSeeAHalfWrittenFile) {
  const fs::path file = folder_ / "x";
  const std::string zeros(200'000, '0'), ones(200'000, '1');
  ASSERT_TRUE(write_file_atomically(file, zeros));
  std::thread writer([&] {
    for (int i = 0; i < 20; ++i) EXPECT_TRUE(write_file_atomically(file, i % 2 == 0 ? ones : zeros));
  });
  for (int i = 0; i < 50; ++i) {
    const auto seen = read_file(file, 1 << 20);
    EXPECT_TRUE(seen && (*seen == zeros || *seen == ones));
  }
  writer.join();
}

TEST_F(AtomicFile, ReadsUpToTheLimitAndNoFurther) {
  ASSERT_TRUE(write_file_atomically(folder_ / "x", std::string(5000, 'x')));
  EXPECT_EQ(read_file(folder_ / "x", 5000).value_or(""), std::string(5000, 'x'));
  EXPECT_EQ(read_file(folder_ / "x", UINT64_MAX).value_or("").size(), 5000u);
  const auto large = read_file(folder_ / "x", 4999, ErrorKind::kInvalidSpec);
  ASSERT_FALSE(large);
  EXPECT_EQ(large.error().kind, ErrorKind::kInvalidSpec);
  EXPECT_NE(large.error().message.find("larger than 4999 bytes"), std::string::npos);
}

TEST_F(AtomicFile, ReadsFilesThatDoNotKnowTheirSize) {
  EXPECT_NE(read_file("/proc/self/status", 1 << 20).value_or("").find("VmRSS"), std::string::npos);
}

TEST_F(AtomicFile, RefusesFoldersPipesAndWhatIsNotThere) {
  EXPECT_FALSE(read_file(folder_, 100));
  EXPECT_FALSE(read_file(folder_ / "absent", 100));
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  const auto pipe = read_file(folder_ / "pipe", 100);  // must not wait for a writer
  ASSERT_FALSE(pipe);
  EXPECT_NE(pipe.error().message.find("not a regular file"), std::string::npos);
}

}  // namespace
}  // namespace pf
