/* Stages of an open-loop game: sizes, terms, and products with their derivatives.
 *
 * This file and those behind it are compiled for one game at a time (one.c), and again for four
 * (four.c), where a `real` has a slot for each. Before it, games/compiled/source.py writes
 * the sizes of one player (STATES n, CONTROLS m, WEIGHTS K, NUMBERS P), PLAYERS N and the
 * functions of games/compiled/stage_functions.py; into it, the nonzero patterns, the kinds of terms
 * and the terms of a stage, each a function of one player or of a pair. The numbers of a game
 * (goals, targets, lanes, dt) are run-time data. games/compiled/elimination.py explains the
 * algorithm; the equation labels (E1) to (E8) are defined there. It checks all sizes.
 *
 * A trajectory is an array (T, SZ) of rows z_t = (x_t, u_t, lambda_t); residuals have rows
 * (rx_t, ru_t, rf_t) and multipliers rows (p_t, q_t, r_t). Matrices are row-major. */

#define NX (PLAYERS * STATES)
#define NU (PLAYERS * CONTROLS + MULTIPLIERS)
#define NT (PLAYERS * WEIGHTS)
#define SZ (2 * NX + NU)        /* length of z_t */
#define PC (NX + NT)            /* columns of Z: d z / d (x_1, theta) */
#define OFF_U NX                /* where u_t, and ru_t, start */
#define OFF_L (NX + NU)         /* where lambda_t, and rf_t, start */
#define WIDTH (PC > OFF_L ? PC : OFF_L)

typedef struct {
    const int size, offset; /* number of nonzeros, first one in the stage's values */
    const int *rows, *columns;
} Pattern;

/* Functions of a term, in the order of games/compiled/terms.py */
enum {
    VALUE, FINAL_VALUE, JACOBIAN, FINAL_JACOBIAN, HESSIAN, FINAL_HESSIAN, COST, FINAL_COST, MOTION
};

/* What CasADi writes: arguments, results and three things that are not used here */
typedef int Function(const real **, real **, int *, real *, int);

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
    const real *numbers;            /* (PLAYERS, NUMBERS) of the game */
    const real *view_numbers;       /* of the observation model */
    const real *constraint_numbers; /* (constraints, CONSTRAINT_NUMBERS) */
    const real *samples, *precision;/* (T, PLAYERS, num_samples) */
    real *blocks;                   /* (T, BLOCKS) first derivatives */
    real *curvature;                /* (T, CURVATURE) second derivatives */
    real *V;                        /* (T, NX, NX) lambda_{t-1} = -V_t x_t + v_t */
    real *M, *K, *S, *L;            /* M^-1 (T, NU, NU), (T, NU, NX) twice, (T, NX, NU) */
    real *G, *v;                    /* (T, NU, PC), (T, NX, NT): u_t and lambda_{t-1} */
    real *Z;                        /* (T, SZ, PC) */
    real *squares;                  /* (3, WIDTH, WIDTH) */
    real *parts;                    /* of games/reduction.c */
    real *scratch;                  /* (5, T, SZ) of games/newton.c */
    double shift;                   /* what the last factorisation added to Q and R */
    const real *enforced;           /* (T, MULTIPLIERS) 1 where a constraint is enforced */
    double relaxation;              /* tau of games/compiled/complementarity.py */
    int num_samples, loss_nonzeros; /* d, and of the Hessian of games/compiled/loss.py */
    Function *loss, *loss_hessian;
    const int *loss_places;         /* (loss_nonzeros,) in (STATES, STATES) */
} Work;

/* Of the mirror in games/compiled/bindings.py */
API int work_size(void) { return sizeof(Work); }

/* ---- small dense and sparse kernels ------------------------------------------------------- */

