#include "coordinator/view/view_filter.h"

#include <math.h>
#include <string.h>

#include <omp.h>

#include "coordinator/view/bmfr.h"
#include "coordinator/view/history.h"
#include "coordinator/view/view_surfaces.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"

/* albedo_least: lower limit of an albedo that light is divided by. weight_floor, filtered_floor: least weight of a new
 * frame in the mean before the filter, and after it. */
static const float albedo_least = 0.02f;
static const double weight_floor = 0.1, filtered_floor = 0.5;

/* Coverage from which a pixel counts as fully covered by surfaces. */
static const float full = 0.999f;

/* Rays along a side of a pixel, to find its surfaces; SIDE_SEQUENCE: in sequences. */
enum { SIDE = 4, SIDE_SEQUENCE = 2 };

/* Planes of a layer: light; gathered frames also have its variance. */
enum { LIGHT = 3, VARIANCE = 3, GATHERED = 4 };

struct kiln_view_filter {
    bool sequence, denoise;
    uint32_t frame;
    struct kiln_history *history;         /* history of a sequence, made with the first frame */
    struct kiln_layer gathered, filtered; /* means over frames, before the filter and after it */
    uint32_t width, height;               /* of the history */
    double seconds, surface_seconds;
};

/* Data per pixel of a picture: planes one after the other. */
struct seen {
    size_t count;
    float *values;
    float *surface[KILN_SEEN_PLANES], *light[LIGHT], *spread[LIGHT], *variance;
    bool *filtered, *bound, *is_surface;
};
enum { PLANES = KILN_SEEN_PLANES + 2 * LIGHT + 1, FLAGS = 3 };

/* ---- begin and end ---- */

int kiln_view_filter_create(struct kiln_view_filter **filter, bool sequence, bool denoise, struct kiln_error *error)
{
    const int status = kiln_allocate(filter, 1, sizeof **filter, "the filter of a view", error);
    if (status == KILN_OK) {
        (*filter)->sequence = sequence;
        (*filter)->denoise = denoise;
    }
    return status;
}

static void forget(struct kiln_view_filter *f)
{
    kiln_layer_destroy(&f->gathered);
    kiln_layer_destroy(&f->filtered);
    kiln_history_destroy(&f->history);
}

void kiln_view_filter_destroy(struct kiln_view_filter **filter)
{
    if (*filter == NULL)
        return;
    forget(*filter);
    kiln_free(filter);
}

void kiln_view_filter_prepare(const struct kiln_view_filter *filter, struct kiln_view_params *params)
{
    params->frame = filter->sequence ? filter->frame : 0;
    params->spread = filter->denoise;
}

void kiln_view_filter_seconds(const struct kiln_view_filter *filter, double *all, double *surfaces)
{
    *all = filter->seconds;
    *surfaces = filter->surface_seconds;
}

/* ---- light without colours ---- */

static int allocate_seen(struct seen *s, size_t count, struct kiln_error *error)
{
    s->count = count;
    int status = kiln_allocate(&s->values, PLANES * count, sizeof *s->values, "the surfaces of a view", error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->filtered, FLAGS * count, sizeof *s->filtered, "the surfaces of a view", error);
    if (status != KILN_OK)
        return status;
    float *next = s->values;
    for (int k = 0; k < KILN_SEEN_PLANES; k++, next += count)
        s->surface[k] = next;
    for (int c = 0; c < LIGHT; c++, next += count)
        s->light[c] = next;
    for (int c = 0; c < LIGHT; c++, next += count)
        s->spread[c] = next;
    s->variance = next;
    s->bound = s->filtered + count;
    s->is_surface = s->bound + count;
    return KILN_OK;
}

static float divisor(const struct seen *s, int c, size_t i)
{
    return fmaxf(s->surface[KILN_SEEN_ALBEDO + c][i], albedo_least);
}

/* Divides the pixel's light by albedo after subtracting emission; join restores it. */
static void split(struct seen *s, size_t i)
{
    for (int c = 0; c < LIGHT && s->is_surface[i]; c++) {
        s->light[c][i] = (s->light[c][i] - s->surface[KILN_SEEN_EMISSION + c][i]) / divisor(s, c, i);
        s->spread[c][i] /= divisor(s, c, i);
    }
}

