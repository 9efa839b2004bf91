#include "common/wire/bundle.h"

#include <unistd.h>

#include <algorithm>
#include <map>
#include <set>
#include <system_error>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/base/hash.h"
#include "common/wire/gltf_files.h"
#include "common/wire/limits.h"
#include "common/wire/message_scan.h"
#include "common/wire/messages.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

tl::unexpected<Error> refuse(const fs::path& file, std::string_view why) {
  return fail(ErrorKind::kInvalidInput, fmt::format("{}: {}", file.generic_string(), why));
}

/// True when `path`, links resolved, lies in `root`.
bool is_inside(const fs::path& path, const fs::path& root) {
  const auto [end, ignored] = std::mismatch(root.begin(), root.end(), path.begin(), path.end());
  return end == root.end();
}

/// Collects the files of one job, each under the path by which the renderer will look for it.
class Collector {
 public:
  explicit Collector(fs::path folder) : folder_(std::move(folder)) {}

  /// `place`: where the file is really looked for; `path`: by which name, relative to the job's folder;
  /// `named_by` and `name` are for messages. Returns where it lies, links resolved.
  Result<fs::path> add(const fs::path& place, const fs::path& path, const fs::path& named_by, const std::string& name) {
    std::error_code error;
    const fs::path root = fs::canonical(folder_, error);
    if (error) return refuse(folder_, "the job's folder is not found");
    const fs::path source = fs::weakly_canonical(place, error);
    const std::string in_bundle = path.lexically_normal().generic_string();
    if (error || !is_inside(source, root))
      return refuse(named_by, fmt::format("'{}' lies outside the job's folder", name));
    if (!fs::exists(place, error)) return refuse(named_by, fmt::format("file '{}' is not found", name));
    if (!fs::is_regular_file(source, error)) return refuse(named_by, fmt::format("'{}' is not a regular file", name));
    if (!is_bundle_path(in_bundle) || !is_utf8(in_bundle)) {
      return refuse(named_by,
                    fmt::format("'{}' cannot be the name of a file on a farm; expected UTF-8 without '\\' of at "
                                "most 1024 bytes, inside the job's folder",
                                name));
    }
    const auto [known, fresh] = files_.emplace(in_bundle, source);
    if (!fresh && known->second != source) {
      return refuse(named_by,
                    fmt::format("'{}' and {} would be one file on a farm; expected paths without links and '..'", name,
                                known->second.generic_string()));
    }
    return source;
  }

  [[nodiscard]] std::vector<BundleFile> files() const {
    std::vector<BundleFile> out;
    for (const auto& [path, source] : files_) out.push_back({path, source});
    return out;
  }

 private:
  fs::path folder_;
  std::map<std::string, fs::path> files_;
};

/// '..' after a folder's name needs that folder to be there, and a bundle holds files only.
bool climbs_back(const fs::path& path) {
  bool inside = false;
  for (const fs::path& part : path) {
    if (part == "..") {
      if (inside) return true;
    } else if (part != ".") {
      inside = true;
    }
  }
  return false;
}

Result<void> add_gltf_files(const JobSpec& spec, const fs::path& scene, Collector& collector) {
  const fs::path shown = spec.folder / spec.scene.file;
  const auto uris = gltf_uris(scene);
  if (!uris) return refuse(shown, uris.error());
  for (const GltfUri& uri : *uris) {
    const auto name = gltf_file_name(uri.uri);
    Result<fs::path> added;
    if (!name) {
      added = refuse(shown, name.error());
    } else if (climbs_back(*name)) {
      added = refuse(shown,
                     fmt::format("'{}' goes into a folder and back out of it; expected '..' at the front only", *name));
    } else {
      added = collector.add(scene.parent_path() / *name, fs::path(spec.scene.file).parent_path() / *name, shown, *name);
    }
    // The loader only warns about an image that nothing uses.
    if (!added && uri.needed) return fail(added.error().kind, added.error().message + fmt::format(" ({})", uri.place));
  }
  return {};
}

}  // namespace

Result<std::vector<BundleFile>> files_of_job(const JobSpec& spec) {
  try {
    Collector collector(spec.folder);
    const fs::path job = spec.folder / spec.scene.file;
    const auto scene = collector.add(job, spec.scene.file, job, spec.scene.file);
    if (!scene) return tl::unexpected(scene.error());
    if (auto added = add_gltf_files(spec, *scene, collector); !added) return tl::unexpected(added.error());
    if (!spec.scene.environment.empty()) {
      const fs::path map = spec.folder / spec.scene.environment;
      if (auto added = collector.add(map, spec.scene.environment, map, spec.scene.environment); !added) {
        return tl::unexpected(added.error());
      }
    }
    return collector.files();
  } catch (const std::exception& e) {  // bad_alloc, or a name that the system has no characters for
    return refuse(spec.folder / spec.scene.file, fmt::format("cannot be read: {}", e.what()));
  }
}

