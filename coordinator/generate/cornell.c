/* The Cornell box and its variants. Geometry: Cornell University Program of Computer Graphics, "Cornell Box Data", with
 * the published millimetres divided by 100 as metres. Colours are an RGB fit of the measured spectra. The light is set
 * flush into a hole of the ceiling. */
#include <string.h>

#include "coordinator/generate/camera.h"
#include "coordinator/generate/scenes.h"

enum { WHITE, GREEN, RED, LIGHT, SOLID, ORANGE, BLUE, MIRROR, GLASS, WATER, MATERIALS };

struct box {
    struct kiln_glb *glb;
    struct kiln_palette palette;
    double scale;
    struct kiln_dvec3 offset;
    int status; /* the first failure; later calls do nothing */
    struct kiln_error *error;
};

static const double HEIGHT = 5.488, DEPTH = 5.592, WIDTH = 5.56;

/* The light's emission is set by the variant. */
static const struct kiln_glb_material table[MATERIALS] = {
    [WHITE] = {.name = "white", .base_color = {0.725f, 0.71f, 0.68f}, .roughness = 1},
    [GREEN] = {.name = "green", .base_color = {0.14f, 0.45f, 0.091f}, .roughness = 1},
    [RED] = {.name = "red", .base_color = {0.63f, 0.065f, 0.05f}, .roughness = 1},
    [LIGHT] = {.name = "light", .base_color = {0.78f, 0.78f, 0.78f}, .roughness = 1},
    [SOLID] = {.name = "solid", .base_color = {0.7f, 0.7f, 0.7f}, .roughness = 1},
    [ORANGE] = {.name = "orange", .base_color = {0.8f, 0.5f, 0.2f}, .roughness = 1},
    [BLUE] = {.name = "blue", .base_color = {0.2f, 0.4f, 0.8f}, .roughness = 1},
    [MIRROR] = {.name = "mirror", .base_color = {0.95f, 0.95f, 0.95f}, .metallic = 1},
    [GLASS] = {.name = "glass", .base_color = {1, 1, 1}, .transmissive = true, .ior = 1.5f, .thickness = 2},
    [WATER] = {.name = "water",
               .base_color = {1, 1, 1},
               .transmissive = true,
               .ior = 1.33f,
               .thickness = 1.2f,
               .attenuation_color = {0.6f, 0.9f, 0.95f},
               .attenuation_distance = 5},
};

static void finish(struct box *box, struct kiln_shape *shape, const char *name)
{
    uint32_t mesh = 0;
    if (box->scale != 1 || dvec3_length(box->offset) > 0)
        kiln_shape_transform(shape, box->scale, box->offset);
    if (box->status == KILN_OK)
        box->status = kiln_shape_add(shape, box->glb, name, &box->palette, &mesh, box->error);
    if (box->status == KILN_OK)
        box->status = kiln_glb_add_node(box->glb, name, mesh, NULL, box->error);
    kiln_shape_clear(shape);
}

static void face(struct box *box, const char *name, uint32_t material, const double corners[4][3])
{
    struct kiln_shape shape = {0};
    struct kiln_dvec3 p[4];
    for (int i = 0; i < 4; i++)
        p[i] = dvec3(corners[i][0], corners[i][1], corners[i][2]);
    kiln_shape_face(&shape, material, p[0], p[1], p[2], p[3]);
    finish(box, &shape, name);
}

static void ceiling_and_light(struct box *box, double x_low, double x_high, double z_low, double z_high)
{
    struct kiln_shape shape = {0};
    const double hole_u[2] = {x_low / WIDTH, x_high / WIDTH}, hole_v[2] = {z_low / DEPTH, z_high / DEPTH};
    kiln_shape_face_with_hole(&shape, WHITE, dvec3(0, HEIGHT, 0), dvec3(WIDTH, 0, 0), dvec3(0, 0, DEPTH), hole_u,
                              hole_v);
    finish(box, &shape, "ceiling");
    /* The corners of the hole, computed as in kiln_shape_face_with_hole, so that there is no gap around the light. */
    const double x0 = WIDTH * hole_u[0], x1 = WIDTH * hole_u[1], z0 = DEPTH * hole_v[0], z1 = DEPTH * hole_v[1];
    const double light[4][3] = {{x1, HEIGHT, z0}, {x1, HEIGHT, z1}, {x0, HEIGHT, z1}, {x0, HEIGHT, z0}};
    face(box, "light", LIGHT, light);
}

