/* Block elimination along time for the first-order conditions of an open-loop game.
 *
 * This file is compiled once per structure of game. Before it, games/compiled/source.py writes the
 * sizes of one player (STATES n, CONTROLS m, WEIGHTS K, SAMPLES d, NUMBERS P), PLAYERS N and the
 * functions of games/compiled/stage_functions.py; into it, the nonzero patterns, the kinds of terms
 * and the terms of a stage, each a function of one player or of a pair. The numbers of a game
 * (goals, targets, lanes, dt) are run-time data. games/compiled/elimination.py explains the
 * algorithm; the equation labels (E1) to (E8) are defined there. It checks all sizes.
 *
 * A trajectory is an array (T, SZ) of rows z_t = (x_t, u_t, lambda_t); residuals have rows
 * (rx_t, ru_t, rf_t) and multipliers rows (p_t, q_t, r_t). Matrices are row-major. */

#include <math.h>
#include <string.h>
#include <time.h>

#define NX (PLAYERS * STATES)
#define NU (PLAYERS * CONTROLS + MULTIPLIERS)
#define NT (PLAYERS * WEIGHTS)
#define ND (PLAYERS * SAMPLES)
#define SZ (2 * NX + NU)        /* length of z_t */
#define PC (NX + NT)            /* columns of Z: d z / d (x_1, theta) */
#define OFF_U NX                /* where u_t, and ru_t, start */
#define OFF_L (NX + NU)         /* where lambda_t, and rf_t, start */
#define WIDTH (PC > OFF_L ? PC : OFF_L)
#define API __attribute__((visibility("default")))

#define SMALLEST_STEP 0.000244140625 /* that Newton's line search tries before it gives up */
/* A factorisation serves as long as a whole step leaves at most this share of the residual: one
 * costs as much as two or three of the steps that it saves. */
#define ENOUGH 0.1

typedef struct {
    const int size, offset; /* number of nonzeros, first one in the stage's values */
    const int *rows, *columns;
} Pattern;

/* Functions of a term, in the order of games/compiled/terms.py */
enum {
    VALUE, FINAL_VALUE, JACOBIAN, FINAL_JACOBIAN, HESSIAN, FINAL_HESSIAN, COST, FINAL_COST, MOTION
};

/* What CasADi writes: arguments, results and three things that are not used here */
typedef int Function(const double **, double **, int *, double *, int);

typedef struct {
    Function *functions[9];
    int sizes[9]; /* of their results */
    /* Of values and Jacobians, where each nonzero belongs in the rows (g_x, g_u, f) and columns
     * (x, u) of the term's own player; -1 where it belongs to another one, or to weights */
    const int *own[4];
} Kind;

/* One term of the stage: `count` players that it looks at; where the nonzeros of each function but
 * the costs belong among the values of the stage */
typedef struct {
    const Kind *kind;
    const int owner, count;
    const int *players, *indices[6];
} Term;

/* The terms of one player, its own one first */
typedef struct {
    const int count, *terms;
} TermsOf;
/* Functions of a constraint, in the order of games/compiled/constraint_functions.py */
enum { MARGINS_OF, PUSH_OF, CHANGE_OF, CONDENSED_OF };

/* Margins of one kind of constraint in one step: how many, and the nonzeros of `condensed` */
typedef struct {
    Function *functions[4];
    int margins, nonzeros;
} ConstraintKind;

/* One constraint: its functions in every step but the last and in the last, where their nonzeros
 * belong among the values of the stage, its players, and its first margin */
typedef struct {
    const ConstraintKind *kinds[2];
    const int *indices[2], *players;
    const int count, offset;
} Constraint;

/* Functions of a constraint that is an equation, in the order of games/compiled/complementarity.py */
enum { VALUE_OF, JACOBIAN_OF, HESSIAN_OF, STEP_MARGINS_OF };

typedef struct {
    Function *functions[4];
    int sizes[4]; /* of their results; the last one is the number of margins */
} EquationKind;

/* One such constraint: its players, its first multiplier; where the nonzeros of its functions
 * belong among the values of the stage; where its unknowns are in theta */
typedef struct {
    const EquationKind *kind;
    const int count, offset, unknowns;
    const int *players, *theta, *indices[3];
} Equation;

DEFINITIONS

