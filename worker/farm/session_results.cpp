// How a worker's sums get to the coordinator: manifest, then the chunks that it asks for, until it has taken them in.

#include <algorithm>

#include "common/wire/limits.h"
#include "common/wire/statistics_codec.h"
#include "worker/farm/session.h"

namespace pf {
namespace {

/// Tracing takes at least so many times as long as handing in: packing, sending and merging of a 512x512 film's sums
/// cost 0.3 CPU seconds, and two workers on two cores trace 6 % less for it when they hand in every 4 s.
constexpr double kTransferShare = 50.0;
/// A worker that dies loses what it holds: little where handing in is quick, never more than the larger [s].
constexpr double kMinHoldSeconds = 4.0;
constexpr double kMaxHoldSeconds = 60.0;

}  // namespace

double Session::hold_seconds() const {
  return std::clamp(kTransferShare * last_transfer_, kMinHoldSeconds, kMaxHoldSeconds);
}

bool Session::flush() {
  if (!held_ || held_->units.empty()) {
    held_.reset();
    return true;
  }
  if (!outgoing_.empty() || (current_ && current_->working)) return false;
  PackedStatistics packed = pack_statistics(*held_->sums);
  Outgoing outgoing;
  wire::ResultManifest& m = outgoing.manifest;
  m.set_kind(wire::Task::SUB_PASSES);
  m.set_job_id(held_->job);
  m.set_round_begin(held_->round_begin);
  std::sort(held_->units.begin(), held_->units.end(),
            [](const wire::Unit& a, const wire::Unit& b) { return a.first_sub_pass() < b.first_sub_pass(); });
  for (const wire::Unit& unit : held_->units) *m.add_units() = unit;
  m.set_content(to_wire(packed.content));
  m.set_photon_paths(held_->sums->photon_paths);
  m.set_photons_stored(held_->sums->photons_stored);
  m.set_rays(held_->sums->rays);
  m.set_not_finite(held_->sums->faults.not_finite);
  m.set_overflow(held_->sums->faults.overflow);
  m.set_trace_seconds(held_->trace_seconds);
  rays_ += held_->sums->rays;
  photon_paths_ += held_->sums->photon_paths;
  outgoing.chunks = std::move(packed.chunks);
  outgoing.run = held_->run;
  outgoing.handles = std::move(held_->handles);
  held_.reset();
  send_result(std::move(outgoing));
  return true;
}

void Session::send_prepared(const PreparedScene& prepared) {
  Outgoing outgoing;
  wire::ResultManifest& m = outgoing.manifest;
  m.set_kind(wire::Task::PREPARE);
  m.set_job_id(current_->task.job_id());
  *m.add_units() = current_->task.unit();
  *m.mutable_prepared()->mutable_film() = to_wire(prepared.film);
  m.mutable_prepared()->set_scene_hash(prepared.scene_hash);
  m.mutable_prepared()->set_plan_line(prepared.plan_line.substr(0, kMaxTextBytes));
  for (const std::string& warning : prepared.warnings)
    m.mutable_prepared()->add_warnings(as_in_bundle(warning, current_->task).substr(0, kMaxTextBytes));
  const auto content = pack_state(prepared.radii, [&](std::string_view chunk) -> Result<void> {
    outgoing.chunks.emplace_back(chunk);
    return {};
  });
  if (!content) return fail_current(content.error(), false);
  m.set_content(to_wire(*content));
  outgoing.run = current_->task.run();
  outgoing.handles = current_->handles;
  current_.reset();
  send_result(std::move(outgoing));
}

void Session::send_result(Outgoing outgoing) {
  wire::ResultManifest& m = outgoing.manifest;
  m.set_version(kWireVersion);
  m.set_build_id(options_.build_id);
  m.set_result_id(next_result_++);
  m.set_transfer_seconds(last_transfer_);
  std::size_t largest = 0;
  for (const std::string& chunk : outgoing.chunks) {
    m.add_chunk_xxh3(xxh3_64(std::string_view(chunk)));
    largest = std::max(largest, chunk.size());
  }
  m.set_largest_chunk_bytes(largest);
  outgoing_.push_back(std::move(outgoing));
  if (outgoing_.size() == 1) announce_first();
}

void Session::announce_first() {
  if (outgoing_.empty()) return;
  Outgoing& first = outgoing_.front();
  first.last_word = clock_.now();
  if (first.started <= 0) first.started = first.last_word;
  wire::FromWorker message;
  *message.mutable_result() = first.manifest;
  send(message);
}

void Session::on_reply(const wire::ResultReply& reply) {
  if (outgoing_.empty()) return;
  Outgoing& first = outgoing_.front();
  if (reply.result_id() != first.manifest.result_id() || reply.job_id() != first.manifest.job_id()) return;
  first.last_word = clock_.now();
  if (reply.verdict() == wire::ResultReply::WANTED) {
    for (const std::uint32_t index : reply.missing()) {
      if (index >= first.chunks.size()) continue;
      wire::FromWorker message;
      message.mutable_chunk()->set_job_id(reply.job_id());
      message.mutable_chunk()->set_result_id(reply.result_id());
      message.mutable_chunk()->set_index(index);
      message.mutable_chunk()->set_data(first.chunks[index]);
      send(message);
    }
    return;
  }
  if (reply.verdict() == wire::ResultReply::REFUSED) {
    log_.info("result refused", {{"job", reply.job_id()}, {"why", reply.reason()}});
  }
  let_first_go();
  send_heartbeat();
  // Held sums that waited for this one while no work was to be had go next.
  if (!current_) flush();
  end_if_drained();
  advance();
  want_work();
}

void Session::let_first_go() {
  last_transfer_ = clock_.now() - outgoing_.front().started;
  acknowledge(outgoing_.front().handles);
  outgoing_.pop_front();
  announce_first();
}

}  // namespace pf
