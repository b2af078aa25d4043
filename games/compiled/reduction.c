/* The reduced Hessian of the inverse problem, compiled behind sensitivities.c.
 *
 * Along G = 0 everything is linear in w_t = (x_t, theta):
 *
 *     u_t = G_t w_t,   x_{t+1} = A x_t + B u_t,   lambda_t = v_{t+1} theta - V_{t+1} x_{t+1}
 *
 * with G = [-K k] of (E3), (E5). So W = Z' H Z of (E8) is the value of a quadratic cost, found
 * backwards in time. With W of t+1, and of half the Hessian of the stage the parts that couple w_t with
 * itself (D), with u_t (P) and with lambda_t, and u_t with itself (R) and with lambda_t, the two
 * with lambda_t written as N and O times w_{t+1},
 *
 *     (E9)  W_t = H + H',   H = D + A'WA / 2 + NA + G'S,
 *           S = P' + B'WA + (NB)' + OA + (R + B'WB / 2 + OB) G,
 *
 * where A and B also carry theta on. Only the products with G are dense. */

static inline void loss_values(const Work *w, Function *function, const double *z, int t, int i,
                               double *out)
{
    const int sample = (t * PLAYERS + i) * w->num_samples;
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
            loss_values(w, w->loss, z, t, i, result);
            sum += result[0];
            memcpy(gradient + t * SZ + i * STATES, result + 1, STATES * sizeof(double));
        }
        memset(gradient + t * SZ + NX, 0, (SZ - NX) * sizeof(double));
    }
    return sum;
}

/* What stage t adds to half of W_t of (E9): the sum of it and its transpose is meant */
typedef struct {
    double *half;                  /* (PC, PC) D, then all of (E9) */
    double *controls;              /* (NU, NU) R */
    double *mixed, *turn, *across; /* (NU, PC) P' and O, (NX, PC) N */
    int has_turn, has_across[NX];  /* rows of N, and whether O, that are not zero */
} Quadratic;

/* out (PC,) += alpha in A for in (PC,), where A carries theta on */
static inline void add_times_motion(const double *stage, double alpha, const double *restrict in,
                                    double *restrict out)
{
    const double *values = stage + PATTERN_A.offset;
    for (int e = 0; e < PATTERN_A.size; e++)
        out[PATTERN_A.columns[e]] += alpha * values[e] * in[PATTERN_A.rows[e]];
    for (int j = NX; j < PC; j++) out[j] += alpha * in[j];
}

/* out (NU,), `stride` apart, += alpha in B for in (PC,) */
static inline void add_times_inputs(const double *stage, double alpha, const double *restrict in,
                                    double *restrict out, int stride)
{
    const double *values = stage + PATTERN_B.offset;
    for (int e = 0; e < PATTERN_B.size; e++)
        out[PATTERN_B.columns[e] * stride] += alpha * values[e] * in[PATTERN_B.rows[e]];
}

/* half (PC, PC) += A'WA / 2 for symmetric W (PC, PC), as half is meant with its transpose; `space`
 * (2, NX, PC) */
static void add_carried(const double *stage, const double *W, double *space, double *half)
{
    double *turned = space + NX * PC;
    memset(space, 0, NX * PC * sizeof(double));
    sparse_rows(&PATTERN_A, stage, 1, 1, W, space, PC, PC);
    for (int i = 0; i < NX; i++) {
        for (int j = 0; j < NX; j++) turned[j * PC + i] = space[i * PC + j];
        for (int j = NX; j < PC; j++) half[i * PC + j] += space[i * PC + j];
    }
    sparse_rows(&PATTERN_A, stage, 0.5, 1, turned, half, NX, PC);
    for (int i = NX; i < PC; i++)
        for (int j = NX; j < PC; j++) half[i * PC + j] += 0.5 * W[i * PC + j];
}

