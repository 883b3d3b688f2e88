#include "worker/backend/embree/kept_rows.h"

#include <errno.h>
#include <string.h>

#include "shaders/shared/color.h"
#include "worker/base/memory.h"
#include "worker/pass/resident_rows.h"
#include "worker/scene/radiosity.h"

int kept_rows_create(struct kept_rows *kept, const struct embree_backend *b, const struct kiln_batch *part,
                     struct kiln_error *error)
{
    const bool goes_on = embree_tints(b) || b->lobes != NULL;
    *kept = (struct kept_rows){0};
    if (b->base.given.rows == NULL || b->probes != NULL || (goes_on && b->base.given.rows->chains == NULL) ||
        part->samples > b->base.given.rows->samples)
        return KILN_OK;
    kept->rows = b->base.given.rows;
    kept->chains.file = kept->rows->chains;
    kept->samples = part->samples;
    return kiln_allocate(&kept->words, RAY_LANES * (1 + (size_t)part->samples), sizeof *kept->words,
                         "the rows of a tile run", error);
}

void kept_rows_release(struct kept_rows *kept)
{
    kiln_free(&kept->words);
    kept_chains_release(&kept->chains);
}

/* Number of points from j on, of `total`, that are consecutive in the global order. */
static uint32_t stretch_of(const uint32_t *place, uint32_t total, uint32_t j)
{
    uint32_t count = 1;
    while (j + count < total && place[j + count] == place[j] + count)
        count++;
    return count;
}

static uint32_t *row_of(const struct kept_rows *kept, uint32_t j) { return kept->words + j * (1 + kept->samples); }

static uint64_t first_of(const struct embree_backend *b, size_t tile_run)
{
    return b->surface->tile_runs[tile_run].first.at;
}

/* ---- reading ---- */

/* Reads the chains of rays in the rows; records damage. */
static bool read_chains(struct kept_rows *kept, const struct embree_backend *b, uint64_t first, const uint32_t *place,
                        uint32_t points)
{
    struct kiln_rows *r = kept->rows;
    if (kept->chains.file == NULL)
        return true;
    const int found = kept_chains_read(&kept->chains, first, place, points);
    bool whole = found > 0;
    if (found == 0 && errno != 0)
        kiln_rows_fail(r, KILN_IO, "read the chains beside", 0);
    if (found < 0)
        kiln_rows_fail(r, KILN_BAD_INPUT, "without its chains", first);
    for (uint32_t j = 0; j < points && whole; j++) {
        whole = kept_chains_are_whole(&kept->chains, r->key, j, first + place[j], row_of(kept, j) + 1, kept->samples,
                                      b->surface->point_count);
        if (!whole)
            kiln_rows_fail(r, KILN_BAD_INPUT, "damaged", first + place[j]);
    }
    return whole;
}

static bool read_rows(struct kept_rows *kept, const struct embree_backend *b, size_t tile_run, const uint32_t *place,
                      uint32_t points)
{
    struct kiln_rows *r = kept->rows;
    const bool whole = kept->samples == r->samples;
    const uint64_t first = first_of(b, tile_run);
    bool there = true;
    for (uint32_t j = 0, count; j < points && there; j += count) {
        count = whole ? stretch_of(place, points, j) : 1;
        there = kiln_rows_load(r, row_of(kept, j), first + place[j], count, kept->samples);
        for (uint32_t i = j; i < j + count && there; i++)
            there = kiln_rows_there(r, row_of(kept, i), first + place[i], kept->samples, b->surface->point_count);
    }
    return there && read_chains(kept, b, first, place, points);
}

static void tally(const struct kept_rows *kept, bool there, uint32_t points)
{
    uint64_t *of = there ? &kept->rows->found : &kept->rows->traced;
    const uint64_t count = (uint64_t)points * kept->samples;
#pragma omp atomic
    *of += count;
}

bool kept_rows_read(struct kept_rows *kept, const struct embree_backend *b, size_t tile_run, const uint32_t *place,
                    uint32_t points)
{
    if (kept->rows == NULL || !kept->rows->replays)
        return false;
    const bool there = read_rows(kept, b, tile_run, place, points);
    tally(kept, there, points);
    return there;
}

void kept_rows_find(const struct kept_rows *kept, const struct embree_backend *b, const struct tile_run_rays *rays,
                    uint32_t step, uint32_t lanes, struct rays_found *found)
{
    found->count = found->escaped = found->blocked = 0;
    for (uint32_t l = 0; l < lanes; l++) {
        const uint32_t word = row_of(kept, rays->point[l])[1 + step * rays->copies + rays->copy[l]];
        if (word == KILN_ROW_ESCAPED) {
            found->escaped_lane[found->escaped++] = (uint8_t)l;
        } else if (word == KILN_ROW_BLOCKED) {
            found->blocked_lane[found->blocked++] = (uint8_t)l;
        } else {
            found->lane[found->count] = (uint8_t)l;
            found->point[found->count++] = word == KILN_ROW_NO_POINT ? KILN_NO_POINT : word;
            if (word != KILN_ROW_NO_POINT)
                __builtin_prefetch(&b->radiosity[word]);
        }
    }
}

