/* A city: a square of blocks with one house each. There are twelve kinds of house; every house is an instance with its
 * own rotation and height. In a distinct city every house is a kind of its own. A part of a city has a share of the
 * houses in their order, and the first part the ground, the sun, the sky and the camera, too. A facade is one grid of
 * wall and window quads, so that no edge ends in the middle of another; some windows emit light. The number of
 * triangles asked for decides how many houses there are and how finely their facades are divided. */
#include <stdio.h>

#include "coordinator/generate/camera.h"
#include "coordinator/generate/scenes.h"
#include "worker/base/memory.h"

enum { WALLS = 5, WINDOW = WALLS, WINDOW_LIT, GROUND, MATERIALS, KINDS = 12, LARGEST_SIDE = 250 };

static const double PITCH = 24; /* distance from house to house, m */

struct kind {
    double width, depth, height;
    uint32_t wall;
    uint32_t across[2], floors; /* windows along x and z; floors */
};

struct city {
    struct kind *kinds;
    uint64_t kind_count;
    uint32_t side; /* houses along each side of the city */
    bool distinct;
    uint64_t first, end; /* houses of this part */
};

/* Triangles of a house: four facades of (2 n + 1) x (2 f + 1) quads, and a roof. */
static uint64_t kind_triangles(const struct kind *kind)
{
    return 4ull * (2 * kind->floors + 1) * (2 * kind->across[0] + 1 + 2 * kind->across[1] + 1) + 2;
}

/* Divides the facades. `detail`: width per window, m. */
static void divide(struct city *city, double detail)
{
    for (uint64_t i = 0; i < city->kind_count; i++) {
        struct kind *kind = &city->kinds[i];
        kind->across[0] = (uint32_t)fmax(1, floor(kind->width / detail));
        kind->across[1] = (uint32_t)fmax(1, floor(kind->depth / detail));
        kind->floors = (uint32_t)fmax(1, floor(kind->height / detail));
    }
}

static uint64_t kind_of_house(const struct city *city, uint64_t seed, uint64_t house)
{
    uint64_t state = seed ^ (house + 1) * 0x9e3779b97f4a7c15u;
    return city->distinct ? house : (uint64_t)(kiln_shape_random(&state) * KINDS);
}

static uint64_t total_triangles(const struct city *city, uint64_t seed)
{
    uint64_t total = 2;
    for (uint64_t house = 0; house < (uint64_t)city->side * city->side; house++)
        total += kind_triangles(&city->kinds[kind_of_house(city, seed, house)]);
    return total;
}

static void draw_kinds(struct city *city, uint64_t seed)
{
    uint64_t state = seed ^ 0x63697479u;
    for (uint64_t i = 0; i < city->kind_count; i++) {
        struct kind *kind = &city->kinds[i];
        kind->width = 8 + floor(8 * kiln_shape_random(&state));
        kind->depth = 8 + floor(8 * kiln_shape_random(&state));
        const double tall = kiln_shape_random(&state);
        kind->height = 3 * floor(3 + 14 * tall * tall);
        kind->wall = (uint32_t)(kiln_shape_random(&state) * WALLS);
    }
}

static int plan(struct city *city, uint64_t triangles, uint64_t seed, struct kiln_error *error)
{
    /* About four thousand triangles per house; more if that would make too many houses. */
    const double side = floor(sqrt((double)triangles / 4000) + 0.5);
    city->side = (uint32_t)fmin(LARGEST_SIDE, fmax(2, side));
    city->kind_count = city->distinct ? (uint64_t)city->side * city->side : KINDS;
    const int status = kiln_allocate(&city->kinds, city->kind_count, sizeof *city->kinds, "the kinds of house", error);
    if (status != KILN_OK)
        return status;
    draw_kinds(city, seed);
    double fine = 1e-3, coarse = 100;
    for (int i = 0; i < 40; i++) {
        const double detail = sqrt(fine * coarse);
        divide(city, detail);
        *(total_triangles(city, seed) > triangles ? &fine : &coarse) = detail;
    }
    divide(city, coarse);
    return KILN_OK;
}