/* (E9): W (PC, PC), which is W_{t+1}, becomes W_t; `space` (2, PC, PC) */
static void step_back(const Work *w, int t, Quadratic *q, double *W, double *space)
{
    const double *stage = w->blocks + t * BLOCKS, *G = w->G + t * NU * PC;
    memset(space, 0, NU * PC * sizeof(double));
    sparse_rows(&PATTERN_B, stage, 1, 1, W, space, PC, PC);
    for (int i = 0; i < NU; i++) {
        add_times_motion(stage, 1, space + i * PC, q->mixed + i * PC);
        add_times_inputs(stage, 0.5, space + i * PC, q->controls + i * NU, 1);
        if (!q->has_turn) continue;
        add_times_motion(stage, 1, q->turn + i * PC, q->mixed + i * PC);
        add_times_inputs(stage, 1, q->turn + i * PC, q->controls + i * NU, 1);
    }
    for (int i = 0; i < NX; i++)
        if (q->has_across[i]) {
            add_times_motion(stage, 1, q->across + i * PC, q->half + i * PC);
            add_times_inputs(stage, 1, q->across + i * PC, q->mixed + i, PC);
        }
    add_carried(stage, W, space, q->half);

    multiply_add(NU, NU, PC, 1, q->controls, NU, G, PC, q->mixed, PC);
    transpose(NU, PC, G, PC, space, NU);
    multiply_add(PC, NU, PC, 1, space, NU, q->mixed, PC, q->half, PC);
    for (int i = 0; i < PC; i++)
        for (int j = 0; j <= i; j++)
            W[i * PC + j] = W[j * PC + i] = q->half[i * PC + j] + q->half[j * PC + i];
}

/* out (PC,) += value * lambda_t, row `c` of the costates, as a function of w_{t+1} */
static inline void add_costate(const Work *w, int t, int c, double value, double *out)
{
    const double *V = w->V + ((t + 1) * NX + c) * NX, *v = w->v + ((t + 1) * NX + c) * NT;
    for (int j = 0; j < NX; j++) out[j] -= value * V[j];
    for (int j = 0; j < NT; j++) out[NX + j] += value * v[j];
}

/* One nonzero of half the Hessian of stage t, which is linear in the costates */
static inline void add_nonzero(const Work *w, int t, int i, int j, double value, Quadratic *q)
{
    const int in_u = i >= OFF_U && i < OFF_L, row = i >= SZ ? i - SZ + NX : i;
    const int column = j >= SZ ? j - SZ + NX : j;
    if (j >= OFF_L && j < SZ) {
        double *out = in_u ? q->turn + (i - OFF_U) * PC : q->across + i * PC;
        add_costate(w, t, j - OFF_L, value, out);
        *(in_u ? &q->has_turn : q->has_across + i) = 1;
    } else if (in_u && j < OFF_L)
        q->controls[(i - OFF_U) * NU + j - OFF_U] += value;
    else if (in_u)
        q->mixed[(i - OFF_U) * PC + column] += value;
    else if (j >= OFF_U && j < OFF_L)
        q->mixed[(j - OFF_U) * PC + row] += value;
    else
        q->half[row * PC + column] += value;
}

/* Z' H Z into W (PC, PC), with H of the present curvature, or with ones for states and controls */
static void sum_of_stages(const Work *w, int metric, double *W)
{
    Quadratic q = {.half = w->squares, .controls = w->parts, .mixed = w->parts + NU * NU};
    q.turn = q.mixed + NU * PC;
    q.across = q.turn + NU * PC;
    memset(W, 0, PC * PC * sizeof(double));
    for (int t = w->horizon - 1; t >= 0; t--) {
        const int last = t == w->horizon - 1;
        const Pattern *pattern = last ? &FINAL_H : &PATTERN_H;
        const double *values = w->curvature + t * CURVATURE;
        memset(q.half, 0, PC * PC * sizeof(double));
        memset(w->parts, 0, (NU * NU + (NX + 2 * NU) * PC) * sizeof(double));
        memset(q.has_across, 0, sizeof(q.has_across));
        q.has_turn = 0;
        if (metric) {
            for (int i = 0; i < NX; i++) q.half[i * (PC + 1)] = 0.5;
            for (int i = 0; i < NU && !last; i++) q.controls[i * (NU + 1)] = 0.5;
        } else
            for (int e = 0; e < pattern->size; e++)
                add_nonzero(w, t, pattern->rows[e], pattern->columns[e], values[e], &q);
        if (!last)
            step_back(w, t, &q, W, w->squares + WIDTH * WIDTH);
        else
            for (int i = 0; i < PC; i++)
                for (int j = 0; j < PC; j++) W[i * PC + j] = q.half[i * PC + j] + q.half[j * PC + i];
    }
}

