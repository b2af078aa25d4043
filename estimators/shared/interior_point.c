/* The interior-point method that estimators/shared/interior_point.py explains. It is compiled once,
 * and calls the libraries of games/compiled/elimination.c through tables of their functions.
 *
 * Numbers in brackets are the equations of Waechter and Biegler (2006), as there. The unknowns are
 * z, the rows of all motions, and theta: D rows of K weights and then the unknowns of all motions.
 * Changes of w = (x_1 of each motion, theta) live on the tangent of the sums of weights: `basis`
 * (K, K-1) spans it for one row. */

#include <math.h>
#include <string.h>
#include <time.h>

#define API __attribute__((visibility("default")))
#define SPACE_ARRAYS 13  /* as long as z */
#define THETA_ARRAYS 6   /* as long as theta */
#define SQUARES 7        /* as large as the Hessian in w */
#define FILTER_ENTRIES 2 /* numbers that an iteration may add to the filter */

/* Status of estimators/shared/joint_problem.py, in its order */
enum { CONVERGED, NOT_FINITE, SINGULAR, NO_TIME, NO_CURVATURE, NO_STEP, NO_ITERATIONS, KNOWN };

static const double FEASIBLE = 1e-9, ACCEPTABLE = 1e-6, EPSILON = 2.220446049250313e-16;

/* What elimination.c and reduction.c offer for a structure of games; mirrored by _Structure */
typedef struct {
    int states, thetas, row, primal; /* NX, NT, SZ and OFF_L there */
    void (*evaluate)(const void *work, const double *z, const double *theta, double *residual);
    double (*observation_loss)(const void *work, const double *z, double *gradient);
    int (*linearise)(void *work, const double *z, const double *theta);
    void (*feedback)(void *work);
    void (*solve)(const void *work, int transposed, const double *right, double *out);
    void (*reduce)(const void *work, const double *g, double *out);
    void (*expand)(const void *work, const double *d, double *out);
    void (*reduced_hessian)(void *work, const double *z, const double *theta,
                            const double *multipliers, double *W);
    void (*trajectory_metric)(const void *work, double *metric);
    void (*hessian_product)(const void *work, const double *d, const double *d_theta, double *out,
                            double *out_theta);
    void (*newton)(void *work, int count, double *z, const double *theta, double tolerance,
                   int max_iterations, double limit, int factorised, double *residuals,
                   int *iterations);
} Structure;

/* One motion, with a work space of its own; mirrored by _Motion */
typedef struct {
    void *work;
    const Structure *structure;
    const int *theta; /* (thetas,) where its own theta is in theta */
    int horizon;
} Motion;

/* Mirrored by _Options of interior_point.py, which explains them */
typedef struct {
    int motions, drivers, weights, unknowns, max_iterations, known;
    double first_barrier, tolerance, limit;
} Options;

/* What is known of theta: its bounds, the pull towards a centre, and the least barrier of each
 * lower bound. The last is a prior: its term stays in what is minimised. */
typedef struct {
    const double *lower, *upper, *centre, *pull, *barrier;
} Prior;

/* Of the structs that estimators/shared/interior_point.py mirrors */
API int interior_point_sizes(int which)
{
    const int sizes[] = {sizeof(Options), sizeof(Prior), sizeof(Structure), sizeof(Motion)};
    return sizes[which];
}

static const double KNOWN_CHANGE = 1e-4, KNOWN_WEIGHTS = 1e-3; /* of the objective, relative, and
                                                                 of any weight */

typedef struct {
    double *z, *residual, *gradient, *theta;
    double loss, objective;           /* squared error; the same with pulls */
    double violation, infeasibility; /* |G|_1, max |G| */
} Point;

typedef struct {
    double *dz, *dtheta;
} Direction;

typedef struct {
    const Motion *motions;
    const Options *options;
    const Prior *prior;
    const double *basis, *known_objectives, *known_theta; /* (K, K-1), (known,), (known, thetas) */
    int size, starts, thetas, columns, tangents; /* of z, all x_1, theta, w, and its changes */
    double barrier, first_violation, shift, last_shift;
    Point point, trial;
    Direction direction, correction;
    double *multipliers, *next_multipliers, *normal, *curvature, *combined; /* like z */
    double *duals, *upper_duals;                                            /* like theta */
    double *reduced_gradient;                                               /* (columns,) */
    double *hessian, *metric, *tangent_hessian, *tangent_metric, *factor;   /* (columns, columns) */
    double *half, *own; /* (columns, columns): a product; what belongs to one motion */
    double (*filter)[2]; /* pairs of violation and barrier objective */
    int filtered;
} Method;

