#include "coordinator/view/seen.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/output/read/rows.h"
#include "coordinator/view/texel_place.h"
#include "worker/backend/backend.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/light/lights.h"

#define NEAR 1e-4f /* relative margin at both ends of a ray between points; hits there are the points' own surfaces */

enum kind { SEEN_YES, SEEN_HIDDEN, SEEN_TURNED, SEEN_TEXEL, SEEN_KINDS };
static const struct {
    const char *word;
    float rgb[3];
} kinds[SEEN_KINDS] = {[SEEN_YES] = {"seen", {1.0f, 1.0f, 1.0f}},
                       [SEEN_HIDDEN] = {"hidden", {0.02f, 0.08f, 0.3f}},
                       [SEEN_TURNED] = {"turned away", {0.03f, 0.03f, 0.03f}},
                       [SEEN_TEXEL] = {"the texel", {1.0f, 0.3f, 0.0f}}};

/* The points of kiln.h5; side NULL: all are fronts. */
struct points {
    struct kiln_image *image;
    uint32_t count;
    const float *at[3], *normal[3], *object, *x, *y, *valid, *area, *side;
};

static int read_points(struct points *p, struct kiln_results *results, struct kiln_error *error)
{
    static const char *const datasets[] = {"/points/position", "/points/normal", "/points/object", "/points/texel",
                                           "/points/valid",    "/points/area",   "/points/side"};
    enum { ALL = sizeof datasets / sizeof *datasets };
    int status = kiln_results_image(results, "kiln.h5", datasets, ALL, &p->image, error);
    if (status == KILN_NO_INPUT) /* without backs */
        status = kiln_results_image(results, "kiln.h5", datasets, ALL - 1, &p->image, error);
    if (status != KILN_OK)
        return status;
    p->count = p->image->width;
    bool found = true;
    for (unsigned c = 0; c < 3; c++) {
        p->at[c] = kiln_dataset_of(p->image, datasets[0], c);
        p->normal[c] = kiln_dataset_of(p->image, datasets[1], c);
        found = found && p->at[c] != NULL && p->normal[c] != NULL;
    }
    p->object = kiln_dataset_of(p->image, datasets[2], 0);
    p->x = kiln_dataset_of(p->image, datasets[3], 0);
    p->y = kiln_dataset_of(p->image, datasets[3], 1);
    p->valid = kiln_dataset_of(p->image, datasets[4], 0);
    p->area = kiln_dataset_of(p->image, datasets[5], 0);
    p->side = kiln_dataset_of(p->image, datasets[6], 0);
    found = found && p->object != NULL && p->x != NULL && p->y != NULL && p->valid != NULL && p->area != NULL;
    return found ? KILN_OK : kiln_fail(error, KILN_BAD_INPUT, "kiln.h5 does not say where points lie; bake again");
}

static bool is_front(const struct points *p, uint32_t i) { return p->side == NULL || !(p->side[i] > 0.0f); }

/* From the scene's centre, m. */
static struct kiln_vec3 place_of(const struct points *p, const struct kiln_scene *scene, uint32_t i)
{
    const double *centre = scene->header->centre;
    return vec3((float)((double)p->at[0][i] - centre[0]), (float)((double)p->at[1][i] - centre[1]),
                (float)((double)p->at[2][i] - centre[2]));
}

static struct kiln_vec3 normal_of(const struct points *p, uint32_t i)
{
    return vec3(p->normal[0][i], p->normal[1][i], p->normal[2][i]);
}

/* ---- the texel ---- */

static int find_texel(const struct points *p, const struct kiln_scene *scene, const char *texel, uint32_t *point,
                      struct kiln_error *error)
{
    struct kiln_texel_place at;
    const int status = kiln_texel_place_read(&at, scene, texel, error);
    if (status != KILN_OK)
        return status;
    for (*point = 0; *point < p->count; ++*point)
        if ((uint32_t)p->object[*point] == at.object && p->x[*point] == (float)at.x && p->y[*point] == (float)at.y &&
            is_front(p, *point))
            return KILN_OK;
    return kiln_texel_place_refuse(texel, error);
}

/* Chooses, of the object with most surface, the point nearest to the middle of its points. */
static int choose_texel(const struct points *p, const struct kiln_scene *scene, uint32_t *point,
                        struct kiln_error *error)
{
    double *sums = NULL, least = INFINITY;
    uint32_t best = 0;
    int status = kiln_allocate(&sums, 4 * ((size_t)scene->object_count + 1), sizeof *sums, "the objects", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t i = 0; i < p->count; i++) {
        const uint32_t object = (uint32_t)p->object[i];
        if (object >= scene->object_count || !(p->valid[i] > 0.0f) || !is_front(p, i))
            continue;
        sums[4 * object + 3] += (double)p->area[i];
        for (uint32_t c = 0; c < 3; c++)
            sums[4 * object + c] += (double)p->area[i] * (double)p->at[c][i];
        best = sums[4 * object + 3] > sums[4 * best + 3] ? object : best;
    }
    for (uint32_t i = 0; i < p->count; i++) {
        double square = 0.0;
        for (uint32_t c = 0; c < 3; c++) {
            const double off = (double)p->at[c][i] - sums[4 * best + c] / sums[4 * best + 3];
            square += off * off;
        }
        if ((uint32_t)p->object[i] == best && p->valid[i] > 0.0f && is_front(p, i) && square < least) {
            least = square;
            *point = i;
        }
    }
    kiln_free(&sums);
    return least < INFINITY ? KILN_OK : kiln_fail(error, KILN_BAD_INPUT, "kiln.h5 has no point that has light");
}

/* ---- what it sees ---- */

