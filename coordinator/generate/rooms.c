/* Rooms in a grid, each with a lamp flush in its ceiling and doors to all its neighbours. A room's mesh depends on
 * which of its walls have doors and on its colours; equal rooms share one mesh. The passage through a wall belongs to
 * the room on the wall's low side. */
#include <stdio.h>
#include <string.h>

#include "coordinator/generate/camera.h"
#include "coordinator/generate/scenes.h"

enum { WALL, FLOOR, LAMP, TINT, TINTS = 4, MATERIALS = TINT + TINTS };
/* walls with doors; x grows to the east, z to the south */
enum { WEST = 1, EAST = 2, NORTH = 4, SOUTH = 8, MASKS = 16 };

static const double WIDE = 4, HIGH = 2.8, DEEP = 5, THICK = 0.2, DOOR_WIDE = 1, DOOR_HIGH = 2.1;

/* Adds a wall. `corner` is its lower left as seen from inside; `along` points to the right. */
static void wall(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 corner, struct kiln_dvec3 along,
                 bool door)
{
    const struct kiln_dvec3 up = dvec3(0, HIGH, 0);
    const double length = dvec3_length(along);
    if (door) {
        const double hole_u[2] = {0.5 - 0.5 * DOOR_WIDE / length, 0.5 + 0.5 * DOOR_WIDE / length},
                     hole_v[2] = {0, DOOR_HIGH / HIGH};
        kiln_shape_face_with_hole(shape, material, corner, along, up, hole_u, hole_v);
    } else {
        kiln_shape_face(shape, material, corner, dvec3_add(corner, along), dvec3_add(corner, dvec3_add(along, up)),
                        dvec3_add(corner, up));
    }
}

/* Adds floor, lintel and two jambs of the passage that leads outwards through a wall; `corner` and `along` as for the
 * wall. */
static void passage(struct kiln_shape *shape, struct kiln_dvec3 corner, struct kiln_dvec3 along,
                    struct kiln_dvec3 outwards)
{
    const double length = dvec3_length(along);
    const struct kiln_dvec3 up = dvec3(0, HIGH * (DOOR_HIGH / HIGH), 0);
    const struct kiln_dvec3 a = dvec3_add(corner, dvec3_scale(along, 0.5 - 0.5 * DOOR_WIDE / length));
    const struct kiln_dvec3 b = dvec3_add(corner, dvec3_scale(along, 0.5 + 0.5 * DOOR_WIDE / length));
    const struct kiln_dvec3 a_out = dvec3_add(a, outwards), b_out = dvec3_add(b, outwards);
    kiln_shape_face(shape, FLOOR, a, b, b_out, a_out);
    kiln_shape_face(shape, WALL, dvec3_add(a_out, up), dvec3_add(b_out, up), dvec3_add(b, up), dvec3_add(a, up));
    kiln_shape_face(shape, WALL, a, a_out, dvec3_add(a_out, up), dvec3_add(a, up));
    kiln_shape_face(shape, WALL, b_out, b, dvec3_add(b, up), dvec3_add(b_out, up));
}

static void room(struct kiln_shape *shape, unsigned doors, uint32_t tint)
{
    const struct kiln_dvec3 east = dvec3(WIDE, 0, 0), south = dvec3(0, 0, DEEP);
    kiln_shape_face(shape, FLOOR, dvec3(0, 0, DEEP), dvec3(WIDE, 0, DEEP), dvec3(WIDE, 0, 0), dvec3(0, 0, 0));
    const double hole_u[2] = {0.4, 0.6}, hole_v[2] = {0.45, 0.55};
    kiln_shape_face_with_hole(shape, WALL, dvec3(0, HIGH, 0), east, south, hole_u, hole_v);
    const double x0 = WIDE * hole_u[0], x1 = WIDE * hole_u[1], z0 = DEEP * hole_v[0], z1 = DEEP * hole_v[1];
    kiln_shape_face(shape, LAMP, dvec3(x0, HIGH, z0), dvec3(x1, HIGH, z0), dvec3(x1, HIGH, z1), dvec3(x0, HIGH, z1));
    wall(shape, WALL, dvec3(0, 0, 0), east, (doors & NORTH) != 0);
    wall(shape, TINT + tint, dvec3(WIDE, 0, DEEP), dvec3_scale(east, -1), (doors & SOUTH) != 0);
    wall(shape, WALL, dvec3(0, 0, DEEP), dvec3_scale(south, -1), (doors & WEST) != 0);
    wall(shape, WALL, dvec3(WIDE, 0, 0), south, (doors & EAST) != 0);
    if ((doors & EAST) != 0)
        passage(shape, dvec3(WIDE, 0, 0), south, dvec3(THICK, 0, 0));
    if ((doors & SOUTH) != 0)
        passage(shape, dvec3(WIDE, 0, DEEP), dvec3_scale(east, -1), dvec3(0, 0, THICK));
}

