#include "coordinator/view/history.h"

#include <math.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* Conditions for reusing a pixel of the previous frame: least cosine between the normals; largest distance from the
 * tangent plane, in pixels; least sum of weights. And steps per pixel to which places are rounded. */
static const float cosine_least = 0.906f, pixels_off = 2.0f, weight_least = 0.01f;
static const double steps = 64.0;

/* The 2 x 2 pixels of the previous frame that a pixel reuses, from the upper left one on, with their weights. */
struct taps {
    int32_t x, y;
    float weight[4]; /* they add up to 1, or all are 0 */
};

struct kiln_history {
    uint32_t width, height;
    bool has_frame;
    struct kiln_view_camera camera;
    float *normal[3], *position[3];
    bool *surface, *bound;
    struct taps *taps;
    struct kiln_arena arena;
};

/* ---- begin and end ---- */

static size_t pixels_of(const struct kiln_history *h) { return (size_t)h->width * h->height; }

int kiln_history_create(struct kiln_history **history, uint32_t width, uint32_t height, struct kiln_error *error)
{
    int status = kiln_allocate(history, 1, sizeof **history, "the frame before", error);
    if (status != KILN_OK)
        return status;
    struct kiln_history *h = *history;
    h->width = width;
    h->height = height;
    KILN_TRY(status);
    for (int c = 0; c < 3; c++)
        KILN_TRY(kiln_allocate(&h->normal[c], pixels_of(h), sizeof(float), "the frame before", error));
    for (int c = 0; c < 3; c++)
        KILN_TRY(kiln_allocate(&h->position[c], pixels_of(h), sizeof(float), "the frame before", error));
    KILN_TRY(kiln_arena_allocate(&h->arena, &h->surface, pixels_of(h), sizeof *h->surface, "the frame before", error));
    KILN_TRY(kiln_arena_allocate(&h->arena, &h->bound, pixels_of(h), sizeof *h->bound, "the frame before", error));
    KILN_TRY(kiln_arena_allocate(&h->arena, &h->taps, pixels_of(h), sizeof *h->taps, "the frame before", error));
end:
    if (status != KILN_OK)
        kiln_history_destroy(history);
    return status;
}

void kiln_history_destroy(struct kiln_history **history)
{
    struct kiln_history *h = *history;
    if (h == NULL)
        return;
    for (int c = 0; c < 3; c++) {
        kiln_free(&h->normal[c]);
        kiln_free(&h->position[c]);
    }
    kiln_arena_release(&h->arena);
    kiln_free(history);
}

int kiln_layer_create(struct kiln_layer *layer, const struct kiln_history *history, size_t count,
                      struct kiln_error *error)
{
    *layer = (struct kiln_layer){.count = count};
    int status = kiln_allocate(&layer->frames, pixels_of(history), sizeof(float), "the frames before", error);
    for (size_t k = 0; k < count && status == KILN_OK; k++)
        status = kiln_allocate(&layer->planes[k], pixels_of(history), sizeof(float), "the frames before", error);
    return status;
}

void kiln_layer_destroy(struct kiln_layer *layer)
{
    kiln_free(&layer->frames);
    for (size_t k = 0; k < layer->count; k++)
        kiln_free(&layer->planes[k]);
    layer->count = 0;
}

/* ---- the frame before ---- */

static bool same_vector(struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    return !(a.x < b.x || a.x > b.x || a.y < b.y || a.y > b.y || a.z < b.z || a.z > b.z);
}

/* Whether the camera stands still. */
static bool is_still(const struct kiln_view_camera *a, const struct kiln_view_camera *b)
{
    const struct kiln_dvec3 one = dvec3(a->extent_x, a->extent_y, a->orthographic ? 1.0 : 0.0),
                            other = dvec3(b->extent_x, b->extent_y, b->orthographic ? 1.0 : 0.0);
    return same_vector(a->position, b->position) && same_vector(a->right, b->right) && same_vector(a->up, b->up) &&
           same_vector(a->forward, b->forward) && same_vector(one, other);
}

static struct kiln_dvec3 vector_at(const float *const planes[3], size_t pixel)
{
    return dvec3((double)planes[0][pixel], (double)planes[1][pixel], (double)planes[2][pixel]);
}

/* Projects the point at `way` from a camera to pixels from the upper left corner. False: it lies behind the camera. */
static bool project(const struct kiln_history *h, const struct kiln_view_camera *c, struct kiln_dvec3 way, double at[2])
{
    const double ahead = dvec3_dot(way, c->forward), scale = c->orthographic ? 1.0 : ahead;
    if (!(ahead > 0.0))
        return false;
    at[0] = 0.5 * h->width * (1.0 + dvec3_dot(way, c->right) / (scale * c->extent_x));
    at[1] = 0.5 * h->height * (1.0 - dvec3_dot(way, c->up) / (scale * c->extent_y));
    return true;
}

/* Vector from the camera of the previous frame to the surface seen in the pixel. */
static struct kiln_dvec3 way_of(const struct kiln_history *h, const struct kiln_frame *f, size_t pixel)
{
    if (f->surface[pixel])
        return dvec3_sub(vector_at(f->position, pixel), h->camera.position);
    const struct kiln_view_camera *c = &f->camera;
    const double x = ((double)(pixel % h->width) + f->place) / h->width * 2.0 - 1.0,
                 y = 1.0 - ((double)(pixel / h->width) + f->place) / h->height * 2.0;
    const struct kiln_dvec3 aside =
        dvec3_add(dvec3_scale(c->right, x * c->extent_x), dvec3_scale(c->up, y * c->extent_y));
    return c->orthographic ? dvec3_add(dvec3_sub(c->position, h->camera.position), dvec3_add(c->forward, aside))
                           : dvec3_add(c->forward, aside);
}