/* ---- replaying by rows alone ---- */

static bool is_smooth(const struct embree_backend *b, size_t tile_run)
{
    const struct kiln_scene *scene = b->params.scene;
    const uint32_t object = kiln_map_object(b->surface, b->surface->tile_runs[tile_run].map);
    return (scene->meshes[scene->objects[object].mesh].flags & KILN_MESH_SMOOTH) != 0;
}

static bool is_opaque(const struct embree_backend *b, const struct kiln_point_cursor *at)
{
    const struct kiln_surface *s = b->surface; /* pieces ascend: those with alpha come last */
    return s->pieces[at->piece + kiln_piece_count(s, at->point) - 1] < b->params.geometry->opaque_count;
}

/* Whether incoming light at the point may be weighted by its material (tile_run_frame.glossy). */
static bool is_glossy(const struct embree_backend *b, const struct kiln_point_cursor *at)
{
    const struct kiln_surface *s = b->surface;
    const uint64_t end = at->piece + kiln_piece_count(s, at->point);
    bool glossy = false;
    for (uint64_t i = at->piece; i < end && b->lobes != NULL; i++)
        glossy = glossy || (b->params.geometry->records[s->pieces[i]].material & KILN_RECORD_GLOSS) != 0;
    return glossy;
}

/* Lists the tile run's valid points among `points`; false if one of them is not opaque, or is glossy. */
static bool find_points(const struct embree_backend *b, size_t tile_run, uint64_t points,
                        uint32_t place[KILN_TILE_TEXELS], uint32_t *count)
{
    const struct kiln_surface *s = b->surface;
    struct kiln_point_cursor at = kiln_point_first(s, tile_run);
    *count = 0;
    for (uint32_t k = 0; k < s->tile_runs[tile_run].count; k++, kiln_point_next(s, &at)) {
        if ((points >> k & 1u) == 0 || !kiln_point_valid(s, at.point))
            continue;
        if (!is_opaque(b, &at) || is_glossy(b, &at))
            return false;
        place[(*count)++] = k;
    }
    return true;
}

enum { AHEAD = 16 }; /* words: prefetch distance of radiosity */

static inline uint64_t radiosity_of(const uint64_t *radiosity, uint32_t word)
{
    return word < KILN_ROW_POINTS ? radiosity[word] : 0;
}

/* Sums up what the rays of a row find, all with weight 1, in the order of the gather pass. */
KILN_CLONES static void sum_row(const uint64_t *restrict radiosity, const uint32_t *restrict words, uint32_t samples,
                                struct kiln_point_result *restrict r)
{
    uint32_t escaped = 0, blocked = 0, k = 0;
    double sum[3] = {0.0, 0.0, 0.0}, quarter[RAY_QUARTERS] = {0.0};
    for (uint32_t q = 0; q < RAY_QUARTERS; q++) {
        const uint32_t end = (uint32_t)(((uint64_t)(q + 1) * samples + RAY_QUARTERS - 1) / RAY_QUARTERS);
        for (; k < end; k++) {
            float rgb[3];
            const uint32_t ahead = words[k + AHEAD < samples ? k + AHEAD : k];
            __builtin_prefetch(&radiosity[ahead < KILN_ROW_POINTS ? ahead : 0]);
            kiln_radiosity_unpack(radiosity_of(radiosity, words[k]), rgb);
            for (int c = 0; c < 3; c++)
                sum[c] += (double)rgb[c];
            quarter[q] += (double)kiln_luminance_in_float(rgb);
            escaped += words[k] == KILN_ROW_ESCAPED;
            blocked += words[k] == KILN_ROW_BLOCKED;
        }
    }
    for (int c = 0; c < 3; c++)
        r->incident[c] = r->irradiance[c] = (float)sum[c];
    r->error = rays_quarters_error(quarter, samples);
    r->escaped = (float)escaped;
    r->blocked = (float)blocked;
    r->present = 1.0f;
    r->count = samples;
}

