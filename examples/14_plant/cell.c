/* The controller of the cell. When a part reaches the light barrier, it stops the belt and moves the robot to the part; when the robot is
 * there, the belt runs on and the robot returns. A part that comes meanwhile waits. */
#include <math.h>

#include "plain_fmu.h"

enum { kJoints = 7, kQ = 0, kQd = 7, kDqd = 14, kDdqd = 21, kDuration = 28, kTolerance = 29 };  // real: rad, …, s, rad
enum { kAtStation, kRun, kPartBefore };                                                         // boolean: input, output, kept
enum { kState, kTaken };                                                                        // integer
enum { kWaiting, kGoing, kReturning };

static const double kHome[kJoints] = {0, 0.3, 0, -1.2, 0, 0.9, 0}, kPart[kJoints] = {0.9, 0.8, 0.3, -0.9, -0.4, 1.1, 0.5};
enum { kSince = 30 };  // real: time in the present state, s

/* The point of the way that is reached at `t`: a polynomial of degree 5 with rest at both ends. */
static void move(Model* m, const double from[], const double to[], double t) {
  const double T = m->real[kDuration], s = t < T ? t / T : 1;
  const double p = s * s * s * (10 + s * (-15 + 6 * s)), dp = 30 * s * s * (1 - s) * (1 - s) / T,
               ddp = 60 * s * (1 - s) * (1 - 2 * s) / (T * T);
  for (int i = 0; i < kJoints; ++i) {
    m->real[kQd + i] = from[i] + (to[i] - from[i]) * p;
    m->real[kDqd + i] = (to[i] - from[i]) * dp;
    m->real[kDdqd + i] = (to[i] - from[i]) * ddp;
  }
}

static int is_at(const Model* m, const double q[]) {
  for (int i = 0; i < kJoints; ++i) {
    if (fabs(m->real[kQ + i] - q[i]) > m->real[kTolerance]) return 0;
  }
  return 1;
}

static void enter(Model* m, int state) {
  m->integer[kState] = state;
  m->real[kSince] = 0;
}

static void begin(Model* m) {
  memset(m, 0, sizeof *m);
  m->real[kDuration] = 1.2;
  m->real[kTolerance] = 2e-3;
  memcpy(m->real + kQ, kHome, sizeof kHome);
  m->boolean[kRun] = 1;
  move(m, kHome, kHome, 0);
}

static void initialise(Model* m) { move(m, kHome, kHome, 0); }

static void advance(Model* m, double h) {
  const int has_come = m->boolean[kAtStation] && !m->boolean[kPartBefore];
  m->boolean[kPartBefore] = m->boolean[kAtStation];
  if (has_come) m->boolean[kRun] = 0;
  const int has_time = m->real[kSince] > m->real[kDuration] - h / 2;
  if (m->integer[kState] == kGoing && has_time && is_at(m, kPart)) {
    ++m->integer[kTaken];
    m->boolean[kRun] = 1;
    enter(m, kReturning);
  } else if (m->integer[kState] == kReturning && has_time && is_at(m, kHome)) {
    enter(m, kWaiting);
  }
  if (m->integer[kState] == kWaiting && !m->boolean[kRun]) enter(m, kGoing);
  m->real[kSince] += h;
  if (m->integer[kState] == kGoing) move(m, kHome, kPart, m->real[kSince]);
  if (m->integer[kState] == kReturning) move(m, kPart, kHome, m->real[kSince]);
}
