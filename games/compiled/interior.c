/* The interior point method of games/solve/interior.py, compiled behind elimination.c; the same algorithm,
 * equation labels (I1) to (I3) are defined there. Arrays of margins are (T, MARGINS). */

#define LONGEST_FILTER 512

typedef struct {
    double last_tau, tolerance, tau_factor, tau_power, solved_for_tau, to_boundary;
    double shortest_step, first_shift, largest_shift, dual_range, rounding;
} InteriorOptions; /* mirrored by _OPTIONS of games/solve/interior.py */

API int interior_options(void) { return sizeof(InteriorOptions); }

typedef struct {
    double *z, *s, *v;         /* trajectory, slacks, multipliers */
    double *error, *gap;       /* G - J' v, g - s */
    double violation, residual;
} Point;

typedef struct {
    Work *w;
    const InteriorOptions *options;
    const double *theta;
    const unsigned char *on; /* which margins are enforced */
    int coupled, filter_size;
    double *dz, *ds, *dv, *sigma, *right, *mixed;
    double shift, most_violation, little_violation;
    double filter[LONGEST_FILTER][2];
} Interior;

static int margin_count(const Interior *I) { return I->w->horizon * MARGINS; }

/* Errors at a point's z, s and v */
static void errors_at(const Interior *I, Point *p)
{
    const int rows = I->w->horizon;
    double sum = 0;
    evaluate(I->w, p->z, I->theta, p->error);
    add_push(I->w, p->z, -1, p->v, p->error);
    memset(p->error, 0, NX * sizeof(double));
    margins(I->w, p->z, p->gap);
    p->violation = p->residual = 0;
    for (int t = 0; t < rows; t++)
        for (int k = 0; k < SZ; k++) {
            const double size = fabs(p->error[t * SZ + k]);
            if (k >= OFF_L) p->violation += size;
            sum += size;
            p->residual = fmax(p->residual, size);
        }
    for (int k = 0; k < margin_count(I); k++) {
        p->gap[k] = I->on[k] ? p->gap[k] - p->s[k] : 0;
        p->violation += fabs(p->gap[k]);
        p->residual = fmax(p->residual, fabs(p->gap[k]));
    }
    if (!isfinite(sum + p->violation)) p->residual = p->violation = INFINITY; /* fmax drops NaN */
}

/* Whether the equations hold for tau, to so many times of it */
static int solved_for(const Interior *I, const Point *p, double tau, double times)
{
    const int last = tau == I->options->last_tau;
    const double limit = last ? I->options->tolerance : times * tau;
    if (!(p->residual < limit)) return 0;
    for (int k = 0; k < margin_count(I); k++)
        if (I->on[k] && !(fabs(p->s[k] * p->v[k] - tau) < fmax(limit, times * tau))) return 0;
    return 1;
}

/* (I3) at z and s, where the present motion is another one */
static double phi_at(const Interior *I, const double *present, const double *z, const double *s,
                     double tau)
{
    double sum = 0, barrier = 0;
    for (int i = 0; i < PLAYERS; i++) {
        const double *motion = z;
        if (I->coupled) {
            memcpy(I->mixed, present, (size_t)I->w->horizon * SZ * sizeof(double));
            for (int t = 0; t < I->w->horizon; t++) {
                const int x = t * SZ + i * STATES, u = t * SZ + OFF_U + i * CONTROLS;
                memcpy(I->mixed + x, z + x, STATES * sizeof(double));
                memcpy(I->mixed + u, z + u, CONTROLS * sizeof(double));
            }
            motion = I->mixed;
        }
        sum += own_cost(I->w, i, motion, I->theta);
    }
    for (int k = 0; k < margin_count(I); k++)
        if (I->on[k]) barrier += log(s[k]);
    return sum - tau * barrier;
}

