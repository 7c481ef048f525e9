/* The common part of strict2.c and strict3.c: a model that insists on the rules of FMI.
 *   x' = u,  y = gain u + bias + x
 * A step after which the importer may set the state back is not completed: it starts from the last completed state and keeps
 * it. If the importer has promised not to set the state back before an instant, the instance refuses it. A reset frees the
 * memory of the instance; afterwards its values are invalid. Calls that begin or end something are written to the file that
 * the environment variable STRICT_CALLS names. */
#ifndef COTWIN_TESTS_STRICT_H
#define COTWIN_TESTS_STRICT_H
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { kU = 1, kY = 2, kX = 3, kGain = 4, kBias = 5, kLongestStep = 6, kFrom = 7, kMode = 10 };
/* kSilent: outputs cannot be read in Initialization Mode. kLate: they are updated only when this mode is left. kNarrow: inputs
 * above 2 are an error afterwards. */
enum { kPolite = 0, kSilent = 1, kLate = 2, kNarrow = 3 };

typedef struct {
  double u, gain, bias, longest_step, from; /* from this time on, steps longer than longest_step are discarded */
  double x, kept_x, time, kept_time;        /* kept: last completed state */
  double y;                                 /* kLate */
  int mode, initialising;
} Memory;

typedef struct {
  Memory* m; /* NULL after a reset */
  double promised;
} Strict;

static void strict_call(const char* what) {
  const char* name = getenv("STRICT_CALLS");
  FILE* file = name != NULL ? fopen(name, "a") : NULL;
  if (file == NULL) return;
  fprintf(file, "%s ", what);
  fclose(file);
}

static void strict_begin(Strict* s) {
  strict_call("instantiate");
  s->m = calloc(1, sizeof *s->m);
  s->m->gain = 1;
  s->m->longest_step = 1e9;
  s->promised = -1e300;
}
static void strict_end(Strict* s) {
  strict_call("free");
  free(s->m);
}
static void strict_reset(Strict* s) {
  strict_call("reset");
  free(s->m);
  s->m = NULL;
}
static void strict_start(Strict* s, double time) {
  s->m->time = s->m->kept_time = time;
  s->m->initialising = 1;
}
static void strict_exit(Strict* s) {
  strict_call("exit");
  s->m->initialising = 0;
  s->m->y = s->m->gain * s->m->u + s->m->bias + s->m->x;
}

static bool strict_get(Strict* s, unsigned reference, double* value) {
  static double rubbish = 1e30;
  const Memory* m = s->m;
  if (m == NULL) {
    *value = rubbish *= -1.1;
    return true;
  }
  if (m->initialising) strict_call("read");
  if (m->initialising && m->mode == kSilent) return false;
  switch (reference) {
    case kU:
      *value = m->u;
      return true;
    case kY:
      *value = m->mode == kLate && m->initialising ? m->y : m->gain * m->u + m->bias + m->x;
      return true;
    case kX:
      *value = m->x;
      return true;
    default:
      return false;
  }
}
static bool strict_set(Strict* s, unsigned reference, double value) {
  Memory* m = s->m;
  if (m == NULL) return false;
  double* const places[] = {&m->u, NULL, NULL, &m->gain, &m->bias, &m->longest_step, &m->from};
  if (reference < kU || reference > kFrom || places[reference - kU] == NULL) return false;
  if (m->mode == kNarrow && !m->initialising && reference == kU && value > 2) return false;
  *places[reference - kU] = value;
  return true;
}

/* False: discarded. */
static bool strict_step(Strict* s, double now, double h, bool stays) {
  Memory* m = s->m;
  if (stays && now > s->promised) s->promised = now;
  if (now >= m->from - 1e-9 && h > m->longest_step * (1 + 1e-9)) return false;
  if (stays) {
    m->kept_x = m->x;
    m->kept_time = now;
  }
  m->x = m->kept_x + m->u * (stays ? h : 1e-9);
  m->time = now + h;
  return true;
}

static bool strict_may_be_set(const Strict* s, const Memory* to) { return to->time >= s->promised - 1e-9; }
#endif
