/* Tests of the order of elimination and of Cholesky factors, with and without a core. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/math/cholesky.h"
#include "worker/base/memory.h"

enum { SIZE = 8, LANES = 6 };

/* The sum over cliques of w w^T, where w alternates between 1 and -1, plus a diagonal. */
struct system {
    size_t count, cliques;
    uint32_t *at;
    double *pull; /* a number for each lane */
};

static uint32_t next_random(uint32_t *state) { return (*state = *state * 1664525u + 1013904223u) >> 8; }

/* Cliques of unknowns that are near one another, or anywhere. */
static void make_system(struct system *s, size_t count, size_t cliques, bool anywhere)
{
    uint32_t state = 1;
    *s = (struct system){.count = count, .cliques = cliques};
    assert_int_equal(kiln_allocate(&s->at, cliques * SIZE, sizeof *s->at, "cliques", NULL), 0);
    assert_int_equal(kiln_allocate(&s->pull, count * LANES, sizeof *s->pull, "pulls", NULL), 0);
    for (size_t i = 0; i < cliques; i++)
        for (size_t k = 0; k < SIZE; k++) /* one may occur twice */
            s->at[i * SIZE + k] = anywhere ? next_random(&state) % (uint32_t)count
                                           : (uint32_t)((i * count / cliques + next_random(&state) % 12u) % count);
    for (size_t i = 0; i < count * LANES; i++)
        s->pull[i] = next_random(&state) % 10u == 0 ? 1e3 : 1e-3 + 1e-2 * (double)(next_random(&state) % 8u);
}

static void free_system(struct system *s)
{
    kiln_free(&s->at);
    kiln_free(&s->pull);
}

static double sign_of(size_t k) { return k % 2 == 0 ? 1.0 : -1.0; }

/* y = matrix x, in one lane; x and y by unknown. */
static void multiply(const struct system *s, size_t lane, const double *x, double *y)
{
    for (size_t u = 0; u < s->count; u++)
        y[u] = s->pull[u * LANES + lane] * x[u];
    for (size_t i = 0; i < s->cliques; i++) {
        double sum = 0.0;
        for (size_t k = 0; k < SIZE; k++)
            sum += sign_of(k) * x[s->at[i * SIZE + k]];
        for (size_t k = 0; k < SIZE; k++)
            y[s->at[i * SIZE + k]] += sign_of(k) * sum;
    }
}

static size_t find_entry(const struct kiln_elimination *e, uint32_t row, uint32_t column)
{
    for (size_t k = e->first[column]; k < e->first[column + 1]; k++)
        if (e->rows[e->first_row[column] + k - e->first[column]] == row)
            return k;
    fail_msg("the factor has no entry (%u, %u), but the matrix has", row, column);
    return 0;
}

/* Sets the matrix of a factor for these lanes. */
static void set_matrix(const struct system *s, struct kiln_cholesky *c, size_t first_lane)
{
    const struct kiln_elimination *e = c->elimination;
    memset(c->matrix, 0, kiln_elimination_entries(e) * sizeof *c->matrix);
    for (size_t u = 0; u < s->count; u++)
        for (size_t l = 0; l < c->lanes; l++)
            c->diagonal[e->place[u] * c->lanes + l] = s->pull[u * LANES + first_lane + l];
    for (size_t i = 0; i < s->cliques; i++)
        for (size_t k = 0; k < SIZE; k++)
            for (size_t j = 0; j < SIZE; j++) {
                const uint32_t row = e->place[s->at[i * SIZE + k]], column = e->place[s->at[i * SIZE + j]];
                for (size_t l = 0; l < c->lanes && row == column; l++)
                    c->diagonal[row * c->lanes + l] += sign_of(k) * sign_of(j);
                if (row > column)
                    c->matrix[find_entry(e, row, column)] += sign_of(k) * sign_of(j);
            }
}

/* Solves for right sides of whole numbers in lanes from this one on. x has `lanes` numbers for each unknown. */
static void solve(const struct system *s, const struct kiln_elimination *e, size_t first_lane, size_t lanes, double *x)
{
    struct kiln_cholesky c;
    double *placed = NULL;
    assert_int_equal(kiln_cholesky_create(&c, e, lanes, NULL), 0);
    assert_int_equal(kiln_allocate(&placed, s->count * lanes, sizeof *placed, "x", NULL), 0);
    set_matrix(s, &c, first_lane);
    for (size_t u = 0; u < s->count; u++)
        for (size_t l = 0; l < lanes; l++)
            placed[e->place[u] * lanes + l] = (double)((u + first_lane + l) % 5);
    kiln_cholesky_factorize(&c);
    kiln_cholesky_solve(&c, placed);
    for (size_t u = 0; u < s->count; u++)
        memcpy(x + u * lanes, placed + e->place[u] * lanes, lanes * sizeof *x);
    kiln_free(&placed);
    kiln_cholesky_destroy(&c);
}

/* Places are a permutation, and rows of a column rise from below it. */
static void check_order(const struct kiln_elimination *e)
{
    bool *seen = calloc(e->count, sizeof *seen);
    for (size_t u = 0; u < e->count; u++) {
        assert_true(e->place[u] < e->count && !seen[e->place[u]]);
        seen[e->place[u]] = true;
    }
    for (size_t j = 0; j < e->count; j++)
        for (size_t k = 0; k < e->first[j + 1] - e->first[j]; k++)
            assert_true(e->rows[e->first_row[j] + k] > (k == 0 ? j : e->rows[e->first_row[j] + k - 1]));
    free(seen);
}

static void check_system(size_t count, size_t cliques, bool anywhere)
{
    struct system s;
    struct kiln_elimination e;
    make_system(&s, count, cliques, anywhere);
    double *all = malloc(count * LANES * sizeof *all), *one = malloc(count * sizeof *one),
           *product = malloc(count * sizeof *product), worst = 0.0;
    assert_int_equal(kiln_elimination_create(&e, count, s.at, cliques, SIZE, NULL), 0);
    check_order(&e);
    assert_true(anywhere == (e.eliminated < count));
    solve(&s, &e, 0, LANES, all);
    for (size_t l = 0; l < LANES; l++) {
        solve(&s, &e, l, 1, one);
        for (size_t u = 0; u < count; u++)
            assert_true(one[u] == all[u * LANES + l]); /* a lane is what it is alone */
        multiply(&s, l, one, product);
        for (size_t u = 0; u < count; u++)
            worst = fmax(worst, fabs(product[u] - (double)((u + l) % 5)));
    }
    printf("%zu unknowns, %zu eliminated, %.1f entries a column: residual %.2g\n", count, e.eliminated,
           (double)kiln_elimination_entries(&e) / (double)count, worst);
    assert_true(worst < (anywhere ? 1e-5 : 1e-9));
    free(all);
    free(one);
    free(product);
    kiln_elimination_destroy(&e);
    free_system(&s);
}

static void test_eliminated(void **state)
{
    (void)state;
    check_system(1, 1, false);
    check_system(40, 1, false); /* most have no entry */
    check_system(3000, 2500, false);
}

static void test_core(void **state)
{
    (void)state;
    check_system(2000, 1500, true);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_eliminated), cmocka_unit_test(test_core)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
