/* Block elimination along time for the first-order conditions of an open-loop game.
 *
 * games/native.py compiles this file once per structure of game. Before it, it writes the sizes
 * NX = N n, NU = N m, NT = N K, ND = N d, the constant SMALLEST_STEP, the nonzero patterns
 * PATTERN_x and the stage functions value, final_value, jacobian, final_jacobian, loss, hessian,
 * final_hessian of games/stage_functions.py, whose numeric constants (goals, targets, dt) are
 * run-time data. games/elimination.py is the same algorithm in NumPy and explains it; the equation
 * labels (E1) to (E8) are defined there. The caller checks all sizes.
 *
 * A trajectory is an array (T, SZ) of rows z_t = (x_t, u_t, lambda_t); residuals have rows
 * (rx_t, ru_t, rf_t) and multipliers rows (p_t, q_t, r_t). Matrices are row-major. */

#include <math.h>
#include <string.h>
#include <time.h>

#define SZ (2 * NX + NU)        /* length of z_t */
#define PC (NX + NT)            /* columns of Z: d z / d (x_1, theta) */
#define OFF_U NX                /* where u_t, and ru_t, start */
#define OFF_L (NX + NU)         /* where lambda_t, and rf_t, start */
#define API __attribute__((visibility("default")))

typedef struct {
    const int size, offset; /* number of nonzeros, first one in the stage's values */
    const int *rows, *columns;
} Pattern;

PATTERN_DEFINITIONS

typedef struct {
    int horizon;
    double *constants;                /* of the stage functions */
    const double *samples, *precision; /* (T, ND) */
    double *blocks;                   /* (T, BLOCKS) first derivatives */
    double *curvature;                /* (T, CURVATURE) second derivatives */
    double *V;                        /* (T, NX, NX) lambda_{t-1} = -V_t x_t + v_t */
    double *M, *K, *S, *L;            /* M^-1 (T, NU, NU), (T, NU, NX) twice, (T, NX, NU) */
    double *Z;                        /* (T, SZ, PC) */
    double *scratch;                  /* (4, T, SZ) */
} Work;

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
    double scale = 0;
    int pivots[NU];
    for (int i = 0; i < NU * NU; i++) {
        if (!isfinite(a[i])) return 0;
        scale = fmax(scale, fabs(a[i]));
    }
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
    return 1;
}

/* ---- evaluation ---------------------------------------------------------------------------- */

/* residual (T, SZ) of (E1); its unused entries are zero */
API void evaluate(const Work *w, const double *z, const double *theta, double *residual)
{
    const int last = w->horizon - 1;
    for (int t = 0; t < last; t++) {
        const double *x = z + t * SZ;
        double *row = residual + t * SZ;
        const double *arguments[] = {x, x + OFF_U, x + OFF_L, theta};
        double *results[] = {row};
        value(arguments, results, 0, w->constants, 0);
        for (int k = 0; k < NX; k++) row[OFF_L + k] = x[SZ + k] - row[OFF_L + k];
        if (t == 0)
            memset(row, 0, NX * sizeof(double)); /* x_1 is given, not chosen */
        else
            for (int k = 0; k < NX; k++) row[k] += x[OFF_L - SZ + k];
    }
    const double *x = z + last * SZ;
    double *row = residual + last * SZ;
    const double *arguments[] = {x, theta};
    double *results[] = {row};
    final_value(arguments, results, 0, w->constants, 0);
    for (int k = 0; k < NX; k++) row[k] += x[OFF_L - SZ + k];
    memset(row + NX, 0, (SZ - NX) * sizeof(double));
}

/* sum of squared observation errors; its gradient (T, SZ) in the places of x */
API double observation_loss(const Work *w, const double *z, double *gradient)
{
    double sum = 0, result[1 + NX];
    for (int t = 0; t < w->horizon; t++) {
        const double *arguments[] = {z + t * SZ, w->samples + t * ND, w->precision + t * ND};
        double *results[] = {result};
        loss(arguments, results, 0, w->constants, 0);
        sum += result[0];
        memcpy(gradient + t * SZ, result + 1, NX * sizeof(double));
        memset(gradient + t * SZ + NX, 0, (SZ - NX) * sizeof(double));
    }
    return sum;
}

