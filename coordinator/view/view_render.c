#include <math.h>
#include <string.h>

#include "coordinator/view/view.h"
#include "coordinator/view/view_gloss.h"
#include "coordinator/view/view_light.h"
#include "worker/base/memory.h"

/* Rays traced together, for a band of pixel rows or some of its pixels; 33 MB with the pixels of previews, which have
 * the fewest rays each. */
enum { BAND_RAYS = 128 << 10 };

/* 4 x 4 rays of a pixel; the first 4 lie in different rows and columns. `places`: subpixels in the order of rays. */
enum { SIDE = 4, FIRST = 4 };
static const uint8_t places[SIDE * SIDE] = {1, 7, 8, 14, 0, 2, 3, 4, 5, 6, 9, 10, 11, 12, 13, 15};

/* Previews have 2 x 2 rays, and before them one in the middle of the pixel. */
enum { PREVIEW_SIDE = 2, PREVIEW_RAYS = 5, METER_SIDE = 1 };

/* Limits for the relative difference between the first rays' values, up to which no more rays are needed. WITHIN_FLAT:
 * within a pixel, on one triangle in even light; WITHIN: within any other pixel; AROUND: within the 3 x 3 pixels. EVEN:
 * difference up to which light is even. */
static const float WITHIN_FLAT = 0.12f, WITHIN = 0.06f, AROUND = 0.25f, EVEN = 0.1f;
/* As AROUND, for previews, which have one first ray per pixel. */
static const float AROUND_ONE = 0.06f;

/* Rows of the previous band that are kept: one whose pixels may get more rays, and the row above it. */
enum { ROWS_BEFORE = 2 };

/* Result of a pixel's first rays. FEW: they suffice. FLAT: the other rays hit the same triangle, and need no tracing.
 * TRACED: the other rays are traced. */
enum fate { FEW, FLAT, TRACED };

/* Results of a pixel's rays; `low` and `high` of the first ones. */
struct pixel {
    float sum[3], low[3], high[3];
    float metal, front_light, flat, mapped; /* sums */
    float irradiance[3];                    /* mean of the first ones */
    uint32_t triangle;                      /* opaque triangle that all first rays hit, in even light; else KILN_NONE */
    bool back;                              /* from behind */
    bool gloss;                             /* a ray hits a surface from which it goes on (view_gloss.h) */
    bool done; /* all rays that go on are drawn; before: all are wanted, since the first hits a rough surface */
    enum fate fate;
};

struct renderer {
    const struct kiln_view_params *params;
    uint32_t rays, first; /* rays of a pixel: all, and the first ones */
    struct kiln_view_maps *maps;
    struct kiln_view_rays *batch;
    struct kiln_view_gloss *gloss; /* NULL: none was needed yet */
    float *planes[3];
    uint32_t rows, begin;              /* rows of a band; first row of the present band */
    struct pixel *pixels;              /* ROWS_BEFORE rows and the band's */
    size_t *traced;                    /* pixels whose other rays are traced */
    struct kiln_view_approximate sums; /* sums over pixels of the mean over their rays */
};

static void make_ray(const struct renderer *r, uint32_t x, uint32_t y, uint32_t k, struct kiln_vec3 *origin,
                     struct kiln_vec3 *direction)
{
    const uint32_t side = r->params->side, place = r->first == FIRST && r->rays > FIRST ? places[k] : k;
    if (r->rays == PREVIEW_RAYS)
        kiln_view_ray(r->params, (double)x + (k == 0 ? 0.5 : (k - 1) % 2 * 0.5 + 0.25),
                      (double)y + (k == 0 ? 0.5 : (k - 1) / 2 * 0.5 + 0.25), origin, direction);
    else
        kiln_view_ray(r->params, (double)x + ((double)(place % side) + 0.5) / side,
                      (double)y + ((double)(place / side) + 0.5) / side, origin, direction);
}

