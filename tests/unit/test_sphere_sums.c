/* Cells of spheres about probes (worker/pass/sphere_cells.h), and sums of chords (worker/backend/embree/sphere_sums.h)
 * against those one by one. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "worker/backend/embree/sphere_sums.h"
#include "worker/base/memory.h"

static double next(uint64_t *state)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

/* The cell that a place is in lists every sphere that the place is in, once; and that it is listed again elsewhere. */
static void cells_have_their_spheres(void **state)
{
    (void)state;
    enum { X = 5, Y = 4, Z = 6, FIRST = 2 * X * Y + 7, COUNT = 3 * X * Y, PLACES = 20000 };
    struct kiln_error error = {""};
    struct kiln_sphere sphere[COUNT];
    struct kiln_probe_spheres s = {.origin = {-1.0, 0.5, 2.0},
                                   .spacing = {0.5, 0.25, 0.4},
                                   .radius = 0.125,
                                   .size = {X, Y, Z},
                                   .first = FIRST,
                                   .count = COUNT,
                                   .sphere = sphere};
    struct kiln_sphere_cells *c = &s.cells;
    uint64_t random = 7, listed[COUNT] = {0}, within = 0;
    for (size_t i = 0; i < COUNT; i++) {
        const size_t n = FIRST + i, at[3] = {n % X, n / X % Y, n / (X * Y)};
        sphere[i].radius = i % 10 == 3 ? 0.0f : 0.125f;
        for (int a = 0; a < 3; a++)
            sphere[i].centre[a] =
                (float)(s.origin[a] + s.spacing[a] * ((double)at[a] + (i % 2 == 0 ? 0.0 : next(&random) - 0.5)));
    }
    assert_int_equal(kiln_sphere_cells_make(c, &s, &error), KILN_OK);
    const size_t cells = (size_t)(c->size[0] * c->size[1] * c->size[2]);
    for (uint32_t k = 0; k < c->begin[cells]; k++)
        listed[c->spheres[k].number]++;
    for (uint32_t k = 0; k < c->begin[cells]; k++)
        assert_true(c->spheres[k].again == (listed[c->spheres[k].number] > 1));
    for (size_t i = 0; i < COUNT; i++)
        assert_true(listed[i] <= 8 && (listed[i] > 0) == (sphere[i].radius > 0.0f) && (i % 2 == 1 || listed[i] <= 1));
    for (int k = 0; k < PLACES; k++) {
        double place[3];
        int64_t cell[3];
        for (int a = 0; a < 3; a++) {
            cell[a] = (int64_t)(next(&random) * (double)c->size[a]);
            place[a] = s.origin[a] + s.spacing[a] * ((double)(c->first[a] + cell[a]) + next(&random) - 0.5);
        }
        const size_t number = (size_t)((cell[2] * c->size[1] + cell[1]) * c->size[0] + cell[0]);
        for (uint32_t i = 0; i < COUNT; i++) {
            double square = 0.0;
            int times = 0;
            for (int a = 0; a < 3; a++)
                square += pow(place[a] - (double)sphere[i].centre[a], 2.0);
            if (!(sqrt(square) < (double)sphere[i].radius - 1e-4))
                continue;
            for (uint32_t j = c->begin[number]; j < c->begin[number + 1]; j++)
                times += c->spheres[j].number == i;
            assert_int_equal(times, 1);
            within++;
        }
    }
    assert_true(within > PLACES / 50);
    kiln_sphere_cells_release(c);
}

/* Tests chords of several threads, some of them too large for quick rounding. */
static void chords_add_up(void **state)
{
    (void)state;
    enum { THREADS = 3, CHORDS = 4000, COUNT = 70 };
    struct kiln_error error = {""};
    uint64_t sums[COUNT * KILN_SPHERE_SUMS] = {0}, expected[COUNT * KILN_SPHERE_SUMS] = {0}, moments[2] = {0},
                          random = 11;
    const struct kiln_probe_spheres s = {.count = COUNT, .unit = 3e-7, .sums = sums, .moments = moments};
    struct sphere_chords threads[THREADS];
    for (size_t t = 0; t < THREADS; t++) {
        assert_int_equal(sphere_chords_begin(&threads[t], &s, &error), KILN_OK);
        for (size_t i = 0; i < CHORDS; i++) {
            struct sphere_chord chord = {.sphere = (uint32_t)(next(&random) * COUNT)};
            double weights[KILN_SPHERE_WEIGHTS];
            chord.direction = vec3_normalize(
                vec3((float)next(&random) - 0.5f, (float)next(&random) - 0.5f, (float)next(&random) - 0.5f));
            for (int c = 0; c < 3; c++)
                chord.brought[c] = exp((i % 50 == 0 ? 60.0 : 20.0) * (next(&random) - 0.6));
            spheres_weights(dvec3_scale(dvec3_of(chord.direction), -1.0), weights);
            for (int k = 0; k < KILN_SPHERE_SUMS; k++)
                expected[KILN_SPHERE_SUMS * chord.sphere + (size_t)k] +=
                    (uint64_t)llrint(fmax(-0x1p61, fmin(chord.brought[k % 3] * weights[k / 3] / s.unit, 0x1p61)));
            sphere_chords_add(&threads[t], &chord);
            sphere_chords_note(&threads[t], &s, i % 100 < 70, i);
        }
        sphere_chords_end(&threads[t], &s);
        assert_int_equal(threads[t].status, KILN_OK);
    }
    for (size_t stretch = 0; stretch < sphere_stretches(&s); stretch++)
        sphere_stretch_add(&s, threads, THREADS, stretch);
    assert_memory_equal(sums, expected, sizeof sums);
    assert_int_equal(moments[0] + moments[1], (uint64_t)THREADS * CHORDS * (CHORDS - 1) / 2);
    assert_true(moments[0] > 0 && moments[1] > moments[0]);
    for (size_t t = 0; t < THREADS; t++)
        sphere_chords_release(&threads[t]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(cells_have_their_spheres), cmocka_unit_test(chords_add_up)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
