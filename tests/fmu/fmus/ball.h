/* A Model Exchange model with all kinds of events, for both versions of FMI:
 *   h' = v,  v' = -g          a ball that bounces with the factor e (state event, indicator h)
 *   x' = k (u - x)            a low-pass, with a nominal value of 1e3
 *   ticks                     counts time events, every 0.25 s
 *   asked                     counts the step events that it requests when the ball starts to rise */
#ifndef COTWIN_TESTS_BALL_H
#define COTWIN_TESTS_BALL_H
#include <stdbool.h>
#include <string.h>

enum {
  kH = 1,
  kV = 2,
  kX = 3,
  kDerH = 4,
  kDerV = 5,
  kDerX = 6,
  kU = 7,
  kG = 8,
  kE = 9,
  kK = 10,
  kMode = 20,
  kTicks = 21,
  kAsked = 22,
  kBounces = 23
};
enum { kStates = 3, kPolite = 0, kWrongDerivatives = 1, kEndlessEvents = 2, kManyStates = 3 };
#define kTick 0.25

typedef struct {
  double t, x[kStates], u, g, e, k;
  int mode, ticks, asked, bounces, rising;
} Model;

static void model_begin(Model* m) {
  memset(m, 0, sizeof *m);
  m->x[0] = 1;
  m->g = 9.81;
  m->e = 0.7;
  m->k = 2;
}

static bool model_derivatives(const Model* m, double dx[]) {
  if (m->mode == kWrongDerivatives && m->t > 0.5) return false;
  dx[0] = m->x[1];
  dx[1] = -m->g;
  dx[2] = m->k * (m->u - m->x[2]);
  return true;
}

static double model_indicator(const Model* m) { return m->x[0] == 0 && m->x[1] > 0 ? 1e-300 : m->x[0]; }

/* Returns whether continuous states changed. */
static bool model_event(Model* m) {
  if (m->t >= kTick * (m->ticks + 1) - 1e-9) ++m->ticks;
  if (m->x[0] <= 0 && m->x[1] < 0) {
    m->x[0] = 0;
    m->x[1] = -m->e * m->x[1];
    ++m->bounces;
    return true;
  }
  return false;
}
static double model_next_event(const Model* m) { return kTick * (m->ticks + 1); }

static bool model_asks_for_event(Model* m) {
  const int rising = m->x[1] > 0;
  const bool asks = rising && !m->rising;
  m->rising = rising;
  if (asks) ++m->asked;
  return asks;
}

static double* model_real(Model* m, unsigned r) {
  switch (r) {
    case kH:
      return &m->x[0];
    case kV:
      return &m->x[1];
    case kX:
      return &m->x[2];
    case kU:
      return &m->u;
    case kG:
      return &m->g;
    case kE:
      return &m->e;
    case kK:
      return &m->k;
    default:
      return NULL;
  }
}
static bool model_get_real(Model* m, unsigned r, double* v) {
  double dx[kStates];
  if (r >= kDerH && r <= kDerX) {
    if (!model_derivatives(m, dx)) return false;
    *v = dx[r - kDerH];
    return true;
  }
  const double* p = model_real(m, r);
  if (p != NULL) *v = *p;
  return p != NULL;
}
static bool model_get_integer(const Model* m, unsigned r, int* v) {
  *v = r == kMode ? m->mode : r == kTicks ? m->ticks : r == kAsked ? m->asked : m->bounces;
  return r >= kMode && r <= kBounces;
}
#endif
