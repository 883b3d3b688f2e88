/* Generates a hall under a regular grid of small lamps of eight colours, facing down. Each lamp is a separate emissive
 * quad. */
#include <stdio.h>

#include "coordinator/generate/camera.h"
#include "coordinator/generate/scenes.h"

enum { WALL, LAMP, COLORS = 8 };

static const struct kiln_glb_material table[LAMP + COLORS] = {
    {.name = "wall", .base_color = {0.6f, 0.6f, 0.6f}, .roughness = 1},
    {.name = "lamp_white", .emission = {20, 20, 20}, .roughness = 1},
    {.name = "lamp_orange", .emission = {20, 12, 6}, .roughness = 1},
    {.name = "lamp_blue", .emission = {8, 12, 20}, .roughness = 1},
    {.name = "lamp_red", .emission = {20, 6, 6}, .roughness = 1},
    {.name = "lamp_green", .emission = {8, 20, 8}, .roughness = 1},
    {.name = "lamp_yellow", .emission = {20, 18, 6}, .roughness = 1},
    {.name = "lamp_violet", .emission = {16, 8, 20}, .roughness = 1},
    {.name = "lamp_cyan", .emission = {6, 20, 18}, .roughness = 1},
};

/* Adds the lamps. Each is a third as wide as its grid cell, so their total power does not depend on their number. */
static void add_lamps(struct kiln_shape *shape, uint32_t columns, uint32_t rows, double width, double depth,
                      double height, uint64_t seed)
{
    uint64_t state = seed ^ 0x6c616d7073u;
    for (uint32_t row = 0; row < rows; row++)
        for (uint32_t column = 0; column < columns; column++) {
            const double w = width / columns / 6, d = depth / rows / 6;
            const double x = (column + 0.5) * width / columns, z = (row + 0.5) * depth / rows;
            const uint32_t color = LAMP + (uint32_t)(kiln_shape_random(&state) * COLORS);
            kiln_shape_face(shape, color, dvec3(x - w, height, z - d), dvec3(x + w, height, z - d),
                            dvec3(x + w, height, z + d), dvec3(x - w, height, z + d));
        }
}

static int add(struct kiln_glb *glb, struct kiln_shape *shape, const char *name, struct kiln_palette *palette,
               struct kiln_error *error)
{
    uint32_t mesh = 0;
    const int status = kiln_shape_add(shape, glb, name, palette, &mesh, error);
    return status != KILN_OK ? status : kiln_glb_add_node(glb, name, mesh, NULL, error);
}

int kiln_generate_lights(struct kiln_glb *glb, const struct kiln_generator *self,
                         const struct kiln_generate_params *params, struct kiln_error *error)
{
    const uint32_t columns = params->columns > 0 ? params->columns : 32, rows = params->rows > 0 ? params->rows : 16;
    const double width = 32, depth = 16, height = 6;
    struct kiln_shape shape = {0};
    struct kiln_palette palette = {.table = table};
    uint32_t pillar = 0;
    if ((double)columns * rows > 1e6)
        return kiln_fail(error, KILN_USAGE, "--columns %u --rows %u makes %.0f lamps; at most 1000000 are made",
                         columns, rows, (double)columns * rows);
    kiln_shape_box(&shape, WALL, dvec3(0, 0, 0), dvec3(width, height, depth), 0, true);
    int status;
    KILN_TRY(add(glb, &shape, "hall", &palette, error));
    add_lamps(&shape, columns, rows, width, depth, height - 0.5, params->seed);
    KILN_TRY(add(glb, &shape, "lamps", &palette, error));
    kiln_shape_box(&shape, WALL, dvec3(-0.3, 0, -0.3), dvec3(0.3, 3.5, 0.3), 0, false);
    KILN_TRY(kiln_shape_add(&shape, glb, "pillar", &palette, &pillar, error));
    for (int i = 0; i < 14; i++) {
        const struct kiln_glb_placement placement = {
            .translation = {(i % 7 + 0.5) * width / 7, 0, (i / 7 + 0.5) * depth / 2}};
        char name[32];
        (void)snprintf(name, sizeof name, "pillar_%d", i);
        KILN_TRY(kiln_glb_add_node(glb, name, pillar, &placement, error));
    }
    KILN_TRY(kiln_generate_camera(glb, dvec3(1, 2.2, depth - 1), dvec3(width * 0.6, 1.2, depth * 0.4), 1.0, 16.0 / 9,
                                  error));
    KILN_TRY(kiln_glb_set_note(glb, self->description, error));
end:
    kiln_shape_clear(&shape);
    return status;
}
