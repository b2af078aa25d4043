/* The backward recursion of feedback equilibria; equations as in feedback.py.

Of each step there is a row with every player's cost, the blocks [A B] of players' own motions, H, g
and second derivatives f'' of the motion. A player's next state depends on its own state and control
alone, so [A B] of player j has its rows j and the columns of its own state and control. */

#include <math.h>
#include <string.h>

typedef struct {
    int steps, count, states, controls; /* T-1, N, n and m of one player */
    const double *motion, *squares, *slopes, *bends;
    int stride; /* from one step to the next in all four */
    const double *kept; /* (T-1, Nm, Nn) gains of controls that are not free */
    const int *free;    /* (Nm) */
} Game;

typedef struct {
    double *Z, *zeta;                      /* (N, Nn, Nn), (N, Nn): the end's, then each step's */
    double *gains, *offsets, *curvatures;  /* (T-1, Nm, Nn), (T-1, Nm), (T-1, N, m, m) */
    double *space;
} Answer;

/* The place among (x, u) of component a of the state and control of player j. */
static int place(const Game *game, int j, int a)
{
    int n = game->states, m = game->controls;
    return a < n ? j * n + a : game->count * n + j * m + a - n;
}

/* W and w of one player, (F3), from H and g. */
static void pull_back(const Game *game, int t, int i, const Answer *out, double *W, double *w)
{
    int n = game->states, own = n + game->controls, S = game->count * n;
    int both = S + game->count * game->controls;
    long row = (long)t * game->stride;
    const double *Z = out->Z + (long)i * S * S, *zeta = out->zeta + (long)i * S;
    const double *bends = game->bends + row;
    memcpy(W, game->squares + row + (long)i * both * both, sizeof(double) * both * both);
    memcpy(w, game->slopes + row + (long)i * both, sizeof(double) * both);
    for (int j = 0; j < game->count; ++j) {
        const double *M = game->motion + row + (long)j * n * both;
        for (int a = 0; a < own; ++a) {
            int p = place(game, j, a);
            for (int k = 0; k < n; ++k)
                w[p] += zeta[j * n + k] * M[k * both + p];
            for (int b = 0; b < own; ++b) {
                double sum = 0;
                for (int k = 0; k < n; ++k)
                    sum += zeta[j * n + k] * bends[((j * n + k) * own + a) * own + b];
                W[p * both + place(game, j, b)] += sum;
            }
        }
        for (int l = 0; l < game->count; ++l) {
            const double *L = game->motion + row + (long)l * n * both;
            for (int k = 0; k < n; ++k)
                for (int b = 0; b < own; ++b) {
                    int q = place(game, l, b);
                    double sum = 0; /* (Z [A B]) of row k of player j, column q */
                    for (int h = 0; h < n; ++h)
                        sum += Z[(j * n + k) * S + l * n + h] * L[h * both + q];
                    for (int a = 0; a < own; ++a) {
                        int p = place(game, j, a);
                        W[p * both + q] += M[k * both + p] * sum;
                    }
                }
        }
    }
}

/* Solve A x = right (size, columns) in place by elimination with row exchanges; 0 if singular. */
static int solve(int size, int columns, double *A, double *right)
{
    for (int k = 0; k < size; ++k) {
        int best = k;
        for (int r = k + 1; r < size; ++r)
            if (fabs(A[r * size + k]) > fabs(A[best * size + k]))
                best = r;
        if (!(fabs(A[best * size + k]) > 0))
            return 0;
        for (int c = 0; best != k && c < size + columns; ++c) {
            double *one = c < size ? A + k * size + c : right + k * columns + c - size;
            double *two = c < size ? A + best * size + c : right + best * columns + c - size;
            double kept = *one;
            *one = *two;
            *two = kept;
        }
        for (int r = k + 1; r < size; ++r) {
            double factor = A[r * size + k] / A[k * size + k];
            for (int c = k + 1; c < size; ++c)
                A[r * size + c] -= factor * A[k * size + c];
            for (int c = 0; c < columns; ++c)
                right[r * columns + c] -= factor * right[k * columns + c];
        }
    }
    for (int k = size - 1; k >= 0; --k)
        for (int c = 0; c < columns; ++c) {
            double sum = right[k * columns + c];
            for (int r = k + 1; r < size; ++r)
                sum -= A[k * size + r] * right[r * columns + c];
            right[k * columns + c] = sum / A[k * size + k];
        }
    return 1;
}

