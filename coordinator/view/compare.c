#include "coordinator/view/compare.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/output/tone_map.h"
#include "worker/base/arena.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

enum { RADIUS = 5, WINDOW = 2 * RADIUS + 1 };
static const double sigma = 1.5, c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;

struct pair {
    uint32_t width, height, channel_count;
    const float *a[KILN_COMPARE_CHANNELS_MAX], *b[KILN_COMPARE_CHANNELS_MAX];
    char names[KILN_COMPARE_CHANNELS_MAX][KILN_CHANNEL_NAME_SIZE];
    bool colour;   /* the compared channels are R, G, B, in this order */
    uint8_t *used; /* for each texel: 0 not compared, 1 valid in both images, 2 also wholly inside charts */
    double exposure;
    float *tone_a, *tone_b; /* tone-mapped luminance; then of 8-bit pictures */
    struct kiln_arena arena;
};

/* ---- selection of channels and texels ---- */

static bool add_channel(struct pair *p, const struct kiln_image *a, const struct kiln_image *b, const char *name)
{
    const struct kiln_image_channel *ca = kiln_image_find(a, name), *cb = kiln_image_find(b, name);
    if (ca == NULL || cb == NULL || p->channel_count == KILN_COMPARE_CHANNELS_MAX)
        return false;
    p->a[p->channel_count] = ca->values;
    p->b[p->channel_count] = cb->values;
    (void)snprintf(p->names[p->channel_count++], KILN_CHANNEL_NAME_SIZE, "%s", name);
    return true;
}

static void choose_channels(struct pair *p, const struct kiln_image *a, const struct kiln_image *b)
{
    p->colour = add_channel(p, a, b, "R") && add_channel(p, a, b, "G") && add_channel(p, a, b, "B");
    if (p->colour)
        return;
    p->channel_count = 0;
    for (size_t i = 0; i < a->channel_count; i++)
        if (strcmp(a->channels[i].name, "validity.Y") != 0 && strcmp(a->channels[i].name, "coverage.Y") != 0)
            (void)add_channel(p, a, b, a->channels[i].name);
}

/* Lowers `used` to `state` at texels whose value in the channel `name` is below `least`, if the image has that channel.
 */
static void lower(struct pair *p, const struct kiln_image *image, const char *name, float least, uint8_t state)
{
    const struct kiln_image_channel *channel = kiln_image_find(image, name);
    const size_t count = (size_t)p->width * p->height;
    for (size_t i = 0; channel != NULL && i < count; i++)
        if (!(channel->values[i] >= least) && p->used[i] > state)
            p->used[i] = state;
}

static uint64_t drop_not_finite(struct pair *p)
{
    const size_t count = (size_t)p->width * p->height;
    uint64_t dropped = 0;
    for (size_t i = 0; i < count; i++) {
        bool finite = true;
        for (uint32_t c = 0; c < p->channel_count; c++)
            finite = finite && isfinite(p->a[c][i]) && isfinite(p->b[c][i]);
        if (!finite && p->used[i] != 0) {
            p->used[i] = 0;
            dropped++;
        }
    }
    return dropped;
}

static int pair_images(struct pair *p, const struct kiln_image *a, const struct kiln_image *b, uint64_t *not_finite,
                       struct kiln_error *error)
{
    if (a->width != b->width || a->height != b->height)
        return kiln_fail(error, KILN_BAD_INPUT, "the images differ in size: %u x %u and %u x %u texels", a->width,
                         a->height, b->width, b->height);
    p->width = a->width;
    p->height = a->height;
    choose_channels(p, a, b);
    if (p->channel_count == 0)
        return kiln_fail(error, KILN_BAD_INPUT, "the images have no common channel");
    const size_t count = (size_t)p->width * p->height;
    const int status = kiln_arena_allocate(&p->arena, &p->used, count, 1, "texels to compare", error);
    if (status != KILN_OK)
        return status;
    memset(p->used, 2, count);
    lower(p, a, "coverage.Y", 0.9995f, 1); /* 1, with rounding: the next smaller half is 1 - 2^-11 */
    lower(p, b, "coverage.Y", 0.9995f, 1);
    lower(p, a, "validity.Y", 1.0f, 0);
    lower(p, b, "validity.Y", 1.0f, 0);
    *not_finite = drop_not_finite(p);
    return KILN_OK;
}