static double sum_of_products(int n, const double *a, const double *b)
{
    double sum = 0;
    for (int i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* out (tangents,) = basis' in (columns,) */
static void to_tangent(const Method *m, const double *in, double *out)
{
    const int K = m->options->weights, L = K - 1, rows = m->options->drivers, first = m->starts;
    memcpy(out, in, first * sizeof(double));
    for (int i = 0; i < rows; i++)
        for (int l = 0; l < L; l++) {
            double sum = 0;
            for (int k = 0; k < K; k++) sum += m->basis[k * L + l] * in[first + i * K + k];
            out[first + i * L + l] = sum;
        }
    memcpy(out + first + rows * L, in + first + rows * K, m->options->unknowns * sizeof(double));
}

/* out (columns,) = basis in (tangents,) */
static void from_tangent(const Method *m, const double *in, double *out)
{
    const int K = m->options->weights, L = K - 1, rows = m->options->drivers, first = m->starts;
    memcpy(out, in, first * sizeof(double));
    for (int i = 0; i < rows; i++)
        for (int k = 0; k < K; k++) {
            double sum = 0;
            for (int l = 0; l < L; l++) sum += m->basis[k * L + l] * in[first + i * L + l];
            out[first + i * K + k] = sum;
        }
    memcpy(out + first + rows * K, in + first + rows * L, m->options->unknowns * sizeof(double));
}

/* out (tangents, tangents) = basis' in (columns, columns) basis, in symmetric */
static void matrix_to_tangent(const Method *m, const double *in, double *out)
{
    const int n = m->tangents, columns = m->columns;
    double column[columns], transformed[n];
    for (int i = 0; i < columns; i++) to_tangent(m, in + i * columns, m->half + i * n);
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < columns; i++) column[i] = m->half[i * n + j];
        to_tangent(m, column, transformed);
        memcpy(out + j * n, transformed, n * sizeof(double));
    }
}

/* Lower factor of a (n, n) + shift b; 0 where the sum is not positive definite */
static int cholesky(int n, const double *a, double shift, const double *b, double *factor)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = a[i * n + j] + (shift ? shift * b[i * n + j] : 0);
            sum -= sum_of_products(j, factor + i * n, factor + j * n);
            if (i == j) {
                if (!(sum > 0)) return 0;
                factor[i * n + i] = sqrt(sum);
            } else
                factor[i * n + j] = sum / factor[j * n + j];
        }
    return 1;
}

static void cholesky_solve(int n, const double *factor, double *b)
{
    for (int i = 0; i < n; i++)
        b[i] = (b[i] - sum_of_products(i, factor + i * n, b)) / factor[i * n + i];
    for (int i = n - 1; i >= 0; i--) {
        b[i] /= factor[i * n + i];
        for (int j = 0; j < i; j++) b[j] -= factor[i * n + j] * b[i];
    }
}

/* ---- sums over motions -------------------------------------------------------------------- */

/* One motion, and where its rows are in z and its x_1 in w */
typedef struct {
    const Motion *motion;
    const Structure *at;
    void *work;
    int z, x, size;
} Place;

static int next_place(const Method *m, Place *p)
{
    const Motion *next = p->motion ? p->motion + 1 : m->motions;
    if (next == m->motions + m->options->motions) return 0;
    if (p->motion) p->z += p->size, p->x += p->at->states;
    p->motion = next, p->at = next->structure, p->work = next->work;
    p->size = next->horizon * p->at->row;
    return 1;
}

#define EACH_MOTION(m, p) for (Place p = {0}; next_place(m, &p);)

static void own_theta(const Place *p, const double *theta, double *own)
{
    for (int k = 0; k < p->at->thetas; k++) own[k] = theta[p->motion->theta[k]];
}