/* C (m, n) += alpha * A (m, k) B (k, n), with row strides */
static inline void multiply_add(int m, int k, int n, double alpha, const real *restrict a,
                                int lda, const real *restrict b, int ldb, real *restrict c,
                                int ldc)
{
    for (int i = 0; i < m; i++) {
        real *restrict row = c + i * ldc;
        int l = 0;
        for (; l + 3 < k; l += 4) {
            const real a0 = alpha * a[i * lda + l], a1 = alpha * a[i * lda + l + 1];
            const real a2 = alpha * a[i * lda + l + 2], a3 = alpha * a[i * lda + l + 3];
            const real *b0 = b + l * ldb, *b1 = b0 + ldb, *b2 = b1 + ldb, *b3 = b2 + ldb;
            for (int j = 0; j < n; j++)
                row[j] += a0 * b0[j] + a1 * b1[j] + a2 * b2[j] + a3 * b3[j];
        }
        for (; l < k; l++) {
            const real a0 = alpha * a[i * lda + l];
            for (int j = 0; j < n; j++) row[j] += a0 * b[l * ldb + j];
        }
    }
}

/* C (n, n) += A' B for A, B (k, n) */
static inline void transpose_multiply_add(int k, int n, const real *restrict a,
                                          const real *restrict b, real *restrict c)
{
    int l = 0;
    for (; l + 3 < k; l += 4) {
        const real *a0 = a + l * n, *b0 = b + l * n;
        for (int i = 0; i < n; i++) {
            const real s0 = a0[i], s1 = a0[n + i], s2 = a0[2 * n + i], s3 = a0[3 * n + i];
            real *restrict row = c + i * n;
            for (int j = 0; j < n; j++)
                row[j] += s0 * b0[j] + s1 * b0[n + j] + s2 * b0[2 * n + j] + s3 * b0[3 * n + j];
        }
    }
    for (; l < k; l++)
        for (int i = 0; i < n; i++) {
            const real s0 = a[l * n + i];
            for (int j = 0; j < n; j++) c[i * n + j] += s0 * b[l * n + j];
        }
}

/* out[to, :] += alpha * value * in[from, :] for every nonzero; `transposed` swaps the roles */
static inline void sparse_rows(const Pattern *p, const real *stage, double alpha, int transposed,
                               const real *in, real *out, int n, int ld)
{
    const real *values = stage + p->offset;
    const int *to = transposed ? p->columns : p->rows, *from = transposed ? p->rows : p->columns;
    for (int e = 0; e < p->size; e++) {
        const real value = alpha * values[e];
        const real *restrict source = in + from[e] * ld;
        real *restrict target = out + to[e] * ld;
        for (int j = 0; j < n; j++) target[j] += value * source[j];
    }
}

/* out (n, m) = in' for in (m, n), with row strides */
static inline void transpose(int m, int n, const real *restrict in, int ldi,
                                  real *restrict out, int ldo)
{
    for (int j = 0; j < n; j++)
        for (int i = 0; i < m; i++) out[j * ldo + i] = in[i * ldi + j];
}

static inline void sparse_scatter(const Pattern *p, const real *stage, double alpha, real *out,
                                  int ld)
{
    for (int e = 0; e < p->size; e++)
        out[p->rows[e] * ld + p->columns[e]] += alpha * stage[p->offset + e];
}

static inline void sparse_vector(const Pattern *p, const real *stage, double alpha,
                                 int transposed, const real *in, real *out)
{
    const int *to = transposed ? p->columns : p->rows, *from = transposed ? p->rows : p->columns;
    for (int e = 0; e < p->size; e++) out[to[e]] += alpha * stage[p->offset + e] * in[from[e]];
}

/* y (m,) += alpha * A (m, n) x */
static inline void apply(int m, int n, double alpha, const real *restrict a,
                         const real *restrict x, real *restrict y)
{
    for (int i = 0; i < m; i++) {
        real sum = {0};
        for (int j = 0; j < n; j++) sum += a[i * n + j] * x[j];
        y[i] += alpha * sum;
    }
}

/* y (n,) += alpha * A' x for A (m, n) */
static inline void apply_transposed(int m, int n, double alpha, const real *restrict a,
                                    const real *restrict x, real *restrict y)
{
    for (int i = 0; i < m; i++) {
        const real factor = alpha * x[i];
        for (int j = 0; j < n; j++) y[j] += factor * a[i * n + j];
    }
}

