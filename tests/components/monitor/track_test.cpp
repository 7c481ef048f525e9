// Places that come as numbers: jumps are lost, and p tells how fast a body is where its v does not.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "components/monitor/track.h"
#include "models/foundation/support/text.h"
#include "tests/components/monitor/slides.h"

namespace cotwin::monitor::track_test {
namespace {

using cotwin::testing::UnitSubject;
using Eigen::Vector3d;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using Values = std::vector<double>;
using Course = std::function<Vector3d(double)>;

class Tracks : public Slides {
 protected:
  /// A robot at rest at 0, and a person.
  UnitSubject watch() const {
    UnitSubject unit = monitor("robot=@slide.urdf&scene=@ball.sdf&separation=all&ignore=hand:obstacle");
    unit.set("v_h", "0").set("a_r", "0").set("T_r", "0.1").set("T_s", "0.5").set("slow_band", "0");
    return unit;
  }
};

std::vector<std::string> notes_of(const UnitSubject& unit) {
  std::vector<std::string> notes;
  const_cast<UnitSubject&>(unit).unit().append_notes(notes);
  return notes;
}

TEST_F(Tracks, PlacesThatJumpAreLostUntilTheyHaveBeenConsistent) {
  struct Case {
    const char* name;
    Course p;          // m
    double last;       // when the last jump is, s; ∞: goes on
    double times;      // lost
    const char* note;  // of the first
  };
  // At 1 s it goes wrong, in the grid of all steps.
  const auto during = [](double t, double to) { return t > 1 - 1e-9 && t < to - 1e-9; };
  const Case cases[] = {
      {"beyond", [&](double t) { return Vector3d(during(t, 1.04) ? 1e300 : 4, 0, 0); }, 1.04, 1,
       "its place was beyond 1e+06 m"},
      {"farther than double squares", [&](double t) { return Vector3d(3, during(t, 1.2) ? -1.7e308 : 0, 0); }, 1.2, 1,
       "its place was beyond 1e+06 m"},
      {"a wrong sample", [&](double t) { return Vector3d(during(t, 1.04) ? 5 : 4, 0, 0); }, 1.04, 1, "it jumped by 1 m in "},
      {"alternating",
       [&](double t) {
         return Vector3d(4, during(t, 9) && std::lround(std::floor((t - 1) / 0.04 + 1e-6)) % 2 == 0 ? 3 : 0, 0);
       },
       INFINITY, 1, "it jumped by 3 m in "},
      {"elsewhere", [&](double t) { return Vector3d(4, during(t, 9) ? 6 : 0, 0); }, 1, 1, "it jumped by 6 m in "},
      {"lost on the way",
       [&](double t) {
         return Vector3d(during(t, 1.6) ? NAN : t > 1.5 ? 9 : 4, 0, 0);
       },
       1.6, 1, "its pose or speed was no number"},
  };
  for (const double h : {0.0005, 0.004, 0.04}) {
    for (const Case& c : cases) {
      SCOPED_TRACE(std::string(c.name) + " at " + std::to_string(h));
      UnitSubject unit = watch();
      unit.set("restart_delay", "0.3");
      const auto place = [&](double t) {
        const Vector3d p = c.p(t) + Vector3d(0, 0, 1e-4 * t);  // which changes all the time
        unit.set("obstacle.p", Values{p.x(), p.y(), p.z()});
      };
      place(0);
      unit.initialise();
      while (unit.now() < 3 - h) {
        place(unit.now() + h);
        unit.step(h);
        const double t = unit.now();
        const bool lost = t > 1 - 1e-9 && t < c.last + 0.3 - 1e-9;
        ASSERT_EQ(unit.real("obstacle.lost"), lost ? 1 : 0) << t;
        if (lost) {
          ASSERT_EQ(unit.integer("zone"), 2) << t;
          ASSERT_NEAR(unit.real("distance"), c.p(0).norm() - 0.3, 1e-8) << "where it was last";
        }
      }
      EXPECT_EQ(unit.real("obstacle.lost", 1), c.times);
      EXPECT_NEAR(unit.real("obstacle.lost", 2), 1, 1e-9);
      EXPECT_EQ(unit.integer("zone"), c.last < INFINITY ? 0 : 2);
      EXPECT_THAT(notes_of(unit), Contains(HasSubstr(std::string("obstacle was lost (") + c.note)));
    }
  }
}

TEST_F(Tracks, WhoComesFirstOrStepByStepDoesNotJump) {
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 0.005);
  for (const double h : {0.0005, 0.004, 0.04}) {
    for (const double v : {1e-3, 1.6, 9.9, 25.0}) {
      for (const double noisy : {0.0, 1.0}) {
        UnitSubject unit = watch();
        unit.set("obstacle.p", Values{0, 0, 0}).set("obstacle.v", Values{0, v, 0});
        unit.initialise();
        while (unit.now() < 2) {
          unit.set("obstacle.p", Values{40 + noisy * noise(random), noisy * noise(random) + v * unit.now(), 0});
          unit.step(h);
        }
        EXPECT_EQ(unit.real("obstacle.lost", 1), v * h > 0.1 + 10 * h ? 1 : 0) << h << " " << v;
        EXPECT_THAT(notes_of(unit), Not(Contains(HasSubstr("by its p"))));
      }
    }
  }
}

/// How a body that goes its course is seen: every `every` seconds with jitter, held in between, with noise.
struct Tracker {
  double every = 0, jitter = 0, noise = 0;
  std::mt19937 random{7};
  double next = 0;
  Vector3d p = Vector3d::Zero(), v = Vector3d::Zero();