/* Column of w of a motion's own column */
static int column_of(const Method *m, const Place *p, int own)
{
    return own < p->at->states ? p->x + own : m->starts + p->motion->theta[own - p->at->states];
}

/* Values at p->z and p->theta; if they are not finite, neither is the violation */
static void assess(const Method *m, Point *p)
{
    p->loss = 0;
    EACH_MOTION(m, of)
    {
        double theta[of.at->thetas];
        own_theta(&of, p->theta, theta);
        of.at->evaluate(of.work, p->z + of.z, theta, p->residual + of.z);
        p->loss += of.at->observation_loss(of.work, p->z + of.z, p->gradient + of.z);
    }
    p->objective = p->loss;
    for (int k = 0; k < m->thetas; k++) {
        const double away = p->theta[k] - m->prior->centre[k];
        p->objective += m->prior->pull[k] * away * away;
    }
    p->violation = p->infeasibility = 0;
    for (int i = 0; i < m->size; i++) {
        const double absolute = fabs(p->residual[i]);
        p->violation += absolute;
        p->infeasibility = fmax(p->infeasibility, absolute);
    }
}

/* Whether all motions are regular; then the next four serve */
static int linearise_all(const Method *m)
{
    EACH_MOTION(m, of)
    {
        double theta[of.at->thetas];
        own_theta(&of, m->point.theta, theta);
        if (!of.at->linearise(of.work, m->point.z + of.z, theta)) return 0;
        of.at->feedback(of.work);
    }
    return 1;
}

static void solve_all(const Method *m, int transposed, const double *right, double *out)
{
    EACH_MOTION(m, of) of.at->solve(of.work, transposed, right + of.z, out + of.z);
}

/* out (columns,) = Z' g */
static void reduce_all(const Method *m, const double *g, double *out)
{
    memset(out, 0, m->columns * sizeof(double));
    EACH_MOTION(m, of)
    {
        const int columns = of.at->states + of.at->thetas;
        double own[columns];
        of.at->reduce(of.work, g + of.z, own);
        for (int k = 0; k < columns; k++) out[column_of(m, &of, k)] += own[k];
    }
}

/* out += Z d for d (columns,) */
static void expand_all(const Method *m, const double *d, double *out)
{
    EACH_MOTION(m, of)
    {
        const int columns = of.at->states + of.at->thetas;
        double own[columns];
        for (int k = 0; k < columns; k++) own[k] = d[column_of(m, &of, k)];
        of.at->expand(of.work, own, out + of.z);
    }
}

/* out (columns, columns) += m->own of a motion */
static void add_square(const Method *m, const Place *of, double *out)
{
    const int columns = of->at->states + of->at->thetas;
    for (int i = 0; i < columns; i++) {
        double *row = out + column_of(m, of, i) * m->columns;
        for (int j = 0; j < columns; j++) row[column_of(m, of, j)] += m->own[i * columns + j];
    }
}

static void hessian_of_all(const Method *m)
{
    memset(m->hessian, 0, (size_t)m->columns * m->columns * sizeof(double));
    EACH_MOTION(m, of)
    {
        double theta[of.at->thetas];
        own_theta(&of, m->point.theta, theta);
        of.at->reduced_hessian(of.work, m->point.z + of.z, theta, m->multipliers + of.z, m->own);
        add_square(m, &of, m->hessian);
    }
}

static void metric_of_all(const Method *m)
{
    memset(m->metric, 0, (size_t)m->columns * m->columns * sizeof(double));
    EACH_MOTION(m, of)
    {
        of.at->trajectory_metric(of.work, m->own);
        add_square(m, &of, m->metric);
    }
    for (int k = m->starts; k < m->columns; k++) m->metric[k * (m->columns + 1)] += 1;
}

/* curvature = (H + shift) dz, curvature_theta = the part of theta */
static void curve(const Method *m, const double *dz, const double *dtheta, double *curvature_theta)
{
    memset(curvature_theta, 0, m->thetas * sizeof(double));
    EACH_MOTION(m, of)
    {
        const int count = of.at->thetas, row = of.at->row;
        const double *own_dz = dz + of.z;
        double theta[count], out_theta[count], *out = m->curvature + of.z;
        own_theta(&of, dtheta, theta);
        of.at->hessian_product(of.work, own_dz, theta, out, out_theta);
        for (int k = 0; k < count; k++) curvature_theta[of.motion->theta[k]] += out_theta[k];
        for (int i = 0; m->shift && i < of.size; i += row)
            for (int k = 0; k < of.at->primal; k++) out[i + k] += m->shift * own_dz[i + k];
    }
}