static bool same_bits(const struct kiln_image *a, const struct kiln_image *b)
{
    if (a->width != b->width || a->height != b->height || a->channel_count != b->channel_count)
        return false;
    for (size_t c = 0; c < a->channel_count; c++)
        if (strcmp(a->channels[c].name, b->channels[c].name) != 0 ||
            memcmp(a->channels[c].values, b->channels[c].values, (size_t)a->width * a->height * sizeof(float)) != 0)
            return false;
    return true;
}

/* ---- sums ---- */

static double luminance(const struct pair *p, const float *const planes[], size_t i)
{
    double sum = 0.0;
    if (p->colour)
        return kiln_luminance_of_floats((float[3]){planes[0][i], planes[1][i], planes[2][i]});
    for (uint32_t c = 0; c < p->channel_count; c++)
        sum += (double)planes[c][i];
    return sum / p->channel_count;
}

static void sum_texel(const struct pair *p, size_t i, struct kiln_difference *d)
{
    double squares = 0.0, reference = 0.0;
    for (uint32_t c = 0; c < p->channel_count; c++) {
        struct kiln_channel_difference *channel = &d->channels[c];
        const double b = (double)p->b[c][i], difference = (double)p->a[c][i] - b;
        squares += difference * difference;
        reference += b;
        channel->squares += difference * difference;
        channel->differences += difference;
        channel->reference += b;
        d->peak = fmax(d->peak, fabs(b));
        d->largest = fmax(d->largest, b);
    }
    d->texels++;
    d->squares += squares;
    d->reference += reference;
    d->lengths += sqrt(squares);
    if (p->used[i] == 2) {
        d->interior++;
        d->interior_squares += squares;
        d->interior_reference += reference;
    }
    if (sqrt(squares) > d->worst || d->texels == 1) {
        d->worst = sqrt(squares);
        d->worst_x = (uint32_t)(i % p->width);
        d->worst_y = (uint32_t)(i / p->width);
    }
}

static void sum_relative(const struct pair *p, struct kiln_difference *d)
{
    const size_t count = (size_t)p->width * p->height;
    double total = 0.0;
    for (size_t i = 0; i < count; i++)
        for (uint32_t c = 0; p->used[i] != 0 && c < p->channel_count; c++)
            total += fabs((double)p->b[c][i]);
    const double floor_value = d->texels == 0 ? 0.0 : 0.01 * total / ((double)d->texels * p->channel_count);
    for (size_t i = 0; i < count; i++)
        for (uint32_t c = 0; p->used[i] != 0 && c < p->channel_count; c++) {
            const double difference = (double)p->a[c][i] - (double)p->b[c][i],
                         by = fabs((double)p->b[c][i]) + floor_value;
            if (by > 0.0)
                d->relative_squares += difference * difference / (by * by);
            else if (difference != 0.0) /* the whole reference is black: any light is an error of 100 % */
                d->relative_squares += 1.0;
        }
}

/* Code of a value in an 8-bit picture, over 255. */
static double code_of(float value, double scale)
{
    const double unit = isfinite(value) ? fmin(fmax((double)value / scale, 0.0), 1.0) : 0.0;
    return floor(255.0 * unit + 0.5) / 255.0;
}

static void sum_codes(const struct pair *p, double largest, struct kiln_difference *d)
{
    const size_t count = (size_t)p->width * p->height;
    const double scale = largest > 0.0 ? largest : 1.0;
    d->pixels = (double)count;
    d->code_lengths = 0.0;
    for (size_t i = 0; i < count; i++) {
        double squares = 0.0;
        for (uint32_t c = 0; c < p->channel_count; c++) {
            const double difference = code_of(p->a[c][i], scale) - code_of(p->b[c][i], scale);
            squares += difference * difference;
        }
        d->code_lengths += sqrt(squares);
    }
}

/* ---- structural similarity ---- */