/* Index in `pixels` of the first pixel in an image row. */
static size_t row_at(const struct renderer *r, uint32_t y)
{
    return (size_t)(y + ROWS_BEFORE - r->begin) * r->params->width;
}

static void add_seen(struct pixel *p, const struct kiln_view_seen *seen)
{
    for (int c = 0; c < 3; c++)
        p->sum[c] += seen->rgb[c];
    p->metal += seen->metal;
    p->front_light += seen->front_light;
    p->flat += seen->flat;
    p->mapped += seen->mapped;
}

static int trace(struct renderer *r, size_t count, struct kiln_error *error)
{
    const int status = kiln_view_trace(&r->params->source, r->batch, count, error);
    return status == KILN_OK ? kiln_view_maps_load(r->maps, r->batch->hits, count, error) : status;
}

/* Whether values from `low` to `high` differ by more than a share of the largest. */
static bool differ(const float low[3], const float high[3], float share)
{
    float largest = 0.0f, range = 0.0f;
    for (int c = 0; c < 3; c++) {
        const float ends[2] = {fabsf(low[c]), fabsf(high[c])}, end = ends[0] > ends[1] ? ends[0] : ends[1];
        largest = end > largest ? end : largest;
        range = high[c] - low[c] > range ? high[c] - low[c] : range;
    }
    return !(range <= share * largest);
}

/* Whether the first rays of a pixel meet one opaque triangle in even light. */
static bool is_even(const struct renderer *r, size_t from, const float low[3], const float high[3])
{
    const struct kiln_hit *hits = &r->batch->hits[from];
    bool even = hits->triangle < r->params->source.geometry->opaque_count && low[0] >= 0.0f && !differ(low, high, EVEN);
    for (uint32_t k = 0; k < r->first; k++)
        even = even && hits[k].triangle == hits->triangle && hits[k].back == hits->back &&
               !(r->batch->passed[from + k] > 0.0f);
    return even;
}

static void widen(float low[3], float high[3], const float value[3])
{
    for (int c = 0; c < 3; c++) {
        low[c] = value[c] < low[c] ? value[c] : low[c];
        high[c] = value[c] > high[c] ? value[c] : high[c];
    }
}

/* Whether a hit goes on from a rough surface. */
static bool is_rough(const struct kiln_view_source *source, const struct kiln_hit *hit)
{
    if (hit->triangle == KILN_NONE)
        return false;
    const uint32_t material = source->geometry->records[hit->triangle].material & KILN_RECORD_MATERIAL;
    const struct kiln_gloss *gloss = kiln_gloss_taken(source->scene, material);
    return gloss != NULL && gloss->mean_roughness > 0.0f;
}

