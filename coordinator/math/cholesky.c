#include "coordinator/math/cholesky.h"

#include <stdbool.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/clones.h"
#include "worker/base/memory.h"

enum { NONE = UINT32_MAX, MOST_ITERATIONS = 1000 };

/* Limit at which conjugate gradients end: the squared residual relative to that of the right side. */
#define SMALL 1e-16

/* Functions with LANE_CODE are inlined, so that `lanes` is a constant in them. */
#define LANE_CODE static inline __attribute__((always_inline))

size_t kiln_cholesky_lanes(size_t matrices)
{
    return matrices <= 2 ? matrices : matrices <= 4 ? 4 : matrices <= 6 ? 6 : KILN_CHOLESKY_LANES;
}

int kiln_cholesky_create(struct kiln_cholesky *c, const struct kiln_elimination *elimination, size_t lanes,
                         struct kiln_error *error)
{
    const char *what = "a Cholesky factor";
    const size_t count = elimination->count, core = count - elimination->eliminated,
                 entries = kiln_elimination_entries(elimination);
    *c = (struct kiln_cholesky){.elimination = elimination, .lanes = lanes};
    int status;
    KILN_TRY(kiln_arena_allocate_bare(&c->arena, &c->matrix, entries, sizeof *c->matrix, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&c->arena, &c->entries, entries, lanes * sizeof *c->entries, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&c->arena, &c->diagonal, count, lanes * sizeof *c->diagonal, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&c->arena, &c->column, count, lanes * sizeof *c->column, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&c->arena, &c->waiting, count, sizeof *c->waiting, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&c->arena, &c->behind, count, sizeof *c->behind, what, error));
    KILN_TRY(kiln_allocate_bare(&c->next, count, sizeof *c->next, what, error));
    KILN_TRY(kiln_arena_allocate(&c->arena, &c->core, core, lanes * sizeof *c->core, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&c->arena, &c->residual, core, lanes * sizeof *c->residual, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&c->arena, &c->direction, core, lanes * sizeof *c->direction, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&c->arena, &c->product, core, lanes * sizeof *c->product, what, error));
end:
    return status;
}

void kiln_cholesky_destroy(struct kiln_cholesky *c)
{
    kiln_free(&c->next);
    kiln_arena_release(&c->arena);
}

/* The row of entry k, which is in this column. */
static inline size_t row_of(const struct kiln_elimination *e, size_t column, size_t k)
{
    return e->rows[e->first_row[column] + (k - e->first[column])];
}

/* Puts a column on the list of those that wait for the row of its entry `next`, unless all of its entries were used. */
static inline void wait_for_row(struct kiln_cholesky *c, uint32_t column, size_t next)
{
    const struct kiln_elimination *e = c->elimination;
    if (next == e->first[column + 1])
        return;
    const size_t row = row_of(e, column, next);
    c->next[column] = next;
    c->behind[column] = c->waiting[row];
    c->waiting[row] = column;
}

/* Subtracts the contribution of an earlier column, which has an entry in row j, from column j. */
LANE_CODE void subtract_column(struct kiln_cholesky *c, const size_t lanes, uint32_t earlier)
{
    const struct kiln_elimination *e = c->elimination;
    const size_t begin = c->next[earlier], end = e->first[earlier + 1];
    const double *restrict entries = c->entries, *restrict diagonal = c->diagonal + earlier * lanes;
    double factor[KILN_CHOLESKY_LANES];
#pragma omp simd
    for (size_t l = 0; l < lanes; l++)
        factor[l] = entries[begin * lanes + l] * diagonal[l];
    for (size_t k = begin; k < end; k++) {
        double *restrict to = c->column + row_of(e, earlier, k) * lanes;
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            to[l] -= entries[k * lanes + l] * factor[l];
    }
}

/* Initializes column j of L with the matrix' column. */
LANE_CODE void begin_column(struct kiln_cholesky *c, const size_t lanes, uint32_t j)
{
    const struct kiln_elimination *e = c->elimination;
    memcpy(c->column + j * lanes, c->diagonal + j * lanes, lanes * sizeof(double));
    for (size_t k = e->first[j]; k < e->first[j + 1]; k++)
        for (size_t l = 0; l < lanes; l++)
            c->column[row_of(e, j, k) * lanes + l] = c->matrix[k];
}