static double choose_exposure(const struct pair *p)
{
    const size_t count = (size_t)p->width * p->height;
    double logarithms = 0.0;
    uint64_t bright = 0;
    for (size_t i = 0; i < count; i++) {
        const double l = p->used[i] != 0 ? luminance(p, p->b, i) : 0.0;
        if (l > 0.0) {
            logarithms += log(l);
            bright++;
        }
    }
    return bright == 0 ? 1.0 : 0.18 / exp(logarithms / (double)bright);
}

static void map_tones(struct pair *p)
{
    const size_t count = (size_t)p->width * p->height;
    for (size_t i = 0; i < count; i++) {
        if (p->used[i] == 0)
            continue;
        const double la = p->exposure * fmax(0.0, luminance(p, p->a, i)),
                     lb = p->exposure * fmax(0.0, luminance(p, p->b, i));
        p->tone_a[i] = (float)(la / (1.0 + la));
        p->tone_b[i] = (float)(lb / (1.0 + lb));
    }
}

/* The 8-bit codes that a picture shows a texel with. */
static void picture_codes(const struct pair *p, const float *const planes[], size_t i, double code[3])
{
    const struct kiln_tone tone = {KILN_TONE_REINHARD, p->exposure, INFINITY};
    float rgb[3];
    for (int c = 0; c < 3; c++)
        rgb[c] = p->colour ? planes[c][i] : (float)luminance(p, planes, i);
    kiln_tone_map_color(&tone, rgb, code);
    for (int c = 0; c < 3; c++)
        code[c] = floor(255.0 * code[c] + 0.5) / 255.0;
}

/* Sums up the differences of the 8-bit pictures, and replaces the tone-mapped luminance by that of the 8-bit codes. */
static void make_pictures(struct pair *p, struct kiln_difference *d)
{
    const size_t count = (size_t)p->width * p->height;
    for (size_t i = 0; i < count; i++) {
        double a[3], b[3];
        if (p->used[i] == 0)
            continue;
        picture_codes(p, p->a, i, a);
        picture_codes(p, p->b, i, b);
        for (int c = 0; c < 3; c++)
            d->picture_squares += (a[c] - b[c]) * (a[c] - b[c]);
        p->tone_a[i] = (float)kiln_luminance_of_floats((float[3]){(float)a[0], (float)a[1], (float)a[2]});
        p->tone_b[i] = (float)kiln_luminance_of_floats((float[3]){(float)b[0], (float)b[1], (float)b[2]});
    }
}

/* Structural similarity in the window around texel (x, y). */
static double similarity_at(const struct pair *p, const double gauss[WINDOW], int64_t x, int64_t y)
{
    double weights = 0.0, a = 0.0, b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0;
    for (int64_t v = y - RADIUS; v <= y + RADIUS; v++)
        for (int64_t u = x - RADIUS; u <= x + RADIUS; u++) {
            if (u < 0 || v < 0 || u >= p->width || v >= p->height || p->used[v * p->width + u] == 0)
                continue;
            const double w = gauss[u - x + RADIUS] * gauss[v - y + RADIUS];
            const double ta = (double)p->tone_a[v * p->width + u], tb = (double)p->tone_b[v * p->width + u];
            weights += w;
            a += w * ta;
            b += w * tb;
            aa += w * ta * ta;
            bb += w * tb * tb;
            ab += w * ta * tb;
        }
    a /= weights;
    b /= weights;
    const double variance_a = fmax(0.0, aa / weights - a * a), variance_b = fmax(0.0, bb / weights - b * b),
                 covariance = ab / weights - a * b;
    return (2.0 * a * b + c1) * (2.0 * covariance + c2) / ((a * a + b * b + c1) * (variance_a + variance_b + c2));
}