typedef struct {
    int horizon;
    const double *numbers;            /* (PLAYERS, NUMBERS) of the game */
    const double *view_numbers;       /* of the observation model */
    const double *constraint_numbers; /* (constraints, CONSTRAINT_NUMBERS) */
    const double *samples, *precision; /* (T, ND) */
    double *blocks;                   /* (T, BLOCKS) first derivatives */
    double *curvature;                /* (T, CURVATURE) second derivatives */
    double *V;                        /* (T, NX, NX) lambda_{t-1} = -V_t x_t + v_t */
    double *M, *K, *S, *L;            /* M^-1 (T, NU, NU), (T, NU, NX) twice, (T, NX, NU) */
    double *G, *v;                    /* (T, NU, PC), (T, NX, NT): u_t and lambda_{t-1} */
    double *Z;                        /* (T, SZ, PC) */
    double *squares;                  /* (3, WIDTH, WIDTH) */
    double *parts;                    /* of games/reduction.c */
    double *scratch;                  /* (4, T, SZ) */
    double shift;                     /* what the last factorisation added to Q and R */
    const double *enforced;           /* (T, MULTIPLIERS) 1 where a constraint is enforced */
    double relaxation;                /* tau of games/compiled/complementarity.py */
} Work;

/* Of the mirror in games/compiled/bindings.py */
API int work_size(void) { return sizeof(Work); }

/* ---- small dense and sparse kernels ------------------------------------------------------- */

/* C (m, n) += alpha * A (m, k) B (k, n), with row strides */
static inline void multiply_add(int m, int k, int n, double alpha, const double *restrict a,
                                int lda, const double *restrict b, int ldb, double *restrict c,
                                int ldc)
{
    for (int i = 0; i < m; i++) {
        double *restrict row = c + i * ldc;
        int l = 0;
        for (; l + 3 < k; l += 4) {
            const double a0 = alpha * a[i * lda + l], a1 = alpha * a[i * lda + l + 1];
            const double a2 = alpha * a[i * lda + l + 2], a3 = alpha * a[i * lda + l + 3];
            const double *b0 = b + l * ldb, *b1 = b0 + ldb, *b2 = b1 + ldb, *b3 = b2 + ldb;
            for (int j = 0; j < n; j++)
                row[j] += a0 * b0[j] + a1 * b1[j] + a2 * b2[j] + a3 * b3[j];
        }
        for (; l < k; l++) {
            const double a0 = alpha * a[i * lda + l];
            for (int j = 0; j < n; j++) row[j] += a0 * b[l * ldb + j];
        }
    }
}

/* C (n, n) += A' B for A, B (k, n) */
static inline void transpose_multiply_add(int k, int n, const double *restrict a,
                                          const double *restrict b, double *restrict c)
{
    int l = 0;
    for (; l + 3 < k; l += 4) {
        const double *a0 = a + l * n, *b0 = b + l * n;
        for (int i = 0; i < n; i++) {
            const double s0 = a0[i], s1 = a0[n + i], s2 = a0[2 * n + i], s3 = a0[3 * n + i];
            double *restrict row = c + i * n;
            for (int j = 0; j < n; j++)
                row[j] += s0 * b0[j] + s1 * b0[n + j] + s2 * b0[2 * n + j] + s3 * b0[3 * n + j];
        }
    }
    for (; l < k; l++)
        for (int i = 0; i < n; i++) {
            const double s0 = a[l * n + i];
            for (int j = 0; j < n; j++) c[i * n + j] += s0 * b[l * n + j];
        }
}

/* out[to, :] += alpha * value * in[from, :] for every nonzero; `transposed` swaps the roles */
static inline void sparse_rows(const Pattern *p, const double *stage, double alpha, int transposed,
                               const double *in, double *out, int n, int ld)
{
    const double *values = stage + p->offset;
    const int *to = transposed ? p->columns : p->rows, *from = transposed ? p->rows : p->columns;
    for (int e = 0; e < p->size; e++) {
        const double value = alpha * values[e];
        const double *restrict source = in + from[e] * ld;
        double *restrict target = out + to[e] * ld;
        for (int j = 0; j < n; j++) target[j] += value * source[j];
    }
}

/* out (n, m) += in' for in (m, n), with row strides */
static inline void add_transposed(int m, int n, const double *restrict in, int ldi,
                                  double *restrict out, int ldo)
{
    for (int j = 0; j < n; j++)
        for (int i = 0; i < m; i++) out[j * ldo + i] += in[i * ldi + j];
}

