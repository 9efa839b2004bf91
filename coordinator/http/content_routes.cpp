// The routes whose content is not held in memory: files that jobs leave, and blobs.

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <mutex>
#include <system_error>
#include <utility>

#include "common/base/hash.h"
#include "common/wire/limits.h"
#include "coordinator/http/json.h"
#include "coordinator/http/routes.h"

namespace pf {
namespace {

bool is_sha256(std::string_view text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

std::optional<std::uint64_t> content_length(const HttpRequest& request) {
  const std::string text = request.header("content-length");
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

HttpReply not_a_hash() {
  return problem(400, "bad-request", "the name of a blob: expected 64 lower-case hexadecimal digits of a SHA-256");
}

HttpReply empty_reply(int status) {
  HttpReply reply;
  reply.status = status;
  return reply;
}

}  // namespace

HttpReply HttpRoutes::exr(const HttpRequest& request, const Captures& captures) {
  return artifact(request, captures[0], Artifact::kExr, "image/x-exr");
}

HttpReply HttpRoutes::png(const HttpRequest& request, const Captures& captures) {
  return artifact(request, captures[0], Artifact::kPng, "image/png");
}

HttpReply HttpRoutes::figures(const HttpRequest& request, const Captures& captures) {
  return artifact(request, captures[0], Artifact::kJson, "application/json");
}

HttpReply HttpRoutes::checkpoint(const HttpRequest& request, const Captures& captures) {
  return artifact(request, captures[0], Artifact::kCheckpoint, "application/octet-stream");
}

HttpReply HttpRoutes::artifact(const HttpRequest& request, const std::string& id, Artifact kind,
                               std::string_view type) {
  const auto path = service_.artifact(id, kind);
  if (!path) {
    const auto job = service_.show(id);
    const std::string_view what = kind == Artifact::kCheckpoint ? "checkpoint" : "results";
    const bool expired = job && std::ranges::find(job->expired, what) != job->expired.end();
    return failure(path.error(), expired ? kExpired : kNotYet);
  }
  auto opened = OpenFile::open(*path);
  if (!opened) return failure(opened.error(), kNotYet);
  const auto file = std::make_shared<const OpenFile>(std::move(*opened));
  HttpReply reply;
  reply.content_type = type;
  reply.headers = {{"ETag", file->etag()}, {"Accept-Ranges", "bytes"}, {"Cache-Control", "no-cache"}};
  if (request.header("if-none-match") == file->etag()) {
    reply.status = 304;
    return reply;
  }
  // A range of a file that was replaced since would mend two files together: then the whole one is sent.
  const std::string condition = request.header("if-range");
  const bool same = condition.empty() || condition == file->etag();
  const ByteRange range = parse_range(same ? request.header("range") : std::string(), file->bytes());
  if (range.kind == ByteRange::Kind::kUnsatisfiable) {
    HttpReply refused = problem(416, "bad-range", fmt::format("the file has {} bytes", file->bytes()));
    refused.headers.emplace_back("Content-Range", fmt::format("bytes */{}", file->bytes()));
    return refused;
  }
  if (range.kind == ByteRange::Kind::kPart) {
    reply.status = 206;
    reply.headers.emplace_back(
        "Content-Range", fmt::format("bytes {}-{}/{}", range.offset, range.offset + range.bytes - 1, file->bytes()));
  }
  reply.body = FileSlice{file, range.offset, range.bytes};
  return reply;
}

HttpReply HttpRoutes::head_blob(const HttpRequest&, const Captures& captures) {
  if (!is_sha256(captures[0])) return not_a_hash();
  std::error_code error;
  const std::lock_guard lock(store_mutex_);
  const std::uint64_t bytes = std::filesystem::file_size(store_.path_of({captures[0], 0}), error);
  if (error || !store_.has({captures[0], bytes})) return problem(404, "not-found", "no such blob");
  // Asked for, it is needed soon: it must not be swept away as a stray one before its job is submitted.
  std::filesystem::last_write_time(store_.path_of({captures[0], bytes}), std::filesystem::file_time_type::clock::now(),
                                   error);
  return empty_reply(200);
}

HttpReply HttpRoutes::get_blob(const HttpRequest&, const Captures& captures) {
  if (!is_sha256(captures[0])) return not_a_hash();
  std::unique_lock lock(store_mutex_);
  auto opened = OpenFile::open(store_.path_of({captures[0], 0}));
  lock.unlock();
  if (!opened) return problem(404, "not-found", "no such blob");
  const auto file = std::make_shared<const OpenFile>(std::move(*opened));
  HttpReply reply;
  reply.content_type = "application/octet-stream";
  reply.body = FileSlice{file, 0, file->bytes()};
  return reply;
}

HttpReply HttpRoutes::put_blob(const HttpRequest& request, const Captures& captures) {
  const std::string& name = captures[0];
  if (!is_sha256(name)) return not_a_hash();
  const auto length = content_length(request);
  if (!length) return problem(411, "length-required", "expected a Content-Length");
  if (*length > kMaxBlobBytes) {
    return problem(413, "too-large", fmt::format("the blob has {} bytes; expected at most {}", *length, kMaxBlobBytes));
  }
  // A store of its own over the same folder: slow uploads do not wait for each other. Only their beginnings
  // do, because opening a store removes files that nobody has locked yet.
  std::unique_lock lock(store_mutex_);
  auto store = BlobStore::open(options_.blobs, 0);
  if (!store) return failure(store.error());
  Sha256 hash;
  std::uint64_t bytes = 0;
  const auto put = store->put_stream([&](const BlobStore::Sink& sink) -> Result<void> {
    lock.unlock();
    Result<void> stored;
    const bool whole = request.read_body([&](std::string_view piece) {
      hash.update(piece);
      bytes += piece.size();
      stored = sink(piece);
      return stored.has_value();
    });
    if (!stored) return stored;
    if (!whole || bytes != *length) return fail(ErrorKind::kInvalidInput, "the blob did not come whole");
    if (hash.hex() != name) {
      return fail(ErrorKind::kInvalidInput, fmt::format("the content's SHA-256 is {}; expected {}", hash.hex(), name));
    }
    return {};
  });
  return put ? empty_reply(201) : failure(put.error());
}

}  // namespace pf