/* Second derivatives of the Lagrangian into w->curvature, and W = Z' H Z (PC, PC) of (E8), after
 * feedback */
API void reduced_hessian(Work *w, const double *z, const double *theta, const double *multipliers,
                         double *W)
{
    const int last = w->horizon - 1;
    for (int t = 0; t <= last; t++) {
        double *values = w->curvature + t * CURVATURE, of_loss[STATES * STATES];
        const Pattern *pattern = t == last ? &FINAL_H : &PATTERN_H;
        sum_of_terms(w, t == last ? FINAL_HESSIAN : HESSIAN, pattern->size, z + t * SZ, theta,
                     multipliers + t * SZ, values);
        if (t < last)
            add_equations(w, HESSIAN_OF, t, z + t * SZ, theta, multipliers + t * SZ, values);
        for (int i = 0; i < PLAYERS; i++) {
            const int *own = (t == last ? FINAL_OWN_STATES : OWN_STATES)[i];
            loss_values(w, w->loss_hessian, z, t, i, of_loss);
            for (int e = 0; e < w->loss_nonzeros; e++)
                values[own[w->loss_places[e]]] += of_loss[e];
        }
    }
    sum_of_stages(w, 0, W);
}

/* Z' Z (PC, PC) over states and controls: the metric of the inertia correction */
API void trajectory_metric(const Work *w, double *metric) { sum_of_stages(w, 1, metric); }

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
            const double first = i < SZ ? dz[i] : d_theta[i - SZ];
            const double second = j < SZ ? dz[j] : d_theta[j - SZ];
            *(i < SZ ? row + i : out_theta + i - SZ) += values[e] * second;
            *(j < SZ ? row + j : out_theta + j - SZ) += values[e] * first;
        }
    }
}

/* out (PC,) = Z' g for g (T, SZ), after feedback */
API void reduce(const Work *w, const double *g, double *out)
{
    const int last = w->horizon - 1;
    double next[PC], controls[NU];
    memset(out, 0, PC * sizeof(double));
    memcpy(out, g + last * SZ, NX * sizeof(double));
    for (int t = last - 1; t >= 0; t--) {
        const double *stage = w->blocks + t * BLOCKS, *row = g + t * SZ;
        memcpy(next, out, sizeof(next));
        apply_transposed(NX, NX, -1, w->V + (t + 1) * NX * NX, row + OFF_L, next);
        apply_transposed(NX, NT, 1, w->v + (t + 1) * NX * NT, row + OFF_L, next + NX);
        memcpy(controls, row + OFF_U, sizeof(controls));
        sparse_vector(&PATTERN_B, stage, 1, 1, next, controls);
        memcpy(out, row, NX * sizeof(double));
        memcpy(out + NX, next + NX, NT * sizeof(double));
        sparse_vector(&PATTERN_A, stage, 1, 1, next, out);
        apply_transposed(NU, PC, 1, w->G + t * NU * PC, controls, out);
    }
}

/* out (T, SZ) += Z d for d (PC,) = (x_1, theta), after feedback */
API void expand(const Work *w, const double *d, double *out)
{
    const int last = w->horizon - 1;
    double now[PC], next[PC], controls[NU];
    memcpy(now, d, sizeof(now));
    memcpy(next, d, sizeof(next));
    for (int t = 0; t <= last; t++) {
        const double *stage = w->blocks + t * BLOCKS;
        double *row = out + t * SZ;
        for (int k = 0; k < NX; k++) row[k] += now[k];
        if (t == last) break;
        memset(controls, 0, sizeof(controls));
        apply(NU, PC, 1, w->G + t * NU * PC, now, controls);
        for (int k = 0; k < NU; k++) row[OFF_U + k] += controls[k];
        memset(next, 0, NX * sizeof(double));
        sparse_vector(&PATTERN_A, stage, 1, 0, now, next);
        sparse_vector(&PATTERN_B, stage, 1, 0, controls, next);
        apply(NX, NX, -1, w->V + (t + 1) * NX * NX, next, row + OFF_L);
        apply(NX, NT, 1, w->v + (t + 1) * NX * NT, next + NX, row + OFF_L);
        memcpy(now, next, NX * sizeof(double));
    }
}