static inline void sparse_scatter(const Pattern *p, const double *stage, double alpha, double *out,
                                  int ld)
{
    for (int e = 0; e < p->size; e++)
        out[p->rows[e] * ld + p->columns[e]] += alpha * stage[p->offset + e];
}

static inline void sparse_vector(const Pattern *p, const double *stage, double alpha,
                                 int transposed, const double *in, double *out)
{
    const int *to = transposed ? p->columns : p->rows, *from = transposed ? p->rows : p->columns;
    for (int e = 0; e < p->size; e++) out[to[e]] += alpha * stage[p->offset + e] * in[from[e]];
}

/* y (m,) += alpha * A (m, n) x */
static inline void apply(int m, int n, double alpha, const double *restrict a,
                         const double *restrict x, double *restrict y)
{
    for (int i = 0; i < m; i++) {
        double sum = 0;
        for (int j = 0; j < n; j++) sum += a[i * n + j] * x[j];
        y[i] += alpha * sum;
    }
}

/* y (n,) += alpha * A' x for A (m, n) */
static inline void apply_transposed(int m, int n, double alpha, const double *restrict a,
                                    const double *restrict x, double *restrict y)
{
    for (int i = 0; i < m; i++) {
        const double factor = alpha * x[i];
        for (int j = 0; j < n; j++) y[j] += factor * a[i * n + j];
    }
}

/* a (NU, NU) <- its inverse, by Gauss-Jordan with partial pivoting; 0 where it is singular to
 * working precision */
static int invert(double *a)
{
#if MULTIPLIERS
    double row_scale[NU];
#endif
    double scale = 0;
    int pivots[NU];
    for (int i = 0; i < NU * NU; i++) {
        if (!isfinite(a[i])) return 0;
        scale = fmax(scale, fabs(a[i]));
    }
#if MULTIPLIERS /* rows of complementarity are tiny where constraints are active */
    for (int i = 0; i < NU; i++) {
        double largest = 0;
        for (int j = 0; j < NU; j++) largest = fmax(largest, fabs(a[i * NU + j]));
        if (!(largest > 0)) return 0;
        row_scale[i] = 1 / largest;
        for (int j = 0; j < NU; j++) a[i * NU + j] *= row_scale[i];
    }
    scale = 1;
#endif
    for (int k = 0; k < NU; k++) {
        int best = k;
        for (int i = k + 1; i < NU; i++)
            if (fabs(a[i * NU + k]) > fabs(a[best * NU + k])) best = i;
        pivots[k] = best;
        const double pivot = a[best * NU + k];
        if (!(fabs(pivot) > 1e-14 * scale)) return 0;
        if (best != k)
            for (int j = 0; j < NU; j++) {
                const double swap = a[k * NU + j];
                a[k * NU + j] = a[best * NU + j];
                a[best * NU + j] = swap;
            }
        a[k * NU + k] = 1;
        for (int j = 0; j < NU; j++) a[k * NU + j] /= pivot;
        for (int i = 0; i < NU; i++) {
            if (i == k) continue;
            const double ratio = a[i * NU + k];
            a[i * NU + k] = 0;
            for (int j = 0; j < NU; j++) a[i * NU + j] -= ratio * a[k * NU + j];
        }
    }
    for (int k = NU - 1; k >= 0; k--)
        if (pivots[k] != k)
            for (int i = 0; i < NU; i++) {
                const double swap = a[i * NU + k];
                a[i * NU + k] = a[i * NU + pivots[k]];
                a[i * NU + pivots[k]] = swap;
            }
#if MULTIPLIERS
    for (int i = 0; i < NU; i++)
        for (int j = 0; j < NU; j++) a[i * NU + j] *= row_scale[j];
#endif
    return 1;
}

/* ---- evaluation ---------------------------------------------------------------------------- */

/* Nonzeros of one function of a term at rows z_t and multipliers (SZ,) */
static inline void term_values(const Work *w, const Term *term, int function, const double *z,
                               const double *theta, const double *multipliers, double *out)
{
    double together[NX];
    const int o = term->owner;
    for (int j = 0; j < term->count; j++)
        memcpy(together + j * STATES, z + term->players[j] * STATES, STATES * sizeof(double));
    const double *u = z + OFF_U + o * CONTROLS, *costate = z + OFF_L + o * STATES;
    const double *p = multipliers + o * STATES, *q = multipliers + OFF_U + o * CONTROLS;
    const double *arguments[] = {together, u, costate, theta + o * WEIGHTS,
                                 w->numbers + o * NUMBERS, p, q, multipliers + OFF_L + o * STATES};
    double *results[] = {out};
    term->kind->functions[function](arguments, results, 0, 0, 0);
}