/* ---- the method ---------------------------------------------------------------------------- */

/* Whether an unknown has an upper bound; weights have theirs by their sum */
static int is_bounded(const Method *m, int k) { return isfinite(m->prior->upper[k]); }

static double dual_scale(const Method *m) /* s_d and s_c of (6) */
{
    double sum = 0;
    for (int k = 0; k < m->thetas; k++) sum += m->duals[k] + m->upper_duals[k];
    return fmax(1, sum / (100 * m->thetas));
}

/* The barrier of the lower bound of theta[k] when that of the others is `barrier` */
static double lower_barrier(const Method *m, int k, double barrier)
{
    return fmax(barrier, m->prior->barrier[k]);
}

static double complementarity(const Method *m, double barrier)
{
    double largest = 0;
    for (int k = 0; k < m->thetas; k++) {
        const double theta = m->point.theta[k];
        if (isfinite(m->prior->lower[k]))
            largest = fmax(largest, fabs((theta - m->prior->lower[k]) * m->duals[k] -
                                         lower_barrier(m, k, barrier)));
        if (is_bounded(m, k))
            largest = fmax(largest, fabs((m->prior->upper[k] - theta) * m->upper_duals[k] - barrier));
    }
    return largest / dual_scale(m);
}

/* The parts of E_mu (5) that do not depend on mu; infinite if they are not finite */
static double stationarity(const Method *m)
{
    double gradient[m->columns], along[m->columns], largest = 0, sum = 0;
    memcpy(gradient, m->reduced_gradient, sizeof(gradient));
    for (int k = 0; k < m->thetas; k++) gradient[m->starts + k] += m->upper_duals[k] - m->duals[k];
    to_tangent(m, gradient, along);
    for (int i = 0; i < m->tangents; i++) {
        largest = fmax(largest, fabs(along[i]));
        sum += along[i];
    }
    return isfinite(sum) ? fmax(m->point.infeasibility, largest / dual_scale(m)) : INFINITY;
}

static void reduce_barrier(Method *m) /* (7) */
{
    m->barrier =
        fmax(m->options->tolerance / 10, fmin(0.2 * m->barrier, pow(m->barrier, 1.5)));
    m->filtered = 0;
}

/* Cholesky factor of the tangent Hessian, shifted until it is positive definite */
static int factorise(Method *m)
{
    const int n = m->tangents;
    hessian_of_all(m);
    for (int k = 0; k < m->thetas; k++) {
        const double theta = m->point.theta[k];
        m->hessian[(m->starts + k) * (m->columns + 1)] += m->duals[k] / (theta - m->prior->lower[k]) +
                                           m->upper_duals[k] / (m->prior->upper[k] - theta) +
                                           2 * m->prior->pull[k];
    }
    matrix_to_tangent(m, m->hessian, m->tangent_hessian);
    double sum = 0;
    for (int i = 0; i < n * n; i++) sum += m->tangent_hessian[i];
    if (!isfinite(sum)) return 0;
    m->shift = 0;
    if (cholesky(n, m->tangent_hessian, 0, 0, m->factor)) return 1;
    metric_of_all(m);
    matrix_to_tangent(m, m->metric, m->tangent_metric);
    const int first = m->last_shift == 0;
    m->shift = first ? 1e-4 : fmax(1e-20, m->last_shift / 3);
    while (!cholesky(n, m->tangent_hessian, m->shift, m->tangent_metric, m->factor)) {
        m->shift *= first ? 100 : 8;
        if (m->shift > 1e20) return 0;
    }
    m->last_shift = m->shift;
    return 1;
}

static double pull_slope(const Method *m, int k)
{
    return 2 * m->prior->pull[k] * (m->point.theta[k] - m->prior->centre[k]);
}