/* Rays from a point to the points that face it. */
struct looks {
    uint32_t count, *to;
    struct kiln_vec3 *origins, *directions;
    float *distances;
    struct kiln_hit *hits;
    struct kiln_arena arena;
};

static int make_looks(struct looks *l, const struct points *p, const struct kiln_scene *scene, uint32_t from,
                      struct kiln_error *error)
{
    static const char what[] = "what a texel sees";
    const struct kiln_vec3 at = place_of(p, scene, from), n = normal_of(p, from);
    int status;
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->to, p->count, sizeof *l->to, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->origins, p->count, sizeof *l->origins, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->directions, p->count, sizeof *l->directions, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->distances, p->count, sizeof *l->distances, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->hits, p->count, sizeof *l->hits, what, error));
    for (uint32_t i = 0; i < p->count; i++) {
        const struct kiln_vec3 d = vec3_sub(place_of(p, scene, i), at);
        const float distance = vec3_length(d), flat = NEAR * distance;
        if (i == from || !(p->valid[i] > 0.0f) || !(vec3_dot(n, d) > flat) || !(vec3_dot(normal_of(p, i), d) < -flat))
            continue;
        l->to[l->count] = i;
        l->directions[l->count] = vec3_scale(d, 1.0f / distance);
        l->origins[l->count] = vec3_madd(at, d, NEAR);
        l->distances[l->count++] = (1.0f - 2.0f * NEAR) * distance;
    }
end:
    return status;
}

static int trace(struct looks *l, const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                 struct kiln_error *error)
{
    struct kiln_backend *backend = NULL;
    struct kiln_lights *lights = NULL;
    int status = kiln_lights_create(&lights, scene, geometry, error);
    const struct kiln_backend_params params = {.scene = scene, .geometry = geometry, .lights = lights, .threads = 1};
    if (status == KILN_OK)
        status = kiln_backend_create(&backend, "embree", &params, error);
    if (status == KILN_OK && l->count > 0)
        status = kiln_backend_intersect(backend, l->origins, l->directions, l->count, l->hits, error);
    kiln_backend_destroy(&backend);
    kiln_lights_destroy(&lights);
    return status;
}

/* SEEN_KINDS: none of them. */
static void color_point(struct kiln_seen *seen, uint32_t i, enum kind kind)
{
    for (uint32_t c = 0; c < 3; c++)
        seen->color[(size_t)c * seen->points + i] = kind < SEEN_KINDS ? kinds[kind].rgb[c] : NAN;
}

static void count(struct kiln_seen *seen, const struct looks *l, const struct points *p, const struct kiln_scene *scene,
                  uint32_t from, const struct kiln_voxels *voxels)
{
    const struct kiln_vec3 at = place_of(p, scene, from), n = normal_of(p, from);
    for (uint32_t i = 0; i < p->count; i++)
        color_point(seen, i, i == from ? SEEN_TEXEL : p->valid[i] > 0.0f ? SEEN_TURNED : SEEN_KINDS);
    seen->facing = l->count;
    for (uint32_t k = 0; k < l->count; k++) {
        const uint32_t i = l->to[k];
        const bool by_ray = l->hits[k].triangle == KILN_NONE || l->hits[k].distance >= l->distances[k],
                   by_voxels =
                       voxels != NULL && kiln_voxels_open(voxels, at, n, place_of(p, scene, i), normal_of(p, i));
        seen->by_rays += by_ray;
        seen->by_voxels += by_voxels;
        seen->by_both += by_ray && by_voxels;
        color_point(seen, i, (voxels != NULL ? by_voxels : by_ray) ? SEEN_YES : SEEN_HIDDEN);
    }
}

int kiln_seen_find(struct kiln_seen *seen, struct kiln_results *results, const struct kiln_scene *scene,
                   const struct kiln_geometry *geometry, const char *texel, const struct kiln_voxels *voxels,
                   struct kiln_error *error)
{
    struct points p = {.image = NULL};
    struct looks l = {.count = 0};
    uint32_t from = 0;
    *seen = (struct kiln_seen){.color = NULL};
    int status;
    KILN_TRY(read_points(&p, results, error));
    KILN_TRY(texel != NULL ? find_texel(&p, scene, texel, &from, error) : choose_texel(&p, scene, &from, error));
    KILN_TRY(make_looks(&l, &p, scene, from, error));
    KILN_TRY(trace(&l, scene, geometry, error));
    KILN_TRY(kiln_allocate(&seen->color, 3 * (size_t)p.count, sizeof *seen->color, "what a texel sees", error));
    seen->points = p.count;
    (void)snprintf(seen->texel, sizeof seen->texel, "%.70s,%.0f,%.0f",
                   kiln_scene_string(scene, scene->objects[(uint32_t)p.object[from]].name), (double)p.x[from],
                   (double)p.y[from]);
    count(seen, &l, &p, scene, from, voxels);
end:
    kiln_arena_release(&l.arena);
    kiln_image_destroy(&p.image);
    return status;
}

void kiln_seen_release(struct kiln_seen *seen) { kiln_free(&seen->color); }

void kiln_seen_key(struct kiln_color_key *key)
{
    *key = (struct kiln_color_key){.pairs = SEEN_KINDS};
    for (int i = 0; i < SEEN_KINDS; i++) {
        (void)snprintf(key->of[i].text, sizeof key->of[i].text, "%s", kinds[i].word);
        for (int turn = 0; turn < 2; turn++)
            memcpy(key->of[i].rgb[turn], kinds[i].rgb, sizeof kinds[i].rgb);
    }
    (void)snprintf(key->note, sizeof key->note,
                   "white: seen; blue: something stands between; dark: turned away; orange: the texel itself");
}