/* Begins a pixel with its first rays, which are rays from `from` on in the batch. */
static void shade_first(const struct renderer *r, size_t from, struct pixel *p)
{
    struct kiln_view_seen seen;
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    *p = (struct pixel){.low = {INFINITY, INFINITY, INFINITY}, .high = {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t k = from; k < from + r->first; k++) {
        kiln_view_radiance(r->maps, &r->batch->hits[k], r->batch->directions[k], &seen);
        p->gloss = p->gloss || kiln_view_goes_on(&r->params->source, &r->batch->hits[k]);
        p->done = p->done || (p->gloss && is_rough(&r->params->source, &r->batch->hits[k]));
        add_seen(p, &seen);
        widen(p->low, p->high, seen.rgb);
        widen(low, high, seen.irradiance);
        for (int c = 0; c < 3; c++)
            p->irradiance[c] += seen.irradiance[c] / (float)r->first;
    }
    p->triangle = is_even(r, from, low, high) ? r->batch->hits[from].triangle : KILN_NONE;
    p->back = r->batch->hits[from].back;
}

/* Lists the pixels of rows [from, to) with mirrors, gloss or glass, by their index in the image; with `traced` only
 * those that need more rays. Returns their number. */
static size_t list_gloss(const struct renderer *r, uint32_t from, uint32_t to, bool traced)
{
    const size_t first = row_at(r, from), place = (size_t)from * r->params->width;
    size_t count = 0;
    for (size_t i = first; i < row_at(r, to); i++)
        if (r->pixels[i].gloss && (!traced || r->pixels[i].fate == TRACED))
            r->traced[count++] = place + i - first;
    return count;
}

/* The pixel of that number. */
static struct pixel *pixel_at(const struct renderer *r, size_t number)
{
    return &r->pixels[row_at(r, r->begin) + number - (size_t)r->begin * r->params->width];
}

/* Replaces the light of a pixel with gloss. */
static void put_gloss(const struct renderer *r, struct pixel *p, const float rgb[3])
{
    p->metal = 0.0f;
    for (int c = 0; c < 3; c++)
        p->sum[c] = rgb[c] * (float)r->first;
}

/* Follows the first rays of the band's pixels that contain mirrors, gloss or glass. */
static int look_on(struct renderer *r, uint32_t rows, struct kiln_error *error)
{
    const size_t count = list_gloss(r, r->begin, r->begin + rows, false);
    float *rgb = NULL;
    bool *done = NULL;
    if (count == 0)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_allocate(&rgb, 3 * count, sizeof *rgb, "the pixels of a view", error));
    KILN_TRY(kiln_allocate(&done, count, sizeof *done, "the pixels of a view", error));
    for (size_t k = 0; k < count; k++)
        done[k] = pixel_at(r, r->traced[k])->done;
    if (r->gloss == NULL)
        KILN_TRY(kiln_view_gloss_create(&r->gloss, r->params, r->maps, error));
    KILN_TRY(kiln_view_gloss_draw(r->gloss, r->traced, count, rgb, done, error));
    for (size_t k = 0; k < count; k++) {
        struct pixel *p = pixel_at(r, r->traced[k]);
        put_gloss(r, p, &rgb[3 * k]);
        p->done = done[k];
        if (done[k])
            continue;
        p->triangle = KILN_NONE;
        memcpy(p->low, &rgb[3 * k], sizeof p->low);
        memcpy(p->high, &rgb[3 * k], sizeof p->high);
    }
end:
    kiln_free(&rgb);
    kiln_free(&done);
    return status;
}

/* Traces the first rays of the band's pixels. */
static int look_first(struct renderer *r, uint32_t rows, struct kiln_error *error)
{
    const uint32_t width = r->params->width, first = r->first;
    const size_t pixels = (size_t)rows * width;
    struct pixel *band = r->pixels + row_at(r, r->begin);
#pragma omp parallel for schedule(dynamic, 4096)
    for (size_t i = 0; i < pixels * first; i++)
        make_ray(r, (uint32_t)(i / first % width), r->begin + (uint32_t)(i / first / width), (uint32_t)(i % first),
                 &r->batch->origins[i], &r->batch->directions[i]);
    const int status = trace(r, pixels * first, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < pixels; i++)
        shade_first(r, i * first, &band[i]);
    return look_on(r, rows, error);
}

/* Whether two triangles are the same, or have a corner in common. */
static bool touch(const struct kiln_geometry *g, uint32_t a, uint32_t b)
{
    bool common = a == b;
    for (int i = 0; i < 9 && !common && a != KILN_NONE && b != KILN_NONE; i++)
        common = g->indices[3 * (size_t)a + (size_t)(i / 3)] == g->indices[3 * (size_t)b + (size_t)(i % 3)];
    return common;
}