  void look(const Course& course, double t) {
    if (t < next - 1e-9) return;
    next += every * (1 + jitter * std::uniform_real_distribution<double>(-1, 1)(random));
    std::normal_distribution<double> normal(0, noise);
    p = course(t);
    v = (course(t + 1e-6) - course(t - 1e-6)) / 2e-6;
    if (noise > 0) p += Vector3d(normal(random), normal(random), normal(random));
  }
};

// Whatever it does and however rarely it is seen.
TEST(Track, AddsNothingWhereVIsRight) {
  std::mt19937 random(5);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  for (int k = 0; k < 300; ++k) {
    const double h = std::array{0.0005, 0.004, 0.04}[static_cast<std::size_t>(k) % 3],
                 every = k % 4 == 0 ? 0 : uniform(0.01, 0.25);
    const double starts = uniform(0, 0.5), stops = uniform(0.8, 2), far = uniform(0.1, 4), slow = uniform(0.5, 1);
    const double turn = uniform(0, 1) * std::min(9.0, 0.6 / std::max(every, h));  // no more than samples can tell
    // Starts with a jerk, swings, stands, and goes on slowly.
    const Course course = [&](double t) {
      const double s = std::clamp(t, starts, stops) - starts;
      return Vector3d(far * s, far / 5 * std::sin(turn * s), std::max(0.0, t - stops - 0.7) * slow);
    };
    Tracker tracker{every, k % 2 == 0 ? 0.2 : 0};
    Track track;
    track.reset();
    for (std::int64_t n = 0; n < std::llround(4 / h); ++n) {
      const double t = static_cast<double>(n) * h;
      tracker.look(course, t);
      ASSERT_FALSE(track.take(true, tracker.p, tracker.v, t, n == 0 ? 0 : h, 1e6, 0.5));
      ASSERT_LE(track.untold(), 0) << k << " at " << t;
    }
    std::vector<std::string> notes;
    track.append_note("person", notes);
    EXPECT_TRUE(notes.empty());
  }
}

TEST(Track, TellsTheSpeedThatVDoesNot) {
  for (const double h : {0.0005, 0.004, 0.04, 0.5}) {
    for (const double every : {0.0, 0.1, 0.25, 1.0}) {
      for (const double share : {0.0, 0.5, -0.5, 0.85, 1.0, 3.0}) {
        SCOPED_TRACE(std::to_string(h) + " " + std::to_string(every) + " " + std::to_string(share));
        const double v = every > 0.5 ? 1.5 : 3;
        Track track;
        track.reset();
        Tracker tracker{every};
        const auto go = [&](double from, double to, const Course& course) {
          for (double t = from; t < to - 1e-9; t += h) {
            tracker.look(course, t);
            ASSERT_FALSE(track.take(true, tracker.p, share * tracker.v, t, t == 0 ? 0 : h, 10, 0.5)) << t;
          }
        };
        const double end = every > 0.5 ? 6 : 3;  // of a rare one two changes are needed
        go(0, end, [&](double t) { return Vector3d(v * t, 0, 0); });
        // 10 mm within 0.2 s to 0.5 s count for nothing.
        const double excess = v * (1 - 1.1 * std::abs(share));
        EXPECT_LE(track.untold(), std::max(0.0, excess) + 1e-9);
        EXPECT_GE(track.untold(), std::max(0.0, excess - 0.05) - 1e-9);
        std::vector<std::string> notes;
        track.append_note("person", notes);
        if (excess > 0.15) {
          ASSERT_EQ(notes.size(), 1u);
          EXPECT_THAT(notes[0], HasSubstr("person moved at " + text::to_text(v) + " m/s by its p, at "));
        }
        if (excess < 0) {
          EXPECT_TRUE(notes.empty());
        }
        for (const double t : {0.1, 0.2, 0.3, 0.39}) {  // between places that come rarely it moves on
          if (every == 1 && h < 0.01) {
            (void)track.take(true, tracker.p, share * tracker.v, end + t, h, 10, 0.5);
            EXPECT_GE(track.untold(), std::max(0.0, excess - 0.05) - 1e-9) << t;
          }
        }
        go(end + 0.4, end + 0.4 + std::max(4.0, 4 * h), [&](double) { return Vector3d(v * end, 0, 0); });
        EXPECT_EQ(track.untold(), 0) << "it stands";
      }
    }
  }
}

// A person who comes at constant speed, told in several ways, to a robot that stands or runs.
TEST_F(Tracks, RobotsStopInTimeForWhoIsFasterThanVTells) {
  const auto stopped = [&](double v, double h, double runs, const std::function<Vector3d(const Vector3d&)>& told,
                           Tracker tracker) {
    UnitSubject unit = watch();
    unit.set("a_r", "0").set("dq", Values{runs, 0, 0});
    const double from = 3 + 1.2 * v;
    const auto observe = [&](double t) {
      tracker.look([&](double at) { return Vector3d(from - v * at, 0, 0); }, t);
      const Vector3d says = told(tracker.v);
      unit.set("obstacle.p", Values{tracker.p.x(), tracker.p.y(), tracker.p.z()});
      for (std::size_t i = 0; i < 3; ++i) unit["obstacle.v"][i] = says[static_cast<Eigen::Index>(i)];
    };
    observe(0);
    unit.start();
    while (unit.integer("zone") != 2 && unit.now() < 9) {
      observe(unit.now() + h);
      unit.step(h);
    }
    if (tracker.noise > 0) {
      EXPECT_EQ(unit.real("obstacle.lost", 1), 0);
      EXPECT_THAT(notes_of(unit), Not(Contains(HasSubstr("by its p"))));
    }
    return unit.now();
  };
  const auto right = [](const Vector3d& v) { return v; };
  for (const double v : {0.8, 1.6, 5.0, 25.0}) {
    for (const double h : {0.0005, 0.004, 0.04}) {
      if (v * h > 0.1 + 10 * h) continue;  // it jumps
      for (const double runs : {0.0, 0.4}) {
        SCOPED_TRACE(std::to_string(v) + " " + std::to_string(h) + " " + std::to_string(runs));
        const double best = stopped(v, h, runs, right, {});
        const double latest = best + 0.2 + 1e-9;
        EXPECT_GT(best, 0.5);
        EXPECT_LT(best, 8);
        EXPECT_LE(stopped(v, h, runs, [](const Vector3d&) { return Vector3d(0, 0, 0); }, {}), latest);
        EXPECT_LE(stopped(v, h, runs, [](const Vector3d& x) { return Vector3d(x / 2); }, {}), latest);
        EXPECT_LE(stopped(v, h, runs, [](const Vector3d&) { return Vector3d(NAN, 0, 0); }, {}), latest);
        EXPECT_EQ(stopped(v, h, runs, [](const Vector3d& x) { return Vector3d(-x); }, {}), best);
        const double noisy = stopped(v, h, runs, right, {0, 0, 0.005});
        EXPECT_NEAR(noisy, best, 0.05 * best);
        if (v > 10) continue;
        // It is seen at most 0.12 s later.
        const double rare = stopped(v, h, runs, right, {0.1, 0.2, 0.005});
        EXPECT_GE(rare, 0.95 * best);
        EXPECT_LE(rare, 1.05 * best + 0.12);
      }
    }
  }
}

TEST_F(Tracks, PersonsWhoAreExchangedAreLost) {
  UnitSubject unit = monitor("robots=a:@slide.urdf,b:@slide.urdf&scene=@two.sdf&separation=all");
  unit.set("b.base_p0", Values{0, 20, 0}).set("v_h", "0");
  const auto see = [&](double one, double other) {
    unit.set("one.p", Values{one, 5, 0}).set("other.p", Values{other, 9, 0});
    unit.step(0.004);
  };
  unit.initialise();
  for (int k = 0; k < 50; ++k) see(2, 6);
  EXPECT_EQ(unit.integer("zone"), 0);
  see(6, 2);
  EXPECT_EQ(unit.integer("zone"), 2);
  for (int k = 0; k < 400; ++k) see(2, 6);
  EXPECT_EQ(unit.integer("zone"), 0);
  for (const char* lost : {"one.lost", "other.lost"}) {
    EXPECT_EQ(unit.real(lost, 0), 0);
    EXPECT_EQ(unit.real(lost, 1), 1);
  }
}

TEST_F(Tracks, LimitsThatAreNoNumbersStopRobots) {
  for (const char* name : {"v_max", "restart_delay"}) {
    UnitSubject unit = watch();
    unit.set("obstacle.p", Values{9, 0, 0});
    unit.initialise();
    unit.step(0.01);
    EXPECT_EQ(unit.integer("zone"), 0);
    unit.set(name, Values{NAN});
    unit.step(0.01);
    EXPECT_EQ(unit.integer("zone"), 2) << name;
  }
}

}  // namespace
}  // namespace cotwin::monitor::track_test
