/* Constraints, as equations or condensed, compiled behind stages.c for one game at a time */

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