/* (F4): strategies of the free controls of a step, from all W and w; 0 where there are none. */
static int strategies(const Game *game, int t, const double *W, const double *w, Answer *out,
                      double *A, double *right)
{
    int m = game->controls, S = game->count * game->states, C = game->count * m, both = S + C;
    double *P = out->gains + (long)t * C * S, *a = out->offsets + (long)t * C;
    const double *kept = game->kept + (long)t * C * S;
    int size = 0, r = 0;
    for (int c = 0; c < C; ++c)
        size += game->free[c];
    for (int c = 0; c < C; ++c) {
        if (!game->free[c])
            continue;
        const double *mine = W + ((long)(c / m) * both + S + c) * both;
        double *row = right + r * (S + 1);
        memcpy(row, mine, sizeof(double) * S);
        row[S] = w[(long)(c / m) * both + S + c];
        for (int d = 0, f = 0; d < C; ++d) {
            if (game->free[d])
                A[r * size + f++] = mine[S + d];
            else
                for (int x = 0; x < S; ++x)
                    row[x] -= mine[S + d] * kept[d * S + x];
        }
        ++r;
    }
    if (!solve(size, S + 1, A, right))
        return 0;
    for (int c = 0, f = 0; c < C; ++c) {
        const double *found = right + f * (S + 1);
        memcpy(P + c * S, game->free[c] ? found : kept + c * S, sizeof(double) * S);
        a[c] = game->free[c] ? found[S] : 0;
        f += game->free[c];
    }
    return 1;
}

/* (F5): Z and zeta of one player a step earlier. */
static void earlier(const Game *game, int t, int i, const double *W, const double *w, Answer *out,
                    double *Y)
{
    int S = game->count * game->states, C = game->count * game->controls, both = S + C;
    const double *P = out->gains + (long)t * C * S, *a = out->offsets + (long)t * C;
    double *Z = out->Z + (long)i * S * S, *zeta = out->zeta + (long)i * S, *v = Y + both * S;
    for (int p = 0; p < both; ++p) {
        memcpy(Y + p * S, W + (long)p * both, sizeof(double) * S);
        v[p] = w[p];
        for (int c = 0; c < C; ++c) {
            double factor = W[(long)p * both + S + c];
            v[p] -= factor * a[c];
            for (int x = 0; x < S; ++x)
                Y[p * S + x] -= factor * P[c * S + x];
        }
    }
    memcpy(Z, Y, sizeof(double) * S * S);
    memcpy(zeta, v, sizeof(double) * S);
    for (int c = 0; c < C; ++c)
        for (int x = 0; x < S; ++x) {
            zeta[x] -= P[c * S + x] * v[S + c];
            for (int z = 0; z < S; ++z)
                Z[x * S + z] -= P[c * S + x] * Y[(S + c) * S + z];
        }
}

/* Doubles that ``answer`` needs as space. */
__attribute__((visibility("default"))) long space_of(const Game *game)
{
    long S = game->count * game->states, C = game->count * game->controls, both = S + C;
    return game->count * both * (both + 1) + C * (C + S + 1) + both * (S + 1);
}

/* (F2) to (F5) from the last step to the first; 0 where a step has no solution. */
__attribute__((visibility("default"))) int answer(const Game *game, Answer *out)
{
    int m = game->controls, S = game->count * game->states, C = game->count * m, both = S + C;
    double *W = out->space, *w = W + (long)game->count * both * both;
    double *A = w + game->count * both, *right = A + C * C, *Y = right + C * (S + 1);
    for (int t = game->steps - 1; t >= 0; --t) {
        for (int i = 0; i < game->count; ++i) {
            double *own = W + (long)i * both * both;
            pull_back(game, t, i, out, own, w + i * both);
            double *inner = out->curvatures + ((long)t * game->count + i) * m * m;
            for (int k = 0; k < m * m; ++k)
                inner[k] = own[(S + i * m + k / m) * both + S + i * m + k % m];
        }
        if (!strategies(game, t, W, w, out, A, right))
            return 0;
        for (int i = 0; i < game->count; ++i)
            earlier(game, t, i, W + (long)i * both * both, w + i * both, out, Y);
    }
    return 1;
}

__attribute__((visibility("default"))) int size_of(int which)
{
    return which ? sizeof(Answer) : sizeof(Game);
}