/* Whether a pixel of the previous frame sees the same surface as the new one. `off`: its distance from the new pixel's
 * tangent plane, m. */
static bool agrees(const struct kiln_history *h, const struct kiln_frame *f, bool still, size_t pixel, double off,
                   int64_t x, int64_t y)
{
    if (x < 0 || y < 0 || x >= h->width || y >= h->height)
        return false;
    const size_t tap = (size_t)y * h->width + (size_t)x;
    if (h->bound[tap] && !still)
        return false;
    if (!h->surface[tap] || !f->surface[pixel])
        return h->surface[tap] == f->surface[pixel];
    const float *const normals[3] = {h->normal[0], h->normal[1], h->normal[2]}, *const positions[3] = {h->position[0],
                                                                                                       h->position[1],
                                                                                                       h->position[2]};
    const struct kiln_dvec3 own = vector_at(f->normal, pixel), other = vector_at(normals, tap),
                            apart = dvec3_sub(vector_at(f->position, pixel), vector_at(positions, tap));
    const double lengths = dvec3_length(own) * dvec3_length(other);
    return dvec3_dot(own, other) >= (double)cosine_least * lengths &&
           fabs(dvec3_dot(own, apart)) <= off * dvec3_length(own);
}

/* Width of a pixel at the surface that it shows, m. */
static double width_at(const struct kiln_frame *f, size_t pixel)
{
    const struct kiln_view_camera *c = &f->camera;
    const double ahead = dvec3_dot(dvec3_sub(vector_at(f->position, pixel), c->position), c->forward);
    return 2.0 * c->extent_y / f->height * (c->orthographic ? 1.0 : ahead);
}

static void find_taps(const struct kiln_history *h, const struct kiln_frame *f, bool still, size_t pixel,
                      struct taps *taps)
{
    double at[2];
    *taps = (struct taps){0};
    if (!h->has_frame || (f->bound[pixel] && !still) || !project(h, &h->camera, way_of(h, f, pixel), at))
        return;
    const double x = rint((at[0] - f->place) * steps) / steps, y = rint((at[1] - f->place) * steps) / steps;
    if (!(x > -1.0 && y > -1.0 && x < h->width && y < h->height))
        return;
    const float u = (float)(x - floor(x)), v = (float)(y - floor(y));
    const float weights[4] = {(1.0f - u) * (1.0f - v), u * (1.0f - v), (1.0f - u) * v, u * v};
    const double off = f->surface[pixel] ? (double)pixels_off * width_at(f, pixel) : 0.0;
    float sum = 0.0f;
    taps->x = (int32_t)floor(x);
    taps->y = (int32_t)floor(y);
    for (int k = 0; k < 4; k++)
        if (weights[k] > 0.0f && agrees(h, f, still, pixel, off, (int64_t)taps->x + k % 2, (int64_t)taps->y + k / 2)) {
            taps->weight[k] = weights[k];
            sum += weights[k];
        }
    for (int k = 0; k < 4; k++)
        taps->weight[k] = sum >= weight_least ? taps->weight[k] / sum : 0.0f;
}

void kiln_history_find(struct kiln_history *h, const struct kiln_frame *frame)
{
    const size_t count = pixels_of(h);
    const bool still = h->has_frame && is_still(&h->camera, &frame->camera);
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t i = 0; i < count; i++)
        find_taps(h, frame, still, i, &h->taps[i]);
    for (int c = 0; c < 3; c++) {
        memcpy(h->normal[c], frame->normal[c], count * sizeof(float));
        memcpy(h->position[c], frame->position[c], count * sizeof(float));
    }
    memcpy(h->surface, frame->surface, count * sizeof *h->surface);
    memcpy(h->bound, frame->bound, count * sizeof *h->bound);
    h->camera = frame->camera;
    h->has_frame = true;
}

/* ---- layers ---- */

/* Reprojected value of a plane. A variance is summed with squared weights, since the noise of pixels is independent. */
static float take_over(const struct kiln_history *h, const struct taps *taps, const float *plane, bool squared)
{
    float sum = 0.0f;
    for (int k = 0; k < 4; k++)
        if (taps->weight[k] > 0.0f)
            sum += taps->weight[k] * (squared ? taps->weight[k] : 1.0f) *
                   plane[(size_t)(taps->y + k / 2) * h->width + (size_t)(taps->x + k % 2)];
    return sum;
}

int kiln_layer_blend(struct kiln_layer *layer, const struct kiln_history *h, double floor, bool variance,
                     float *const *planes, struct kiln_error *error)
{
    const size_t count = pixels_of(h);
    float *frames = NULL;
    const int status = kiln_allocate(&frames, count, sizeof *frames, "the frames before", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t i = 0; i < count; i++) {
        const float before = take_over(h, &h->taps[i], layer->frames, false),
                    own = fmaxf(1.0f / (before + 1.0f), (float)floor);
        frames[i] = before + 1.0f;
        for (size_t k = 0; k < layer->count && before > 0.0f; k++) {
            const bool squared = variance && k + 1 == layer->count;
            const float one = squared ? own * own : own, other = squared ? (1.0f - own) * (1.0f - own) : 1.0f - own;
            planes[k][i] = one * planes[k][i] + other * take_over(h, &h->taps[i], layer->planes[k], squared);
        }
    }
    for (size_t k = 0; k < layer->count; k++)
        memcpy(layer->planes[k], planes[k], count * sizeof(float));
    kiln_free(&layer->frames);
    layer->frames = frames;
    return KILN_OK;
}