static void walls(struct box *box)
{
    static const double floor[4][3] = {{5.528, 0, 0}, {0, 0, 0}, {0, 0, 5.592}, {5.496, 0, 5.592}};
    static const double back[4][3] = {{5.496, 0, 5.592}, {0, 0, 5.592}, {0, 5.488, 5.592}, {5.56, 5.488, 5.592}};
    static const double right[4][3] = {{0, 0, 5.592}, {0, 0, 0}, {0, 5.488, 0}, {0, 5.488, 5.592}};
    static const double left[4][3] = {{5.528, 0, 0}, {5.496, 0, 5.592}, {5.56, 5.488, 5.592}, {5.56, 5.488, 0}};
    face(box, "floor", WHITE, floor);
    face(box, "back", WHITE, back);
    face(box, "right_green", GREEN, right);
    face(box, "left_red", RED, left);
}

/* Adds a block of four sides and a top; `outline` is counter-clockwise from above. */
static void block(struct box *box, const char *name, const double outline[4][2], double height)
{
    struct kiln_shape shape = {0};
    struct kiln_dvec3 low[4], high[4];
    for (int i = 0; i < 4; i++) {
        low[i] = dvec3(outline[i][0], 0, outline[i][1]);
        high[i] = dvec3(outline[i][0], height, outline[i][1]);
    }
    kiln_shape_face(&shape, WHITE, high[0], high[1], high[2], high[3]);
    for (int i = 0; i < 4; i++)
        kiln_shape_face(&shape, WHITE, low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]);
    finish(box, &shape, name);
}

static void blocks(struct box *box)
{
    static const double small[4][2] = {{1.30, 0.65}, {0.82, 2.25}, {2.40, 2.72}, {2.90, 1.14}};
    static const double tall[4][2] = {{4.23, 2.47}, {2.65, 2.96}, {3.14, 4.56}, {4.72, 4.06}};
    block(box, "short_block", small, 1.65);
    block(box, "tall_block", tall, 3.30);
}

/* Adds two shelves, a small distance from the walls. */
static void shelves(struct box *box)
{
    struct kiln_shape shape = {0};
    kiln_shape_box(&shape, SOLID, dvec3(0.01, 2.9, 0.01), dvec3(4.2, 3.1, 5.5), 0, false);
    finish(box, &shape, "upper_shelf");
    kiln_shape_box(&shape, SOLID, dvec3(1.4, 1.3, 0.01), dvec3(5.48, 1.5, 5.5), 0, false);
    finish(box, &shape, "lower_shelf");
}

static void round_solid(struct box *box, const char *name, uint32_t material, const struct kiln_shape_surface *surface)
{
    struct kiln_shape shape = {0};
    kiln_shape_surface(&shape, material, surface);
    finish(box, &shape, name);
}

static void ellipsoid(struct box *box, const char *name, uint32_t material, struct kiln_dvec3 centre,
                      struct kiln_dvec3 radius, uint32_t columns)
{
    const struct kiln_shape_ellipsoid data = {centre, radius};
    round_solid(box, name, material,
                &(struct kiln_shape_surface){kiln_shape_ellipsoid_point, &data, .columns = columns, .rows = columns / 2,
                                             .poles = true});
}

static void solids(struct box *box)
{
    struct kiln_shape shape = {0};
    kiln_shape_box(&shape, SOLID, dvec3(0.5, 0, 0.6), dvec3(2.0, 1.5, 2.1), 0.4, false);
    finish(box, &shape, "cube");
    ellipsoid(box, "ball", SOLID, dvec3(4.0, 0.81, 1.5), dvec3(0.8, 0.8, 0.8), 48);
    const struct kiln_shape_torus torus = {dvec3(2.6, 0.31, 3.0), 0.9, 0.3};
    round_solid(box, "torus", ORANGE,
                &(struct kiln_shape_surface){kiln_shape_torus_point, &torus, .columns = 48, .rows = 24});
    ellipsoid(box, "ellipsoid", BLUE, dvec3(4.3, 1.51, 4.1), dvec3(0.5, 1.5, 0.5), 48);
    kiln_shape_box(&shape, SOLID, dvec3(0.3, 0, 3.9), dvec3(2.0, 2.6, 4.1), 0, false);
    finish(box, &shape, "slab");
}

