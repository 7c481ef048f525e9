/* A belt with a part every `pitch`, and a light barrier where the robot takes them. */
#include <math.h>

#include "plain_fmu.h"

enum { kSpeed, kPitch, kTravel };        // real: m/s, m, m
enum { kRun, kAtStation };               // boolean: input, output
enum { kArrived };                       // integer: parts that have reached the light barrier
static const double kPartLength = 0.02;  // m

static void look(Model* m) {
  const double travel = m->real[kTravel] + 1e-9;  // sums of steps are rounded
  const double parts = floor(travel / m->real[kPitch]);
  m->integer[kArrived] = (int)parts;
  m->boolean[kAtStation] = parts > 0 && travel - parts * m->real[kPitch] < kPartLength;
}

static void begin(Model* m) {
  m->real[kSpeed] = 0.25;
  m->real[kPitch] = 0.25;
  m->real[kTravel] = 0;
  m->boolean[kRun] = 1;
  look(m);
}

static void initialise(Model* m) { look(m); }

static void advance(Model* m, double h) {
  if (m->boolean[kRun]) m->real[kTravel] += m->real[kSpeed] * h;
  look(m);
}