/* out (size,) = the values of one function, summed over all terms */
static void sum_of_terms(const Work *w, int function, int size, const double *z,
                         const double *theta, const double *multipliers, double *out)
{
    double values[MOST_VALUES];
    memset(out, 0, size * sizeof(double));
    for (const Term *term = TERMS; term < TERMS + NUM_TERMS; term++) {
        const int *places = term->indices[function], count = term->kind->sizes[function];
        term_values(w, term, function, z, theta, multipliers, values);
        for (int e = 0; e < count; e++) out[places[e]] += values[e];
    }
}

/* One function of a constraint that is an equation, at row t of a trajectory */
static inline void equation_values(const Work *w, const Equation *equation, int function, int t,
                                   const double *z, const double *theta,
                                   const double *multipliers, double *out)
{
    double x[NX], u[NU], p[NX], q[NU], s[NT];
    const int count = equation->count, margins = equation->kind->sizes[STEP_MARGINS_OF];
    const int own = PLAYERS * CONTROLS + equation->offset;
    for (int j = 0; j < count; j++) {
        const int from = equation->players[j];
        memcpy(x + j * STATES, z + from * STATES, STATES * sizeof(double));
        memcpy(p + j * STATES, multipliers + from * STATES, STATES * sizeof(double));
        memcpy(u + j * CONTROLS, z + OFF_U + from * CONTROLS, CONTROLS * sizeof(double));
        memcpy(q + j * CONTROLS, multipliers + OFF_U + from * CONTROLS,
               CONTROLS * sizeof(double));
    }
    memcpy(q + count * CONTROLS, multipliers + OFF_U + own, margins * sizeof(double));
    for (int k = 0; k < equation->unknowns; k++) s[k] = theta[equation->theta[k]];
    const double *numbers = w->constraint_numbers + (equation - EQUATIONS) * CONSTRAINT_NUMBERS;
    const double *on = w->enforced + t * MULTIPLIERS + equation->offset;
    const double *arguments[] = {x, u, z + OFF_U + own, on, numbers, &w->relaxation, s, p, q};
    double *results[] = {out};
    equation->kind->functions[function](arguments, results, 0, 0, 0);
}

/* out += the values of one function of all constraints that are equations */
static void add_equations(const Work *w, int function, int t, const double *z, const double *theta,
                          const double *multipliers, double *out)
{
    double values[MOST_EQUATION];
    for (const Equation *e = EQUATIONS; e < EQUATIONS + NUM_EQUATIONS; e++) {
        equation_values(w, e, function, t, z, theta, multipliers, values);
        for (int k = 0; k < e->kind->sizes[function]; k++) out[e->indices[function][k]] += values[k];
    }
}

/* out (T - 1, MULTIPLIERS): margins of constraints that are equations */
API void step_margins(const Work *w, const double *z, const double *theta, double *out)
{
    for (int t = 0; t < w->horizon - 1; t++)
        for (const Equation *e = EQUATIONS; e < EQUATIONS + NUM_EQUATIONS; e++)
            equation_values(w, e, STEP_MARGINS_OF, t, z + t * SZ, theta, z + t * SZ,
                            out + t * MULTIPLIERS + e->offset);
}

/* residual (T, SZ) of (E1); its unused entries are zero */
API void evaluate(const Work *w, const double *z, const double *theta, double *residual)
{
    const int last = w->horizon - 1;
    for (int t = 0; t < last; t++) {
        const double *x = z + t * SZ;
        double *row = residual + t * SZ;
        sum_of_terms(w, VALUE, SZ, x, theta, x, row);
        add_equations(w, VALUE_OF, t, x, theta, x, row);
        for (int k = 0; k < NX; k++) row[OFF_L + k] = x[SZ + k] - row[OFF_L + k];
        if (t == 0)
            memset(row, 0, NX * sizeof(double)); /* x_1 is given, not chosen */
        else
            for (int k = 0; k < NX; k++) row[k] += x[OFF_L - SZ + k];
    }
    const double *x = z + last * SZ;
    double *row = residual + last * SZ;
    sum_of_terms(w, FINAL_VALUE, SZ, x, theta, x, row);
    for (int k = 0; k < NX; k++) row[k] += x[OFF_L - SZ + k];
}