/* Decides about a pixel of a preview, by the rays through the centres of the 3 x 3 pixels. */
static enum fate fate_by_middles(const struct renderer *r, uint32_t x, uint32_t y)
{
    const uint32_t width = r->params->width, height = r->params->height, left = x > 0 ? x - 1 : 0,
                   right = x + 1 < width ? x + 1 : x;
    const struct pixel *own = &r->pixels[row_at(r, y) + x];
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, lit[2][3];
    bool alike = true; /* light by rough lobes is unknown at this stage */
    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
        for (uint32_t u = left; u <= right; u++) {
            const struct pixel *other = &r->pixels[row_at(r, v) + u];
            widen(low, high, other->low);
            alike = alike && other->done == own->done;
        }
    if (alike && !differ(low, high, AROUND_ONE))
        return FEW;
    bool flat = own->triangle != KILN_NONE;
    memcpy(lit[0], own->irradiance, sizeof lit[0]);
    memcpy(lit[1], own->irradiance, sizeof lit[1]);
    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height && flat; v++)
        for (uint32_t u = left; u <= right && flat; u++) {
            const struct pixel *other = &r->pixels[row_at(r, v) + u];
            widen(lit[0], lit[1], other->irradiance);
            flat = touch(r->params->source.geometry, own->triangle, other->triangle);
        }
    return flat && !differ(lit[0], lit[1], EVEN) ? FLAT : TRACED;
}

/* Decides about a pixel, by the first rays of the 3 x 3 pixels. */
static enum fate fate_of(const struct renderer *r, uint32_t x, uint32_t y)
{
    const uint32_t width = r->params->width, height = r->params->height;
    const struct pixel *own = &r->pixels[row_at(r, y) + x];
    bool flat = own->triangle != KILN_NONE;
    float low[3], high[3];
    memcpy(low, own->low, sizeof low);
    memcpy(high, own->high, sizeof high);
    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++) {
            const struct pixel *other = &r->pixels[row_at(r, v) + u];
            widen(low, high, other->low);
            widen(low, high, other->high);
            flat = flat && touch(r->params->source.geometry, own->triangle, other->triangle);
        }
    if (!differ(own->low, own->high, flat ? WITHIN_FLAT : WITHIN) && (flat || !differ(low, high, AROUND)))
        return FEW;
    return flat ? FLAT : TRACED;
}

/* Intersects a ray with the plane of a triangle; false: outside the triangle. */
static bool cross(const struct kiln_geometry *g, struct kiln_vec3 origin, struct kiln_vec3 direction,
                  struct kiln_hit *hit)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, hit->triangle, corner);
    const struct kiln_vec3 e1 = vec3_sub(corner[1], corner[0]), e2 = vec3_sub(corner[2], corner[0]),
                           from = vec3_sub(origin, corner[0]), p = vec3_cross(direction, e2), q = vec3_cross(from, e1);
    const float part = 1.0f / vec3_dot(e1, p);
    hit->u = part * vec3_dot(from, p);
    hit->v = part * vec3_dot(direction, q);
    return hit->u >= 0.0f && hit->v >= 0.0f && hit->u + hit->v <= 1.0f;
}

/* Shades the other rays of a pixel without tracing, as hits of the first rays' triangle with their mean irradiance.
 * False, with nothing added, if a ray misses the triangle. */
static bool shade_flat(const struct renderer *r, uint32_t x, uint32_t y)
{
    struct pixel *p = &r->pixels[row_at(r, y) + x];
    float sum[3] = {0.0f, 0.0f, 0.0f}, rgb[3];
    for (uint32_t k = r->first; k < r->rays; k++) {
        struct kiln_vec3 origin, direction;
        struct kiln_hit hit = {.triangle = p->triangle, .back = p->back};
        make_ray(r, x, y, k, &origin, &direction);
        if (!cross(r->params->source.geometry, origin, direction, &hit))
            return false;
        kiln_view_lit(r->maps, &hit, p->irradiance, rgb);
        for (int c = 0; c < 3; c++)
            sum[c] += rgb[c];
    }
    for (int c = 0; c < 3; c++)
        p->sum[c] += sum[c];
    return true;
}

/* Decides about the pixels of rows [from, to), and lists those whose other rays must be traced. Returns their number.
 */
