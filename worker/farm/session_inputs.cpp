// What a unit needs before it can be traced: the job's bundle and its files, and the radii of the round.

#include <fmt/format.h>

#include "common/wire/bundle.h"
#include "common/wire/limits.h"
#include "common/wire/state_blob.h"
#include "worker/farm/session.h"

namespace pf {
namespace {

constexpr double kDiskPauseSeconds = 2.0;  ///< between tries of a worker whose own disk is full

}  // namespace

bool Session::have(const BlobId& blob) {
  if (blobs_.has(blob)) return true;
  if (!fetch_ || fetch_->blob != blob) {
    fetch_ = Fetch{blob};
    ask_for_blob();
  }
  return false;
}

void Session::ask_for_blob() {
  wire::FromWorker message;
  wire::BlobRequest& request = *message.mutable_blob_request();
  request.mutable_blob()->set_sha256(sha256_bytes(fetch_->blob.sha256));
  request.mutable_blob()->set_bytes(fetch_->blob.bytes);
  request.set_offset(blobs_.partial_bytes(fetch_->blob));
  fetch_->asked = clock_.now();
  send(message);
}

void Session::on_blob_part(const wire::BlobPart& part) {
  if (!fetch_ || id_of(part.blob()) != fetch_->blob) return;
  const BlobId blob = fetch_->blob;
  const std::uint64_t here = blobs_.partial_bytes(blob);
  if (part.offset() != here) return;  // an answer to a question asked twice
  if (part.data().empty() && here < blob.bytes) {
    // The coordinator has it no more: the round is over, or the job is. Another task will come.
    fetch_.reset();
    if (current_) {
      acknowledge(current_->handles);
      current_.reset();
      want_work();
    }
    return;
  }
  auto kept = part.data().empty() ? Result<void>{} : blobs_.append_partial(blob, here, part.data());
  if (kept && blobs_.partial_bytes(blob) < blob.bytes) return ask_for_blob();
  if (kept) kept = blobs_.finish_partial(blob);
  fetch_.reset();
  if (!kept) {
    if (current_) hand_back_current(kept.error());
    return;
  }
  advance();
}

/// A trouble of this machine (a full disk, above all), not of the unit: it does not count as a failed attempt.
void Session::hand_back_current(const Error& error) {
  log_.error("unit handed back", {{"job", current_->task.job_id()}, {"why", error.message}});
  wire::FromWorker message;
  message.mutable_log()->set_level(wire::LogLine::ERROR);
  message.mutable_log()->set_job_id(current_->task.job_id());
  message.mutable_log()->set_text(fmt::format("a unit is handed back: {}", error.message).substr(0, kMaxTextBytes));
  send(message);
  for (const std::uint64_t handle : current_->handles) port_.give_back(handle);
  current_.reset();
  paused_until_ = clock_.now() + kDiskPauseSeconds;
  flush();
}

std::filesystem::path Session::folder_of(const wire::Task& task) const {
  return options_.cache / fmt::format("{}.{:x}", options_.name, options_.incarnation) / id_of(task.bundle()).sha256;
}

std::string Session::as_in_bundle(std::string text, const wire::Task& task) const {
  const std::string folder = folder_of(task).string() + "/";
  for (std::size_t at = text.find(folder); at != std::string::npos; at = text.find(folder, at))
    text.erase(at, folder.size());
  return text;
}

Result<bool> Session::have_bundle(const wire::Task& task) {
  const BlobId id = id_of(task.bundle());
  if (bundles_.contains(id.sha256)) return true;
  if (!have(id)) return false;
  const auto bytes = blobs_.read(id, 0, kMaxBundleBytes);
  if (!bytes)
    return fail(ErrorKind::kInternal, bytes.error().message);  // whatever became of it, the job has no part in it
  const auto bundle = parse_bundle(*bytes);
  if (!bundle) return tl::unexpected(bundle.error());
  for (const auto& file : bundle->files()) {
    if (!have(id_of(file.content()))) return false;
  }
  const auto folder = folder_of(task);
  auto spec = unpack_bundle(*bytes, blobs_, folder);
  if (!spec) {
    // The next try begins anew.
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
    return tl::unexpected(spec.error());
  }
  bundles_[id.sha256] = std::move(*spec);
  return true;
}

Result<void> Session::load_state(const wire::Task& task) {
  const BlobId id = id_of(task.state());
  if (state_hash_ == id.sha256) return {};
  auto state = read_state_blob(blobs_.path_of(id), std::size_t{task.width()} * task.height());
  if (!state) return tl::unexpected(state.error());
  state_hash_ = id.sha256;
  state_radii_ = std::make_shared<const std::vector<ProgressivePixel>>(std::move(*state));
  return {};
}

}  // namespace pf