/* Derivative of the barrier function of the bounds of theta[k] */
static double barrier_slope(const Method *m, int k)
{
    const double theta = m->point.theta[k];
    return m->barrier / (m->prior->upper[k] - theta) -
           lower_barrier(m, k, m->barrier) / (theta - m->prior->lower[k]);
}

/* The Newton step (11) for a right-hand side of G */
static void newton_step(const Method *m, const double *residual, Direction *out)
{
    double gradient[m->columns], change[m->columns], along[m->columns];
    double zero[m->thetas], curvature_theta[m->thetas];
    memset(zero, 0, sizeof(zero));
    solve_all(m, 0, residual, m->normal);
    for (int i = 0; i < m->size; i++) m->normal[i] = -m->normal[i];
    curve(m, m->normal, zero, curvature_theta);
    reduce_all(m, m->curvature, gradient);
    for (int i = 0; i < m->columns; i++) gradient[i] += m->reduced_gradient[i];
    for (int k = 0; k < m->thetas; k++)
        gradient[m->starts + k] += curvature_theta[k] + barrier_slope(m, k);
    to_tangent(m, gradient, along);
    for (int i = 0; i < m->tangents; i++) along[i] = -along[i];
    cholesky_solve(m->tangents, m->factor, along);
    from_tangent(m, along, change);
    memcpy(out->dz, m->normal, m->size * sizeof(double));
    expand_all(m, change, out->dz);
    memcpy(out->dtheta, change + m->starts, m->thetas * sizeof(double));
}

/* Whether a step is too small to change the point in floating point; false for NaN */
static int is_rounding(const Method *m, const Direction *d)
{
    const double least = 10 * EPSILON;
    for (int k = 0; k < m->thetas; k++)
        if (!(fabs(d->dtheta[k]) < least)) return 0;
    for (int i = 0; i < m->size; i++)
        if (!(fabs(d->dz[i]) < least * (1 + fabs(m->point.z[i])))) return 0;
    return 1;
}

/* Largest step in (0, 1] that leaves a share 1 - boundary of every gap (15); `above` may be 0 */
static double longest_step(const Method *m, const double *value, const double *below,
                           const double *above, const double *change, double boundary)
{
    double ratio = 0;
    for (int k = 0; k < m->thetas; k++) {
        ratio = fmax(ratio, -change[k] / (value[k] - (below ? below[k] : 0)));
        if (above) ratio = fmax(ratio, change[k] / (above[k] - value[k]));
    }
    return ratio <= boundary ? 1 : boundary / ratio;
}

static double barrier_objective(const Method *m, const Point *p)
{
    double sum = 0;
    for (int k = 0; k < m->thetas; k++) {
        if (isfinite(m->prior->lower[k]))
            sum += lower_barrier(m, k, m->barrier) * log(p->theta[k] - m->prior->lower[k]);
        if (is_bounded(m, k)) sum += m->barrier * log(m->prior->upper[k] - p->theta[k]);
    }
    return p->objective - sum;
}

/* What is minimised: squared error, pulls and the barriers that stay */
static double criterion(const Method *m, const Point *p)
{
    double sum = 0;
    for (int k = 0; k < m->thetas; k++)
        if (m->prior->barrier[k])
            sum += m->prior->barrier[k] * log(p->theta[k] - m->prior->lower[k]);
    return p->objective - sum;
}

static void try_step(Method *m, const Direction *d, double length)
{
    for (int i = 0; i < m->size; i++) m->trial.z[i] = m->point.z[i] + length * d->dz[i];
    for (int k = 0; k < m->thetas; k++)
        m->trial.theta[k] = m->point.theta[k] + length * d->dtheta[k];
    assess(m, &m->trial);
}

/* The switching condition (19), where the point is almost feasible */
static int switches(const Method *m, double slope, double length)
{
    return m->point.violation <= 1e-4 * m->first_violation && slope < 0 &&
           length * pow(-slope, 2.3) > pow(m->point.violation, 1.1);
}

