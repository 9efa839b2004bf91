// Parallel loops: the one door to oneTBB's scheduler.
//
// Debian's libtbb is not instrumented, so the thread sanitizer cannot see how it hands work from thread to thread and
// calls every loop a race. A build under that sanitizer runs the same loop bodies on plain threads, where a race that
// it reports is a race of the body.
#pragma once

#ifdef __SANITIZE_THREAD__
#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>
#else
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#endif

#include <cstddef>

namespace pf {

#ifdef __SANITIZE_THREAD__

/// As below.
template <class Body>
void parallel_ranges(std::size_t count, std::size_t grain, const Body& body) {
  constexpr std::size_t kThreads = 3;  // more than the smallest machine has processors: orders vary
  const std::size_t chunks = (count + grain - 1) / grain;
  std::atomic<std::size_t> next{0};
  std::exception_ptr failure;
  std::mutex failing;
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < std::min(kThreads, chunks); ++t) {
    threads.emplace_back([&] {
      try {
        // Relaxed: the counter must not order the bodies, or it would hide their races.
        for (std::size_t c; (c = next.fetch_add(1, std::memory_order_relaxed)) < chunks;)
          body(c * grain, std::min(count, (c + 1) * grain));
      } catch (...) {
        const std::lock_guard lock(failing);
        failure = std::current_exception();
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  if (failure) std::rethrow_exception(failure);
}

#else

/// Calls `body(begin, end)` on ranges that together are [0, count), each of about `grain` or more items; returns after
/// the last. Ranges run in any order and at once. An exception of a body ends the loop and is thrown on.
template <class Body>
void parallel_ranges(std::size_t count, std::size_t grain, const Body& body) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, grain),
                    [&](const tbb::blocked_range<std::size_t>& range) { body(range.begin(), range.end()); });
}

#endif

/// Calls `body(i)` for every i in [0, count), as `parallel_ranges` does.
template <class Body>
void parallel_for(std::size_t count, const Body& body) {
  parallel_ranges(count, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) body(i);
  });
}

/// Calls both, at once where a thread is free.
template <class First, class Second>
void parallel_invoke(const First& first, const Second& second) {
#ifdef __SANITIZE_THREAD__
  parallel_for(2, [&](std::size_t i) { i == 0 ? first() : second(); });
#else
  tbb::parallel_invoke(first, second);
#endif
}

}  // namespace pf
