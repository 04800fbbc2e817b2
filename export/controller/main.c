/* Simulates NAME with its own model for @SECONDS@ s, and prints CSV. The controls are compared
   with those that the library found for the same flight by its own code; the exit code
   is 1 if one differs by more than @TOLERANCE@ of its range, or if a control is not finite
   and within its bounds after states that are no numbers. */
#include "NAME.h"

#include <math.h>
#include <stdio.h>

static NAME_memory memory;
@TABLES@
static int is_within(const NAME_real u[NAME_NU])
{
  int i;
  for (i = 0; i < NAME_NU; ++i) {
    if (!(u[i] - u[i] == 0 && u[i] >= least[i] && u[i] <= most[i])) {
      return 0;
    }
  }
  return 1;
}

/* After a state that is no number, or huge, the control must stay within its bounds;
   without a number it is the next one of the last plan. */
static int withstands(NAME_real value)
{
  NAME_real x[NAME_NX], u[NAME_NU], next[NAME_NU];
  int i, status, is_right;
  for (i = 0; i < NAME_NX; ++i) {
    x[i] = value;
  }
  for (i = 0; i < NAME_NU; ++i) {
    next[i] = memory.plan[NAME_NU + i];
  }
  status = NAME_step(&memory, x@PASSED@, u);
  is_right = (status == NAME_INVALID) == !(value - value == 0);
  for (i = 0; i < NAME_NU && status == NAME_INVALID; ++i) {
    is_right = is_right && !(u[i] < next[i]) && !(u[i] > next[i]);
  }
  return is_within(u) && is_right;
}

int main(void)
{
  NAME_real x[NAME_NX], after[NAME_NX], u[NAME_NU], worst = 0;
  int step, i, status, bad = 0;
  unsigned long long operations = 0;
  NAME_reset(&memory);
  for (i = 0; i < NAME_NX; ++i) {
    x[i] = begin[i];
  }
  printf("@HEADINGS@\n");
  for (step = 0; step < STEPS; ++step) {
    status = NAME_step(&memory, x@PASSED@, u);
    bad += !is_within(u);
    if (memory.operations > operations) {
      operations = memory.operations;
    }
    printf("%.9g", step * (double)NAME_DT);
    for (i = 0; i < NAME_NX; ++i) {
      printf(",%.17g", (double)x[i]);
    }
    for (i = 0; i < NAME_NU; ++i) {
      const NAME_real apart
        = (u[i] - expected[step * NAME_NU + i]) / range[i];
      if (!(apart <= worst && -apart <= worst)) {
        worst = apart < 0 ? -apart : apart;
      }
      printf(",%.17g", (double)u[i]);
    }
    bad += wanted[step] >= 0 && status != wanted[step];
    printf(",%d,%.17g,%.9g\n", status, (double)memory.cost, (double)memory.violation);
    NAME_model(x, u@PASSED@, after);
    for (i = 0; i < NAME_NX; ++i) {
      x[i] = after[i];
    }
  }
  bad += !withstands((NAME_real)NAN);
  bad += !withstands((NAME_real)INFINITY);
  bad += !withstands((NAME_real)-INFINITY);
  bad += !withstands((NAME_real)1e30);
  bad += operations > NAME_MOST_OPERATIONS;
  bad += !(worst <= tolerance);
  fprintf(stderr, "largest difference %.3g of the range, allowed %.3g; at most %llu of "
          "%llu operations a step\n", (double)worst, (double)tolerance, operations,
          NAME_MOST_OPERATIONS);
  fprintf(stderr, bad ? "NAME: FAILED\n" : "NAME: passed\n");
  return bad != 0;
}