static inline void loss_values(const Work *w, Function *function, const double *z, int t, int i,
                               double *out)
{
    const int sample = t * ND + i * SAMPLES;
    const double *arguments[] = {z + t * SZ + i * STATES, w->samples + sample,
                                 w->precision + sample, w->view_numbers};
    double *results[] = {out};
    function(arguments, results, 0, 0, 0);
}

/* sum of squared observation errors; its gradient (T, SZ) in the places of x */
API double observation_loss(const Work *w, const double *z, double *gradient)
{
    double sum = 0, result[1 + STATES];
    for (int t = 0; t < w->horizon; t++) {
        for (int i = 0; i < PLAYERS; i++) {
            loss_values(w, loss, z, t, i, result);
            sum += result[0];
            memcpy(gradient + t * SZ + i * STATES, result + 1, STATES * sizeof(double));
        }
        memset(gradient + t * SZ + NX, 0, (SZ - NX) * sizeof(double));
    }
    return sum;
}

/* ---- constraints --------------------------------------------------------------------------- */

/* One function of a constraint at step t of z (T, SZ); v, sigma (T, MARGINS), d (T, SZ) or 0 */
static inline void constraint_values(const Work *w, const Constraint *constraint, int function,
                                     int t, const double *z, const double *v, const double *sigma,
                                     const double *d, double *out)
{
    double together[NX], direction[OFF_L];
    const int own = OFF_U + constraint->players[0] * CONTROLS, at = constraint->count * STATES;
    const int margin = t * MARGINS + constraint->offset;
    const double *row = z + t * SZ;
    for (int j = 0; j < constraint->count; j++) {
        const int x = constraint->players[j] * STATES;
        memcpy(together + j * STATES, row + x, STATES * sizeof(double));
        if (d) memcpy(direction + j * STATES, d + t * SZ + x, STATES * sizeof(double));
    }
    if (d) memcpy(direction + at, d + t * SZ + own, CONTROLS * sizeof(double));
    const double *numbers = w->constraint_numbers + (constraint - ALL_CONSTRAINTS) * CONSTRAINT_NUMBERS;
    const double *arguments[] = {together, row + own, numbers, v ? v + margin : 0,
                                 sigma ? sigma + margin : 0, direction};
    double *results[] = {out};
    constraint->kinds[t == w->horizon - 1]->functions[function](arguments, results, 0, 0, 0);
}

/* out (T, MARGINS): the margins, or with a direction d (T, SZ) their change along it */
static void margin_rows(const Work *w, const double *z, const double *d, double *out)
{
    const Constraint *end = ALL_CONSTRAINTS + NUM_CONSTRAINTS;
    memset(out, 0, (size_t)w->horizon * MARGINS * sizeof(double));
    for (int t = 0; t < w->horizon; t++)
        for (const Constraint *c = ALL_CONSTRAINTS; c < end; c++)
            constraint_values(w, c, d ? CHANGE_OF : MARGINS_OF, t, z, 0, 0, d,
                              out + t * MARGINS + c->offset);
}

API void margins(const Work *w, const double *z, double *out) { margin_rows(w, z, 0, out); }

API void change(const Work *w, const double *z, const double *d, double *out)
{
    margin_rows(w, z, d, out);
}

/* out (T, SZ) += alpha J' v for v (T, MARGINS) */
static void add_push(const Work *w, const double *z, double alpha, const double *v, double *out)
{
    double values[OFF_L];
    const Constraint *end = ALL_CONSTRAINTS + NUM_CONSTRAINTS;
    for (int t = 0; t < w->horizon; t++)
        for (const Constraint *c = ALL_CONSTRAINTS; c < end; c++) {
            const int last = t == w->horizon - 1, own = OFF_U + c->players[0] * CONTROLS;
            double *row = out + t * SZ;
            if (c->kinds[last]->margins == 0) continue;
            constraint_values(w, c, PUSH_OF, t, z, v, 0, 0, values);
            for (int j = 0; j < c->count; j++)
                for (int k = 0; k < STATES; k++)
                    row[c->players[j] * STATES + k] += alpha * values[j * STATES + k];
            if (!last)
                for (int k = 0; k < CONTROLS; k++)
                    row[own + k] += alpha * values[c->count * STATES + k];
        }
}

