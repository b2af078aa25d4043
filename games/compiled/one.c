/* Numbers of one game at a time, in front of stages.c; four.c has the same names for four games */

#include <math.h>
#include <string.h>
#include <time.h>

#define API __attribute__((visibility("default")))
#define ALONE API /* of functions that serve one game at a time */
#define SLOTS 1
#define EVERYWHERE -1
#define NOWHERE 0
#define SLOT(number, slot) (number)
typedef double real;
typedef int mask;

static inline real same(double number) { return number; }
static inline real absolute(real a) { return fabs(a); }
static inline real larger(real a, real b) { return fmax(a, b); }
static inline mask finite_at(real a) { return isfinite(a); }
static inline int any(mask m) { return m; }
static inline real where(mask m, real a, real b) { return m ? a : b; }