/* Swap n numbers, `stride` apart, of those slots that a mask says */
static inline void swap_where(mask m, int n, int stride, real *a, real *b)
{
    for (int j = 0; j < n; j++) {
        const real first = a[j * stride], second = b[j * stride];
        a[j * stride] = where(m, second, first);
        b[j * stride] = where(m, first, second);
    }
}

/* a (NU, NU) <- its inverse, by Gauss-Jordan with partial pivoting. Says where it is regular to
 * working precision; where it is not, a is undefined. */
static mask invert(real *a)
{
#if MULTIPLIERS
    double row_scale[NU];
#endif
    real scale = {0}, pivots[NU];
    mask regular = EVERYWHERE;
    for (int i = 0; i < NU * NU; i++) {
        regular &= finite_at(a[i]);
        scale = larger(scale, absolute(a[i]));
    }
    if (!any(regular)) return regular;
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
        real best = same(k), size = absolute(a[k * NU + k]);
        for (int i = k + 1; i < NU; i++) {
            const real own = absolute(a[i * NU + k]);
            best = where(own > size, same(i), best);
            size = larger(size, own);
        }
        pivots[k] = best;
        regular &= size > 1e-14 * scale;
        if (!any(regular)) return regular;
        for (int i = k + 1; i < NU; i++)
            if (any(best == i)) swap_where(best == i, NU, 1, a + k * NU, a + i * NU);
        const real pivot = a[k * NU + k];
        real row[NU];
        a[k * NU + k] = same(1);
        for (int j = 0; j < NU; j++) a[k * NU + j] = row[j] = a[k * NU + j] / pivot;
        for (int i = 0; i < NU; i++) {
            if (i == k) continue;
            const real ratio = a[i * NU + k];
            a[i * NU + k] = same(0);
            for (int j = 0; j < NU; j++) a[i * NU + j] -= ratio * row[j];
        }
    }
    for (int k = NU - 1; k >= 0; k--)
        for (int i = k + 1; i < NU; i++)
            if (any(pivots[k] == i)) swap_where(pivots[k] == i, NU, NU, a + k, a + i);
#if MULTIPLIERS
    for (int i = 0; i < NU; i++)
        for (int j = 0; j < NU; j++) a[i * NU + j] *= row_scale[j];
#endif
    return regular;
}

/* ---- evaluation ---------------------------------------------------------------------------- */

/* Nonzeros of one function of a term at rows z_t and multipliers (SZ,) */
static inline void term_values(const Work *w, const Term *term, int function, const real *z,
                               const real *theta, const real *multipliers, real *out)
{
    real together[NX];
    const int o = term->owner;
    for (int j = 0; j < term->count; j++)
        memcpy(together + j * STATES, z + term->players[j] * STATES, STATES * sizeof(real));
    const real *u = z + OFF_U + o * CONTROLS, *costate = z + OFF_L + o * STATES;
    const real *p = multipliers + o * STATES, *q = multipliers + OFF_U + o * CONTROLS;
    const real *arguments[] = {together, u, costate, theta + o * WEIGHTS,
                                 w->numbers + o * NUMBERS, p, q, multipliers + OFF_L + o * STATES};
    real *results[] = {out};
    term->kind->functions[function](arguments, results, 0, 0, 0);
}

/* out (size,) = the values of one function, summed over all terms */
static void sum_of_terms(const Work *w, int function, int size, const real *z,
                         const real *theta, const real *multipliers, real *out)
{
    real values[MOST_VALUES];
    memset(out, 0, size * sizeof(real));
    for (const Term *term = TERMS; term < TERMS + NUM_TERMS; term++) {
        const int *places = term->indices[function], count = term->kind->sizes[function];
        term_values(w, term, function, z, theta, multipliers, values);
        for (int e = 0; e < count; e++) out[places[e]] += values[e];
    }
}