API void push(const Work *w, const double *z, const double *v, double *out)
{
    memset(out, 0, (size_t)w->horizon * SZ * sizeof(double));
    add_push(w, z, 1, v, out);
}

/* What the condensed constraints add to the values of stage t */
static void add_condensed(const Work *w, int t, const double *z, const double *v,
                          const double *sigma, double *stage)
{
    double values[MOST_CONDENSED];
    const int last = t == w->horizon - 1;
    const Constraint *end = ALL_CONSTRAINTS + NUM_CONSTRAINTS;
    for (const Constraint *c = ALL_CONSTRAINTS; c < end; c++) {
        constraint_values(w, c, CONDENSED_OF, t, z, v, sigma, 0, values);
        for (int e = 0; e < c->kinds[last]->nonzeros; e++) stage[c->indices[last][e]] += values[e];
    }
}

/* ---- elimination --------------------------------------------------------------------------- */

/* Whether the symmetric part of a (NU, NU) is positive definite */
static int definite(const double *a)
{
    double lower[NU * NU], scale = 0;
    for (int i = 0; i < NU; i++) scale = fmax(scale, fabs(a[i * NU + i]));
    for (int i = 0; i < NU; i++)
        for (int j = 0; j <= i; j++) {
            double sum = (a[i * NU + j] + a[j * NU + i]) / 2;
            for (int l = 0; l < j; l++) sum -= lower[i * NU + l] * lower[j * NU + l];
            if (i != j)
                lower[i * NU + j] = sum / lower[j * NU + j];
            else if (sum > 1e-13 * scale)
                lower[i * NU + i] = sqrt(sum);
            else
                return 0;
        }
    return 1;
}

/* Stage blocks at (z, theta) and the factorisation (E2)-(E4); with v and sigma (T, MARGINS), the
 * condensed constraints and shift I are added. Returns 0, or t + 1 where the stage matrix M_t is
 * singular or, with constraints, not positive definite. */
static int factorise_stages(Work *w, const double *z, const double *theta, const double *v,
                     const double *sigma, double shift)
{
    const int last = w->horizon - 1;
    w->shift = shift;
    {
        const double *x = z + last * SZ;
        double *stage = w->blocks + last * BLOCKS;
        sum_of_terms(w, FINAL_JACOBIAN, FINAL_BLOCKS, x, theta, x, stage);
        if (v) add_condensed(w, last, z, v, sigma, stage);
        double *V = w->V + last * NX * NX;
        memset(V, 0, NX * NX * sizeof(double));
        sparse_scatter(&FINAL_Q, stage, 1, V, NX);
        for (int i = 0; i < NX; i++) V[i * NX + i] += shift;
    }
    for (int t = last - 1; t >= 0; t--) {
        const double *x = z + t * SZ;
        double *stage = w->blocks + t * BLOCKS;
        sum_of_terms(w, JACOBIAN, BLOCKS, x, theta, x, stage);
        add_equations(w, JACOBIAN_OF, t, x, theta, x, stage);
        if (v) add_condensed(w, t, z, v, sigma, stage);

        const double *V = w->V + (t + 1) * NX * NX;
        double *M = w->M + t * NU * NU, *K = w->K + t * NU * NX;
        double *S = w->S + t * NU * NX, *L = w->L + t * NX * NU;
        /* [A B]' V, transposed, and again from the left: all inner loops run along rows. */
        double *half = w->squares, *turned = half + WIDTH * WIDTH, *full = turned + WIDTH * WIDTH;
        memset(half, 0, OFF_L * NX * sizeof(double));
        memset(turned, 0, NX * OFF_L * sizeof(double));
        memset(full, 0, OFF_L * OFF_L * sizeof(double));
        sparse_rows(&PATTERN_A, stage, 1, 1, V, half, NX, NX);
        sparse_rows(&PATTERN_B, stage, 1, 1, V, half + NX * NX, NX, NX);
        add_transposed(OFF_L, NX, half, NX, turned, OFF_L);
        sparse_rows(&PATTERN_A, stage, 1, 1, turned, full, OFF_L, OFF_L);
        sparse_rows(&PATTERN_B, stage, 1, 1, turned, full + NX * OFF_L, OFF_L, OFF_L);
        memset(M, 0, NU * NU * sizeof(double));
        memset(S, 0, NU * NX * sizeof(double));
        memset(L, 0, NX * NU * sizeof(double));
        sparse_scatter(&PATTERN_R, stage, 1, M, NU);
        sparse_scatter(&PATTERN_S, stage, 1, S, NX);
        sparse_scatter(&PATTERN_P, stage, 1, L, NU);
        add_transposed(NU, NU, full + NX * OFF_L + NX, OFF_L, M, NU);
        add_transposed(NX, NU, full + NX, OFF_L, S, NX);
        add_transposed(NU, NX, full + NX * OFF_L, OFF_L, L, NU);
        for (int i = 0; i < NU; i++) M[i * NU + i] += shift;
        if ((v && !definite(M)) || !invert(M)) return t + 1;
        memset(K, 0, NU * NX * sizeof(double));
        multiply_add(NU, NU, NX, 1, M, NU, S, NX, K, NX);
        if (t > 0) {
            double *Vt = w->V + t * NX * NX;
            memset(Vt, 0, NX * NX * sizeof(double));
            sparse_scatter(&PATTERN_Q, stage, 1, Vt, NX);
            add_transposed(NX, NX, full, OFF_L, Vt, NX);
            multiply_add(NX, NU, NX, -1, L, NU, K, NX, Vt, NX);
            for (int i = 0; i < NX; i++) Vt[i * NX + i] += shift;
        }
    }
    return 0;
}