/* Finishes a column: divides it by its diagonal if it is eliminated. A column of the core stays as it is. */
LANE_CODE void end_column(struct kiln_cholesky *c, const size_t lanes, uint32_t j)
{
    const struct kiln_elimination *e = c->elimination;
    double factor[KILN_CHOLESKY_LANES];
    memcpy(c->diagonal + j * lanes, c->column + j * lanes, lanes * sizeof(double));
#pragma omp simd
    for (size_t l = 0; l < lanes; l++)
        factor[l] = j < e->eliminated ? 1.0 / c->diagonal[j * lanes + l] : 1.0;
    for (size_t k = e->first[j]; k < e->first[j + 1]; k++)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            c->entries[k * lanes + l] = c->column[row_of(e, j, k) * lanes + l] * factor[l];
}

LANE_CODE void factorize(struct kiln_cholesky *c, const size_t lanes)
{
    const struct kiln_elimination *e = c->elimination;
    memset(c->waiting, 0xff, e->count * sizeof *c->waiting);
    for (uint32_t j = 0; j < e->count; j++) {
        begin_column(c, lanes, j);
        for (uint32_t k = c->waiting[j], behind; k != NONE; k = behind) {
            behind = c->behind[k];
            subtract_column(c, lanes, k);
            wait_for_row(c, k, c->next[k] + 1);
        }
        end_column(c, lanes, j);
        if (j < e->eliminated)
            wait_for_row(c, j, e->first[j]);
    }
}

/* ---- the core ---- */

/* Computes product = core x direction, and *curvature = direction x product. */
LANE_CODE void multiply_core(struct kiln_cholesky *c, const size_t lanes, double curvature[KILN_CHOLESKY_LANES])
{
    const struct kiln_elimination *e = c->elimination;
    const size_t core = e->eliminated, count = e->count - core;
    const double *restrict entries = c->entries, *restrict direction = c->direction;
    double *restrict product = c->product;
    for (size_t i = 0; i < count * lanes; i++)
        product[i] = c->diagonal[core * lanes + i] * direction[i];
    for (size_t j = 0; j < count; j++) {
        double sum[KILN_CHOLESKY_LANES] = {0.0};
        for (size_t k = e->first[core + j]; k < e->first[core + j + 1]; k++) {
            const size_t row = row_of(e, core + j, k) - core;
#pragma omp simd
            for (size_t l = 0; l < lanes; l++) {
                product[row * lanes + l] += entries[k * lanes + l] * direction[j * lanes + l];
                sum[l] += entries[k * lanes + l] * direction[row * lanes + l];
            }
        }
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            product[j * lanes + l] += sum[l];
    }
    for (size_t l = 0; l < lanes; l++)
        curvature[l] = 0.0;
    for (size_t j = 0; j < count; j++)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            curvature[l] += direction[j * lanes + l] * product[j * lanes + l];
}

/* Makes a step of conjugate gradients, and returns the preconditioned norm of the residual in `norm`. */
LANE_CODE void step_core(struct kiln_cholesky *c, const size_t lanes, double *restrict x,
                         const double step[KILN_CHOLESKY_LANES], double norm[KILN_CHOLESKY_LANES])
{
    const size_t core = c->elimination->eliminated, count = c->elimination->count - core;
    const double *restrict diagonal = c->diagonal + core * lanes;
    for (size_t l = 0; l < lanes; l++)
        norm[l] = 0.0;
    for (size_t i = 0; i < count * lanes; i += lanes)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++) {
            const double left = c->residual[i + l] - step[l] * c->product[i + l];
            x[i + l] += step[l] * c->direction[i + l];
            c->residual[i + l] = left;
            norm[l] += left * left / diagonal[i + l];
        }
}

LANE_CODE void turn_core(struct kiln_cholesky *c, const size_t lanes, const double part[KILN_CHOLESKY_LANES])
{
    const size_t core = c->elimination->eliminated, count = c->elimination->count - core;
    const double *restrict diagonal = c->diagonal + core * lanes;
    for (size_t i = 0; i < count * lanes; i += lanes)
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            c->direction[i + l] = c->residual[i + l] / diagonal[i + l] + part[l] * c->direction[i + l];
}

/* Starts conjugate gradients at the previous solution, as if by a step from 0. `norm` receives the preconditioned norm
 * of its residual, and `enough` the norm at which to end. x has the right sides before, and that solution after. */
LANE_CODE void begin_core(struct kiln_cholesky *c, const size_t lanes, double *x, double norm[KILN_CHOLESKY_LANES],
                          double enough[KILN_CHOLESKY_LANES])
{
    const size_t size = (c->elimination->count - c->elimination->eliminated) * lanes * sizeof *x;
    double step[KILN_CHOLESKY_LANES] = {0.0};
    memcpy(c->residual, x, size);
    memset(x, 0, size);
    memcpy(c->direction, c->core, size);
    multiply_core(c, lanes, norm);
    step_core(c, lanes, x, step, norm);
    for (size_t l = 0; l < lanes; l++) {
        enough[l] = SMALL * norm[l];
        step[l] = 1.0;
    }
    step_core(c, lanes, x, step, norm);
}

