/* Boxes of places that may see a lamp in a mirror, against the places in them. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "worker/backend/mirror_images.h"

enum { TRIALS = 20000, PLACES = 64 };

#define EXTENT 4.0 /* m */

static double draw(uint64_t *state, double least, double most)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return least + (most - least) * ((double)(*state >> 11) * 0x1p-53);
}

static struct kiln_dvec3 draw_vector(uint64_t *state, double most)
{
    const double x = draw(state, -most, most), y = draw(state, -most, most), z = draw(state, -most, most);
    return dvec3(x, y, z);
}

static struct kiln_mirror_plane draw_plane(uint64_t *state)
{
    const struct kiln_dvec3 n = draw_vector(state, 1.0), centre = draw_vector(state, 0.5 * EXTENT),
                            half = dvec3(draw(state, 0.0, 1.0), draw(state, 0.0, 1.0), draw(state, 0.0, 1.0));
    const struct kiln_dvec3 normal = dvec3_scale(n, 1.0 / dvec3_length(n));
    return (struct kiln_mirror_plane){.normal = normal,
                                      .distance = dvec3_dot(normal, centre),
                                      .minimum = dvec3_sub(centre, half),
                                      .maximum = dvec3_add(centre, half)};
}

static struct kiln_mirror_lamp draw_lamp(uint64_t *state)
{
    const bool outside = draw(state, 0.0, 1.0) < 0.5;
    const struct kiln_dvec3 p = draw_vector(state, 0.5 * EXTENT);
    return (struct kiln_mirror_lamp){.outside = outside, .place = outside ? dvec3_scale(p, 1.0 / dvec3_length(p)) : p};
}

/* Counts the corners, and places between them, that see the lamp. */
static int count_seen(uint64_t *state, const struct kiln_mirror_plane *plane, const struct kiln_mirror_lamp *lamp,
                      struct kiln_dvec3 low, struct kiln_dvec3 high)
{
    int seen = 0;
    for (int i = 0; i < PLACES; i++) {
        struct kiln_dvec3 direction;
        const double x = i < 8 ? i & 1 : draw(state, 0.0, 1.0), y = i < 8 ? i >> 1 & 1 : draw(state, 0.0, 1.0),
                     z = i < 8 ? i >> 2 & 1 : draw(state, 0.0, 1.0);
        const struct kiln_dvec3 p =
            dvec3(low.x + x * (high.x - low.x), low.y + y * (high.y - low.y), low.z + z * (high.z - low.z));
        seen += kiln_mirror_image(plane, lamp, p, &direction);
    }
    return seen;
}

static void test_boxes(void **context)
{
    (void)context;
    uint64_t state = 1;
    int shown = 0, seen = 0;
    for (int t = 0; t < TRIALS; t++) {
        const struct kiln_mirror_plane plane = draw_plane(&state);
        const struct kiln_mirror_lamp lamp = draw_lamp(&state);
        const double width = EXTENT * exp2(draw(&state, -12.0, -4.0));
        const struct kiln_dvec3 low = draw_vector(&state, 0.5 * EXTENT),
                                high = dvec3_add(low, dvec3(draw(&state, 0.0, width), draw(&state, 0.0, width),
                                                            draw(&state, 0.0, width)));
        const bool may = kiln_mirror_may_show(&plane, &lamp, low, high, EXTENT);
        const int places = count_seen(&state, &plane, &lamp, low, high);
        assert_true(may || places == 0);
        shown += may;
        seen += places > 0;
    }
    assert_true(seen > TRIALS / 100);
    assert_true(shown < 2 * seen); /* boxes are told apart */
}

/* A place on the mirror itself. */
static void test_in_plane(void **context)
{
    (void)context;
    const struct kiln_mirror_plane floor = {
        .normal = {0.0, 0.0, 1.0}, .minimum = {-1.0, -1.0, -1e-5}, .maximum = {1.0, 1.0, 1e-5}};
    const struct kiln_mirror_lamp lamp = {.place = {0.0, 0.0, 1.0}}, under = {.place = {0.0, 0.0, -1.0}};
    const struct kiln_dvec3 low = dvec3(0.1, 0.1, 0.0), high = dvec3(0.2, 0.2, 0.0);
    assert_true(kiln_mirror_may_show(&floor, &lamp, low, high, EXTENT));
    assert_false(kiln_mirror_may_show(&floor, &under, low, high, EXTENT));
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_boxes), cmocka_unit_test(test_in_plane)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
