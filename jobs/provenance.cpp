#include "jobs/provenance.h"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <span>
#include <system_error>

#include <fmt/format.h>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"

namespace pf {
namespace {

namespace fs = std::filesystem;

Result<void> copy_to(const fs::path& source, const fs::path& target) {
  std::error_code error;
  if (fs::equivalent(source, target, error) && !error) return {};
  fs::create_directories(target.parent_path(), error);
  if (!error) fs::copy_file(source, target, fs::copy_options::overwrite_existing, error);
  if (error)
    return fail(ErrorKind::kInternal,
                fmt::format("{}: cannot be copied to {}: {}", source.string(), target.string(), error.message()));
  return {};
}

}  // namespace

Result<ImageOrigin> read_origin(const fs::path& exr) {
  auto image = read_exr(exr);
  if (!image) return tl::unexpected(image.error());
  const auto text = [&](const char* key) {
    const auto found = image->metadata.find(key);
    return found == image->metadata.end() ? std::string() : found->second;
  };
  if (text("spec").empty() || text("passes").empty() || text("build_id").empty() || image->layers.empty()) {
    return fail(
        ErrorKind::kInvalidInput,
        fmt::format("{}: does not say how it was rendered; expected an image that photonfarm wrote", exr.string()));
  }
  auto spec = parse_job_json(text("spec"), exr.string() + " (its spec)");
  if (!spec) return fail(ErrorKind::kInvalidInput, spec.error().message);
  ImageOrigin origin;
  const std::string passes = text("passes");
  std::int64_t count = 0;
  if (std::from_chars(passes.data(), passes.data() + passes.size(), count).ec != std::errc() || count <= 0)
    return fail(ErrorKind::kInvalidInput,
                fmt::format("{}: its passes are '{}'; expected a number", exr.string(), passes));
  // Whatever stopped it, a job that stops after as many passes gives the same bits.
  if (spec->stop.error > 0) spec->integrator.error_estimate = true;  // the same layers
  spec->stop = {};
  spec->stop.passes = count;
  origin.spec = std::move(*spec);
  if (auto files = parse_file_list(text("files"))) origin.files = std::move(*files);
  origin.build_id = text("build_id");
  origin.scene_hash = text("scene_hash");
  origin.state_chain = text("state_chain");
  origin.image_hash = sha256_hex(std::as_bytes(std::span(image->layers.front().data)));
  origin.image = std::move(*image);
  return origin;
}

Result<void> use_scene_folder(ImageOrigin& origin, const fs::path& scene) {
  origin.spec.folder = scene;
  auto files = hashed_files_of_job(origin.spec);
  if (!files) return tl::unexpected(files.error());
  for (const auto& [path, id] : origin.files) {
    const auto here = std::ranges::find(
        *files, path, [](const auto& file) -> const auto& { return file.first; });
    if (here != files->end() && here->second == id) continue;
    return fail(
        ErrorKind::kInvalidInput,
        fmt::format("{}: {}; expected the file that the image was rendered from, SHA-256 {}", (scene / path).string(),
                    here == files->end() ? "the scene does not need it any more" : "has another content", id.sha256));
  }
  origin.files = std::move(*files);
  return {};
}

Result<void> fetch_scene(ServiceClient& client, ImageOrigin& origin, const fs::path& folder) {
  if (origin.files.empty())
    return fail(ErrorKind::kInvalidInput, "the image does not list its scene's files; expected --scene FOLDER");
  for (const auto& [path, id] : origin.files) {
    const fs::path target = folder / path;
    std::error_code error;
    fs::create_directories(target.parent_path(), error);
    std::ofstream out(target, std::ios::binary);
    Sha256 hash;
    ServiceCall call{.path = "/v1/blobs/" + id.sha256};
    call.take = [&](std::string_view piece) {
      hash.update(piece);
      return static_cast<bool>(out.write(piece.data(), static_cast<std::streamsize>(piece.size())));
    };
    const auto reply = client.call(call);
    if (!reply) return tl::unexpected(reply.error());
    out.close();
    if (reply->status == 404) {
      return fail(ErrorKind::kInvalidInput,
                  fmt::format("{} does not have {} any more (SHA-256 {}); expected --scene FOLDER", client.url(), path,
                              id.sha256));
    }
    if (auto checked = client.check(*reply); !checked) return checked;
    if (!out || hash.hex() != id.sha256)
      return fail(ErrorKind::kInternal, fmt::format("{}: did not come whole", target.string()));
  }
  origin.spec.folder = folder;
  return {};
}

Result<fs::path> lay_out_job(const ImageOrigin& origin, const fs::path& folder) {
  for (const auto& [path, id] : origin.files) {
    if (auto copied = copy_to(origin.spec.folder / path, folder / path); !copied) return tl::unexpected(copied.error());
  }
  const fs::path job = folder / "job.json";
  if (auto written = write_file_atomically(job, canonical_json(origin.spec)); !written)
    return tl::unexpected(written.error());
  return job;
}

}  // namespace pf