/* dz, ds, dv of (I2); 0 where no shift makes the stage matrices definite */
static int find_direction(Interior *I, const Point *p, double tau)
{
    const InteriorOptions *o = I->options;
    const int count = margin_count(I), size = I->w->horizon * SZ;
    double shift = 0;
    for (int k = 0; k < count; k++) {
        I->sigma[k] = I->on[k] ? p->v[k] / p->s[k] : 0;
        I->dv[k] = I->on[k] ? tau / p->s[k] - p->v[k] : 0;
        I->ds[k] = I->dv[k] - I->sigma[k] * p->gap[k];
    }
    while (!factorise_stages(I->w, p->z, I->theta, p->v, I->sigma, shift)) {
        if (shift == 0)
            shift = I->shift > 0 ? fmax(1e-6, I->shift / 3) : o->first_shift;
        else
            shift *= I->shift > 0 ? 8 : 100;
        if (!(shift <= o->largest_shift)) return 0;
    }
    if (shift > 0) I->shift = shift;
    memcpy(I->right, p->error, size * sizeof(double));
    add_push(I->w, p->z, -1, I->ds, I->right);
    memset(I->right, 0, NX * sizeof(double));
    for (int k = 0; k < size; k++) I->right[k] = -I->right[k];
    solve(I->w, 0, I->right, I->dz);
    change(I->w, p->z, I->dz, I->ds);
    for (int k = 0; k < count; k++) {
        I->ds[k] = I->on[k] ? I->ds[k] + p->gap[k] : 0;
        I->dv[k] -= I->sigma[k] * I->ds[k];
    }
    return 1;
}

/* The derivative of phi along the direction: the gradient of the costs is that of the Lagrangian
 * without motion and constraints, whose changes are known */
static double slope_of(const Interior *I, const Point *p, double tau)
{
    double slope = 0;
    for (int t = 0; t < I->w->horizon; t++) {
        const double *error = p->error + t * SZ, *dz = I->dz + t * SZ;
        for (int k = 0; k < OFF_L; k++) slope += error[k] * dz[k];
        for (int k = OFF_L; k < SZ; k++) slope += error[k] * p->z[t * SZ + k];
    }
    for (int k = 0; k < margin_count(I); k++)
        if (I->on[k]) slope += p->v[k] * (I->ds[k] - p->gap[k]) - tau * I->ds[k] / p->s[k];
    return slope;
}

/* The longest step, at most 1, along which positive values stay positive */
static double to_boundary(const Interior *I, const double *value, const double *step)
{
    double longest = 1;
    for (int k = 0; k < margin_count(I); k++)
        if (I->on[k] && step[k] < 0)
            longest = fmin(longest, -I->options->to_boundary * value[k] / step[k]);
    return longest;
}

static void move(const Interior *I, const Point *from, double primal, double dual, Point *to)
{
    for (int k = 0; k < I->w->horizon * SZ; k++) to->z[k] = from->z[k] + primal * I->dz[k];
    for (int k = 0; k < margin_count(I); k++) {
        to->s[k] = from->s[k] + primal * I->ds[k];
        to->v[k] = from->v[k] + dual * I->dv[k];
    }
    errors_at(I, to);
}

/* Whether a violation and phi are better than each of the filter in one of the two */
static int acceptable(const Interior *I, double violation, double phi)
{
    if (!isfinite(violation) || !isfinite(phi) || violation > I->most_violation) return 0;
    for (int k = 0; k < I->filter_size; k++) {
        const double *entry = I->filter[k];
        if (!(violation < (1 - 1e-5) * entry[0] || phi < entry[1] - 1e-5 * entry[0])) return 0;
    }
    return 1;
}

/* Keep v within a factor of tau / s */
static void keep_multipliers(const Interior *I, Point *p, double tau)
{
    int changed = 0;
    for (int k = 0; k < margin_count(I); k++) {
        if (!I->on[k]) continue;
        const double centred = tau / p->s[k], before = p->v[k];
        p->v[k] = fmin(fmax(before, centred / I->options->dual_range),
                       centred * I->options->dual_range);
        changed |= p->v[k] != before;
    }
    if (changed) errors_at(I, p);
}