/* As sum_row, with chains. The point's record has the shares that were lost. */
static void sum_row_with_chains(struct kept_rows *kept, const uint64_t *radiosity, uint32_t j,
                                struct kiln_point_result *r)
{
    const uint32_t *words = row_of(kept, j) + 1, samples = kept->samples;
    const struct kiln_row_chain *record = &kept->chains.record[j];
    double sum[3] = {0.0, 0.0, 0.0}, quarter[RAY_QUARTERS] = {0.0};
    for (uint32_t q = 0, k = 0; q < RAY_QUARTERS; q++) {
        const uint32_t end = (uint32_t)(((uint64_t)(q + 1) * samples + RAY_QUARTERS - 1) / RAY_QUARTERS);
        for (; k < end; k++) {
            float rgb[3];
            if (words[k] == KILN_ROW_CHAIN || words[k] == KILN_ROW_TINTED)
                kept_chains_light(&kept->chains, j, words[k] == KILN_ROW_TINTED, radiosity, rgb);
            else
                kiln_radiosity_unpack(radiosity_of(radiosity, words[k]), rgb);
            for (int c = 0; c < 3; c++)
                sum[c] += (double)rgb[c];
            quarter[q] += (double)kiln_luminance_in_float(rgb);
        }
    }
    for (int c = 0; c < 3; c++)
        r->incident[c] = r->irradiance[c] = (float)sum[c];
    r->error = rays_quarters_error(quarter, samples);
    r->escaped = record->escaped;
    r->blocked = record->blocked;
    memcpy(r->glass, record->glass, sizeof r->glass);
    memcpy(r->gloss, record->gloss, sizeof r->gloss);
    r->present = 1.0f;
    r->count = samples;
}

bool kept_rows_replay(struct kept_rows *kept, const struct embree_backend *b, const struct kiln_batch *part,
                      size_t tile_run, struct kiln_point_result *results)
{
    uint32_t place[KILN_TILE_TEXELS] = {0}, count;
    if (kept->rows == NULL || !kept->rows->replays || is_smooth(b, tile_run) ||
        !find_points(b, tile_run, kiln_batch_points(part, tile_run), place, &count) ||
        !read_rows(kept, b, tile_run, place, count))
        return false;
    for (uint32_t j = 0; j < count; j++)
        if (kept->chains.file != NULL)
            sum_row_with_chains(kept, b->radiosity, j, &results[place[j]]);
        else
            sum_row(b->radiosity, row_of(kept, j) + 1, kept->samples, &results[place[j]]);
    tally(kept, true, count);
    return true;
}

/* ---- writing ---- */

void kept_rows_note(struct kept_rows *kept, const struct tile_run_rays *rays, uint32_t step,
                    const struct rays_found *found)
{
    if (kept->rows == NULL || (kept->rows->replays && kept->rows->resident == NULL))
        return;
    uint32_t word[RAY_LANES];
    for (uint32_t i = 0; i < found->escaped; i++)
        word[found->escaped_lane[i]] = KILN_ROW_ESCAPED;
    for (uint32_t i = 0; i < found->blocked; i++)
        word[found->blocked_lane[i]] = KILN_ROW_BLOCKED;
    for (uint32_t i = 0; i < found->count; i++)
        word[found->lane[i]] = found->point[i] == KILN_NO_POINT ? KILN_ROW_NO_POINT : (uint32_t)found->point[i];
    const uint32_t lanes = found->escaped + found->blocked + found->count;
    for (uint32_t l = 0; l < lanes; l++)
        row_of(kept, rays->point[l])[1 + step * rays->copies + rays->copy[l]] = word[l];
}

void kept_rows_write(struct kept_rows *kept, const struct embree_backend *b, const struct tile_run_rays *rays,
                     size_t tile_run, const struct kiln_point_result *results)
{
    const struct tile_run_frame *f = &rays->frame;
    struct kiln_rows *r = kept->rows;
    if (r == NULL || (r->replays && r->resident == NULL))
        return;
    const uint64_t first = first_of(b, tile_run), count = (uint64_t)f->count * kept->samples;
    if (kept->chains.file != NULL && !kept_chains_write(&kept->chains, r->key, first, f, results)) {
        kiln_rows_fail(r, KILN_IO, "write the chains beside", 0);
        return;
    }
    for (uint32_t j = 0; j < f->count; j++)
        *row_of(kept, j) = kiln_rows_check(r->key, first + f->place[j], row_of(kept, j) + 1, kept->samples);
    for (uint32_t j = 0, stretch; j < f->count; j += stretch) {
        stretch = kept->samples == r->samples ? stretch_of(f->place, f->count, j) : 1;
        if (!kiln_rows_store(r, row_of(kept, j), first + f->place[j], stretch, kept->samples))
            return;
    }
#pragma omp atomic
    r->kept += count;
}

void kept_rows_weigh(const struct kept_rows *kept, const struct tile_run_rays *rays, size_t tile_run, uint32_t step,
                     uint32_t l, float incident, float irradiance)
{
    const struct kiln_resident_rows *r = kept->rows->resident;
    const uint64_t sample = (uint64_t)step * rays->copies + rays->copy[l];
    float *to =
        r->weights + r->weights_at[tile_run] + 2 * ((uint64_t)rays->frame.place[rays->point[l]] * r->samples + sample);
    to[0] = incident > 0.0f ? incident : 0.0f; /* such a ray brings nothing */
    to[1] = incident > 0.0f ? irradiance : 0.0f;
}
