/* Cells of the sky: they part the image, a sun has its own, directions are drawn within them by the image's light. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "worker/light/environment.h"
#include "worker/light/sky_cells.h"

enum { WIDTH = 64, HEIGHT = 32, SUN_X = 20, SUN_Y = 5, MOST = 12 };

struct world {
    float texels[3 * WIDTH * HEIGHT];
    struct kiln_environment environment;
    struct kiln_scene scene;
    struct kiln_geometry geometry;
    struct kiln_lights lights;
    struct kiln_sky_cells cells;
};

/* A sky that is brighter above, black in a part, with a sun of that radiance. */
static void make(struct world *w, float sun, uint32_t x, size_t most)
{
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++)
        for (uint32_t c = 0; c < 3; c++)
            w->texels[3 * i + c] = i % WIDTH < 8 && i / WIDTH > 20 ? 0.0f : 0.2f + 0.01f * (float)(HEIGHT - i / WIDTH);
    for (uint32_t c = 0; c < 3; c++)
        w->texels[3 * (SUN_Y * WIDTH + x) + c] = sun;
    w->environment = (struct kiln_environment){
        .kind = KILN_ENVIRONMENT_LATLONG, .radiance = {2, 2, 2}, .rotation = 0.7f, .width = WIDTH, .height = HEIGHT};
    w->scene = (struct kiln_scene){.environment = &w->environment, .environment_texels = w->texels};
    w->geometry = (struct kiln_geometry){.extent = 1.0f};
    w->lights = (struct kiln_lights){.scene = &w->scene, .geometry = &w->geometry};
    assert_int_equal(kiln_environment_build(&w->lights, NULL), KILN_OK);
    assert_int_equal(kiln_sky_cells_create(&w->cells, &w->lights, most, NULL), KILN_OK);
}

static void release(struct world *w)
{
    kiln_sky_cells_release(&w->cells);
    kiln_free(&w->lights.marginal);
    kiln_free(&w->lights.conditional);
}

static size_t cell_of_texel(const struct world *w, uint32_t x, uint32_t y)
{
    return kiln_sky_cell_of(&w->cells, kiln_environment_in_texel(&w->lights, x, y, 0.5, 0.5));
}

static void cells_part_the_image(void **state)
{
    static struct world w;
    size_t texels = 0;
    double share = 0.0;
    (void)state;
    make(&w, 5000.0f, SUN_X, MOST);
    assert_true(w.cells.count > 5 && w.cells.count <= MOST);
    for (size_t i = 0; i < w.cells.count; i++) {
        const struct kiln_sky_cell *c = &w.cells.all[i];
        assert_true(c->x0 < c->x1 && c->x1 <= WIDTH && c->y0 < c->y1 && c->y1 <= HEIGHT);
        texels += (size_t)(c->x1 - c->x0) * (c->y1 - c->y0);
        share += c->share;
        for (uint32_t y = c->y0; y < c->y1; y++)
            for (uint32_t x = c->x0; x < c->x1; x++)
                assert_int_equal(cell_of_texel(&w, x, y), i);
    }
    assert_int_equal(texels, WIDTH * HEIGHT);
    assert_true(fabs(share - 1.0) < 1e-6);
    release(&w);
}

/* Also in the first and in the last column; and not where nothing is much brighter than the rest. */
static void a_sun_has_its_own(void **state)
{
    static struct world w;
    (void)state;
    for (uint32_t i = 0; i < 3; i++) {
        const uint32_t x = i == 0 ? SUN_X : i == 1 ? 0 : WIDTH - 1;
        make(&w, 5000.0f, x, 5);
        const struct kiln_sky_cell *c = &w.cells.all[cell_of_texel(&w, x, SUN_Y)];
        assert_true(c->x0 == x && c->x1 == x + 1 && c->y0 == SUN_Y && c->y1 == SUN_Y + 1);
        assert_true(c->share > 0.5);
        release(&w);
    }
    make(&w, 0.5f, SUN_X, 5);
    const struct kiln_sky_cell *c = &w.cells.all[cell_of_texel(&w, SUN_X, SUN_Y)];
    assert_true(c->x1 - c->x0 > 1);
    release(&w);
}

/* Directions stay in the cell, their density is the image's over the cell's share, and light over density has the
 * image's mean. */
static void directions_go_by_light(void **state)
{
    enum { SIDE = 64 };
    static struct world w;
    double flux = 0.0;
    (void)state;
    make(&w, 5000.0f, SUN_X, MOST);
    for (size_t i = 0; i < w.cells.count; i++)
        for (int k = 0; k < SIDE * SIDE && w.cells.all[i].share > 0.0; k++) {
            double density;
            float rgb[3];
            const struct kiln_dvec3 d =
                kiln_sky_cell_sample(&w.cells, i, (k % SIDE + 0.5) / SIDE, (k / SIDE + 0.5) / SIDE, &density);
            assert_int_equal(kiln_sky_cell_of(&w.cells, d), i);
            assert_true(fabs(density * w.cells.all[i].share / kiln_environment_density(&w.lights, d) - 1.0) < 1e-9);
            kiln_environment_radiance(&w.lights, d, rgb);
            flux += (double)rgb[1] / density / (SIDE * SIDE);
        }
    assert_true(fabs(flux / (4.0 * KILN_PI * (double)w.lights.environment_mean[1]) - 1.0) < 1e-4);
    release(&w);
}

/* One cell is the whole image, and a sky without an image has none. */
static void few_cells(void **state)
{
    static struct world w;
    (void)state;
    make(&w, 5000.0f, SUN_X, 0);
    assert_int_equal(w.cells.count, 1);
    assert_true(w.cells.all[0].x1 == WIDTH && w.cells.all[0].y1 == HEIGHT);
    release(&w);
    w.lights.conditional = NULL;
    assert_int_equal(kiln_sky_cells_create(&w.cells, &w.lights, MOST, NULL), KILN_OK);
    assert_int_equal(w.cells.count, 0);
    kiln_sky_cells_release(&w.cells);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cells_part_the_image),
        cmocka_unit_test(a_sun_has_its_own),
        cmocka_unit_test(directions_go_by_light),
        cmocka_unit_test(few_cells),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
