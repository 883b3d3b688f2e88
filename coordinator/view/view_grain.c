#include "coordinator/view/view_grain.h"

#include <math.h>
#include <stdlib.h>

#include "coordinator/output/image.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

/* Rounds of the filter; radius and side of its window, in pixels. */
enum { ROUNDS = 3, RADIUS = 2, SIDE = 2 * RADIUS + 1 };

/* Weights along a window. */
static const float bell[SIDE] = {1.0f / 16.0f, 1.0f / 4.0f, 3.0f / 8.0f, 1.0f / 4.0f, 1.0f / 16.0f};

/* Differences that count as one unit. by_normal: 1 - cosine between the normals, over alpha. by_plane: distance from
 * the tangent plane, over the distance to the next pixel. by_alpha: of alpha. least: lower limit of alpha. */
static const float by_normal = 1.0f / 16.0f, by_plane = 1.0f, by_alpha = 0.05f, least = 0.05f;

/* Added to the standard deviations per unit of luminance difference, divided by the root of a pixel's ray count: with
 * fewer rays the estimated deviation is less reliable. */
static const float unsure = 6.0f;

/* State of a pixel during filtering. y: its light divided by its share. */
struct smooth {
    float y[3], luminance, variance;
    float deviation; /* over the pixels around */
    float step;      /* m, to the next pixel */
};

/* Picture to filter. */
struct picture {
    const struct kiln_view_grain *grains;
    uint32_t *at; /* per pixel: index of its grain; KILN_NONE: none */
    struct smooth *now, *next;
    size_t count;
    uint32_t width, height;
    float by_luminance; /* standard deviations of luminance per unit of difference */
};

/* Grain of the pixel at offset (right, down) from that of grain i; KILN_NONE: none. */
static uint32_t beside(const struct picture *p, size_t i, int right, int down)
{
    const int64_t x = (int64_t)(p->grains[i].pixel % p->width) + right,
                  y = (int64_t)(p->grains[i].pixel / p->width) + down;
    return x < 0 || y < 0 || x >= p->width || y >= p->height ? KILN_NONE : p->at[(size_t)y * p->width + (size_t)x];
}

/* Bell-shaped weight of x >= 0: 1 at 0, and 0 from 4 on. */
static float fall(float x)
{
    const float left = fmaxf(0.0f, 1.0f - 0.25f * x);
    return left * left * left * left;
}

/* Difference between the surfaces of two pixels that are `apart` pixels apart. */
static float differ(const struct picture *p, size_t i, size_t k, int apart)
{
    const struct kiln_view_grain *a = &p->grains[i], *b = &p->grains[k];
    const float away = fabsf(vec3_dot(vec3_sub(b->position, a->position), a->normal)) / (float)apart;
    return fmaxf(0.0f, 1.0f - vec3_dot(a->normal, b->normal)) / (by_normal * fmaxf(a->alpha, least)) +
           away / (by_plane * p->now[i].step) + fabsf(a->alpha - b->alpha) / by_alpha;
}

static int apart_of(int right, int down) { return abs(right) > abs(down) ? abs(right) : abs(down); }

static float luminance_of(const float y[3]) { return kiln_rgb_luminance(y[0], y[1], y[2]); }

