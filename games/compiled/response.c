/* One player's best response to the others' fixed motion, compiled behind elimination.c.
 *
 * This is Newton's method on the player's controls. A sweep back in time factorises the second
 * derivatives of its cost along the motion, as (E1) to (E5) for one player. The step is rolled out
 * with feedback, so that the motion stays feasible (differential dynamic programming with exact
 * second derivatives). A shift keeps M_t + shift I positive definite. A stationary point that needs
 * none is a strict local minimum.
 *
 * z (T, SZ) holds the joint trajectory. The states, controls and costates of the player at hand are
 * overwritten; of the others only states are read. */

#define OWN (STATES + CONTROLS)
#define OWN_ROWS (OWN + STATES) /* of g_x, g_u, f */

typedef struct {
    double gradient[CONTROLS];             /* of the cost in u_t */
    double blocks[OWN_ROWS * OWN];         /* of (g_x, g_u, f) in (x, u) */
    double step[CONTROLS];                 /* k of (E5) */
    double feedback[CONTROLS * STATES];    /* K of (E3) */
} ResponseStage;

/* One function of all terms of a player, brought to its own rows and columns */
static void own_values(const Work *w, int player, int function, int size, const double *row,
                       const double *theta, double *out)
{
    double values[MOST_VALUES];
    memset(out, 0, size * sizeof(double));
    for (int k = 0; k < TERMS_OF[player].count; k++) {
        const Term *term = TERMS + TERMS_OF[player].terms[k];
        const int *places = term->kind->own[function], count = term->kind->sizes[function];
        term_values(w, term, function, row, theta, row, values);
        for (int e = 0; e < count; e++)
            if (places[e] >= 0) out[places[e]] += values[e];
    }
}

static double own_cost(const Work *w, int player, const double *z, const double *theta)
{
    double sum = 0, value;
    for (int k = 0; k < TERMS_OF[player].count; k++) {
        const Term *term = TERMS + TERMS_OF[player].terms[k];
        for (int t = 0; t < w->horizon; t++) {
            term_values(w, term, t == w->horizon - 1 ? FINAL_COST : COST, z + t * SZ, theta, z,
                        &value);
            sum += value;
        }
    }
    return sum;
}

/* Costs (N,) of all players along a trajectory (T, SZ) */
API void costs(const Work *w, const double *z, const double *theta, double *out)
{
    for (int i = 0; i < PLAYERS; i++) out[i] = own_cost(w, i, z, theta);
}

/* Costates, backwards in time, and gradients and second derivatives of the cost at a feasible
 * motion z (T, SZ); costates are written into z, the rest into stages (T) */
static void differentiate(const Work *w, int player, double *z, const double *theta,
                          ResponseStage *stages)
{
    const int last = w->horizon - 1, costate = OFF_L + player * STATES;
    double values[OWN_ROWS];
    own_values(w, player, FINAL_VALUE, OWN_ROWS, z + last * SZ, theta, values);
    own_values(w, player, FINAL_JACOBIAN, OWN_ROWS * OWN, z + last * SZ, theta,
               stages[last].blocks);
    for (int t = last - 1; t >= 0; t--) {
        double *row = z + t * SZ;
        for (int k = 0; k < STATES; k++) row[costate + k] = -values[k];
        own_values(w, player, VALUE, OWN_ROWS, row, theta, values);
        own_values(w, player, JACOBIAN, OWN_ROWS * OWN, row, theta, stages[t].blocks);
        memcpy(stages[t].gradient, values + STATES, CONTROLS * sizeof(double));
    }
}

/* Lower factor of a (CONTROLS, CONTROLS) in its place; 0 where it is not positive definite */
static int factor_controls(double *a, double scale)
{
    for (int i = 0; i < CONTROLS; i++)
        for (int j = 0; j <= i; j++) {
            double sum = a[i * CONTROLS + j];
            for (int l = 0; l < j; l++) sum -= a[i * CONTROLS + l] * a[j * CONTROLS + l];
            if (i == j) {
                if (!(sum > 1e-13 * scale)) return 0;
                a[i * CONTROLS + i] = sqrt(sum);
            } else
                a[i * CONTROLS + j] = sum / a[j * CONTROLS + j];
        }
    return 1;
}

static void solve_controls(const double *factor, double *b, int stride)
{
    for (int i = 0; i < CONTROLS; i++) {
        for (int l = 0; l < i; l++) b[i * stride] -= factor[i * CONTROLS + l] * b[l * stride];
        b[i * stride] /= factor[i * CONTROLS + i];
    }
    for (int i = CONTROLS - 1; i >= 0; i--) {
        for (int l = i + 1; l < CONTROLS; l++)
            b[i * stride] -= factor[l * CONTROLS + i] * b[l * stride];
        b[i * stride] /= factor[i * CONTROLS + i];
    }
}