static size_t list_traced(struct renderer *r, uint32_t from, uint32_t to)
{
    const uint32_t width = r->params->width;
    size_t count = 0;
    if (r->first == r->rays)
        return 0;
#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t y = from; y < to; y++)
        for (uint32_t x = 0; x < width; x++) {
            struct pixel *p = &r->pixels[row_at(r, y) + x];
            const enum fate fate = p->done ? FEW : r->first == 1 ? fate_by_middles(r, x, y) : fate_of(r, x, y);
            p->fate = fate == FLAT && !shade_flat(r, x, y) ? TRACED : fate;
        }
    for (size_t i = row_at(r, from); i < row_at(r, to); i++)
        if (r->pixels[i].fate == TRACED && !r->pixels[i].gloss)
            r->traced[count++] = i;
    return count;
}

/* Traces the remaining rays of `count` listed pixels. */
static int look_again(struct renderer *r, const size_t *list, size_t count, struct kiln_error *error)
{
    const uint32_t width = r->params->width, left = r->rays - r->first;
#pragma omp parallel for schedule(dynamic, 4096)
    for (size_t i = 0; i < count * left; i++) {
        const size_t pixel = list[i / left];
        make_ray(r, (uint32_t)(pixel % width), r->begin + (uint32_t)(pixel / width) - ROWS_BEFORE,
                 r->first + (uint32_t)(i % left), &r->batch->origins[i], &r->batch->directions[i]);
    }
    const int status = trace(r, count * left, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < count; i++)
        for (size_t k = i * left; k < (i + 1) * left; k++) {
            struct kiln_view_seen seen;
            kiln_view_radiance(r->maps, &r->batch->hits[k], r->batch->directions[k], &seen);
            add_seen(&r->pixels[list[i]], &seen);
        }
    return KILN_OK;
}

/* Follows the remaining rays of pixels in rows [from, to) that contain mirrors, gloss or glass. */
static int look_on_again(struct renderer *r, uint32_t from, uint32_t to, struct kiln_error *error)
{
    const size_t count = list_gloss(r, from, to, true);
    float *rgb = NULL;
    if (count == 0)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_allocate(&rgb, 3 * count, sizeof *rgb, "the pixels of a view", error));
    for (size_t k = 0; k < count; k++)
        memcpy(&rgb[3 * k], pixel_at(r, r->traced[k])->sum, 3 * sizeof *rgb);
    KILN_TRY(kiln_view_gloss_draw_rest(r->gloss, r->traced, count, rgb, error));
    for (size_t k = 0; k < count; k++) {
        struct pixel *p = pixel_at(r, r->traced[k]);
        put_gloss(r, p, &rgb[3 * k]);
        p->fate = FEW;
    }
end:
    kiln_free(&rgb);
    return status;
}

/* Writes rows [from, to) to the image: a pixel is the mean over its rays. */
static void put_rows(struct renderer *r, uint32_t from, uint32_t to)
{
    const size_t first = row_at(r, from), count = row_at(r, to) - first, place = (size_t)from * r->params->width;
    for (size_t i = 0; i < count; i++) {
        const struct pixel *p = &r->pixels[first + i];
        const float rays = (float)(p->fate == FEW ? r->first : r->rays),
                    traced = (float)(p->fate == TRACED ? r->rays : r->first);
        for (int c = 0; c < 3; c++)
            r->planes[c][place + i] = p->sum[c] / rays;
        r->sums.metal += (double)(p->metal / traced);
        r->sums.front_light += (double)(p->front_light / traced);
        r->sums.flat += (double)(p->flat / traced);
        r->sums.mapped += (double)(p->mapped / traced);
    }
}

/* Renders a band of `rows` rows, and finishes its pixels and the last row of the previous band; the band's own last row
 * waits, unless it is the image's last. */