/* One step (I2) from a point to the next; 0 where there is none */
static int interior_step(Interior *I, const Point *p, Point *next, double tau)
{
    if (!find_direction(I, p, tau)) return 0;
    const double primal = to_boundary(I, p->s, I->ds), dual = to_boundary(I, p->v, I->dv);
    const double slope = slope_of(I, p, tau), phi = phi_at(I, p->z, p->z, p->s, tau);
    if (I->coupled) I->filter_size = 0; /* phi of other steps means something else */
    for (double length = primal; length > I->options->shortest_step; length /= 2) {
        move(I, p, length, dual, next);
        const double violation = next->violation;
        const double found = phi_at(I, p->z, next->z, next->s, tau) -
                             I->options->rounding * (1 + fabs(phi));
        if (!acceptable(I, violation, found)) continue;
        if (p->violation <= I->little_violation && slope < 0 &&
            length * pow(-slope, 2.3) > pow(p->violation, 1.1)) {
            if (found > phi + 1e-4 * length * slope) continue;
        } else if (violation <= (1 - 1e-5) * p->violation || found <= phi - 1e-5 * p->violation) {
            if (I->filter_size == LONGEST_FILTER) I->filter_size = 0;
            I->filter[I->filter_size][0] = p->violation;
            I->filter[I->filter_size++][1] = phi;
        } else
            continue;
        keep_multipliers(I, next, tau);
        return 1;
    }
    I->filter_size = 0; /* a step that the filter does not like is better than none */
    move(I, p, primal, dual, next);
    keep_multipliers(I, next, tau);
    return 1;
}

/* Entries of the work space of `interior` */
API int interior_space(int horizon) { return horizon * (7 * SZ + 10 * MARGINS); }

/* Iterate from z (T, SZ), in place. Returns the number of steps; v (T, MARGINS) are the
 * multipliers, *residual the largest error of G - J' v and g - s, *solved whether (I1) holds. */
API int interior(Work *w, const InteriorOptions *options, const double *theta,
                 const unsigned char *on, int coupled, double tau, double relaxed,
                 int max_iterations, double *z, double *v, double *residual, int *solved,
                 double *space)
{
    const int size = w->horizon * SZ, count = w->horizon * MARGINS;
    Interior I = {w, options, theta, on, coupled};
    Point points[2], *p = points, *next = points + 1;
    double **rows[] = {&I.dz, &I.right, &I.mixed, &points[0].z, &points[0].error, &points[1].z,
                       &points[1].error};
    double **columns[] = {&I.ds, &I.dv, &I.sigma, &points[0].s, &points[0].v, &points[0].gap,
                          &points[1].s, &points[1].v, &points[1].gap};
    for (int k = 0; k < 7; k++, space += size) *rows[k] = space;
    for (int k = 0; k < 9; k++, space += count) *columns[k] = space;
    memcpy(p->z, z, size * sizeof(double));
    margins(w, z, p->gap);
    for (int c = 0; c < MARGINS; c++) {
        double sum = 0;
        int steps = 0;
        for (int k = c; k < count; k += MARGINS)
            if (on[k]) sum += fabs(p->gap[k]), steps++;
        for (int k = c; k < count; k += MARGINS) {
            p->s[k] = on[k] ? fmax(p->gap[k], relaxed * sum / steps + 1e-8) : 1;
            p->v[k] = on[k] ? tau / p->s[k] : 0;
        }
    }
    errors_at(&I, p);
    I.most_violation = 1e4 * fmax(1, p->violation);
    I.little_violation = 1e-4 * fmax(1, p->violation);
    int iterations = 0;
    for (; iterations < max_iterations; iterations++) {
        if (solved_for(&I, p, options->last_tau, 1)) break;
        while (tau > options->last_tau && solved_for(&I, p, tau, options->solved_for_tau)) {
            tau = fmin(options->tau_factor * tau, 1e-3 * pow(1e3 * tau, options->tau_power));
            tau = fmax(options->last_tau, tau);
            I.filter_size = 0;
        }
        if (!interior_step(&I, p, next, tau)) break;
        Point *before = p;
        p = next;
        next = before;
    }
    *solved = solved_for(&I, p, options->last_tau, 1);
    *residual = p->residual;
    memcpy(z, p->z, size * sizeof(double));
    memcpy(v, p->v, count * sizeof(double));
    return iterations;
}