/* The sum over T of the structural similarity of tone_a and tone_b. `rows`: scratch, one for each row. */
static double sum_windows(const struct pair *p, double *rows)
{
    double gauss[WINDOW], sum = 0.0;
    for (int i = 0; i < WINDOW; i++)
        gauss[i] = exp(-0.5 * (i - RADIUS) * (i - RADIUS) / (sigma * sigma));
#pragma omp parallel for schedule(dynamic, 8)
    for (uint32_t y = 0; y < p->height; y++) {
        rows[y] = 0.0;
        for (uint32_t x = 0; x < p->width; x++)
            if (p->used[(size_t)y * p->width + x] != 0)
                rows[y] += similarity_at(p, gauss, x, y);
    }
    for (uint32_t y = 0; y < p->height; y++) /* in the order of rows, so that the sum does not depend on threads */
        sum += rows[y];
    return sum;
}

static int sum_similarity(struct pair *p, struct kiln_difference *d, struct kiln_error *error)
{
    const size_t count = (size_t)p->width * p->height;
    double *rows = NULL;
    int status;
    KILN_TRY(kiln_arena_allocate(&p->arena, &p->tone_a, count, sizeof(float), "tone-mapped luminance", error));
    KILN_TRY(kiln_arena_allocate(&p->arena, &p->tone_b, count, sizeof(float), "tone-mapped luminance", error));
    KILN_TRY(kiln_allocate(&rows, p->height, sizeof *rows, "sums of rows", error));
end:
    if (status != KILN_OK)
        return status;
    p->exposure = choose_exposure(p);
    map_tones(p);
    d->similarity = sum_windows(p, rows);
    make_pictures(p, d);
    d->picture_similarity = sum_windows(p, rows);
    kiln_free(&rows);
    return KILN_OK;
}

/* ---- metrics ---- */

static void derive(struct kiln_difference *d)
{
    const double texels = d->measure, values = texels * d->channel_count,
                 interior = d->interior_measure * d->channel_count;
    d->rmse = values > 0.0 ? sqrt(d->squares / values) : 0.0;
    d->nrmse = d->interior_reference > 0.0 ? sqrt(d->interior_squares / interior) / (d->interior_reference / interior)
                                           : (double)NAN;
    d->rel_rmse = values > 0.0 ? sqrt(d->relative_squares / values) : 0.0;
    d->psnr = d->rmse > 0.0 ? 20.0 * log10(d->peak / d->rmse) : (double)INFINITY;
    d->dssim = texels > 0.0 ? 0.5 * (1.0 - d->similarity / texels) : 0.0;
    d->picture_psnr = d->picture_squares > 0.0 ? 10.0 * log10(3.0 * texels / d->picture_squares) : (double)INFINITY;
    const double alike = texels > 0.0 ? d->picture_similarity / texels : 1.0;
    d->picture_dissimilarity = alike > 0.0 ? fmax(0.0, 1.0 / alike - 1.0) : (double)INFINITY;
    d->dfpr = texels > 0.0 ? d->lengths / texels : 0.0;
    d->dfpr_unit = d->largest > 0.0 ? d->dfpr / d->largest : 0.0;
    d->dfpr_8bit = d->pixels > 0.0 ? d->code_lengths / d->pixels : 0.0;
    d->mean = values > 0.0 ? d->reference / values : 0.0;
    for (uint32_t c = 0; texels > 0.0 && c < d->channel_count; c++) {
        d->channels[c].rmse = sqrt(d->channels[c].squares / texels);
        d->channels[c].mean_difference = d->channels[c].differences / texels;
        d->channels[c].mean = d->channels[c].reference / texels;
    }
}

static void destroy_pair(struct pair *p) { kiln_arena_release(&p->arena); }

int kiln_compare_images(const struct kiln_image *a, const struct kiln_image *b, struct kiln_difference *difference,
                        struct kiln_error *error)
{
    struct pair p = {0};
    struct kiln_difference *d = difference;
    *d = (struct kiln_difference){.identical = same_bits(a, b), .weight = 1.0};
    int status;
    KILN_TRY(pair_images(&p, a, b, &d->not_finite, error));
    d->channel_count = p.channel_count;
    for (uint32_t c = 0; c < p.channel_count; c++)
        memcpy(d->channels[c].name, p.names[c], sizeof p.names[c]);
    for (size_t i = 0; i < (size_t)p.width * p.height; i++)
        if (p.used[i] != 0)
            sum_texel(&p, i, d);
    d->measure = (double)d->texels;
    d->interior_measure = (double)d->interior;
    sum_relative(&p, d);
    sum_codes(&p, d->largest, d);
    KILN_TRY(sum_similarity(&p, d, error));
    derive(d);
end:
    destroy_pair(&p);
    return status;
}