API int linearise(Work *w, const double *z, const double *theta)
{
    return factorise_stages(w, z, theta, 0, 0, 0);
}

API int linearise_condensed(Work *w, const double *z, const double *theta, const double *v,
                            const double *sigma, double shift)
{
    return factorise_stages(w, z, theta, v, sigma, shift);
}

/* (E5), (E6): G_z out = right for right, out (T, SZ), with out's x_1 = 0; or G_z' out = right */
API void solve(const Work *w, int transposed, const double *right, double *out)
{
    const int last = w->horizon - 1;
    double v[NX], e[NX];
    memcpy(v, right + last * SZ, NX * sizeof(double));
    for (int t = last - 1; t >= 0; t--) {
        const double *stage = w->blocks + t * BLOCKS, *a = right + t * SZ;
        const double *b = a + OFF_U, *d = a + OFF_L, *V = w->V + (t + 1) * NX * NX;
        double *k = out + t * SZ + OFF_U;
        memcpy(e, v, sizeof(e));
        (transposed ? apply_transposed : apply)(NX, NX, -1, V, d, e);
        for (int i = 0; i < NU; i++) k[i] = b[i];
        sparse_vector(&PATTERN_B, stage, 1, 1, e, k);
        if (t == 0) break;
        const double *M = w->M + t * NU * NU;
        double gain[NU] = {0};
        memcpy(v, a, sizeof(v));
        sparse_vector(&PATTERN_A, stage, 1, 1, e, v);
        if (transposed) {
            apply_transposed(NU, NU, 1, M, k, gain);
            apply_transposed(NU, NX, -1, w->S + t * NU * NX, gain, v);
        } else {
            apply(NU, NU, 1, M, k, gain);
            apply(NX, NU, -1, w->L + t * NX * NU, gain, v);
        }
    }
    memset(out, 0, NX * sizeof(double));
    for (int t = 0; t < last; t++) {
        const double *stage = w->blocks + t * BLOCKS, *d = right + t * SZ + OFF_L;
        double *x = out + t * SZ, *u = x + OFF_U, *next = x + SZ;
        const double *M = w->M + t * NU * NU;
        double right_u[NU];
        memcpy(right_u, u, sizeof(right_u));
        memset(u, 0, sizeof(right_u));
        if (transposed) {
            apply_transposed(NX, NU, -1, w->L + t * NX * NU, x, right_u);
            apply_transposed(NU, NU, 1, M, right_u, u);
        } else {
            apply(NU, NX, -1, w->S + t * NU * NX, x, right_u);
            apply(NU, NU, 1, M, right_u, u);
        }
        memcpy(next, d, NX * sizeof(double));
        sparse_vector(&PATTERN_A, stage, 1, 0, x, next);
        sparse_vector(&PATTERN_B, stage, 1, 0, u, next);
    }
    memset(out + last * SZ + NX, 0, (SZ - NX) * sizeof(double));
    {
        double *costate = out + (last - 1) * SZ + OFF_L;
        memcpy(costate, right + last * SZ, NX * sizeof(double));
        sparse_vector(&FINAL_Q, w->blocks + last * BLOCKS, -1, transposed, out + last * SZ, costate);
        for (int i = 0; i < NX; i++) costate[i] -= w->shift * out[last * SZ + i];
    }
    for (int t = last - 1; t > 0; t--) {
        const double *stage = w->blocks + t * BLOCKS, *x = out + t * SZ;
        double *costate = out + (t - 1) * SZ + OFF_L;
        memcpy(costate, right + t * SZ, NX * sizeof(double));
        sparse_vector(&PATTERN_Q, stage, -1, transposed, x, costate);
        for (int i = 0; i < NX; i++) costate[i] -= w->shift * x[i];
        sparse_vector(transposed ? &PATTERN_S : &PATTERN_P, stage, -1, transposed, x + OFF_U, costate);
        sparse_vector(&PATTERN_A, stage, 1, 1, x + OFF_L, costate);
    }
}

