/* Sensitivities, compiled behind elimination.c */

/* G and v of all stages, after linearise */
ALONE void feedback(Work *w)
{
    const int last = w->horizon - 1;
    real *right = w->squares;
    memset(w->v + last * NX * NT, 0, NX * NT * sizeof(real));
    sparse_scatter(&FINAL_X, w->blocks + last * BLOCKS, -1, w->v + last * NX * NT, NT);
    for (int t = last - 1; t >= 0; t--) {
        const real *stage = w->blocks + t * BLOCKS, *next = w->v + (t + 1) * NX * NT;
        real *G = w->G + t * NU * PC, *v = w->v + t * NX * NT;
        memset(right, 0, NU * NT * sizeof(real));
        sparse_scatter(&PATTERN_U, stage, -1, right, NT);
        sparse_rows(&PATTERN_B, stage, 1, 1, next, right, NT, NT);
        memset(G, 0, NU * PC * sizeof(real));
        multiply_add(NU, NU, NT, 1, w->M + t * NU * NU, NU, right, NT, G + NX, PC);
        for (int i = 0; i < NU; i++)
            for (int j = 0; j < NX; j++) G[i * PC + j] = -w->K[(t * NU + i) * NX + j];
        if (t == 0) break;
        memset(v, 0, NX * NT * sizeof(real));
        sparse_scatter(&PATTERN_X, stage, -1, v, NT);
        sparse_rows(&PATTERN_A, stage, 1, 1, next, v, NT, NT);
        multiply_add(NX, NU, NT, -1, w->L + t * NX * NU, NU, G + NX, PC, v, NT);
    }
}

/* d u_t (NU, PC) and d x_{t+1} (NX, PC) of d x_t, all by (x_1, theta) */
static void step_sensitivities(const Work *w, int t, const real *now, real *controls, real *next)
{
    const real *stage = w->blocks + t * BLOCKS, *G = w->G + t * NU * PC;
    memset(controls, 0, NU * PC * sizeof(real));
    multiply_add(NU, NX, PC, 1, G, PC, now, PC, controls, PC);
    for (int i = 0; i < NU; i++)
        for (int j = NX; j < PC; j++) controls[i * PC + j] += G[i * PC + j];
    memset(next, 0, NX * PC * sizeof(real));
    sparse_rows(&PATTERN_A, stage, 1, 0, now, next, PC, PC);
    sparse_rows(&PATTERN_B, stage, 1, 0, controls, next, PC, PC);
}

/* (E7): Z = d z / d (x_1, theta) on the linearised conditions, into w->Z */
ALONE void sensitivities(Work *w)
{
    const int last = w->horizon - 1;
    feedback(w);
    memset(w->Z, 0, (size_t)w->horizon * SZ * PC * sizeof(real));
    for (int i = 0; i < NX; i++) w->Z[i * PC + i] = same(1);
    for (int t = 0; t < last; t++) {
        const real *V = w->V + (t + 1) * NX * NX, *v = w->v + (t + 1) * NX * NT;
        real *Zx = w->Z + t * SZ * PC, *costates = Zx + OFF_L * PC;
        step_sensitivities(w, t, Zx, Zx + OFF_U * PC, Zx + SZ * PC);
        multiply_add(NX, NX, PC, -1, V, NX, Zx + SZ * PC, PC, costates, PC);
        for (int i = 0; i < NX; i++)
            for (int j = 0; j < NT; j++) costates[i * PC + NX + j] += v[i * NT + j];
    }
}

/* Rows of step t of `observe_sensitivities` from d x_t / d (x_1, theta), now (NX, PC) */
static void observe_step(int t, int first, int count, int horizon, int samples, const double *seen,
                         const real *now, double *out)
{
    for (int k = 0; k < PLAYERS * samples; k++) {
        const real *states = now + k / samples * STATES * PC;
        real factors[STATES];
        size_t places[SLOTS];
        for (int l = 0; l < SLOTS; l++) {
            const int game = first + l < count ? first + l : first;
            places[l] = ((size_t)game * horizon + t) * PLAYERS * samples + k;
            for (int c = 0; c < STATES; c++) SLOT(factors[c], l) = seen[places[l] * STATES + c];
        }
        for (int j = 0; j < PC; j++) {
            real sum = {0};
            for (int c = 0; c < STATES; c++) sum += factors[c] * states[c * PC + j];
            for (int l = 0; l < SLOTS && first + l < count; l++)
                out[places[l] * PC + j] = SLOT(sum, l);
        }
    }
}

/* d h / d (x_1, theta) of `count` games, SLOTS at a time, where h (T, N, d) is seen of the states:
 * out (count, T, N, d, PC) at roots z (count, T, SZ), theta (count, NT), with `seen` (count, T, N, d,
 * STATES) = d h / d x. `regular` (count,) says of which games the root is regular. */
API void observe_sensitivities(Work *w, int count, int samples, const double *z,
                               const double *theta, const double *seen, double *out, int *regular)
{
    const int n = w->horizon * SZ;
    real *point = w->scratch, *controls = w->parts, *now = w->Z, *next = now + NX * PC, own[NT];
    for (int first = 0; first < count; first += SLOTS) {
        for (int l = 0; l < SLOTS; l++) {
            const size_t game = first + l < count ? first + l : first;
            for (int i = 0; i < n; i++) SLOT(point[i], l) = z[game * n + i];
            for (int i = 0; i < NT; i++) SLOT(own[i], l) = theta[game * NT + i];
        }
        const mask done = factorise_stages(w, point, own, 0, 0, 0);
        for (int l = 0; l < SLOTS && first + l < count; l++)
            regular[first + l] = SLOT(done, l) != 0;
        if (!any(done)) continue;
        feedback(w);
        memset(now, 0, NX * PC * sizeof(real));
        for (int i = 0; i < NX; i++) now[i * PC + i] = same(1);
        for (int t = 0; t < w->horizon; t++) {
            observe_step(t, first, count, w->horizon, samples, seen, now, out);
            if (t == w->horizon - 1) break;
            step_sensitivities(w, t, now, controls, next);
            real *swap = now;
            now = next, next = swap;
        }
    }
}