static void balls(struct box *box)
{
    ellipsoid(box, "mirror_ball", MIRROR, dvec3(1.6, 1.01, 3.6), dvec3(1, 1, 1), 96);
    ellipsoid(box, "glass_ball", GLASS, dvec3(3.8, 1.01, 1.9), dvec3(1, 1, 1), 96);
}

/* The body of water: its sides and its bottom lie behind the walls and below the floor, so that these stand in the
 * water, and its front is free. */
static const double WATER_LOW[3] = {-0.05, -0.05, 0.02}, WATER_HIGH[3] = {5.61, 1.2, 5.642};
enum { WATER_SIDE = 48 }; /* quads along each side */

/* Four waves of different length and direction, 6 cm high in all. */
static double waves(double x, double z)
{
    static const double wave[4][4] = {/* height, along x, along z, phase; radians per m */
                                      {0.024, 4.1, 1.3, 0.3},
                                      {0.018, -2.2, 5.0, 1.7},
                                      {0.012, 6.3, 4.4, 4.1},
                                      {0.006, -7.9, 6.1, 2.6}};
    double height = 0;
    for (int i = 0; i < 4; i++)
        height += wave[i][0] * sin(wave[i][1] * x + wave[i][2] * z + wave[i][3]);
    return height;
}

static struct kiln_dvec3 water_top(const void *unused, double s, double t)
{
    (void)unused;
    const double x = WATER_LOW[0] + t * (WATER_HIGH[0] - WATER_LOW[0]),
                 z = WATER_LOW[2] + s * (WATER_HIGH[2] - WATER_LOW[2]);
    return dvec3(x, WATER_HIGH[1] + waves(x, z), z);
}

static struct kiln_dvec3 water_bottom(const void *unused, double s, double t)
{
    const struct kiln_dvec3 top = water_top(unused, t, s);
    return dvec3(top.x, WATER_LOW[1], top.z);
}

/* Adds one side of the body, from each point i of an edge of the top to i + 1. It uses the top's own points, so that
 * the body is closed. */
static void water_side(struct kiln_shape *shape, const struct kiln_dvec3 edge[WATER_SIDE + 1])
{
    for (int i = 0; i < WATER_SIDE; i++)
        kiln_shape_quad(shape, WATER, dvec3(edge[i].x, WATER_LOW[1], edge[i].z),
                        dvec3(edge[i + 1].x, WATER_LOW[1], edge[i + 1].z), edge[i + 1], edge[i]);
}

static void water(struct box *box)
{
    struct kiln_shape shape = {0};
    /* left, back, right, front: round the body, counter-clockwise from above */
    struct kiln_dvec3 edge[4][WATER_SIDE + 1];
    kiln_shape_surface(
        &shape, WATER,
        &(struct kiln_shape_surface){water_top, NULL, .columns = WATER_SIDE, .rows = WATER_SIDE, .open = true});
    kiln_shape_surface(
        &shape, WATER,
        &(struct kiln_shape_surface){water_bottom, NULL, .columns = WATER_SIDE, .rows = WATER_SIDE, .open = true});
    for (int i = 0; i <= WATER_SIDE; i++) {
        const double at = (double)i / WATER_SIDE, back = (double)(WATER_SIDE - i) / WATER_SIDE;
        edge[0][i] = water_top(NULL, at, 0);
        edge[1][i] = water_top(NULL, 1, at);
        edge[2][i] = water_top(NULL, back, 1);
        edge[3][i] = water_top(NULL, 0, back);
    }
    for (int i = 0; i < 4; i++)
        water_side(&shape, edge[i]);
    finish(box, &shape, "water");
}

