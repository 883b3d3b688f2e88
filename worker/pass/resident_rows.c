#include "worker/pass/resident_rows.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/color.h"
#include "shaders/shared/radiosity.h"
#include "worker/base/clones.h"
#include "worker/base/memory.h"

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
    int status = kiln_allocate(&r->weights_at, surface->tile_run_count, sizeof *r->weights_at, "kept rays", error);
    for (size_t f = 0; f < surface->tile_run_count && status == KILN_OK; f++) {
        const bool smooth = is_smooth(surface, scene, f);
        r->weights_at[f] = smooth ? floats : KILN_RESIDENT_FLAT;
        floats += smooth ? 2 * (uint64_t)surface->tile_runs[f].count * samples : 0;
    }
    if (status == KILN_OK)
        status =
            kiln_allocate(&r->rows, (size_t)(r->count * (1 + (uint64_t)samples)), sizeof *r->rows, "kept rays", error);
    if (status == KILN_OK)
        status = kiln_allocate(&r->weights, (size_t)floats, sizeof *r->weights, "the weights of kept rays", error);
    if (status == KILN_OK)
        status = kiln_allocate(&r->points, (size_t)r->count, sizeof *r->points, "kept rays", error);
    if (status == KILN_OK)
        status = kiln_allocate(&r->ready, surface->tile_run_count, sizeof *r->ready, "kept rays", error);
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

/* ---- gathering ---- */

/* What the rays of a point find under each light, in the order of the samples. */
struct sums {
    double incident[3][KILN_RESIDENT_LANES], irradiance[3][KILN_RESIDENT_LANES];
    double quarter[QUARTERS][KILN_RESIDENT_LANES];
};

static inline uint32_t place_of(uint32_t word) { return word < KILN_ROW_POINTS ? word : 0; }

/* Adds one ray. `seen`: it has met a surface point; else it counts with 0. `weight`: NULL: both are 1. */
static inline __attribute__((always_inline)) void add_ray(struct sums *restrict s, double *restrict quarter,
                                                          const uint64_t *restrict radiosity, bool seen,
                                                          const float *restrict weight, const uint32_t lanes)
{
    const uint64_t mask = seen ? UINT64_MAX : 0;
    const float facet = weight != NULL ? weight[0] : 1.0f, shading = weight != NULL ? weight[1] : 1.0f;
    for (uint32_t i = 0; i < lanes; i++) {
        const uint64_t packed = radiosity[i] & mask;
        const uint32_t low = (uint32_t)packed, high = (uint32_t)(packed >> 32);
        const uint32_t bits[3] = {kiln_radiosity_red(low), kiln_radiosity_green(low, high), kiln_radiosity_blue(high)};
        float rgb[3];
        memcpy(rgb, bits, sizeof rgb);
        for (int c = 0; c < 3; c++) {
            s->incident[c][i] += (double)(facet * rgb[c]);
            if (weight != NULL)
                s->irradiance[c][i] += (double)(shading * rgb[c]);
        }
        quarter[i] += (double)(shading * kiln_luminance_in_float(rgb));
    }
}

enum { AHEAD = 12 }; /* rays: so far ahead radiosity is fetched */

static inline __attribute__((always_inline)) void sum_row(struct sums *restrict s, const uint32_t *restrict words,
                                                          const float *restrict weights, uint32_t samples,
                                                          const uint64_t *restrict radiosity, const uint32_t lanes)
{
    uint32_t k = 0;
    memset(s, 0, sizeof *s);
    for (uint32_t q = 0; q < QUARTERS; q++) {
        const uint32_t end = (uint32_t)(((uint64_t)(q + 1) * samples + QUARTERS - 1) / QUARTERS);
        for (; k < end; k++) {
            const uint32_t ahead = words[k + AHEAD < samples ? k + AHEAD : k];
            __builtin_prefetch(&radiosity[(uint64_t)place_of(ahead) * lanes]);
            add_ray(s, s->quarter[q], &radiosity[(uint64_t)place_of(words[k]) * lanes], words[k] < KILN_ROW_POINTS,
                    weights != NULL ? weights + 2 * (size_t)k : NULL, lanes);
        }
    }
}

KILN_CLONES static void sum_flat_1(struct sums *s, const uint32_t *words, uint32_t n, const uint64_t *radiosity)
{
    sum_row(s, words, NULL, n, radiosity, 1);
}
KILN_CLONES static void sum_flat_2(struct sums *s, const uint32_t *words, uint32_t n, const uint64_t *radiosity)
{
    sum_row(s, words, NULL, n, radiosity, 2);
}
KILN_CLONES static void sum_flat_4(struct sums *s, const uint32_t *words, uint32_t n, const uint64_t *radiosity)
{
    sum_row(s, words, NULL, n, radiosity, 4);
}
KILN_CLONES static void sum_flat_8(struct sums *s, const uint32_t *words, uint32_t n, const uint64_t *radiosity)
{
    sum_row(s, words, NULL, n, radiosity, 8);
}
KILN_CLONES static void sum_smooth(struct sums *s, const uint32_t *words, const float *weights, uint32_t n,
                                   const uint64_t *radiosity, uint32_t lanes)
{
    if (lanes == 1)
        sum_row(s, words, weights, n, radiosity, 1);
    else if (lanes == 2)
        sum_row(s, words, weights, n, radiosity, 2);
    else if (lanes == 4)
        sum_row(s, words, weights, n, radiosity, 4);
    else
        sum_row(s, words, weights, n, radiosity, 8);
}

static void sum_flat(struct sums *s, const uint32_t *words, uint32_t samples, const uint64_t *radiosity, uint32_t lanes)
{
    if (lanes == 1)
        sum_flat_1(s, words, samples, radiosity);
    else if (lanes == 2)
        sum_flat_2(s, words, samples, radiosity);
    else if (lanes == 4)
        sum_flat_4(s, words, samples, radiosity);
    else
        sum_flat_8(s, words, samples, radiosity);
}

/* As the Embree backend's rays_quarters_error: standard error of the sum, of the means of its quarters. */
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

static void store(const struct sums *s, const struct kiln_resident_point *point, bool smooth, uint32_t lane,
                  struct kiln_point_result *r)
{
    *r = (struct kiln_point_result){
        .escaped = point->escaped, .blocked = point->blocked, .present = point->present, .count = point->count};
    for (int c = 0; c < 3; c++) {
        r->incident[c] = (float)s->incident[c][lane];
        r->irradiance[c] = smooth ? (float)s->irradiance[c][lane] : r->incident[c];
    }
    r->error = error_of(s, lane, point->count);
}

void kiln_resident_gather(const struct kiln_resident_rows *r, const struct kiln_tile_run *run, size_t number,
                          const uint64_t *radiosity, uint32_t lanes, struct kiln_point_result *const results[])
{
    const uint64_t first = run->first.at - r->first, at = r->weights_at[number];
    const bool smooth = at != KILN_RESIDENT_FLAT;
    struct sums s;
    for (uint32_t k = 0; k < run->count; k++) {
        const struct kiln_resident_point *point = &r->points[first + k];
        const uint32_t *words = kiln_resident_row(r, first + k) + 1;
        if (point->count > 0 && smooth)
            sum_smooth(&s, words, r->weights + at + 2 * (uint64_t)k * r->samples, point->count, radiosity, lanes);
        else if (point->count > 0)
            sum_flat(&s, words, point->count, radiosity, lanes);
        else
            memset(&s, 0, sizeof s);
        for (uint32_t i = 0; i < lanes && results[i] != NULL; i++)
            store(&s, point, smooth, i, &results[i][k]);
    }
}