/* The trial to the filter, and either of sufficient decrease (20) or of progress (18) */
static int acceptable(const Method *m, double slope, double length)
{
    const double now = barrier_objective(m, &m->point), then = barrier_objective(m, &m->trial);
    const double rounding = 10 * EPSILON * fabs(now), violation = m->trial.violation;
    if (!isfinite(then + violation) || violation > 1e4 * m->first_violation) return 0;
    for (int i = 0; i < m->filtered; i++)
        if (violation >= m->filter[i][0] && then >= m->filter[i][1]) return 0;
    if (switches(m, slope, length)) return then <= now + 1e-8 * length * slope + rounding;
    return violation <= (1 - 1e-5) * m->point.violation ||
           then <= now - 1e-8 * m->point.violation + rounding;
}

/* (23) */
static double shortest_step(const Method *m, double slope, double longest)
{
    const double violation = m->point.violation;
    double shortest = 1e-5;
    if (slope < 0) {
        shortest = fmin(shortest, 1e-8 * violation / -slope);
        if (violation <= 1e-4 * m->first_violation)
            shortest = fmin(shortest, pow(violation, 1.1) / pow(-slope, 2.3));
    }
    return fmax(0.05 * shortest, 1e-12 * longest);
}

/* Add the point to the filter (22) */
static void block(Method *m)
{
    double *pair = m->filter[m->filtered++];
    pair[0] = (1 - 1e-5) * m->point.violation;
    pair[1] = barrier_objective(m, &m->point) - 1e-8 * m->point.violation;
}

static double kept_near(double dual, double central)
{
    return fmax(central / 1e10, fmin(central * 1e10, dual));
}

/* Take the trial, with the bounds' duals kept near the central path (16) */
static void move(Method *m)
{
    const Point swap = m->point;
    m->point = m->trial;
    m->trial = swap;
    for (int k = 0; k < m->thetas; k++) {
        const double theta = m->point.theta[k];
        m->duals[k] = kept_near(m->duals[k],
                                lower_barrier(m, k, m->barrier) / (theta - m->prior->lower[k]));
        m->upper_duals[k] =
            kept_near(m->upper_duals[k], m->barrier / (m->prior->upper[k] - theta));
    }
}

/* Step of the dual of a bound at distance `gap`, which grows by `change` */
static double dual_step_of(double barrier, double dual, double gap, double change)
{
    return barrier / gap - dual - dual / gap * change;
}

/* Move to the trial, with the multipliers that belong to its direction (14) */
static void take(Method *m, const Direction *d, double length)
{
    double steps[m->thetas], upper_steps[m->thetas], curvature_theta[m->thetas];
    const double boundary = fmax(0.99, 1 - m->barrier);
    for (int k = 0; k < m->thetas; k++) {
        const double theta = m->point.theta[k];
        steps[k] = dual_step_of(lower_barrier(m, k, m->barrier), m->duals[k],
                                theta - m->prior->lower[k], d->dtheta[k]);
        upper_steps[k] = dual_step_of(m->barrier, m->upper_duals[k], m->prior->upper[k] - theta,
                                      -d->dtheta[k]);
        /* an unknown without bounds has no duals */
        if (!isfinite(m->prior->lower[k])) steps[k] = 0;
        if (!is_bounded(m, k)) upper_steps[k] = 0;
    }
    const double dual_length = longest_step(m, m->duals, 0, 0, steps, boundary);
    const double upper_length = longest_step(m, m->upper_duals, 0, 0, upper_steps, boundary);
    for (int k = 0; k < m->thetas; k++) {
        m->duals[k] += fmin(dual_length, upper_length) * steps[k];
        m->upper_duals[k] += fmin(dual_length, upper_length) * upper_steps[k];
    }
    curve(m, d->dz, d->dtheta, curvature_theta);
    for (int i = 0; i < m->size; i++)
        m->combined[i] = -(m->point.gradient[i] + m->curvature[i]);
    solve_all(m, 1, m->combined, m->next_multipliers);
    for (int i = 0; i < m->size; i++)
        m->multipliers[i] += length * (m->next_multipliers[i] - m->multipliers[i]);
    move(m);
}

static void accept(Method *m, const Direction *d, double slope, double length, double used)
{
    if (!(switches(m, slope, length) &&
          barrier_objective(m, &m->trial) <=
              barrier_objective(m, &m->point) + 1e-8 * length * slope))
        block(m);
    take(m, d, used);
}

