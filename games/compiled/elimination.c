/* Residuals, the factorisation (E2) to (E4), and solutions (E5), (E6), compiled behind stages.c */

/* residual (T, SZ) of (E1); its unused entries are zero */
ALONE void evaluate(const Work *w, const real *z, const real *theta, real *residual)
{
    const int last = w->horizon - 1;
    for (int t = 0; t < last; t++) {
        const real *x = z + t * SZ;
        real *row = residual + t * SZ;
        sum_of_terms(w, VALUE, SZ, x, theta, x, row);
        add_equations(w, VALUE_OF, t, x, theta, x, row);
        for (int k = 0; k < NX; k++) row[OFF_L + k] = x[SZ + k] - row[OFF_L + k];
        if (t == 0)
            memset(row, 0, NX * sizeof(real)); /* x_1 is given, not chosen */
        else
            for (int k = 0; k < NX; k++) row[k] += x[OFF_L - SZ + k];
    }
    const real *x = z + last * SZ;
    real *row = residual + last * SZ;
    sum_of_terms(w, FINAL_VALUE, SZ, x, theta, x, row);
    for (int k = 0; k < NX; k++) row[k] += x[OFF_L - SZ + k];
}

/* Stage blocks at (z, theta) and the factorisation (E2)-(E4); with v and sigma (T, MARGINS), the
 * condensed constraints and shift I are added. Says where all stage matrices M_t are regular and,
 * with constraints, positive definite. */
static mask factorise_stages(Work *w, const real *z, const real *theta, const real *v,
                             const real *sigma, double shift)
{
    const int last = w->horizon - 1;
    mask regular = EVERYWHERE;
    w->shift = shift;
    {
        const real *x = z + last * SZ;
        real *stage = w->blocks + last * BLOCKS;
        sum_of_terms(w, FINAL_JACOBIAN, FINAL_BLOCKS, x, theta, x, stage);
        if (v) add_condensed(w, last, z, v, sigma, stage);
        real *V = w->V + last * NX * NX;
        memset(V, 0, NX * NX * sizeof(real));
        sparse_scatter(&FINAL_Q, stage, 1, V, NX);
        for (int i = 0; i < NX; i++) V[i * NX + i] += shift;
    }
    for (int t = last - 1; t >= 0; t--) {
        const real *x = z + t * SZ;
        real *stage = w->blocks + t * BLOCKS;
        sum_of_terms(w, JACOBIAN, BLOCKS, x, theta, x, stage);
        add_equations(w, JACOBIAN_OF, t, x, theta, x, stage);
        if (v) add_condensed(w, t, z, v, sigma, stage);

        const real *V = w->V + (t + 1) * NX * NX;
        real *M = w->M + t * NU * NU, *K = w->K + t * NU * NX;
        real *S = w->S + t * NU * NX, *L = w->L + t * NX * NU;
        /* [A B]' V, transposed, and again from the left: all inner loops run along rows. */
        real *half = w->squares, *turned = half + WIDTH * WIDTH, *full = turned + WIDTH * WIDTH;
        memset(half, 0, OFF_L * NX * sizeof(real));
        memset(full, 0, OFF_L * OFF_L * sizeof(real));
        sparse_rows(&PATTERN_A, stage, 1, 1, V, half, NX, NX);
        sparse_rows(&PATTERN_B, stage, 1, 1, V, half + NX * NX, NX, NX);
        transpose(OFF_L, NX, half, NX, turned, OFF_L);
        sparse_rows(&PATTERN_A, stage, 1, 1, turned, full, OFF_L, OFF_L);
        sparse_rows(&PATTERN_B, stage, 1, 1, turned, full + NX * OFF_L, OFF_L, OFF_L);
        transpose(NU, NU, full + NX * OFF_L + NX, OFF_L, M, NU);
        transpose(NX, NU, full + NX, OFF_L, S, NX);
        transpose(NU, NX, full + NX * OFF_L, OFF_L, L, NU);
        sparse_scatter(&PATTERN_R, stage, 1, M, NU);
        sparse_scatter(&PATTERN_S, stage, 1, S, NX);
        sparse_scatter(&PATTERN_P, stage, 1, L, NU);
        for (int i = 0; i < NU; i++) M[i * NU + i] += shift;
        if (v && !definite(M)) return NOWHERE;
        regular &= invert(M);
        if (!any(regular)) return regular;
        memset(K, 0, NU * NX * sizeof(real));
        multiply_add(NU, NU, NX, 1, M, NU, S, NX, K, NX);
        if (t > 0) {
            real *Vt = w->V + t * NX * NX;
            transpose(NX, NX, full, OFF_L, Vt, NX);
            sparse_scatter(&PATTERN_Q, stage, 1, Vt, NX);
            multiply_add(NX, NU, NX, -1, L, NU, K, NX, Vt, NX);
            for (int i = 0; i < NX; i++) Vt[i * NX + i] += shift;
        }
    }
    return regular;
}

