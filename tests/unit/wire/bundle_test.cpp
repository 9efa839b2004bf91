#include "common/wire/bundle.h"

#include <fstream>
#include <iterator>

#include <gtest/gtest.h>

#include "common/wire/gltf_files.h"
#include "common/wire/messages.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/wire/samples.h"
#include "worker/scene/gltf_source.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

void write(const fs::path& file, std::string_view bytes) {
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << bytes;
}

/// A job in a folder of its own, whose scene/a.gltf holds the given buffers and images.
class Job {
 public:
  explicit Job(std::string_view gltf = R"({"asset":{"version":"2.0"}})") {
    spec.job.name = "test";
    spec.scene.file = "scene/a.gltf";
    spec.folder = folder / "job";
    write(spec.folder / "scene/a.gltf", gltf);
  }
  static std::string buffer(std::string_view uri) {
    return R"({"buffers":[{"byteLength":1,"uri":")" + std::string(uri) + "\"}]}";
  }

  [[nodiscard]] std::vector<std::string> paths() const {
    std::vector<std::string> out;
    const auto files = files_of_job(spec);
    EXPECT_TRUE(files) << files.error().message;
    if (files) {
      for (const BundleFile& file : *files) out.push_back(file.path);
    }
    return out;
  }
  [[nodiscard]] std::string error() const {
    const auto files = files_of_job(spec);
    return files ? "" : files.error().message;
  }

  TempFolder folder;
  JobSpec spec;
};

using Paths = std::vector<std::string>;

TEST(FilesOfJob, AreSceneBuffersImagesAndEnvironment) {
  Job job(R"({"buffers":[{"uri":"my%20data.bin"},{"uri":"data:application/octet-stream;base64,AA=="},{}],
              "images":[{"uri":"../textures/wood.png"},{"bufferView":0},{"uri":"./my data.bin"}]})");
  write(job.spec.folder / "scene/my data.bin", "1");
  write(job.spec.folder / "textures/wood.png", "2");
  write(job.spec.folder / "scene/not named.bin", "3");
  write(job.spec.folder / "sky.exr", "4");
  job.spec.scene.environment = "sky.exr";
  EXPECT_EQ(job.paths(), (Paths{"scene/a.gltf", "scene/my data.bin", "sky.exr", "textures/wood.png"}));
}

TEST(FilesOfJob, AreReadFromGlbToo) {
  Job job;
  std::string json = Job::buffer("b.bin");
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const auto word = [](std::size_t value) {
    const auto v = static_cast<std::uint32_t>(value);
    return std::string(reinterpret_cast<const char*>(&v), 4);
  };
  const std::string glb = "glTF" + word(2) + word(20 + json.size()) + word(json.size()) + "JSON" + json;
  write(job.spec.folder / "scene/a.gltf", glb);
  write(job.spec.folder / "scene/b.bin", "1");
  EXPECT_EQ(job.paths(), (Paths{"scene/a.gltf", "scene/b.bin"}));
  for (std::size_t size = 4; size < glb.size(); ++size) {
    write(job.spec.folder / "scene/a.gltf", glb.substr(0, size));
    EXPECT_NE(job.error(), "") << size;
  }
}