static const struct kiln_glb_material table[MATERIALS] = {
    [WALL] = {.name = "wall", .base_color = {0.75f, 0.73f, 0.7f}, .roughness = 1},
    [FLOOR] = {.name = "floor", .base_color = {0.4f, 0.3f, 0.2f}, .roughness = 1},
    [LAMP] = {.name = "lamp", .base_color = {0.5f, 0.5f, 0.5f}, .emission = {15, 12.5f, 9}, .roughness = 1},
    [TINT] = {.name = "red", .base_color = {0.65f, 0.15f, 0.1f}, .roughness = 1},
    [TINT + 1] = {.name = "green", .base_color = {0.15f, 0.45f, 0.15f}, .roughness = 1},
    [TINT + 2] = {.name = "blue", .base_color = {0.1f, 0.25f, 0.6f}, .roughness = 1},
    [TINT + 3] = {.name = "yellow", .base_color = {0.7f, 0.6f, 0.15f}, .roughness = 1},
};

int kiln_generate_rooms(struct kiln_glb *glb, const struct kiln_generator *self,
                        const struct kiln_generate_params *params, struct kiln_error *error)
{
    const uint32_t columns = params->columns > 0 ? params->columns : 3, rows = params->rows > 0 ? params->rows : 2;
    struct kiln_palette palette = {.table = table};
    uint32_t meshes[MASKS][TINTS];
    uint64_t state = params->seed ^ 0x726f6f6d73u;
    struct kiln_shape shape = {0};
    if ((double)columns * rows > 1e5)
        return kiln_fail(error, KILN_USAGE, "--columns %u --rows %u makes %.0f rooms; at most 100000 are made", columns,
                         rows, (double)columns * rows);
    memset(meshes, 0xff, sizeof meshes);
    int status = KILN_OK;
    for (uint32_t i = 0; i < columns * rows && status == KILN_OK; i++) {
        const uint32_t column = i % columns, row = i / columns;
        const unsigned doors = (column > 0 ? WEST : 0u) | (column + 1 < columns ? EAST : 0u) | (row > 0 ? NORTH : 0u) |
                               (row + 1 < rows ? SOUTH : 0u);
        const uint32_t tint = (uint32_t)(kiln_shape_random(&state) * TINTS);
        char name[48];
        if (meshes[doors][tint] == UINT32_MAX) {
            room(&shape, doors, tint);
            (void)snprintf(name, sizeof name, "kind_%u_%u", doors, tint);
            status = kiln_shape_add(&shape, glb, name, &palette, &meshes[doors][tint], error);
        }
        const struct kiln_glb_placement placement = {.translation = {column * (WIDE + THICK), 0, row * (DEEP + THICK)}};
        (void)snprintf(name, sizeof name, "room_%u_%u", column, row);
        if (status == KILN_OK)
            status = kiln_glb_add_node(glb, name, meshes[doors][tint], &placement, error);
    }
    if (status == KILN_OK)
        status = kiln_generate_camera(glb, dvec3(0.4, 1.7, 0.4), dvec3(WIDE, 1, DEEP), 1.2, 4.0 / 3, error);
    if (status == KILN_OK)
        status = kiln_glb_set_note(glb, self->description, error);
    kiln_shape_clear(&shape);
    return status;
}
