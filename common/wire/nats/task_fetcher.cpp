#include "common/wire/nats/task_fetcher.h"

#include <algorithm>
#include <cstdlib>

#include <fmt/format.h>

#include "common/wire/nats/subjects.h"

namespace pf::engine {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

constexpr double kMaxSeconds = 10.0;
constexpr auto kLookEvery = 200;   // ms; only lost answers and retries wait for it
constexpr auto kGrace = 250ms;     // the engine's own word on the end of a request may be so late
constexpr auto kAskAgain = 250ms;  // after the engine had no queue, or no room for the request
constexpr auto kAtOnceGrace = 750ms;
// A long wait is several requests: one that got lost, because the queue did not exist yet or its leader changed, has no
// answer at all, and costs no more than this.
constexpr auto kSlice = 2s;

/// 0 for a task.
int status_of(natsMsg* message) {
  const char* status = nullptr;
  if (natsMsgHeader_Get(message, "Status", &status) != NATS_OK || status == nullptr) return 0;
  return std::atoi(status);
}

}  // namespace

Result<void> TaskFetcher::start(Link& link) {
  link_ = &link;
  return link.listen(
      inbox_ + "*", [this](Message message) { take(std::move(message)); }, [this] { look_at_the_time(); }, kLookEvery);
}

void TaskFetcher::fetch(double seconds) {
  const std::lock_guard lock(mutex_);
  if (waiting_) return;
  waiting_ = true;
  at_once_ = seconds <= 0.0;
  const auto patience = std::chrono::duration<double>(std::clamp(seconds, 0.0, kMaxSeconds));
  deadline_ = steady_clock::now() + std::chrono::duration_cast<steady_clock::duration>(patience);
  ask();
}

void TaskFetcher::on_reconnected() {
  const std::lock_guard lock(mutex_);
  if (waiting_) ask_again_ = steady_clock::now();
}

/// Puts the request, with what is left of its time. Under the lock.
void TaskFetcher::ask() {
  const auto now = steady_clock::now();
  const auto slice = std::min<steady_clock::duration>(deadline_ - now, kSlice);
  const auto left = std::max<std::chrono::nanoseconds>(slice, 1ms).count();
  request_ += 1;
  ask_again_ = now + slice + kGrace;
  const std::string request =
      at_once_ ? std::string(R"({"batch":1,"no_wait":true})") : fmt::format(R"({{"batch":1,"expires":{}}})", left);
  link_->post(kNextTask, request, Link::IfDown::kDrop, inbox_ + std::to_string(request_));
}

void TaskFetcher::take(Message message) {
  const int status = status_of(message.get());
  if (status == 0) {
    take_task(std::move(message));
    return;
  }
  if (status == 100) return;  // a heartbeat
  const std::string_view subject = natsMsg_GetSubject(message.get());
  {
    const std::lock_guard lock(mutex_);
    if (!waiting_ || subject.substr(subject.rfind('.') + 1) != std::to_string(request_)) return;
    const auto now = steady_clock::now();
    const bool nothing_there = status == 404 || status == 408;
    if (!nothing_there && !at_once_) {
      ask_again_ = now + kAskAgain;
      return;
    }
    if (!at_once_ && now < deadline_) {
      ask();
      return;
    }
    waiting_ = false;
  }
  link_->sink()(NoTask{});
}

void TaskFetcher::take_task(Message message) {
  const char* reply = natsMsg_GetReply(message.get());
  if (reply == nullptr || !std::string_view(reply).starts_with(kAckPrefix)) return;
  TaskDelivered task;
  {
    const std::lock_guard lock(mutex_);
    if (!waiting_) {
      // Nobody waits for it any more: another worker may have it.
      link_->post(reply, "-NAK", Link::IfDown::kKeep);
      return;
    }
    waiting_ = false;
    task.delivery = {++last_handle_, std::string(data_of(message.get()))};
    acks_.emplace(last_handle_, reply);
  }
  link_->sink()(std::move(task));
}

void TaskFetcher::look_at_the_time() {
  {
    const std::lock_guard lock(mutex_);
    if (!waiting_) return;
    const auto now = steady_clock::now();
    if (now < deadline_ + (at_once_ ? kAtOnceGrace : kGrace)) {
      if (now >= ask_again_ && now < deadline_) ask();
      return;
    }
    waiting_ = false;
  }
  link_->sink()(NoTask{});
}

void TaskFetcher::in_progress(std::uint64_t handle) {
  const std::lock_guard lock(mutex_);
  const auto ack = acks_.find(handle);
  if (ack != acks_.end()) link_->post(ack->second, "+WPI", Link::IfDown::kDrop);
}

void TaskFetcher::finish(std::uint64_t handle, std::string_view word) {
  const std::lock_guard lock(mutex_);
  const auto ack = acks_.find(handle);
  if (ack == acks_.end()) return;
  link_->post(ack->second, word, Link::IfDown::kKeep);
  acks_.erase(ack);
}

}  // namespace pf::engine