TEST(FilesOfJob, RefusesWhatTheLoaderWouldRefuse) {
  for (const char* uri : {"absent.bin", "/etc/passwd", "../../outside.bin", "file:///etc/passwd", "http://x/y.bin", "",
                          "..", "%2e%2e/%2e%2e/outside.bin", "a%00b", "%2fetc%2fpasswd", "\\\\\\\\host"}) {
    const Job job(Job::buffer(uri));
    write(job.folder / "outside.bin", "secret");
    EXPECT_NE(job.error().find("a.gltf"), std::string::npos) << uri << ": " << job.error();
    EXPECT_NE(job.error().find("/buffers/0/uri"), std::string::npos) << uri << ": " << job.error();
  }
  EXPECT_NE(Job("{").error(), "");
  EXPECT_NE(Job("[]").error(), "");
  EXPECT_NE(Job(R"({"buffers":[{"uri":5}]})").error(), "");
  EXPECT_NE(Job(std::string(100'000, '[')).error(), "");
}

TEST(FilesOfJob, FollowsLinksOnlyInsideTheFolder) {
  Job job(Job::buffer("link.bin"));
  write(job.folder / "outside.bin", "secret");
  write(job.spec.folder / "data/real.bin", "1");
  fs::create_symlink(job.folder / "outside.bin", job.spec.folder / "scene/link.bin");
  EXPECT_NE(job.error().find("outside the job's folder"), std::string::npos) << job.error();
  fs::remove(job.spec.folder / "scene/link.bin");
  fs::create_symlink(job.spec.folder / "data/real.bin", job.spec.folder / "scene/link.bin");
  EXPECT_EQ(job.paths(), (Paths{"scene/a.gltf", "scene/link.bin"}));
  fs::remove(job.spec.folder / "scene/link.bin");
  fs::create_symlink(job.folder.path(), job.spec.folder / "scene/up");
  write(job.spec.folder / "scene/a.gltf", Job::buffer("up/outside.bin"));
  EXPECT_NE(job.error().find("outside the job's folder"), std::string::npos) << job.error();
}

TEST(FilesOfJob, RefusesAnEnvironmentOrSceneOutside) {
  Job job;
  write(job.folder / "sky.exr", "1");
  fs::create_symlink(job.folder / "sky.exr", job.spec.folder / "sky.exr");
  job.spec.scene.environment = "sky.exr";
  EXPECT_NE(job.error().find("outside"), std::string::npos);
  job.spec.scene.environment = "absent.exr";
  EXPECT_NE(job.error().find("not found"), std::string::npos);
  job.spec.scene.environment = "";
  job.spec.scene.file = "absent.gltf";
  EXPECT_NE(job.error().find("not found"), std::string::npos);
  job.spec.scene.file = "scene";
  EXPECT_NE(job.error().find("not a regular file"), std::string::npos);
}

TEST(FilesOfJob, GoesWithoutAnImageThatNothingUses) {
  constexpr const char* kFormat =
      R"({"images":[{"uri":"a.png"},{"uri":"b.png"}],"textures":[{"source":0},{"source":1}],
    "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":1}}}]})";
  const Job job(kFormat);
  EXPECT_NE(job.error().find("/images/1/uri"), std::string::npos) << job.error();
  write(job.spec.folder / "scene/b.png", "1");
  EXPECT_EQ(job.paths(), (Paths{"scene/a.gltf", "scene/b.png"}));
}

TEST(FilesOfJob, RefusesAPathThroughAFolderThatWouldNotTravel) {
  const Job job(Job::buffer("sub/../b.bin"));
  write(job.spec.folder / "scene/b.bin", "1");
  fs::create_directories(job.spec.folder / "scene/sub");
  EXPECT_NE(job.error().find("out of it"), std::string::npos) << job.error();
}

TEST(FilesOfJob, TakesAndRefusesTheUrisThatTheLoaderDoes) {
  const TempFolder folder;
  write(folder / "root/scene/b.bin", "1");
  write(folder / "root/up.bin", "1");
  write(folder / "root/scene/50%.bin", "1");
  write(folder / "root/scene/c:d.bin", "1");
  write(folder / "out.bin", "1");
  const gltf::Folder loader(folder / "root/scene", folder / "root");
  for (const char* uri : {"b.bin",   "./b.bin", "%62.bin",   "50%.bin",   "50%25.bin", "../up.bin", "../../out.bin",
                          "x:b.bin", "c:d.bin", "./c:d.bin", "c%3Ad.bin", "/b.bin",    "\\b.bin",   "%5cb.bin",
                          "b.bin/",  "b.bin?x", ".",         "",          "b%0a.bin",  "é.bin"}) {
    JobSpec spec;
    spec.scene.file = "scene/a.gltf";
    spec.folder = folder / "root";
    std::string escaped;
    for (const char c : std::string_view(uri)) escaped += c == '\\' ? std::string("\\\\") : std::string(1, c);
    write(folder / "root/scene/a.gltf", Job::buffer(escaped));
    const auto files = files_of_job(spec);
    const auto opened = loader.resolve(uri);
    EXPECT_EQ(files.has_value(), opened.has_value()) << uri << ": " << (files ? "" : files.error().message);
    if (files && opened) {
      EXPECT_TRUE(std::any_of(files->begin(), files->end(), [&](const BundleFile& f) { return f.source == *opened; }))
          << uri;
    }
  }
}