ALONE mask linearise(Work *w, const real *z, const real *theta)
{
    return factorise_stages(w, z, theta, 0, 0, 0);
}

ALONE mask linearise_condensed(Work *w, const real *z, const real *theta, const real *v,
                            const real *sigma, double shift)
{
    return factorise_stages(w, z, theta, v, sigma, shift);
}

/* (E5), (E6): G_z out = right for right, out (T, SZ), with out's x_1 = 0; or G_z' out = right */
ALONE void solve(const Work *w, int transposed, const real *right, real *out)
{
    const int last = w->horizon - 1;
    real v[NX], e[NX];
    memcpy(v, right + last * SZ, NX * sizeof(real));
    for (int t = last - 1; t >= 0; t--) {
        const real *stage = w->blocks + t * BLOCKS, *a = right + t * SZ;
        const real *b = a + OFF_U, *d = a + OFF_L, *V = w->V + (t + 1) * NX * NX;
        real *k = out + t * SZ + OFF_U;
        memcpy(e, v, sizeof(e));
        (transposed ? apply_transposed : apply)(NX, NX, -1, V, d, e);
        for (int i = 0; i < NU; i++) k[i] = b[i];
        sparse_vector(&PATTERN_B, stage, 1, 1, e, k);
        if (t == 0) break;
        const real *M = w->M + t * NU * NU;
        real gain[NU] = {0};
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
    memset(out, 0, NX * sizeof(real));
    for (int t = 0; t < last; t++) {
        const real *stage = w->blocks + t * BLOCKS, *d = right + t * SZ + OFF_L;
        real *x = out + t * SZ, *u = x + OFF_U, *next = x + SZ;
        const real *M = w->M + t * NU * NU;
        real right_u[NU];
        memcpy(right_u, u, sizeof(right_u));
        memset(u, 0, sizeof(right_u));
        if (transposed) {
            apply_transposed(NX, NU, -1, w->L + t * NX * NU, x, right_u);
            apply_transposed(NU, NU, 1, M, right_u, u);
        } else {
            apply(NU, NX, -1, w->S + t * NU * NX, x, right_u);
            apply(NU, NU, 1, M, right_u, u);
        }
        memcpy(next, d, NX * sizeof(real));
        sparse_vector(&PATTERN_A, stage, 1, 0, x, next);
        sparse_vector(&PATTERN_B, stage, 1, 0, u, next);
    }
    memset(out + last * SZ + NX, 0, (SZ - NX) * sizeof(real));
    {
        real *costate = out + (last - 1) * SZ + OFF_L;
        memcpy(costate, right + last * SZ, NX * sizeof(real));
        sparse_vector(&FINAL_Q, w->blocks + last * BLOCKS, -1, transposed, out + last * SZ, costate);
        for (int i = 0; i < NX; i++) costate[i] -= w->shift * out[last * SZ + i];
    }
    for (int t = last - 1; t > 0; t--) {
        const real *stage = w->blocks + t * BLOCKS, *x = out + t * SZ;
        real *costate = out + (t - 1) * SZ + OFF_L;
        memcpy(costate, right + t * SZ, NX * sizeof(real));
        sparse_vector(&PATTERN_Q, stage, -1, transposed, x, costate);
        for (int i = 0; i < NX; i++) costate[i] -= w->shift * x[i];
        sparse_vector(transposed ? &PATTERN_S : &PATTERN_P, stage, -1, transposed, x + OFF_U, costate);
        sparse_vector(&PATTERN_A, stage, 1, 1, x + OFF_L, costate);
    }
}

