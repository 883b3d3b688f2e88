#include "worker/pass/resident_rows.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/color.h"
#include "worker/base/clones.h"
#include "worker/base/memory.h"
#include "worker/scene/radiosity.h"

enum { QUARTERS = 4 };

/* ---- memory ---- */

static bool is_smooth(const struct kiln_surface *surface, const struct kiln_scene *scene, size_t tile_run)
{
    const uint32_t object = kiln_map_object(surface, surface->tile_runs[tile_run].map);
    return (scene->meshes[scene->objects[object].mesh].flags & KILN_MESH_SMOOTH) != 0;
}

int kiln_resident_rows_create(struct kiln_resident_rows *r, const struct kiln_surface *surface,
                              const struct kiln_scene *scene, uint32_t samples, struct kiln_error *error)
{
    uint64_t floats = 0;
    *r = (struct kiln_resident_rows){.first = surface->first.at, .count = surface->count, .samples = samples};
    int status;
    KILN_TRY(kiln_allocate(&r->weights_at, surface->tile_run_count, sizeof *r->weights_at, "kept rays", error));
    for (size_t f = 0; f < surface->tile_run_count; f++) {
        const bool smooth = is_smooth(surface, scene, f);
        r->weights_at[f] = smooth ? floats : KILN_RESIDENT_FLAT;
        floats += smooth ? 2 * (uint64_t)surface->tile_runs[f].count * samples : 0;
    }
    KILN_TRY(
        kiln_allocate(&r->rows, (size_t)(r->count * (1 + (uint64_t)samples)), sizeof *r->rows, "kept rays", error));
    KILN_TRY(kiln_allocate(&r->weights, (size_t)floats, sizeof *r->weights, "the weights of kept rays", error));
    KILN_TRY(kiln_allocate(&r->points, (size_t)r->count, sizeof *r->points, "kept rays", error));
    KILN_TRY(kiln_allocate(&r->ready, surface->tile_run_count, sizeof *r->ready, "kept rays", error));
end:
    return status;
}

void kiln_resident_rows_release(struct kiln_resident_rows *r)
{
    kiln_free(&r->rows);
    kiln_free(&r->weights);
    kiln_free(&r->weights_at);
    kiln_free(&r->points);
    kiln_free(&r->ready);
}

uint64_t kiln_resident_rows_bytes(const struct kiln_resident_rows *r, size_t tile_runs)
{
    const uint64_t row = kiln_rows_row_bytes(r->samples) + sizeof *r->points;
    uint64_t smooth = 0;
    for (size_t f = 0; f < tile_runs; f++)
        if (r->weights_at[f] != KILN_RESIDENT_FLAT)
            smooth = r->weights_at[f];
    return r->count * row + smooth * sizeof *r->weights;
}

void kiln_resident_take(const struct kiln_resident_rows *r, const struct kiln_surface *surface, size_t tile_run,
                        const struct kiln_point_result *results)
{
    const struct kiln_tile_run *run = &surface->tile_runs[tile_run];
    struct kiln_resident_point *points = r->points + (run->first.at - r->first);
    for (uint32_t k = 0; k < run->count; k++)
        points[k] =
            (struct kiln_resident_point){results[k].escaped, results[k].blocked, results[k].present, results[k].count};
    r->ready[tile_run] = 1;
}

/* ---- light ---- */

void kiln_resident_light(const uint64_t *radiosity, uint64_t points, uint32_t lane, uint32_t lanes, float *light)
{
    float *to = light + lane;
    for (uint64_t i = 0; i < points; i++, to += 4 * (size_t)lanes) {
        float rgb[3];
        kiln_radiosity_unpack(radiosity[i], rgb);
        for (size_t c = 0; c < 3; c++)
            to[c * lanes] = rgb[c];
        to[3 * (size_t)lanes] = kiln_luminance_in_float(rgb);
    }
    for (size_t c = 0; c < 4; c++)
        to[c * lanes] = 0.0f;
}