struct Unpacking {
  explicit Unpacking() : store(BlobStore::open(folder / "blobs", 0).value()) {}
  TempFolder folder;
  BlobStore store;
};

TEST(Bundle, CarriesAJobToAnotherFolder) {
  Job job(Job::buffer("../b.bin"));
  write(job.spec.folder / "b.bin", "buffer");
  job.spec.stop.passes = 7;
  Unpacking to;
  std::vector<std::pair<std::string, BlobId>> files;
  const auto named = files_of_job(job.spec);
  ASSERT_TRUE(named);
  for (const BundleFile& file : *named) files.emplace_back(file.path, to.store.put_file(file.source).value());
  std::reverse(files.begin(), files.end());
  const auto manifest = make_bundle(job.spec, files);
  ASSERT_TRUE(manifest) << manifest.error().message;
  const auto spec = unpack_bundle(*manifest, to.store, to.folder / "job");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(canonical_json(*spec), canonical_json(job.spec));
  EXPECT_EQ(spec->folder, to.folder / "job");
  EXPECT_EQ(bytes_of(to.folder / "job/b.bin"), "buffer");
  const auto there = files_of_job(*spec);
  ASSERT_TRUE(there) << there.error().message;
  EXPECT_EQ(there->size(), named->size());
  EXPECT_FALSE(unpack_bundle(*manifest, to.store, to.folder / "job")) << "the folder is not empty";
}

TEST(Bundle, IsRefusedBeforeAnythingIsWritten) {
  Job job;
  Unpacking to;
  const BlobId scene = to.store.put_file(job.spec.folder / "scene/a.gltf").value();
  const auto refused = [&](const std::string& manifest) {
    return !unpack_bundle(manifest, to.store, to.folder / "job") && !fs::exists(to.folder / "job");
  };
  EXPECT_TRUE(refused(""));
  EXPECT_TRUE(refused(make_bundle(job.spec, {}).value())) << "without its scene";
  EXPECT_TRUE(refused(make_bundle(job.spec, {{"scene/a.gltf", BlobId{std::string(64, 'a'), 3}}}).value()))
      << "blob absent";
  wire::Bundle bundle = parse_bundle(make_bundle(job.spec, {{"scene/a.gltf", scene}}).value()).value();
  EXPECT_FALSE(refused(to_bytes(bundle)));
  fs::remove_all(to.folder / "job");
  bundle.set_spec_json("{}");
  EXPECT_TRUE(refused(to_bytes(bundle)));
}

TEST(Bundle, OfFilesThatCannotBeLaidOutIsNotMade) {
  const Job job;
  const BlobId id{std::string(64, 'a'), 3};
  for (const char* path : {"../a", "/a", "a/../b", ""}) EXPECT_FALSE(make_bundle(job.spec, {{path, id}})) << path;
  EXPECT_FALSE(make_bundle(job.spec, {{"a", id}, {"a", id}}));
  EXPECT_FALSE(make_bundle(job.spec, {{"a", id}, {"a-", id}, {"a/b", id}}));
  EXPECT_FALSE(make_bundle(job.spec, {{"a", BlobId{"short", 3}}}));
  EXPECT_FALSE(make_bundle(job.spec, {{"\xff", id}}));
}

}  // namespace
}  // namespace pf