/* Steps and feedback of all stages with M + shift I; the square of Newton's decrement, or -1 where
 * that is not positive definite. *scale becomes the largest entry of any M. */
static double sweep_back(int last, ResponseStage *stages, double shift, double *scale)
{
    double V[STATES * STATES], v[STATES] = {0}, decrement = 0;
    for (int i = 0; i < STATES; i++)
        memcpy(V + i * STATES, stages[last].blocks + i * OWN, STATES * sizeof(double));
    for (int t = last - 1; t >= 0; t--) {
        ResponseStage *stage = stages + t;
        const double *F = stage->blocks + OWN * OWN;
        double VF[STATES * OWN] = {0}, H[OWN * OWN], M[CONTROLS * CONTROLS], e[OWN] = {0};
        multiply_add(STATES, STATES, OWN, 1, V, STATES, F, OWN, VF, OWN);
        memcpy(H, stage->blocks, sizeof(H));
        transpose_multiply_add(STATES, OWN, F, VF, H);
        for (int l = 0; l < STATES; l++)
            for (int j = 0; j < OWN; j++) e[j] += F[l * OWN + j] * v[l];
        for (int i = 0; i < CONTROLS; i++) {
            for (int j = 0; j < CONTROLS; j++) {
                M[i * CONTROLS + j] = H[(STATES + i) * OWN + STATES + j];
                *scale = fmax(*scale, fabs(M[i * CONTROLS + j]));
            }
            M[i * CONTROLS + i] += shift;
            stage->step[i] = stage->gradient[i] + e[STATES + i];
            memcpy(stage->feedback + i * STATES, H + (STATES + i) * OWN, STATES * sizeof(double));
        }
        if (!isfinite(*scale) || !factor_controls(M, *scale)) return -1;
        double slope[CONTROLS];
        memcpy(slope, stage->step, sizeof(slope));
        solve_controls(M, stage->step, 1);
        for (int j = 0; j < STATES; j++) solve_controls(M, stage->feedback + j, STATES);
        for (int i = 0; i < CONTROLS; i++) decrement += slope[i] * stage->step[i];
        for (int i = 0; i < STATES; i++) {
            const double *L = H + i * OWN + STATES;
            v[i] = e[i];
            for (int l = 0; l < CONTROLS; l++) v[i] -= L[l] * stage->step[l];
            for (int j = 0; j < STATES; j++) {
                V[i * STATES + j] = H[i * OWN + j];
                for (int l = 0; l < CONTROLS; l++)
                    V[i * STATES + j] -= L[l] * stage->feedback[l * STATES + j];
            }
        }
    }
    return decrement;
}

/* The motion after a step of some length, from z into next */
static void roll_out(const Work *w, int player, const ResponseStage *stages, double length,
                     const double *z, const double *theta, double *next)
{
    const int x = player * STATES, u = OFF_U + player * CONTROLS;
    const Term *own = TERMS + TERMS_OF[player].terms[0]; /* only it has a motion */
    for (int t = 0; t < w->horizon - 1; t++) {
        const double *before = z + t * SZ;
        double *row = next + t * SZ;
        for (int i = 0; i < CONTROLS; i++) {
            row[u + i] = before[u + i] - length * stages[t].step[i];
            for (int j = 0; j < STATES; j++)
                row[u + i] -= stages[t].feedback[i * STATES + j] * (row[x + j] - before[x + j]);
        }
        term_values(w, own, MOTION, row, theta, row, row + SZ + x);
    }
}

/* Improve the player's part of z (T, SZ), a feasible motion, in place; `next` (T, SZ) and `stages`
 * (T) are work space. Returns the cost. *status: 0 where the iteration ended early, 1 at a
 * stationary point, 2 at a strict local minimum; *iterations counts the sweeps. */
