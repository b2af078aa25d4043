/* Numbers of four games at a time, in front of stages.c: the names of one.c, and CasADi's functions.
 *
 * Every operation is that of four slots, and none looks at another slot. The compiler must not
 * reorder sums here (-fno-associative-math), so what a slot holds does not depend on the others. */

#include <math.h>
#include <string.h>
#include <time.h>

#define API __attribute__((visibility("default")))
#define ALONE static /* of functions that serve one game at a time */
#define SLOTS 4
#define EVERYWHERE (mask){-1, -1, -1, -1}
#define NOWHERE (mask){0}
#define SLOT(number, slot) ((number)[slot])
typedef double real __attribute__((vector_size(32)));
typedef long long mask __attribute__((vector_size(32)));
typedef int whole __attribute__((vector_size(16)));

static inline real same(double a) { return (real){a, a, a, a}; }
static inline real where(mask m, real a, real b)
{
    return (real)((m & (mask)a) | (~m & (mask)b));
}
static inline real absolute(real a) { return (real)((mask)a & 0x7fffffffffffffffLL); }
static inline mask finite_at(real a) { return absolute(a) < INFINITY; }
static inline int any(mask m) { return (m[0] | m[1] | m[2] | m[3]) != 0; }
static inline real larger(real a, real b) { return where((a > b) | (b != b), a, b); }

/* ---- CasADi's functions: name_at is name in every slot ------------------------------------ */

#define ONE_BY_ONE(name)                                                                         \
    static inline real name##_at(real a)                                                           \
    {                                                                                              \
        return (real){name(a[0]), name(a[1]), name(a[2]), name(a[3])};                             \
    }
#define PAIR_BY_PAIR(name)                                                                         \
    static inline real name##_at(real a, real b)                                                   \
    {                                                                                              \
        return (real){name(a[0], b[0]), name(a[1], b[1]), name(a[2], b[2]), name(a[3], b[3])};     \
    }

ONE_BY_ONE(asin) ONE_BY_ONE(acos) ONE_BY_ONE(atan) ONE_BY_ONE(sinh) ONE_BY_ONE(cosh)
ONE_BY_ONE(tanh) ONE_BY_ONE(asinh) ONE_BY_ONE(acosh) ONE_BY_ONE(atanh) ONE_BY_ONE(exp)
ONE_BY_ONE(log) ONE_BY_ONE(log1p) ONE_BY_ONE(expm1) ONE_BY_ONE(sqrt) ONE_BY_ONE(floor)
ONE_BY_ONE(ceil) ONE_BY_ONE(erf)
PAIR_BY_PAIR(pow) PAIR_BY_PAIR(fmod) PAIR_BY_PAIR(remainder) PAIR_BY_PAIR(atan2)
PAIR_BY_PAIR(copysign) PAIR_BY_PAIR(hypot)

static inline real sq_at(real a) { return a * a; }
static inline real fabs_at(real a) { return absolute(a); }
static inline real fmax_at(real a, real b) { return larger(a, b); }
static inline real fmin_at(real a, real b) { return where((a < b) | (b != b), a, b); }
static inline real flag_at(mask m) { return where(m, same(1), same(0)); }
static inline real sign_at(real a)
{
    return where((a > 0) | (a < 0), flag_at(a > 0) - flag_at(a < 0), a);
}

/* Sine of x, or of x + pi / 2: of the rest after the nearest multiple of pi / 2, which is exact to
 * rounding as the parts of pi / 2 have 33 bits; polynomials of Sun's fdlibm. */
static inline real sine(real x, int quarters)
{
    const real half = (real)((mask)same(0.5) | ((mask)x & (mask)same(-0.0)));
    const whole nearest = __builtin_convertvector(x * 0.6366197723675814 + half, whole);
    const real count = __builtin_convertvector(nearest, real);
    const mask quarter = __builtin_convertvector(nearest + quarters, mask);
    const real rest = x - count * 1.57079632673412561417 - count * 6.07710050630396597660e-11
                      - count * 2.02226624879595063154e-21;
    const real z = rest * rest;
    const real odd = ((((1.58969099521155010221e-10 * z - 2.50507602534068634195e-8) * z
                        + 2.75573137070700676789e-6) * z - 1.98412698298579493134e-4) * z
                      + 8.33333333332248946124e-3) * z - 1.66666666666666324348e-1;
    const real even = ((((-1.13596475577881948265e-11 * z + 2.08757232129817482790e-9) * z
                         - 2.75573143513906633035e-7) * z + 2.48015872894767294178e-5) * z
                       - 1.38888888888741095749e-3) * z + 4.16666666666666019037e-2;
    const real value =
        where((quarter & 1) != 0, 1 - (0.5 * z - z * z * even), rest + rest * z * odd);
    return where((quarter & 2) != 0, -value, value);
}

#define FAR 1e5 /* beyond, as many quarters are not counted exactly */

static inline real sin_at(real x)
{
    const mask near = absolute(x) < FAR;
    const real value = sine(x, 0);
    if (!any(~near)) return value;
    return where(near, value, (real){sin(x[0]), sin(x[1]), sin(x[2]), sin(x[3])});
}

static inline real cos_at(real x)
{
    const mask near = absolute(x) < FAR;
    const real value = sine(x, 1);
    if (!any(~near)) return value;
    return where(near, value, (real){cos(x[0]), cos(x[1]), cos(x[2]), cos(x[3])});
}

static inline real tan_at(real x) { return sin_at(x) / cos_at(x); }