static int render_band(struct renderer *r, uint32_t rows, struct kiln_error *error)
{
    const uint32_t width = r->params->width, left = r->rays - r->first, end = r->begin + rows;
    const uint32_t from = r->begin > 0 ? r->begin - 1 : 0, to = end < r->params->height ? end - 1 : end;
    int status = look_first(r, rows, error);
    const size_t count = status == KILN_OK ? list_traced(r, from, to) : 0;
    KILN_TRY(status);
    for (size_t i = 0, some; i < count; i += some) {
        some = left > 0 && count - i > r->batch->capacity / left ? r->batch->capacity / left : count - i;
        KILN_TRY(look_again(r, r->traced + i, some, error));
    }
    KILN_TRY(look_on_again(r, from, to, error));
    put_rows(r, from, to);
end:
    memmove(r->pixels, r->pixels + (size_t)rows * width, ROWS_BEFORE * (size_t)width * sizeof *r->pixels);
    return status;
}

static int allocate_band(struct renderer *r, struct kiln_error *error)
{
    const struct kiln_view_params *p = r->params;
    const size_t row = (size_t)p->width * r->first;
    r->rows = row >= BAND_RAYS ? 1 : (uint32_t)(BAND_RAYS / row);
    const size_t pixels = (size_t)(r->rows + ROWS_BEFORE) * p->width;
    int status;
    KILN_TRY(kiln_view_rays_create(&r->batch, row * r->rows > r->rays ? row * r->rows : r->rays, error));
    KILN_TRY(kiln_allocate(&r->pixels, pixels, sizeof *r->pixels, "the pixels of a view", error));
    KILN_TRY(kiln_allocate(&r->traced, pixels, sizeof *r->traced, "the pixels of a view", error));
end:
    return status;
}

static int render_bands(struct renderer *r, struct kiln_error *error)
{
    const struct kiln_view_params *p = r->params;
    int status = KILN_OK;
    for (r->begin = 0; status == KILN_OK && r->begin < p->height; r->begin += r->rows) {
        if (p->source.tell != NULL && p->side != METER_SIDE)
            p->source.tell(p->source.tell_context, (double)r->begin / (double)p->height);
        status = kiln_stop_asked(p->source.stop)
                     ? kiln_give_up(error)
                     : render_band(r, p->height - r->begin < r->rows ? p->height - r->begin : r->rows, error);
    }
    return status;
}

int kiln_view_render(const struct kiln_view_params *params, struct kiln_image **image,
                     struct kiln_view_approximate *approximate, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    const bool preview = params->side == PREVIEW_SIDE && params->source.field == NULL;
    const uint32_t rays = preview ? PREVIEW_RAYS : params->side * params->side;
    struct renderer r = {.params = params,
                         .rays = rays,
                         .first = preview                                                ? 1
                                  : params->side == SIDE && params->source.field == NULL ? FIRST
                                                                                         : rays,
                         .maps = params->source.maps};
    struct kiln_view_maps *own = NULL;
    int status = kiln_image_create(image, params->width, params->height, names, 3, error);
    if (status != KILN_OK)
        return status;
    (void)kiln_image_rgb(*image, "", r.planes);
    if (r.maps == NULL)
        status = kiln_view_maps_create(&own, &params->source, 0, error);
    if (r.maps == NULL)
        r.maps = own;
    if (status == KILN_OK)
        status = allocate_band(&r, error);
    if (status == KILN_OK)
        status = render_bands(&r, error);
    if (status == KILN_OK && r.gloss != NULL)
        status = kiln_view_gloss_smooth(r.gloss, r.planes, error);
    const double all = (double)params->width * params->height;
    *approximate = (struct kiln_view_approximate){r.sums.metal / all, r.sums.front_light / all, r.sums.flat / all,
                                                  r.sums.mapped / all};
    kiln_view_gloss_destroy(&r.gloss);
    kiln_free(&r.traced);
    kiln_free(&r.pixels);
    kiln_view_rays_destroy(&r.batch);
    kiln_view_maps_destroy(&own);
    if (status != KILN_OK)
        kiln_image_destroy(image);
    return status;
}