/* A carved figure: a turned outline, flutes that wind around it, and fine grain. */
static struct kiln_dvec3 statue_point(const void *unused, double s, double t)
{
    (void)unused;
    const double around = 2 * KILN_PI * s, rise = KILN_PI * t;
    const double outline = 0.62 + 0.22 * sin(3.1 * rise + 0.4) + 0.12 * sin(6.7 * rise + 1.9);
    const double flutes =
        1 + 0.09 * sin(9 * around + 5 * rise) * sin(rise) + 0.035 * sin(31 * around - 17 * rise) * sin(rise);
    const double grain = 1 + 0.008 * sin(113 * around + 71 * rise) * sin(97 * rise - 40 * around) * sin(rise);
    const double r = t <= 0 || t >= 1 ? 0 : sin(rise) * outline * flutes * grain;
    return dvec3(2.78 + r * cos(around), 0.605 + 1.5 - 1.5 * cos(rise), 2.8 - r * sin(around));
}

static void statue(struct box *box, uint64_t triangles)
{
    struct kiln_shape shape = {0};
    kiln_shape_box(&shape, WHITE, dvec3(1.98, 0, 2.0), dvec3(3.58, 0.6, 3.6), 0, false);
    finish(box, &shape, "pedestal");
    /* Twice as many columns as rows: 2 c (c/2 - 1) triangles. */
    const double columns = 1 + sqrt(1 + (double)triangles);
    const uint32_t even = (uint32_t)fmax(4, 2 * floor(0.5 * columns + 0.5));
    /* 32 bytes a vertex, 12 a triangle: checked before anything is made. */
    const double bytes = 0.5 * even * even * 32 + even * (even - 2.0) * 12;
    if (box->status == KILN_OK && bytes > KILN_GLB_LARGEST * 0.999)
        box->status = kiln_fail(
            box->error, KILN_USAGE,
            "--triangles %llu needs %.2f GB in one mesh, and a .glb holds at most 4.29 GB; at most about 150000000 fit",
            (unsigned long long)triangles, bytes * 1e-9);
    if (box->status == KILN_OK)
        round_solid(box, "statue", SOLID,
                    &(struct kiln_shape_surface){statue_point, NULL, .columns = even, .rows = even / 2, .poles = true});
}

int kiln_generate_cornell(struct kiln_glb *glb, const struct kiln_generator *self,
                          const struct kiln_generate_params *params, struct kiln_error *error)
{
    const char *variant = self->name + strlen("cornell");
    const bool narrow = strcmp(variant, "-shapes") == 0, wet = strcmp(variant, "-water") == 0;
    /* Radiance of the measured lamp, and of the narrow and the small one. */
    static const float measured[3] = {18.387f, 13.987300f, 6.753570f}, bright[3] = {60, 55, 45};
    struct kiln_glb_material materials[MATERIALS];
    memcpy(materials, table, sizeof materials);
    memcpy(materials[LIGHT].emission, narrow || wet ? bright : measured, sizeof measured);
    struct box box = {.glb = glb, .palette = {.table = materials}, .scale = 1, .error = error};
    if (strcmp(variant, "-offset") == 0)
        box.offset = dvec3(1e5, 0, 0);
    else if (strcmp(variant, "-tiny") == 0)
        box.scale = 1e-6;
    else if (strcmp(variant, "-huge") == 0)
        box.scale = 1e6;
    walls(&box);
    if (narrow)
        ceiling_and_light(&box, 2.7, 2.86, 1.0, 4.6);
    else if (wet)
        ceiling_and_light(&box, 2.48, 3.08, 2.5, 3.1);
    else
        ceiling_and_light(&box, 2.13, 3.43, 2.27, 3.32);
    if (strcmp(variant, "-layers") == 0)
        shelves(&box);
    else if (narrow)
        solids(&box);
    else if (strcmp(variant, "-spheres") == 0)
        balls(&box);
    else if (wet)
        water(&box);
    else if (strcmp(variant, "-statue") == 0)
        statue(&box, params->triangles > 0 ? params->triangles : 20000);
    else
        blocks(&box);
    /* Focal length 35 mm, film 25 mm. */
    const struct kiln_dvec3 eye = dvec3_add(dvec3_scale(dvec3(2.78, 2.73, -8), box.scale), box.offset);
    if (box.status == KILN_OK)
        box.status = kiln_generate_camera(glb, eye, dvec3_add(eye, dvec3(0, 0, 8 * box.scale)),
                                          2 * atan(0.0125 / 0.035), 1, error);
    if (box.status == KILN_OK)
        box.status = kiln_glb_set_note(glb, self->description, error);
    return box.status;
}