/* Adds a facade. `corner` is its lower left as seen from outside. Windows are at the odd places of the grid. */
static void facade(struct kiln_shape *shape, const struct kind *kind, struct kiln_dvec3 corner, struct kiln_dvec3 along,
                   uint32_t across, uint64_t *state)
{
    const uint32_t columns = 2 * across + 1, rows = 2 * kind->floors + 1;
    kiln_shape_chart(shape, along, dvec3(0, 1, 0));
    for (uint32_t row = 0; row < rows; row++)
        for (uint32_t column = 0; column < columns; column++) {
            uint32_t material = kind->wall;
            if (row % 2 == 1 && column % 2 == 1)
                material = kiln_shape_random(state) < 0.2 ? WINDOW_LIT : WINDOW;
            const double u0 = (double)column / columns, u1 = (double)(column + 1) / columns;
            const double y0 = kind->height * row / rows, y1 = kind->height * (row + 1) / rows;
            const struct kiln_dvec3 left = dvec3_add(corner, dvec3_scale(along, u0)),
                                    right = dvec3_add(corner, dvec3_scale(along, u1));
            kiln_shape_quad(shape, material, dvec3(left.x, y0, left.z), dvec3(right.x, y0, right.z),
                            dvec3(right.x, y1, right.z), dvec3(left.x, y1, left.z));
        }
}

static int add_kind(struct kiln_glb *glb, const struct kind *kind, uint64_t number, struct kiln_palette *palette,
                    uint64_t seed, uint32_t *mesh, struct kiln_error *error)
{
    struct kiln_shape shape = {0};
    uint64_t state = seed ^ (number + 1) * 0xd1342543de82ef95u;
    const double x = 0.5 * kind->width, z = 0.5 * kind->depth, h = kind->height;
    facade(&shape, kind, dvec3(-x, 0, z), dvec3(2 * x, 0, 0), kind->across[0], &state);
    facade(&shape, kind, dvec3(x, 0, z), dvec3(0, 0, -2 * z), kind->across[1], &state);
    facade(&shape, kind, dvec3(x, 0, -z), dvec3(-2 * x, 0, 0), kind->across[0], &state);
    facade(&shape, kind, dvec3(-x, 0, -z), dvec3(0, 0, 2 * z), kind->across[1], &state);
    kiln_shape_face(&shape, kind->wall, dvec3(-x, h, z), dvec3(x, h, z), dvec3(x, h, -z), dvec3(-x, h, -z));
    char name[32];
    (void)snprintf(name, sizeof name, "house_%llu", (unsigned long long)number);
    const int status = kiln_shape_add(&shape, glb, name, palette, mesh, error);
    kiln_shape_clear(&shape);
    return status;
}

static const struct kiln_glb_material table[MATERIALS] = {
    {.name = "stone", .base_color = {0.6f, 0.55f, 0.5f}, .roughness = 1},
    {.name = "brick", .base_color = {0.5f, 0.3f, 0.25f}, .roughness = 1},
    {.name = "sand", .base_color = {0.7f, 0.65f, 0.5f}, .roughness = 1},
    {.name = "concrete", .base_color = {0.45f, 0.45f, 0.48f}, .roughness = 1},
    {.name = "plaster", .base_color = {0.65f, 0.62f, 0.6f}, .roughness = 1},
    [WINDOW] = {.name = "window", .base_color = {0.05f, 0.07f, 0.1f}, .roughness = 0.1f},
    [WINDOW_LIT] = {.name = "window_lit",
                    .base_color = {0.1f, 0.1f, 0.1f},
                    .emission = {6, 4.5f, 2.5f},
                    .roughness = 1},
    [GROUND] = {.name = "ground", .base_color = {0.15f, 0.15f, 0.16f}, .roughness = 1},
};

static int add_ground(struct kiln_glb *glb, double half, struct kiln_palette *palette, struct kiln_error *error)
{
    struct kiln_shape shape = {0};
    uint32_t mesh = 0;
    kiln_shape_face(&shape, GROUND, dvec3(-half, 0, half), dvec3(half, 0, half), dvec3(half, 0, -half),
                    dvec3(-half, 0, -half));
    int status = kiln_shape_add(&shape, glb, "ground", palette, &mesh, error);
    if (status == KILN_OK)
        status = kiln_glb_add_node(glb, "ground", mesh, NULL, error);
    kiln_shape_clear(&shape);
    return status;
}

/* Adds the meshes of the kinds that the part's houses have. */
static int add_kinds(struct kiln_glb *glb, const struct city *city, uint64_t seed, struct kiln_palette *palette,
                     uint32_t *meshes, struct kiln_error *error)
{
    bool *used = NULL;
    int status = kiln_allocate(&used, city->kind_count, sizeof *used, "the kinds of house", error);
    if (status != KILN_OK)
        return status;
    for (uint64_t house = city->first; house < city->end; house++)
        used[kind_of_house(city, seed, house)] = true;
    for (uint64_t i = 0; i < city->kind_count && status == KILN_OK; i++)
        if (used[i])
            status = add_kind(glb, &city->kinds[i], i, palette, seed, &meshes[i], error);
    kiln_free(&used);
    return status;
}