/* ---- elimination --------------------------------------------------------------------------- */

/* Stage blocks at (z, theta) and the factorisation (E2)-(E4). Returns 0, or t + 1 where the
 * stage matrix M_t is singular. */
API int linearise(Work *w, const double *z, const double *theta)
{
    const int last = w->horizon - 1;
    {
        const double *arguments[] = {z + last * SZ, theta};
        double *results[] = {w->blocks + last * BLOCKS};
        final_jacobian(arguments, results, 0, w->constants, 0);
        double *V = w->V + last * NX * NX;
        memset(V, 0, NX * NX * sizeof(double));
        sparse_scatter(&FINAL_Q, results[0], 1, V, NX);
    }
    for (int t = last - 1; t >= 0; t--) {
        const double *x = z + t * SZ;
        double *stage = w->blocks + t * BLOCKS;
        const double *arguments[] = {x, x + OFF_U, x + OFF_L, theta};
        double *results[] = {stage};
        jacobian(arguments, results, 0, w->constants, 0);

        const double *V = w->V + (t + 1) * NX * NX;
        double *M = w->M + t * NU * NU, *K = w->K + t * NU * NX;
        double *S = w->S + t * NU * NX, *L = w->L + t * NX * NU;
        /* [A B]' V, transposed, and again from the left: all inner loops run along rows. */
        double half[OFF_L * NX] = {0}, turned[NX * OFF_L] = {0}, full[OFF_L * OFF_L] = {0};
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
        if (!invert(M)) return t + 1;
        memset(K, 0, NU * NX * sizeof(double));
        multiply_add(NU, NU, NX, 1, M, NU, S, NX, K, NX);
        if (t > 0) {
            double *Vt = w->V + t * NX * NX;
            memset(Vt, 0, NX * NX * sizeof(double));
            sparse_scatter(&PATTERN_Q, stage, 1, Vt, NX);
            add_transposed(NX, NX, full, OFF_L, Vt, NX);
            multiply_add(NX, NU, NX, -1, L, NU, K, NX, Vt, NX);
        }
    }
    return 0;
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
    }
    for (int t = last - 1; t > 0; t--) {
        const double *stage = w->blocks + t * BLOCKS, *x = out + t * SZ;
        double *costate = out + (t - 1) * SZ + OFF_L;
        memcpy(costate, right + t * SZ, NX * sizeof(double));
        sparse_vector(&PATTERN_Q, stage, -1, transposed, x, costate);
        sparse_vector(transposed ? &PATTERN_S : &PATTERN_P, stage, -1, transposed, x + OFF_U, costate);
        sparse_vector(&PATTERN_A, stage, 1, 1, x + OFF_L, costate);
    }
}

