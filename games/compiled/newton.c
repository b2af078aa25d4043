/* Damped Newton on G(z; theta) = 0 for a batch of games, SLOTS at a time; behind elimination.c.
 *
 * A slot whose game ends takes the next one. A slot that needs a factorisation waits until all do; a
 * step that it does not need is computed again, with the same result. So what becomes of a game does
 * not depend on other games. */

#define SMALLEST_STEP 0.000244140625 /* that the line search tries before it gives up */
/* A factorisation serves as long as a whole step leaves at most this share of the residual: one
 * costs as much as two or three of the steps that it saves. */
#define ENOUGH 0.1

typedef struct {
    int game;                  /* the slot's place in the batch; -1 where it has none */
    int starts, refresh, ends; /* whether it has yet to be evaluated, needs a factorisation, ends */
    int turns;                 /* whether its last step is not from here */
    int stale, iterations;     /* whether its factorisation has served before; how many there were */
    double length;             /* of the step that comes next */
    double largest, squares;   /* max |G| and |G|^2 */
} Slot;

/* All slots: arrays (T, SZ), and (NT,) */
typedef struct {
    Slot slots[SLOTS];
    real *z, *residual, *step, *trial, *next, theta[NT];
} Search;

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

static void norms(const real *v, int n, real *largest, real *squares)
{
    *largest = *squares = same(0);
    for (int i = 0; i < n; i++) {
        *squares += v[i] * v[i];
        *largest = larger(*largest, absolute(v[i]));
    }
    *largest = where(finite_at(*squares), *largest, *squares); /* `larger` drops NaN */
}

/* Whether a slot waits for a factorisation */
static int waits(const Slot *slot) { return slot->game >= 0 && slot->refresh && !slot->starts; }

/* Factorise all slots where they are, once none has a step to do: one factorisation of all costs as
 * much as that of one. Slots end where it is singular. */
static void refresh(Work *w, Search *s)
{
    for (int l = 0; l < SLOTS; l++)
        if (s->slots[l].game >= 0 && !waits(s->slots + l)) return;
    const mask regular = factorise_stages(w, s->z, s->theta, 0, 0, 0);
    for (int l = 0; l < SLOTS; l++) {
        s->slots[l].refresh = s->slots[l].stale = 0;
        s->slots[l].turns = 1;
        s->slots[l].iterations += SLOT(regular, l) != 0;
        s->slots[l].ends = !SLOT(regular, l);
    }
}

/* Whether a slot moves to its trial point, with these norms, and what it does next */
static int judged(Slot *slot, double largest, double squares)
{
    /* NaN compares false, so an undefined trial point is refused as well. */
    if (!slot->starts && !(sqrt(squares) < (1 - 1e-4 * slot->length) * sqrt(slot->squares))) {
        slot->refresh = slot->stale;
        if (!slot->stale) slot->length /= 2;
        slot->ends |= slot->length < SMALLEST_STEP;
        return 0;
    }
    if (!slot->starts) {
        slot->refresh = !(squares < ENOUGH * ENOUGH * slot->squares);
        slot->stale = 1;
    }
    slot->starts = 0;
    slot->turns = 1;
    slot->length = 1;
    slot->largest = largest;
    slot->squares = squares;
    return 1;
}

/* Move each slot on by one trial */
static void try_steps(Work *w, Search *s)
{
    const int n = w->horizon * SZ;
    real length = {0}, largest, squares;
    mask starts = NOWHERE, moves = NOWHERE;
    int turn = 0;
    for (int l = 0; l < SLOTS; l++) {
        turn |= s->slots[l].game >= 0 && s->slots[l].turns && !waits(s->slots + l);
        SLOT(starts, l) = -s->slots[l].starts;
        SLOT(length, l) = s->slots[l].length;
    }
    if (turn) solve(w, 0, s->residual, s->step);
    for (int i = 0; i < n; i++)
        s->trial[i] = where(starts, s->z[i], s->z[i] - length * s->step[i]);
    evaluate(w, s->trial, s->theta, s->next);
    norms(s->next, n, &largest, &squares);
    for (int l = 0; l < SLOTS; l++)
        if (s->slots[l].game >= 0 && !s->slots[l].ends && !waits(s->slots + l)) {
            s->slots[l].turns = 0;
            SLOT(moves, l) = -judged(s->slots + l, SLOT(largest, l), SLOT(squares, l));
        }
    for (int i = 0; i < n; i++) {
        s->z[i] = where(moves, s->trial[i], s->z[i]);
        s->residual[i] = where(moves, s->next[i], s->residual[i]);
    }
}

/* Newton for `count` games: z (count, T, SZ) in and out, whose x_1 stay fixed, theta (count, NT);
 * max |G| and the number of factorisations (count,). `factorised`: a single game, near which the
 * present factorisation was made. After `limit` seconds games stay where they are. */
API void newton(Work *w, int count, double *z, const double *theta, double tolerance,
                int max_iterations, double limit, int factorised, double *residuals,
                int *iterations)
{
    const double deadline = seconds() + limit;
    const int n = w->horizon * SZ;
    Search s = {.z = w->scratch};
    s.residual = s.z + n, s.step = s.residual + n, s.trial = s.step + n, s.next = s.trial + n;
    for (int l = 0; l < SLOTS; l++) s.slots[l].game = -1;
    for (int next = 0, left = count; left;) {
        for (int l = 0; l < SLOTS; l++) {
            if (s.slots[l].game >= 0 || next == count) continue;
            s.slots[l] = (Slot){next, .starts = 1, .refresh = !factorised, .stale = factorised};
            for (int i = 0; i < n; i++) SLOT(s.z[i], l) = z[(size_t)next * n + i];
            for (int i = 0; i < NT; i++) SLOT(s.theta[i], l) = theta[(size_t)next * NT + i];
            next++;
        }
        refresh(w, &s);
        try_steps(w, &s);
        const int late = seconds() > deadline;
        for (int l = 0; l < SLOTS; l++) {
            Slot *slot = s.slots + l;
            const int open = !(slot->largest < tolerance) && isfinite(slot->largest) && !late;
            const int spent = slot->refresh && slot->iterations == max_iterations;
            if (slot->game < 0 || (open && !spent && !slot->ends)) continue;
            for (int i = 0; i < n; i++) z[(size_t)slot->game * n + i] = SLOT(s.z[i], l);
            residuals[slot->game] = slot->largest;
            iterations[slot->game] = slot->iterations;
            slot->game = -1;
            left--;
        }
    }
}
