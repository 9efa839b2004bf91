#include "jobs/farm_supervisor.h"

#include <gtest/gtest.h>

namespace pf {
namespace {

using namespace std::chrono_literals;

TEST(RestartPause, DoublesForWhatFailsAtItsStart) {
  RestartPause pause;
  for (const auto expected : {250ms, 500ms, 1000ms, 2000ms, 4000ms, 8000ms, 16000ms, 32000ms, 32000ms, 32000ms})
    EXPECT_EQ(pause.after(100ms), expected);
}

TEST(RestartPause, StaysShortForWhatIsKilledAtWork) {
  RestartPause pause;
  for (int i = 0; i < 100; ++i) EXPECT_EQ(pause.after(5s), 250ms);
}

TEST(RestartPause, BeginsAnewOnceTheProgramHasRun) {
  RestartPause pause;
  for (int i = 0; i < 9; ++i) static_cast<void>(pause.after(0s));
  EXPECT_EQ(pause.after(3s), 250ms);
  EXPECT_EQ(pause.after(0s), 500ms);
}

}  // namespace
}  // namespace pf