static void join(const struct seen *s, size_t i)
{
    for (int c = 0; c < LIGHT && s->is_surface[i]; c++)
        s->light[c][i] = s->light[c][i] * divisor(s, c, i) + s->surface[KILN_SEEN_EMISSION + c][i];
}

/* Emission and coverage of the 3 x 3 pixels around a pixel, since paths may meet surfaces that the pixel's own rays
 * miss. */
struct around {
    float emission, least, most; /* least and most coverage */
};

static struct around look_around(const struct seen *s, uint32_t width, size_t i)
{
    const uint32_t x = (uint32_t)(i % width), y = (uint32_t)(i / width), height = (uint32_t)(s->count / width);
    struct around a = {.least = 1.0f};
    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++) {
            const size_t k = (size_t)v * width + u;
            for (int c = 0; c < LIGHT; c++)
                a.emission += s->surface[KILN_SEEN_EMISSION + c][k];
            a.least = fminf(a.least, s->surface[KILN_SEEN_COVERAGE][k]);
            a.most = fmaxf(a.most, s->surface[KILN_SEEN_COVERAGE][k]);
        }
    return a;
}

/* Classifies a pixel. filtered: it is denoised. bound: its content moves with the camera (gloss), or it is at an edge
 * of a lamp or of the surroundings. */
static void sort_out(struct seen *s, uint32_t width, size_t i)
{
    const struct around a = look_around(s, width, i);
    const float light = s->light[0][i] + s->light[1][i] + s->light[2][i];
    s->is_surface[i] = s->surface[KILN_SEEN_DEPTH][i] < KILN_VIEW_FAR;
    s->bound[i] = a.emission > 0.0f || s->surface[KILN_SEEN_GLOSS][i] > 0.0f || (a.least < full && a.most > 0.0f);
    s->filtered[i] =
        s->is_surface[i] && s->surface[KILN_SEEN_COVERAGE][i] >= full && !(a.emission > 0.0f) && isfinite(light);
}

static float luminance_at(float *const planes[LIGHT], size_t i)
{
    return kiln_rgb_luminance(planes[0][i], planes[1][i], planes[2][i]);
}

/* Estimates the variance of a pixel from its squared difference to the mean of its up to four filtered neighbours, as
 * if their true light were equal. */
static float variance_around(const struct seen *s, uint32_t width, size_t i)
{
    const size_t x = i % width, around[4] = {i - 1, i + 1, i - width, i + width};
    const bool there[4] = {x > 0, x + 1 < width, i >= width, i + width < s->count};
    float sum = 0.0f, count = 0.0f;
    for (int k = 0; k < 4; k++)
        if (there[k] && s->filtered[around[k]]) {
            sum += luminance_at(s->light, around[k]);
            count += 1.0f;
        }
    const float away = count > 0.0f ? luminance_at(s->light, i) - sum / count : 0.0f;
    return away * away * count / (count + 1.0f);
}

/* Prepares the input of the filter. */
static int look(const struct kiln_view_filter *f, const struct kiln_view_params *params, const struct kiln_image *image,
                struct seen *s, struct kiln_error *error)
{
    float *light[LIGHT], *spread[LIGHT];
    const bool halves = kiln_image_rgb(image, "spread.", spread);
    const int status =
        kiln_view_see_surfaces(params, f->sequence ? SIDE_SEQUENCE : SIDE, (float *const *)s->surface, error);
    if (status != KILN_OK || !kiln_image_rgb(image, "", light))
        return status;
    for (int c = 0; c < LIGHT; c++) {
        memcpy(s->light[c], light[c], s->count * sizeof(float));
        if (halves)
            memcpy(s->spread[c], spread[c], s->count * sizeof(float));
    }
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < s->count; i++) {
        sort_out(s, params->width, i);
        split(s, i);
    }
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < s->count; i++) {
        const float deviation = luminance_at(s->spread, i);
        s->variance[i] = halves ? deviation * deviation : variance_around(s, params->width, i);
    }
    return KILN_OK;
}

/* ---- frames and filter ---- */