/* (E7): Z = d z / d (x_1, theta) on the linearised conditions, into w->Z */
API void sensitivities(Work *w)
{
    const int last = w->horizon - 1;
    double v[NX * NT] = {0}, next_v[NX * NT];
    sparse_scatter(&FINAL_X, w->blocks + last * BLOCKS, -1, v, NT);
    for (int t = last - 1; t >= 0; t--) {
        const double *stage = w->blocks + t * BLOCKS;
        double *Zu = w->Z + (t * SZ + OFF_U) * PC, right[NU * NT] = {0}, k[NU * NT] = {0};
        sparse_scatter(&PATTERN_U, stage, -1, right, NT);
        sparse_rows(&PATTERN_B, stage, 1, 1, v, right, NT, NT);
        multiply_add(NU, NU, NT, 1, w->M + t * NU * NU, NU, right, NT, k, NT);
        for (int i = 0; i < NU; i++) {
            memset(Zu + i * PC, 0, NX * sizeof(double));
            memcpy(Zu + i * PC + NX, k + i * NT, NT * sizeof(double));
        }
        if (t == 0) break;
        memset(next_v, 0, sizeof(next_v));
        sparse_scatter(&PATTERN_X, stage, -1, next_v, NT);
        sparse_rows(&PATTERN_A, stage, 1, 1, v, next_v, NT, NT);
        multiply_add(NX, NU, NT, -1, w->L + t * NX * NU, NU, k, NT, next_v, NT);
        memcpy(v, next_v, sizeof(v));
    }
    memset(w->Z, 0, NX * PC * sizeof(double));
    for (int i = 0; i < NX; i++) w->Z[i * PC + i] = 1;
    for (int t = 0; t < last; t++) {
        const double *stage = w->blocks + t * BLOCKS;
        double *Zx = w->Z + t * SZ * PC, *Zu = Zx + OFF_U * PC, *next = Zx + SZ * PC;
        multiply_add(NU, NX, PC, -1, w->K + t * NU * NX, NX, Zx, PC, Zu, PC);
        memset(next, 0, NX * PC * sizeof(double));
        sparse_rows(&PATTERN_A, stage, 1, 0, Zx, next, PC, PC);
        sparse_rows(&PATTERN_B, stage, 1, 0, Zu, next, PC, PC);
    }
    memset(w->Z + (last * SZ + OFF_U) * PC, 0, (SZ - NX) * PC * sizeof(double));
    for (int t = last; t > 0; t--) {
        const double *stage = w->blocks + t * BLOCKS;
        double *Zx = w->Z + t * SZ * PC, *costates = w->Z + ((t - 1) * SZ + OFF_L) * PC;
        memset(costates, 0, NX * PC * sizeof(double));
        if (t == last) {
            sparse_scatter(&FINAL_X, stage, -1, costates + NX, PC);
            sparse_rows(&FINAL_Q, stage, -1, 0, Zx, costates, PC, PC);
        } else {
            sparse_scatter(&PATTERN_X, stage, -1, costates + NX, PC);
            sparse_rows(&PATTERN_Q, stage, -1, 0, Zx, costates, PC, PC);
            sparse_rows(&PATTERN_P, stage, -1, 0, Zx + OFF_U * PC, costates, PC, PC);
            sparse_rows(&PATTERN_A, stage, 1, 1, Zx + OFF_L * PC, costates, PC, PC);
        }
    }
}

/* ---- the inverse problem ------------------------------------------------------------------- */

/* Second derivatives of the Lagrangian into w->curvature, and W = Z' H Z (PC, PC) of (E8) */
API void reduced_hessian(Work *w, const double *z, const double *theta, const double *multipliers,
                         double *W)
{
    const int last = w->horizon - 1;
    memset(W, 0, PC * PC * sizeof(double));
    for (int t = 0; t <= last; t++) {
        const double *x = z + t * SZ, *p = multipliers + t * SZ;
        const double *y = w->samples + t * ND, *precision = w->precision + t * ND;
        double *values = w->curvature + t * CURVATURE;
        double *results[] = {values};
        const Pattern *pattern = t == last ? &FINAL_H : &PATTERN_H;
        if (t == last) {
            const double *arguments[] = {x, theta, p, y, precision};
            final_hessian(arguments, results, 0, w->constants, 0);
        } else {
            const double *arguments[] = {x,         x + OFF_U, x + OFF_L, theta, p,
                                         p + OFF_U, p + OFF_L, y,         precision};
            hessian(arguments, results, 0, w->constants, 0);
        }
        /* Half the Hessian has rows of x and u only: it is linear in (lambda, theta). */
        double Y[OFF_L * PC];
        memset(Y, 0, sizeof(Y));
        const double *Z = w->Z + t * SZ * PC;
        for (int e = 0; e < pattern->size; e++) {
            double *target = Y + pattern->rows[e] * PC;
            if (pattern->columns[e] >= SZ)
                target[pattern->columns[e] - SZ + NX] += values[e];
            else
                for (int j = 0; j < PC; j++)
                    target[j] += values[e] * Z[pattern->columns[e] * PC + j];
        }
        transpose_multiply_add(t == last ? NX : OFF_L, PC, Z, Y, W);
    }
    for (int i = 0; i < PC; i++)
        for (int j = 0; j <= i; j++) W[i * PC + j] = W[j * PC + i] = W[i * PC + j] + W[j * PC + i];
}

