/* The shapes pass (worker/pass/shapes.h). */
#include "worker/pass/shapes.h"

#include <math.h>

#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/scene/texture.h"

enum { SIDE = 8, PLACES = SIDE * SIDE };

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)b, (void)parameters, (void)part;
    struct tile_run_frame *frame = NULL;
    const int status = kiln_allocate(&frame, 1, sizeof *frame, "the shapes of patches", error);
    *work = frame;
    return status;
}

static void work_destroy(void **work) { kiln_free(work); }

static float number(uint32_t i) { return ((float)i + 0.5f) / SIDE; }

/* Mean radiance of the point's texel. */
static void find_emission(const struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, float emission[3])
{
    const struct kiln_scene *scene = b->params.scene;
    const struct kiln_geometry *g = b->params.geometry;
    for (uint32_t i = 0; i < PLACES; i++) {
        uint32_t triangle;
        float b1, b2, s1, s2, rgb[3];
        kiln_footprint_sample(&f->footprint[j], number(i % SIDE), number(i / SIDE), &triangle, &b1, &b2);
        kiln_geometry_stored_barycentrics(scene, g, triangle, b1, b2, &s1, &s2);
        kiln_surface_emission(scene, &scene->meshes[scene->objects[g->records[triangle].object].mesh],
                              g->stored_triangle[triangle], s1, s2, rgb);
        for (int c = 0; c < 3; c++)
            emission[c] += (float)(KILN_PI / PLACES) * rgb[c];
    }
}

/* Positions on the point, and the one nearest to their mean: the place. */
static void find_place(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j,
                       struct kiln_vec3 at[PLACES], struct kiln_patch *patch)
{
    struct kiln_vec3 normal[PLACES], mean = vec3(0.0f, 0.0f, 0.0f);
    float least = INFINITY;
    for (uint32_t i = 0; i < PLACES; i++) {
        (void)frame_position(f, b, j, number(i % SIDE), number(i / SIDE), &at[i], &normal[i]);
        mean = vec3_madd(mean, at[i], 1.0f / PLACES);
    }
    for (uint32_t i = 0; i < PLACES; i++) {
        const float distance = vec3_length(vec3_sub(at[i], mean));
        if (!(distance < least))
            continue;
        least = distance;
        patch->place = at[i];
        patch->normal = normal[i];
    }
}

/* The rectangle in the place's plane with the proportions of the positions' covariance. */
static void find_rectangle(const struct kiln_vec3 at[PLACES], struct kiln_patch *patch)
{
    const struct kiln_vec3 n = patch->normal,
                           side = fabsf(n.x) < 0.5f ? vec3(1.0f, 0.0f, 0.0f) : vec3(0.0f, 1.0f, 0.0f),
                           u = vec3_normalize(vec3_cross(n, side)), v = vec3_cross(n, u);
    double sum[2] = {0.0}, square[3] = {0.0};
    for (uint32_t i = 0; i < PLACES; i++) {
        const struct kiln_vec3 d = vec3_sub(at[i], patch->place);
        const double x = (double)vec3_dot(d, u), y = (double)vec3_dot(d, v);
        sum[0] += x / PLACES, sum[1] += y / PLACES;
        square[0] += x * x / PLACES, square[1] += x * y / PLACES, square[2] += y * y / PLACES;
    }
    const double xx = square[0] - sum[0] * sum[0], xy = square[1] - sum[0] * sum[1], yy = square[2] - sum[1] * sum[1],
                 turn = 0.5 * atan2(2.0 * xy, xx - yy), middle = 0.5 * (xx + yy), spread = hypot(0.5 * (xx - yy), xy),
                 longer = sqrt(middle + spread), shorter = sqrt(fmax(middle - spread, 0.0));
    /* positions in a line, or in one place, tell of no proportions */
    const double ratio = shorter > 0.01 * longer && longer > 0.0 ? sqrt(longer / shorter) : 1.0;
    const double length = sqrt((double)patch->area);
    const struct kiln_vec3 along = vec3_madd(vec3_scale(u, (float)cos(turn)), v, (float)sin(turn));
    patch->edge_s = vec3_scale(along, (float)(length * ratio));
    patch->edge_t = vec3_scale(vec3_cross(n, along), (float)(length / ratio));
}

static void find_shape(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, double area,
                       struct kiln_patch *patch)
{
    struct kiln_vec3 at[PLACES];
    patch->area = (float)area;
    if (!f->whole[j]) {
        find_place(f, b, j, at, patch);
        find_rectangle(at, patch);
        return;
    }
    (void)frame_position(f, b, j, 0.5f, 0.5f, &patch->place, &patch->normal);
    patch->edge_s = vec3(f->edge_s[0][j], f->edge_s[1][j], f->edge_s[2][j]);
    patch->edge_t = vec3(f->edge_t[0][j], f->edge_t[1][j], f->edge_t[2][j]);
}

static void shapes_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                            void *results, uint64_t *rays)
{
    (void)context, (void)rays;
    struct tile_run_frame *f = work;
    const struct kiln_surface *s = b->surface;
    const struct kiln_tile_run *run = &s->tile_runs[tile_run];
    const bool is_met = (b->params.scene->objects[kiln_map_object(s, run->map)].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
    frame_build(f, b, tile_run, UINT64_MAX, 0);
    for (uint32_t j = 0; j < f->count; j++) {
        struct kiln_shape_result *r = (struct kiln_shape_result *)results + f->place[j];
        const struct kiln_own_point own = {kiln_own_of_global(s, run->first).at + f->place[j]};
        find_shape(f, b, j, kiln_lit_area(s, own, f->present[j]), &r->patch);
        if (!is_met)
            r->patch.area = 0.0f;
        find_emission(f, b, j, r->emission);
    }
}

int embree_shapes(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, shapes_tile_run,
                                              sizeof(struct kiln_shape_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