/* ---- gathering ---- */

typedef float floats __attribute__((vector_size(16)));
typedef double doubles __attribute__((vector_size(32)));

/* Light that a point's rays find: for each light red, green and blue, as incident light and as irradiance; and the
 * luminance of irradiance by quarters of the samples. */
struct sums {
    double incident[3 * KILN_RESIDENT_LANES], irradiance[3 * KILN_RESIDENT_LANES];
    double quarter[QUARTERS][KILN_RESIDENT_LANES];
};

/* Index of the radiosity for a ray's hit; entries beyond the points are 0. */
static inline uint64_t place_of(uint32_t word, uint64_t points) { return word < KILN_ROW_POINTS ? word : points; }

static inline floats load(const float *from)
{
    floats value;
    memcpy(&value, from, sizeof value);
    return value;
}

/* Converts element by element, which compilers turn into one instruction; for __builtin_convertvector some emit
 * several. */
#define WIDEN(v) ((doubles){(double)(v)[0], (double)(v)[1], (double)(v)[2], (double)(v)[3]})

enum { AHEAD = 12 }; /* prefetch distance of radiosity, in rays */

/* Sums up samples in order, as the gather pass does: groups of 4 adjacent floats. The last `lanes` groups are
 * luminance, which is subtracted at the end of each quarter. `weights`: NULL: all are 1. */
static inline __attribute__((always_inline)) void sum_row(struct sums *restrict s, const uint32_t *restrict words,
                                                          const float *restrict weights, uint32_t samples,
                                                          const float *restrict light, uint64_t points,
                                                          const uint32_t lanes)
{
    doubles facet[KILN_RESIDENT_LANES], shading[KILN_RESIDENT_LANES];
    uint32_t k = 0;
#pragma GCC unroll 8
    for (uint32_t i = 0; i < lanes; i++)
        facet[i] = shading[i] = (doubles){0.0, 0.0, 0.0, 0.0};
    for (uint32_t q = 0; q < QUARTERS; q++) {
        const uint32_t end = (uint32_t)(((uint64_t)(q + 1) * samples + QUARTERS - 1) / QUARTERS);
        for (; k < end; k++) {
            const uint32_t ahead = words[k + AHEAD < samples ? k + AHEAD : k];
            const float *far = light + 4 * lanes * place_of(ahead, points);
            const float *from = light + 4 * lanes * place_of(words[k], points);
            __builtin_prefetch(far);
            if (lanes > 4)
                __builtin_prefetch(far + 16);
#pragma GCC unroll 8
            for (uint32_t i = 0; i < lanes; i++) {
                const floats value = load(from + 4 * (size_t)i);
                if (weights == NULL) {
                    facet[i] += WIDEN(value);
                } else {
                    const floats incident = value * weights[2 * (size_t)k],
                                 irradiance = value * weights[2 * (size_t)k + 1];
                    facet[i] += WIDEN(incident);
                    shading[i] += WIDEN(irradiance);
                }
            }
        }
        double all[4 * KILN_RESIDENT_LANES];
        doubles *sum = weights == NULL ? facet : shading;
        memcpy(all, sum, lanes * sizeof *sum);
        for (uint32_t i = 0; i < lanes; i++) {
            s->quarter[q][i] = all[3 * lanes + i];
            all[3 * lanes + i] = 0.0;
        }
        memcpy(sum, all, lanes * sizeof *sum);
    }
    memcpy(s->incident, facet, 3 * lanes * sizeof *s->incident);
    memcpy(s->irradiance, weights == NULL ? facet : shading, 3 * lanes * sizeof *s->irradiance);
}