/* Z' Z (PC, PC) over states and controls: the metric of the inertia correction */
API void trajectory_metric(const Work *w, double *metric)
{
    memset(metric, 0, PC * PC * sizeof(double));
    for (int t = 0; t < w->horizon; t++) {
        const double *Z = w->Z + t * SZ * PC;
        transpose_multiply_add(OFF_L, PC, Z, Z, metric);
    }
}

/* H (d, d_theta) with the curvature of the last reduced_hessian: (T, SZ) and (NT,) */
API void hessian_product(const Work *w, const double *d, const double *d_theta, double *out,
                         double *out_theta)
{
    memset(out_theta, 0, NT * sizeof(double));
    memset(out, 0, w->horizon * SZ * sizeof(double));
    for (int t = 0; t < w->horizon; t++) {
        const Pattern *pattern = t == w->horizon - 1 ? &FINAL_H : &PATTERN_H;
        const double *values = w->curvature + t * CURVATURE, *dz = d + t * SZ;
        double *row = out + t * SZ;
        for (int e = 0; e < pattern->size; e++) {
            const int i = pattern->rows[e], j = pattern->columns[e];
            row[i] += values[e] * (j < SZ ? dz[j] : d_theta[j - SZ]);
            *(j < SZ ? row + j : out_theta + j - SZ) += values[e] * dz[i];
        }
    }
}

/* out (PC,) = Z' g for g (T, SZ) */
API void reduce(const Work *w, const double *g, double *out)
{
    memset(out, 0, PC * sizeof(double));
    for (int r = 0; r < w->horizon * SZ; r++)
        for (int j = 0; j < PC; j++) out[j] += g[r] * w->Z[r * PC + j];
}

/* out (T, SZ) += Z d for d (PC,) = (x_1, theta) */
API void expand(const Work *w, const double *d, double *out)
{
    for (int r = 0; r < w->horizon * SZ; r++) {
        double sum = 0;
        for (int j = 0; j < PC; j++) sum += w->Z[r * PC + j] * d[j];
        out[r] += sum;
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

/* Damped Newton on G(z; theta) = 0 from z (T, SZ), whose x_1 stays fixed; games/elimination.py has
 * the same loop in Python. Returns max |G|; *iterations counts the factorisations. */
static double newton_one(Work *w, double *z, const double *theta, double tolerance,
                         int max_iterations, double deadline, int *iterations)
{
    const int n = w->horizon * SZ;
    double *residual = w->scratch, *step = residual + n, *trial = step + n, *next = trial + n;
    double largest, squares, trial_largest, trial_squares;
    evaluate(w, z, theta, residual);
    norms(residual, n, &largest, &squares);
    for (*iterations = 0; *iterations < max_iterations; ++*iterations) {
        if (largest < tolerance || !isfinite(largest) || seconds() > deadline) break;
        if (linearise(w, z, theta)) break;
        solve(w, 0, residual, step);
        double length = 1;
        for (;; length /= 2) {
            if (length < SMALLEST_STEP) return largest;
            for (int i = 0; i < n; i++) trial[i] = z[i] - length * step[i];
            evaluate(w, trial, theta, next);
            norms(next, n, &trial_largest, &trial_squares);
            /* NaN compares false, so an undefined trial point is refused as well. */
            if (sqrt(trial_squares) < (1 - 1e-4 * length) * sqrt(squares)) break;
        }
        memcpy(z, trial, n * sizeof(double));
        memcpy(residual, next, n * sizeof(double));
        largest = trial_largest;
        squares = trial_squares;
    }
    return largest;
}

/* The same for `count` games: z (count, T, SZ) in and out, theta (count, NT), residuals and
 * iterations (count,). After `limit` seconds the remaining games stay as they are. */
API void newton(Work *w, int count, double *z, const double *theta, double tolerance,
                int max_iterations, double limit, double *residuals, int *iterations)
{
    const double deadline = seconds() + limit;
    const size_t size = (size_t)w->horizon * SZ;
    for (int b = 0; b < count; b++)
        residuals[b] = newton_one(w, z + b * size, theta + (size_t)b * NT, tolerance,
                                  max_iterations, deadline, iterations + b);
}