static int add_houses(struct kiln_glb *glb, const struct city *city, uint64_t seed, const uint32_t *meshes,
                      struct kiln_error *error)
{
    uint64_t state = seed ^ 0x686f75736573u;
    int status = KILN_OK;
    for (uint32_t i = 0; i < city->end && status == KILN_OK; i++) {
        const double angle = floor(4 * kiln_shape_random(&state)) * 0.5 * KILN_PI;
        const double height = floor(100 * (0.8 + 0.5 * kiln_shape_random(&state)) + 0.5) / 100;
        const struct kiln_glb_placement placement = {.translation = {(i % city->side + 0.5 - 0.5 * city->side) * PITCH,
                                                                     0,
                                                                     (i / city->side + 0.5 - 0.5 * city->side) * PITCH},
                                                     .rotation = {0, sin(0.5 * angle), 0, cos(0.5 * angle)},
                                                     .scale = {1, height, 1}};
        char name[32];
        if (i < city->first)
            continue;
        (void)snprintf(name, sizeof name, "house_%u_%u", i % city->side, i / city->side);
        status = kiln_glb_add_node(glb, name, meshes[kind_of_house(city, seed, i)], &placement, error);
    }
    return status;
}

/* Adds the lights and the camera. */
static int add_surroundings(struct kiln_glb *glb, double half, struct kiln_error *error)
{
    struct kiln_glb_placement sun = {.translation = {0, 0, 0}};
    kiln_generate_look(dvec3(-0.5, -1, -0.3), sun.rotation);
    int status;
    KILN_TRY(kiln_glb_add_sun(glb, "sun", (const double[3]){1, 0.95, 0.88}, 4, &sun, error));
    KILN_TRY(kiln_glb_set_environment(glb, (const double[3]){0.3, 0.4, 0.6}, error));
    KILN_TRY(kiln_generate_camera(glb, dvec3(half * 0.9, 40 + half * 0.3, half * 1.3), dvec3(0, 5, 0), 0.66, 4.0 / 3,
                                  error));
end:
    return status;
}

/* Chooses the houses of the part. */
static int choose_part(struct city *city, const struct kiln_generate_params *params, struct kiln_error *error)
{
    const uint64_t houses = (uint64_t)city->side * city->side, parts = params->parts > 0 ? params->parts : 1;
    if (parts > houses)
        return kiln_fail(error, KILN_USAGE,
                         "--parts %llu: the city has %llu houses; ask for more triangles or fewer parts",
                         (unsigned long long)parts, (unsigned long long)houses);
    city->first = houses * params->part / parts;
    city->end = houses * (params->part + 1) / parts;
    return KILN_OK;
}

int kiln_generate_city(struct kiln_glb *glb, const struct kiln_generator *self,
                       const struct kiln_generate_params *params, struct kiln_error *error)
{
    const uint64_t triangles = params->triangles > 0 ? params->triangles : 100000;
    struct city city = {.distinct = params->distinct};
    struct kiln_palette palette = {.table = table};
    uint32_t *meshes = NULL;
    int status;
    if (triangles < 1000 || triangles > 1000000000)
        return kiln_fail(error, KILN_USAGE, "--triangles %llu is out of range; a city has from 1000 to 1000000000",
                         (unsigned long long)triangles);
    KILN_TRY(plan(&city, triangles, params->seed, error));
    KILN_TRY(choose_part(&city, params, error));
    KILN_TRY(kiln_allocate(&meshes, city.kind_count, sizeof *meshes, "the kinds of house", error));
    const double half = 0.5 * city.side * PITCH + 6;
    KILN_TRY(add_kinds(glb, &city, params->seed, &palette, meshes, error));
    if (params->part == 0)
        KILN_TRY(add_ground(glb, half, &palette, error));
    KILN_TRY(add_houses(glb, &city, params->seed, meshes, error));
    if (params->part == 0)
        KILN_TRY(add_surroundings(glb, half, error));
    KILN_TRY(kiln_glb_set_note(glb, self->description, error));
end:
    kiln_free(&meshes);
    kiln_free(&city.kinds);
    return status;
}