/* Second-order corrections after the trial; the step used, or 0 */
static double correct(Method *m, double slope, double length, double boundary)
{
    double *residual = m->combined, violation = m->trial.violation, step = length;
    memcpy(residual, m->point.residual, m->size * sizeof(double));
    for (int tries = 0; tries < 4; tries++) {
        for (int i = 0; i < m->size; i++)
            residual[i] = step * residual[i] + m->trial.residual[i];
        if (!isfinite(m->trial.violation)) return 0;
        newton_step(m, residual, &m->correction);
        step = longest_step(m, m->point.theta, m->prior->lower, m->prior->upper, m->correction.dtheta,
                            boundary);
        try_step(m, &m->correction, step);
        if (acceptable(m, slope, length)) return step;
        if (!(m->trial.violation <= 0.99 * violation)) return 0;
        violation = m->trial.violation;
    }
    return 0;
}

/* Algorithm A, steps; moves the point where a step is accepted */
static int line_search(Method *m)
{
    const Direction *d = &m->direction;
    const double boundary = fmax(0.99, 1 - m->barrier);
    double slope = sum_of_products(m->size, m->point.gradient, d->dz);
    for (int k = 0; k < m->thetas; k++)
        slope += (pull_slope(m, k) + barrier_slope(m, k)) * d->dtheta[k];
    const double longest =
        longest_step(m, m->point.theta, m->prior->lower, m->prior->upper, d->dtheta, boundary);
    const double shortest = shortest_step(m, slope, longest);
    for (double length = longest; length >= shortest; length /= 2) {
        try_step(m, d, length);
        if (acceptable(m, slope, length)) {
            accept(m, d, slope, length, length);
            return 1;
        }
        if (length == longest && m->trial.violation >= m->point.violation) {
            const double used = correct(m, slope, length, boundary);
            if (used) {
                accept(m, &m->correction, slope, length, used);
                return 1;
            }
        }
    }
    return 0;
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

/* Newton on G = 0 at fixed x_1 and weights, in place of IPOPT's restoration phase */
static int restore(Method *m, double deadline)
{
    if (m->point.infeasibility <= FEASIBLE) return 0;
    block(m);
    memcpy(m->trial.z, m->point.z, m->size * sizeof(double));
    memcpy(m->trial.theta, m->point.theta, m->thetas * sizeof(double));
    EACH_MOTION(m, of)
    {
        double theta[of.at->thetas], residual;
        int iterations;
        own_theta(&of, m->trial.theta, theta);
        of.at->newton(of.work, 1, m->trial.z + of.z, theta, FEASIBLE / 100, 30,
                      deadline - seconds(), 0, &residual, &iterations);
    }
    assess(m, &m->trial);
    if (!(m->trial.violation <= 0.9 * m->point.violation)) return 0;
    memset(m->multipliers, 0, m->size * sizeof(double));
    move(m);
    return 1;
}

/* Whether the point is so close to a known optimum that the run would end there */
static int is_known(const Method *m)
{
    const Options *o = m->options;
    if (m->point.violation > 1e-4 * m->first_violation) return 0;
    const double now = criterion(m, &m->point);
    for (int i = 0; i < o->known; i++) {
        const double *theta = m->known_theta + i * m->thetas, objective = m->known_objectives[i];
        double change = 0;
        for (int k = 0; k < m->thetas; k++) change = fmax(change, fabs(m->point.theta[k] - theta[k]));
        if (change <= KNOWN_WEIGHTS &&
            fabs(now - objective) <= KNOWN_CHANGE * fabs(objective))
            return 1;
    }
    return 0;
}

static int iterate(Method *m, double deadline, int *iterations)
{
    const double tolerance = m->options->tolerance;
    assess(m, &m->point);
    if (!isfinite(m->point.violation + m->point.objective)) return NOT_FINITE;
    m->first_violation = fmax(1, m->point.violation);
    for (*iterations = 0; *iterations < m->options->max_iterations; ++*iterations) {
        if (is_known(m)) return KNOWN;
        if (!linearise_all(m)) return SINGULAR;
        reduce_all(m, m->point.gradient, m->reduced_gradient);
        for (int k = 0; k < m->thetas; k++)
            m->reduced_gradient[m->starts + k] += pull_slope(m, k);
        const double error = stationarity(m), final = fmax(error, complementarity(m, 0));
        if (final <= tolerance) return CONVERGED;
        while (m->barrier > tolerance / 10 &&
               fmax(error, complementarity(m, m->barrier)) <= 10 * m->barrier)
            reduce_barrier(m);
        if (seconds() > deadline) return NO_TIME;
        if (!factorise(m)) return NO_CURVATURE;
        newton_step(m, m->point.residual, &m->direction);
        if (is_rounding(m, &m->direction)) {
            try_step(m, &m->direction, 1);
            take(m, &m->direction, 1);
            reduce_barrier(m);
        } else if (!line_search(m) && !restore(m, deadline))
            return final <= ACCEPTABLE ? CONVERGED : NO_STEP;
    }
    return NO_ITERATIONS;
}

/* Doubles of work space that interior_point needs, for so many numbers in z, theta and w */
API size_t interior_point_space(int size, int thetas, int columns, int max_iterations)
{
    return SPACE_ARRAYS * (size_t)size + THETA_ARRAYS * (size_t)thetas + columns +
           SQUARES * (size_t)columns * columns + FILTER_ENTRIES * ((size_t)max_iterations + 1);
}

static double *taken(double **space, size_t count)
{
    double *first = *space;
    *space += count;
    return first;
}

static void lay_out(Method *m, double *space)
{
    double **arrays[SPACE_ARRAYS] = {
        &m->point.z,      &m->point.residual, &m->point.gradient, &m->trial.z,  &m->trial.residual,
        &m->trial.gradient, &m->direction.dz, &m->correction.dz,  &m->multipliers, &m->normal,
        &m->curvature,    &m->combined,       &m->next_multipliers};
    double **thetas[THETA_ARRAYS] = {&m->point.theta,       &m->trial.theta, &m->direction.dtheta,
                                     &m->correction.dtheta, &m->duals,       &m->upper_duals};
    double **squares[SQUARES] = {&m->hessian, &m->metric, &m->tangent_hessian, &m->tangent_metric,
                                 &m->factor,  &m->half,   &m->own};
    for (int i = 0; i < SPACE_ARRAYS; i++) *arrays[i] = taken(&space, m->size);
    for (int i = 0; i < THETA_ARRAYS; i++) *thetas[i] = taken(&space, m->thetas);
    for (int i = 0; i < SQUARES; i++) *squares[i] = taken(&space, (size_t)m->columns * m->columns);
    m->reduced_gradient = taken(&space, m->columns);
    m->filter = (double(*)[2])space;
}

/* Improves z (of all motions in turn) and theta in place; returns why it stopped, one of the codes
 * above. objective (2,): what is minimised, and the squared error alone. */
API int interior_point(const Motion *motions, const Options *options, const Prior *prior,
                       const double *basis, const double *known_objectives,
                       const double *known_theta, double *space, double *z, double *theta,
                       double *objective, int *iterations)
{
    Method m = {.motions = motions, .options = options, .prior = prior, .basis = basis,
                .known_objectives = known_objectives, .known_theta = known_theta,
                .barrier = options->first_barrier};
    EACH_MOTION(&m, of) m.size += of.size, m.starts += of.at->states;
    m.thetas = options->drivers * options->weights + options->unknowns;
    m.columns = m.starts + m.thetas;
    m.tangents = m.columns - options->drivers;
    lay_out(&m, space);
    memset(m.multipliers, 0, m.size * sizeof(double));
    for (int k = 0; k < m.thetas; k++) {
        m.duals[k] = isfinite(prior->lower[k]);
        m.upper_duals[k] = isfinite(prior->upper[k]);
    }
    memcpy(m.point.z, z, m.size * sizeof(double));
    memcpy(m.point.theta, theta, m.thetas * sizeof(double));
    *iterations = 0;
    const int status = iterate(&m, seconds() + options->limit, iterations);
    memcpy(z, m.point.z, m.size * sizeof(double));
    memcpy(theta, m.point.theta, m.thetas * sizeof(double));
    objective[0] = criterion(&m, &m.point);
    objective[1] = m.point.loss;
    return status;
}