int kiln_compare_codes(const struct kiln_image *a, const struct kiln_image *b, double largest,
                       struct kiln_difference *difference, struct kiln_error *error)
{
    struct pair p = {0};
    uint64_t not_finite = 0;
    const int status = pair_images(&p, a, b, &not_finite, error);
    if (status == KILN_OK) {
        sum_codes(&p, largest, difference);
        derive(difference);
    }
    destroy_pair(&p);
    return status;
}

void kiln_difference_add(struct kiln_difference *set, const struct kiln_difference *one)
{
    if (one->texels > 0 && (set->texels == 0 || one->worst > set->worst)) {
        set->worst = one->worst;
        set->worst_x = one->worst_x;
        set->worst_y = one->worst_y;
    }
    set->texels += one->texels;
    set->interior += one->interior;
    set->not_finite += one->not_finite;
    set->identical = set->identical && one->identical;
    set->measure += one->weight * one->measure;
    set->interior_measure += one->weight * one->interior_measure;
    set->squares += one->weight * one->squares;
    set->interior_squares += one->weight * one->interior_squares;
    set->interior_reference += one->weight * one->interior_reference;
    set->relative_squares += one->weight * one->relative_squares;
    set->lengths += one->weight * one->lengths;
    set->pixels += one->weight * one->pixels;
    set->code_lengths += one->weight * one->code_lengths;
    set->similarity += one->weight * one->similarity;
    set->picture_similarity += one->weight * one->picture_similarity;
    set->picture_squares += one->weight * one->picture_squares;
    set->reference += one->weight * one->reference;
    set->peak = fmax(set->peak, one->peak);
    set->largest = fmax(set->largest, one->largest);
    set->channel_count = one->channel_count;
    for (uint32_t c = 0; c < one->channel_count; c++) {
        memcpy(set->channels[c].name, one->channels[c].name, sizeof one->channels[c].name);
        set->channels[c].squares += one->weight * one->channels[c].squares;
        set->channels[c].differences += one->weight * one->channels[c].differences;
        set->channels[c].reference += one->weight * one->channels[c].reference;
    }
    derive(set);
}

/* ---- picture ---- */

static void heat(double t, uint8_t rgb[3])
{
    static const double stops[5][3] = {{0, 0, 0}, {0.1, 0.1, 0.8}, {0.9, 0.1, 0.1}, {1, 0.9, 0.1}, {1, 1, 1}};
    const double place = 4.0 * fmin(1.0, fmax(0.0, t));
    const int below = place < 4.0 ? (int)place : 3;
    for (int c = 0; c < 3; c++)
        rgb[c] = (uint8_t)(255.0 * (stops[below][c] + (place - below) * (stops[below + 1][c] - stops[below][c])) + 0.5);
}

int kiln_difference_picture(const struct kiln_image *a, const struct kiln_image *b, double full, uint8_t *bytes,
                            struct kiln_error *error)
{
    struct pair p = {0};
    uint64_t not_finite;
    const int status = pair_images(&p, a, b, &not_finite, error);
    const size_t count = (size_t)a->width * a->height;
    double sum = 0.0;
    uint64_t used = 0;
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        if (p.used[i] != 0) {
            sum += luminance(&p, p.b, i);
            used++;
        }
    const double mean = used > 0 && sum > 0.0 ? sum / (double)used : 1.0;
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        double squares = 0.0;
        for (uint32_t c = 0; c < p.channel_count; c++) {
            const double difference = (double)p.a[c][i] - (double)p.b[c][i];
            squares += difference * difference;
        }
        if (p.used[i] != 0)
            heat(sqrt(squares) / (full * mean), bytes + 3 * i);
        else
            memset(bytes + 3 * i, 64, 3);
    }
    destroy_pair(&p);
    return status;
}