static void begin(const struct picture *p, size_t i)
{
    static const int ways[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
    const struct kiln_view_grain *g = &p->grains[i];
    struct smooth *s = &p->now[i];
    float square = INFINITY;
    for (int c = 0; c < 3; c++)
        s->y[c] = g->share[c] > 0.0f ? g->light[c] / g->share[c] : 0.0f;
    s->luminance = luminance_of(s->y);
    const float share = luminance_of(g->share);
    s->variance = share > 0.0f ? g->variance / (share * share) : 0.0f;
    for (int k = 0; k < 4; k++) {
        const uint32_t other = beside(p, i, ways[k][0], ways[k][1]);
        const struct kiln_vec3 to = vec3_sub(other != KILN_NONE ? p->grains[other].position : g->position, g->position);
        if (vec3_dot(to, to) > 0.0f)
            square = fminf(square, vec3_dot(to, to));
    }
    s->step = isfinite(square) ? sqrtf(square) : 1.0f;
}

/* Writes to `next` the mean variance of the neighbourhood; where the pixel's own variance is unknown, the variance of
 * the neighbours' luminance. */
static void look_around(const struct picture *p, size_t i)
{
    float sum = 0.0f, squares = 0.0f, weights = 0.0f, variances = 0.0f;
    for (int down = -RADIUS; down <= RADIUS; down++)
        for (int right = -RADIUS; right <= RADIUS; right++) {
            const uint32_t k = beside(p, i, right, down);
            const int apart = apart_of(right, down);
            if (k == KILN_NONE)
                continue;
            const float weight = apart == 0 ? 1.0f : fall(differ(p, i, k, apart)), luminance = p->now[k].luminance;
            weights += weight;
            sum += weight * luminance;
            squares += weight * luminance * luminance;
            variances += weight * p->now[k].variance;
        }
    const float mean = sum / weights, spread = fmaxf(0.0f, squares / weights - mean * mean);
    p->next[i] = p->now[i];
    if (p->grains[i].variance >= 0.0f)
        p->next[i].variance = variances / weights;
    else
        p->next[i].variance = weights > 1.5f ? spread * weights / (weights - 1.0f) : mean * mean;
}

static void find_deviation(const struct picture *p, size_t i)
{
    float sum = 0.0f, weights = 0.0f;
    for (int down = -1; down <= 1; down++)
        for (int right = -1; right <= 1; right++) {
            const uint32_t k = beside(p, i, right, down);
            const float weight = (float)((2 - abs(right)) * (2 - abs(down)));
            sum += k != KILN_NONE ? weight * p->now[k].variance : 0.0f;
            weights += k != KILN_NONE ? weight : 0.0f;
        }
    p->now[i].deviation = sqrtf(sum / weights);
}

/* One filter round for a pixel, with window pixels `step` apart (à trous). */
static void average(const struct picture *p, size_t i, int step)
{
    const struct smooth *own = &p->now[i];
    struct smooth *s = &p->next[i];
    const float unit = 1.0f / (p->by_luminance * own->deviation + KILN_FLOAT_TINY);
    float y[3] = {0.0f}, variance = 0.0f, weights = 0.0f;
    for (int down = -RADIUS; down <= RADIUS; down++)
        for (int right = -RADIUS; right <= RADIUS; right++) {
            const uint32_t k = beside(p, i, right * step, down * step);
            const int apart = apart_of(right, down);
            if (k == KILN_NONE)
                continue;
            const struct smooth *other = &p->now[k];
            const float off = apart == 0
                                  ? 0.0f
                                  : differ(p, i, k, apart * step) + unit * fabsf(other->luminance - own->luminance),
                        weight = bell[right + RADIUS] * bell[down + RADIUS] * fall(off);
            for (int c = 0; c < 3; c++)
                y[c] += weight * other->y[c];
            variance += weight * weight * other->variance;
            weights += weight;
        }
    *s = *own;
    for (int c = 0; c < 3; c++)
        s->y[c] = y[c] / weights;
    s->luminance = luminance_of(s->y);
    s->variance = variance / (weights * weights);
}

static void swap(struct picture *p)
{
    struct smooth *const now = p->now;
    p->now = p->next;
    p->next = now;
}

static void run(struct picture *p)
{
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t i = 0; i < p->count; i++)
        begin(p, i);
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t i = 0; i < p->count; i++)
        look_around(p, i);
    swap(p);
    for (int round = 0; round < ROUNDS; round++) {
#pragma omp parallel for schedule(dynamic, 1024)
        for (size_t i = 0; i < p->count; i++)
            find_deviation(p, i);
#pragma omp parallel for schedule(dynamic, 1024)
        for (size_t i = 0; i < p->count; i++)
            average(p, i, 1 << round);
        swap(p);
    }
}

int kiln_view_grain_smooth(struct kiln_view_grain *grains, size_t count, uint32_t width, uint32_t height, uint32_t rays,
                           struct kiln_error *error)
{
    static const char *const what = "the grain of a view";
    struct picture p = {.grains = grains,
                        .count = count,
                        .width = width,
                        .height = height,
                        .by_luminance = 1.0f + unsure / sqrtf((float)rays)};
    const size_t pixels = (size_t)width * height;
    int status;
    KILN_TRY(kiln_allocate(&p.at, pixels, sizeof *p.at, what, error));
    KILN_TRY(kiln_allocate(&p.now, count, sizeof *p.now, what, error));
    KILN_TRY(kiln_allocate(&p.next, count, sizeof *p.next, what, error));
    for (size_t i = 0; i < pixels; i++)
        p.at[i] = KILN_NONE;
    for (size_t i = 0; i < count; i++)
        p.at[grains[i].pixel] = (uint32_t)i;
    run(&p);
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++)
            grains[i].light[c] = grains[i].share[c] > 0.0f ? p.now[i].y[c] * grains[i].share[c] : grains[i].light[c];
end:
    kiln_free(&p.at);
    kiln_free(&p.now);
    kiln_free(&p.next);
    return status;
}