/* ---- Newton's method for the forward game ---------------------------------------------------- */

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

static void norms(const double *v, int n, double *largest, double *squares)
{
    *largest = *squares = 0;
    for (int i = 0; i < n; i++) {
        *squares += v[i] * v[i];
        *largest = fmax(*largest, fabs(v[i]));
    }
    if (!isfinite(*squares)) *largest = *squares; /* fmax drops NaN */
}

/* One step of Newton from z with the present factorisation, shortened until the residual falls, or
 * to `shortest`. Moves z and the residual with its norms; returns 0 where no length was found. */
static int step_to_root(Work *w, double *z, const double *theta, double shortest, double *largest,
                        double *squares)
{
    const int n = w->horizon * SZ;
    double *residual = w->scratch, *step = residual + n, *trial = step + n, *next = trial + n;
    double trial_largest, trial_squares;
    solve(w, 0, residual, step);
    for (double length = 1; length >= shortest; length /= 2) {
        for (int i = 0; i < n; i++) trial[i] = z[i] - length * step[i];
        evaluate(w, trial, theta, next);
        norms(next, n, &trial_largest, &trial_squares);
        /* NaN compares false, so an undefined trial point is refused as well. */
        if (sqrt(trial_squares) < (1 - 1e-4 * length) * sqrt(*squares)) {
            memcpy(z, trial, n * sizeof(double));
            memcpy(residual, next, n * sizeof(double));
            *largest = trial_largest;
            *squares = trial_squares;
            return 1;
        }
    }
    return 0;
}

/* Damped Newton on G(z; theta) = 0 from z (T, SZ), whose x_1 stays fixed. Where *again is set, the present factorisation serves first; it serves
 * as long as whole steps leave at most a share ENOUGH of the residual. Returns max |G|;
 * *iterations counts the factorisations. */
static double newton_one(Work *w, double *z, const double *theta, double tolerance,
                         int max_iterations, double deadline, int *again, int *iterations)
{
    double largest, squares;
    evaluate(w, z, theta, w->scratch);
    norms(w->scratch, w->horizon * SZ, &largest, &squares);
    *iterations = 0;
    while (!(largest < tolerance) && isfinite(largest) && seconds() <= deadline) {
        const double before = squares;
        if (*again) {
            *again = step_to_root(w, z, theta, 1, &largest, &squares);
        } else {
            if (*iterations == max_iterations || linearise(w, z, theta)) break;
            ++*iterations;
            if (!step_to_root(w, z, theta, SMALLEST_STEP, &largest, &squares)) break;
            *again = 1;
        }
        *again = *again && squares < ENOUGH * ENOUGH * before;
    }
    return largest;
}

/* The same for `count` games: z (count, T, SZ) in and out, theta (count, NT), residuals and
 * iterations (count,). A factorisation serves further games as well. After `limit` seconds the
 * remaining games stay as they are. */
API void newton(Work *w, int count, double *z, const double *theta, double tolerance,
                int max_iterations, double limit, int factorised, double *residuals,
                int *iterations)
{
    const double deadline = seconds() + limit;
    const size_t size = (size_t)w->horizon * SZ;
    for (int b = 0; b < count; b++)
        residuals[b] = newton_one(w, z + b * size, theta + (size_t)b * NT, tolerance,
                                  max_iterations, deadline, &factorised, iterations + b);
}
