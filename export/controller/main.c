@REMARK@/* Simulates NAME with its own model for @SECONDS@ s, and prints CSV. The controls are compared
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

/* States that are no numbers, infinite and huge ones: the control must stay bounded. */
static int withstands(NAME_real value)
{
  NAME_real x[NAME_NX], u[NAME_NU];
  int i;
  for (i = 0; i < NAME_NX; ++i) {
    x[i] = value;
  }
  i = NAME_step(&memory, x@PASSED@, u);
  return is_within(u) && (i == NAME_INVALID) == !(value - value == 0);
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