/* Creates the history, in the size of the picture. */
static int open_history(struct kiln_view_filter *f, const struct kiln_view_params *params, struct kiln_error *error)
{
    if (f->history != NULL && f->width == params->width && f->height == params->height)
        return KILN_OK;
    forget(f);
    f->width = params->width;
    f->height = params->height;
    int status;
    KILN_TRY(kiln_history_create(&f->history, params->width, params->height, error));
    KILN_TRY(kiln_layer_create(&f->gathered, f->history, GATHERED, error));
    if (f->denoise)
        KILN_TRY(kiln_layer_create(&f->filtered, f->history, LIGHT, error));
end:
    return status;
}

/* Averages the light over frames. */
static int add_frames(struct kiln_view_filter *f, const struct kiln_view_params *params, const struct seen *s,
                      struct kiln_error *error)
{
    const double *centre = params->source.scene->header->centre;
    const struct kiln_dvec3 shift = dvec3(centre[0], centre[1], centre[2]);
    struct kiln_frame frame = {.camera = params->camera,
                               .width = params->width,
                               .height = params->height,
                               .place = kiln_view_seen_place(SIDE_SEQUENCE),
                               .surface = s->is_surface,
                               .bound = s->bound};
    frame.camera.position = dvec3_add(frame.camera.position, shift);
    for (int c = 0; c < 3; c++) {
        frame.normal[c] = s->surface[KILN_SEEN_NORMAL + c];
        frame.position[c] = s->surface[KILN_SEEN_POSITION + c];
    }
    float *const planes[GATHERED] = {s->light[0], s->light[1], s->light[2], s->variance};
    kiln_history_find(f->history, &frame);
    return kiln_layer_blend(&f->gathered, f->history, weight_floor, true, planes, error);
}

static int denoise(const struct kiln_view_filter *f, const struct kiln_view_params *params, const struct seen *s,
                   struct kiln_error *error)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < s->count; i++)
        s->variance[i] = sqrtf(s->variance[i]); /* nobody needs it any more */
    struct kiln_bmfr picture = {
        .width = params->width, .height = params->height, .filtered = s->filtered, .deviation = s->variance};
    for (int c = 0; c < 3; c++) {
        picture.normal[c] = s->surface[KILN_SEEN_REACHED_NORMAL + c];
        picture.position[c] = s->surface[KILN_SEEN_REACHED_POSITION + c];
        picture.light[c] = s->light[c];
        if (c < 2 && f->sequence)
            picture.shift[c] = kiln_hash2(f->frame, (uint32_t)c);
    }
    return kiln_bmfr_run(&picture, error);
}

static int work(struct kiln_view_filter *f, const struct kiln_view_params *params, const struct seen *s,
                struct kiln_error *error)
{
    int status;
    KILN_TRY(f->sequence ? open_history(f, params, error) : KILN_OK);
    if (f->sequence)
        KILN_TRY(add_frames(f, params, s, error));
    if (f->denoise)
        KILN_TRY(denoise(f, params, s, error));
    if (f->denoise && f->sequence)
        KILN_TRY(kiln_layer_blend(&f->filtered, f->history, filtered_floor, false, s->light, error));
end:
    return status;
}

/* Replaces the image by one with only the light. */
static int put(const struct seen *s, struct kiln_image **image, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    struct kiln_image *result = NULL;
    float *planes[LIGHT];
    const int status = kiln_image_create(&result, (*image)->width, (*image)->height, names, LIGHT, error);
    if (status != KILN_OK || !kiln_image_rgb(result, "", planes))
        return status;
    for (size_t i = 0; i < s->count; i++)
        join(s, i);
    for (int c = 0; c < LIGHT; c++)
        memcpy(planes[c], s->light[c], s->count * sizeof(float));
    kiln_image_destroy(image);
    *image = result;
    return KILN_OK;
}

int kiln_view_filter_run(struct kiln_view_filter *filter, const struct kiln_view_params *params,
                         struct kiln_image **image, struct kiln_error *error)
{
    struct seen s = {0};
    const double begin = omp_get_wtime();
    int status = allocate_seen(&s, (size_t)params->width * params->height, error);
    if (status == KILN_OK)
        status = look(filter, params, *image, &s, error);
    filter->surface_seconds += omp_get_wtime() - begin;
    if (status == KILN_OK)
        status = work(filter, params, &s, error);
    if (status == KILN_OK)
        status = put(&s, image, error);
    filter->frame++;
    filter->seconds += omp_get_wtime() - begin;
    kiln_free(&s.values);
    kiln_free(&s.filtered);
    return status;
}