/* Replaces the core's right sides by the solutions. A lane that has arrived takes steps of no length. */
LANE_CODE void solve_core(struct kiln_cholesky *c, const size_t lanes, double *x)
{
    double norm[KILN_CHOLESKY_LANES], next[KILN_CHOLESKY_LANES], enough[KILN_CHOLESKY_LANES], step[KILN_CHOLESKY_LANES],
        part[KILN_CHOLESKY_LANES] = {0.0};
    begin_core(c, lanes, x, norm, enough);
    for (int iteration = 0; iteration < MOST_ITERATIONS; iteration++) {
        bool any = false;
        for (size_t l = 0; l < lanes; l++)
            any = any || norm[l] > enough[l];
        if (!any)
            break;
        turn_core(c, lanes, part);
        multiply_core(c, lanes, step);
        for (size_t l = 0; l < lanes; l++)
            step[l] = norm[l] > enough[l] ? norm[l] / step[l] : 0.0;
        step_core(c, lanes, x, step, next);
        for (size_t l = 0; l < lanes; l++)
            part[l] = norm[l] > enough[l] ? next[l] / norm[l] : 0.0;
        memcpy(norm, next, sizeof norm);
    }
    memcpy(c->core, x, (c->elimination->count - c->elimination->eliminated) * lanes * sizeof *x);
}

void kiln_cholesky_forget(struct kiln_cholesky *c)
{
    const size_t core = c->elimination->count - c->elimination->eliminated;
    memset(c->core, 0, core * c->lanes * sizeof *c->core);
}

/* ---- solutions ---- */

LANE_CODE void go_forward(const struct kiln_cholesky *c, const size_t lanes, double *restrict x)
{
    const struct kiln_elimination *e = c->elimination;
    for (size_t j = 0; j < e->eliminated; j++)
        for (size_t k = e->first[j]; k < e->first[j + 1]; k++) {
            const size_t row = row_of(e, j, k);
#pragma omp simd
            for (size_t l = 0; l < lanes; l++)
                x[row * lanes + l] -= c->entries[k * lanes + l] * x[j * lanes + l];
        }
}

LANE_CODE void go_back(const struct kiln_cholesky *c, const size_t lanes, double *restrict x)
{
    const struct kiln_elimination *e = c->elimination;
    for (size_t j = e->eliminated; j-- > 0;) {
        double sum[KILN_CHOLESKY_LANES];
#pragma omp simd
        for (size_t l = 0; l < lanes; l++)
            sum[l] = x[j * lanes + l] / c->diagonal[j * lanes + l];
        for (size_t k = e->first[j]; k < e->first[j + 1]; k++) {
            const size_t row = row_of(e, j, k);
#pragma omp simd
            for (size_t l = 0; l < lanes; l++)
                sum[l] -= c->entries[k * lanes + l] * x[row * lanes + l];
        }
        memcpy(x + j * lanes, sum, lanes * sizeof(double));
    }
}

LANE_CODE void solve(struct kiln_cholesky *c, const size_t lanes, double *x)
{
    go_forward(c, lanes, x);
    if (c->elimination->eliminated < c->elimination->count)
        solve_core(c, lanes, x + c->elimination->eliminated * lanes);
    go_back(c, lanes, x);
}

#define LANES(count)                                                                                                   \
    KILN_CLONES static void factorize_##count(struct kiln_cholesky *c) { factorize(c, count); }                        \
    KILN_CLONES static void solve_##count(struct kiln_cholesky *c, double *x) { solve(c, count, x); }
LANES(1)
LANES(2)
LANES(4)
LANES(6)
LANES(8)

void kiln_cholesky_factorize(struct kiln_cholesky *c)
{
    void (*const ways[])(struct kiln_cholesky *) = {
        [1] = factorize_1, [2] = factorize_2, [4] = factorize_4, [6] = factorize_6, [8] = factorize_8};
    ways[c->lanes](c);
}

void kiln_cholesky_solve(struct kiln_cholesky *c, double *x)
{
    void (*const ways[])(struct kiln_cholesky *,
                         double *) = {[1] = solve_1, [2] = solve_2, [4] = solve_4, [6] = solve_6, [8] = solve_8};
    ways[c->lanes](c, x);
}