#define SUM_FUNCTIONS(lanes)                                                                                           \
    KILN_CLONES static void sum_flat_##lanes(struct sums *s, const uint32_t *words, uint32_t samples,                  \
                                             const float *light, uint64_t points)                                      \
    {                                                                                                                  \
        sum_row(s, words, NULL, samples, light, points, lanes);                                                        \
    }                                                                                                                  \
    KILN_CLONES static void sum_smooth_##lanes(struct sums *s, const uint32_t *words, const float *weights,            \
                                               uint32_t samples, const float *light, uint64_t points)                  \
    {                                                                                                                  \
        sum_row(s, words, weights, samples, light, points, lanes);                                                     \
    }
SUM_FUNCTIONS(1)
SUM_FUNCTIONS(2)
SUM_FUNCTIONS(4)
SUM_FUNCTIONS(8)

static void sum_flat(struct sums *s, const uint32_t *words, uint32_t samples, const float *light, uint64_t points,
                     uint32_t lanes)
{
    if (lanes == 1)
        sum_flat_1(s, words, samples, light, points);
    else if (lanes == 2)
        sum_flat_2(s, words, samples, light, points);
    else if (lanes == 4)
        sum_flat_4(s, words, samples, light, points);
    else
        sum_flat_8(s, words, samples, light, points);
}

static void sum_smooth(struct sums *s, const uint32_t *words, const float *weights, uint32_t samples,
                       const float *light, uint64_t points, uint32_t lanes)
{
    if (lanes == 1)
        sum_smooth_1(s, words, weights, samples, light, points);
    else if (lanes == 2)
        sum_smooth_2(s, words, weights, samples, light, points);
    else if (lanes == 4)
        sum_smooth_4(s, words, weights, samples, light, points);
    else
        sum_smooth_8(s, words, weights, samples, light, points);
}

/* Standard error of the sum, from the means of its quarters: as the Embree backend's rays_quarters_error. */
static float error_of(const struct sums *s, uint32_t lane, uint32_t samples)
{
    if (samples < QUARTERS)
        return 0.0f;
    double mean = 0.0, square = 0.0, value[QUARTERS];
    for (int i = 0; i < QUARTERS; i++) {
        value[i] = s->quarter[i][lane] * QUARTERS / samples;
        mean += value[i] / QUARTERS;
    }
    for (int i = 0; i < QUARTERS; i++)
        square += (value[i] - mean) * (value[i] - mean);
    return (float)(samples * sqrt(square / (QUARTERS * (QUARTERS - 1))));
}

static void store(const struct sums *s, const struct kiln_resident_point *point, uint32_t lane, uint32_t lanes,
                  struct kiln_point_result *r)
{
    *r = (struct kiln_point_result){
        .escaped = point->escaped, .blocked = point->blocked, .present = point->present, .count = point->count};
    for (uint32_t c = 0; c < 3; c++) {
        r->incident[c] = (float)s->incident[c * lanes + lane];
        r->irradiance[c] = (float)s->irradiance[c * lanes + lane];
    }
    r->error = error_of(s, lane, point->count);
}

void kiln_resident_gather(const struct kiln_resident_rows *r, const struct kiln_tile_run *run, size_t number,
                          const float *light, uint64_t points, uint32_t lanes,
                          struct kiln_point_result *const results[])
{
    const uint64_t first = run->first.at - r->first, at = r->weights_at[number];
    struct sums s;
    for (uint32_t k = 0; k < run->count; k++) {
        const struct kiln_resident_point *point = &r->points[first + k];
        const uint32_t *words = kiln_resident_row(r, first + k) + 1;
        if (point->count == 0)
            memset(&s, 0, sizeof s);
        else if (at == KILN_RESIDENT_FLAT)
            sum_flat(&s, words, point->count, light, points, lanes);
        else
            sum_smooth(&s, words, r->weights + at + 2 * (uint64_t)k * r->samples, point->count, light, points, lanes);
        for (uint32_t i = 0; i < lanes && results[i] != NULL; i++)
            store(&s, point, i, lanes, &results[i][k]);
    }
}