Result<std::string> make_bundle(const JobSpec& spec, const std::vector<std::pair<std::string, BlobId>>& files) {
  wire::Bundle bundle;
  bundle.set_version(kWireVersion);
  bundle.set_spec_json(canonical_json(spec));
  auto sorted = files;
  std::sort(sorted.begin(), sorted.end());
  for (const auto& [path, id] : sorted) {
    wire::Bundle::File& file = *bundle.add_files();
    if (!is_utf8(path)) return fail(ErrorKind::kInvalidInput, "bundle: a path is not UTF-8");
    file.set_path(path);
    file.mutable_content()->set_sha256(sha256_bytes(id.sha256));
    file.mutable_content()->set_bytes(id.bytes);
  }
  std::string bytes = to_bytes(bundle);
  // What no worker would take is refused here.
  if (auto parsed = parse_bundle(bytes); !parsed) return tl::unexpected(parsed.error());
  return bytes;
}

namespace {

Result<void> lay_out(const fs::path& blob, const fs::path& target) {
  std::error_code error;
  fs::create_directories(target.parent_path(), error);
  if (!error && ::link(blob.c_str(), target.c_str()) == 0) return {};
  if (!error) fs::copy_file(blob, target, fs::copy_options::none, error);
  if (error)
    return fail(ErrorKind::kInternal, fmt::format("{}: cannot be laid out: {}", target.string(), error.message()));
  return {};
}

}  // namespace

Result<JobSpec> unpack_bundle(std::string_view manifest, const BlobStore& store, const fs::path& folder) {
  const auto bundle = parse_bundle(manifest);
  if (!bundle) return tl::unexpected(bundle.error());
  auto spec = parse_job_json(bundle->spec_json(), "bundle");
  if (!spec) return tl::unexpected(spec.error());
  std::set<std::string_view> paths;
  for (const wire::Bundle::File& file : bundle->files()) {
    const BlobId id{sha256_hex_of_bytes(file.content().sha256()), file.content().bytes()};
    if (!store.has(id)) {
      return fail(ErrorKind::kInvalidInput,
                  fmt::format("bundle: the content of {} is not here: blob {}", file.path(), id.sha256));
    }
    paths.insert(file.path());
  }
  for (const std::string& needed : {spec->scene.file, spec->scene.environment}) {
    if (!needed.empty() && !paths.contains(needed)) {
      return fail(ErrorKind::kInvalidInput,
                  fmt::format("bundle: {} is named by the job and not in the bundle", needed));
    }
  }
  std::error_code error;
  fs::create_directories(folder, error);
  if (error || !fs::is_empty(folder, error) || error) {
    return fail(ErrorKind::kInternal,
                fmt::format("{}: expected an empty folder, or none, for the files of a bundle", folder.string()));
  }
  for (const wire::Bundle::File& file : bundle->files()) {
    const BlobId id{sha256_hex_of_bytes(file.content().sha256()), file.content().bytes()};
    if (auto laid = lay_out(store.path_of(id), folder / file.path()); !laid) return tl::unexpected(laid.error());
  }
  spec->folder = folder;
  return spec;
}

std::string file_list_json(const FileList& files) {
  nlohmann::json list = nlohmann::json::array();
  for (const auto& [path, id] : files) list.push_back({{"path", path}, {"sha256", id.sha256}, {"bytes", id.bytes}});
  return list.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Result<FileList> parse_file_list(std::string_view text) {
  const auto broken = [](std::string_view what) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("list of files: {}; expected [{{\"path\", \"sha256\", \"bytes\"}}]", what));
  };
  FileList files;
  try {
    for (const nlohmann::json& file : nlohmann::json::parse(text)) {
      const BlobId id{file.at("sha256").get<std::string>(), file.at("bytes").get<std::uint64_t>()};
      const auto path = file.at("path").get<std::string>();
      if (id.sha256.size() != 64 || id.sha256.find_first_not_of("0123456789abcdef") != std::string::npos)
        return broken("no SHA-256");
      if (!is_bundle_path(path) || files.size() >= kMaxBundleFiles) return broken("no relative path, or too many");
      files.emplace_back(path, id);
    }
  } catch (const nlohmann::json::exception&) {
    return broken("not valid");
  }
  return files;
}

Result<FileList> files_of_bundle(std::string_view manifest) {
  const auto bundle = parse_bundle(manifest);
  if (!bundle) return tl::unexpected(bundle.error());
  FileList files;
  for (const wire::Bundle::File& file : bundle->files())
    files.emplace_back(file.path(), BlobId{sha256_hex_of_bytes(file.content().sha256()), file.content().bytes()});
  return files;
}

Result<FileList> hashed_files_of_job(const JobSpec& spec) {
  const auto bundle = files_of_job(spec);
  if (!bundle) return tl::unexpected(bundle.error());
  FileList files;
  for (const BundleFile& file : *bundle) {
    auto hash = sha256_hex_of_file(file.source);
    if (!hash) return tl::unexpected(hash.error());
    std::error_code error;
    const std::uint64_t bytes = fs::file_size(file.source, error);
    if (error) return fail(ErrorKind::kInvalidInput, fmt::format("{}: {}", file.source.string(), error.message()));
    files.emplace_back(file.path, BlobId{std::move(*hash), bytes});
  }
  return files;
}

}  // namespace pf