static double respond(const Work *w, int player, double *z, double *next, ResponseStage *stages,
                      const double *theta, double tolerance, int max_iterations, int *status,
                      int *iterations)
{
    const int last = w->horizon - 1;
    double cost = own_cost(w, player, z, theta), shift = 0;
    *status = 0;
    for (*iterations = 0; *iterations < max_iterations && isfinite(cost); ++*iterations) {
        *status = 0;
        differentiate(w, player, z, theta, stages);
        double scale = 0, decrement, length = 1, trial = cost;
        while ((decrement = sweep_back(last, stages, shift, &scale)) < 0) {
            if (!isfinite(scale) || shift > 1e12 * (1 + scale)) return cost;
            shift = fmax(4 * shift, 1e-6 * (1e-3 + scale));
        }
        if (decrement < tolerance * (1 + fabs(cost))) {
            if (shift > 0) decrement = sweep_back(last, stages, shift = 0, &scale);
            *status = decrement < 0 ? 1 : 2;
            if (decrement < tolerance * (1 + fabs(cost))) return cost;
        }
        memcpy(next, z, (size_t)w->horizon * SZ * sizeof(double));
        for (;; length /= 2) {
            if (length < SMALLEST_STEP) break;
            roll_out(w, player, stages, length, z, theta, next);
            trial = own_cost(w, player, next, theta);
            /* NaN compares false, so an undefined trial point is refused as well. */
            if (trial <= cost - 1e-4 * length * decrement) break;
        }
        if (length < SMALLEST_STEP) {
            if (shift > 1e12 * (1 + scale)) return cost;
            shift = fmax(16 * shift, 1e-4 * (1e-3 + scale));
            continue;
        }
        memcpy(z, next, (size_t)w->horizon * SZ * sizeof(double));
        cost = trial;
        shift = shift > 1e-6 * (1e-3 + scale) ? shift / 8 : 0;
    }
    return cost;
}

/* Entries of the work space of `responses` */
API int response_space(int horizon)
{
    return 2 * horizon * SZ + horizon * (int)(sizeof(ResponseStage) / sizeof(double));
}

/* Responses of a player from `count` first plans (count, T-1, CONTROLS) to the others' motion in
 * z (T, SZ): the plans they end in, their costates (count, T-1, STATES), costs, status and
 * iterations (count,) as of `respond`. */
API void responses(const Work *w, int player, int count, const double *z, const double *theta,
                   double tolerance, int max_iterations, double *plans, double *costates,
                   double *found, int *status, int *iterations, double *space)
{
    const size_t size = (size_t)w->horizon * SZ;
    const int steps = w->horizon - 1, u = OFF_U + player * CONTROLS;
    double *own = space, *next = own + size;
    ResponseStage *stages = (ResponseStage *)(next + size);
    for (int b = 0; b < count; b++) {
        double *plan = plans + (size_t)b * steps * CONTROLS;
        memcpy(own, z, size * sizeof(double));
        memset(stages, 0, w->horizon * sizeof(ResponseStage));
        for (int t = 0; t < steps; t++)
            memcpy(own + t * SZ + u, plan + t * CONTROLS, CONTROLS * sizeof(double));
        memcpy(next, own, size * sizeof(double));
        roll_out(w, player, stages, 0, own, theta, next); /* without steps: the plan itself */
        memcpy(own, next, size * sizeof(double));
        found[b] = respond(w, player, own, next, stages, theta, tolerance, max_iterations,
                           status + b, iterations + b);
        double *costate = costates + (size_t)b * steps * STATES;
        for (int t = 0; t < steps; t++) {
            const double *row = own + t * SZ;
            memcpy(plan + t * CONTROLS, row + u, CONTROLS * sizeof(double));
            memcpy(costate + t * STATES, row + OFF_L + player * STATES, STATES * sizeof(double));
        }
    }
}

/* Iterated best response from a feasible motion z (T, SZ), in place: in each round every player in
 * turn, `first` before the others, goes a share `damping` of the way to its best response. It ends
 * once no control changes by more than damping * settled in one round, after max_rounds rounds, or
 * where max_steps sweeps are spent. Returns the number of sweeps. */
API int respond_in_turn(const Work *w, int first, double *z, const double *theta, double damping,
                        double settled, double tolerance, int max_iterations, int max_rounds,
                        int max_steps, double *space)
{
    const size_t size = (size_t)w->horizon * SZ;
    double *own = space, *next = own + size;
    ResponseStage *stages = (ResponseStage *)(next + size);
    int used = 0;
    for (int round = 0; round < max_rounds && used < max_steps; round++) {
        double largest = 0;
        for (int k = 0; k < PLAYERS; k++) {
            const int player = (first + k) % PLAYERS, u = OFF_U + player * CONTROLS;
            int status, iterations;
            memcpy(own, z, size * sizeof(double));
            respond(w, player, own, next, stages, theta, tolerance, max_iterations, &status,
                    &iterations);
            used += iterations;
            for (int t = 0; t < w->horizon - 1; t++) {
                double *row = z + t * SZ;
                for (int l = 0; l < CONTROLS; l++) {
                    const double change = own[t * SZ + u + l] - row[u + l];
                    largest = fmax(largest, fabs(change));
                    row[u + l] += damping * change;
                }
                memcpy(row + OFF_L + player * STATES, own + t * SZ + OFF_L + player * STATES,
                       STATES * sizeof(double));
            }
            memset(stages, 0, w->horizon * sizeof(ResponseStage)); /* no feedback: the plan itself */
            roll_out(w, player, stages, 0, z, theta, z);
        }
        if (largest < settled) break;
    }
    return used;
}
