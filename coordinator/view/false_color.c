#include "coordinator/view/false_color.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "worker/base/memory.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wsign-conversion"
#pragma GCC diagnostic ignored "-Wunused-function"
#include <stb_easy_font.h>
#pragma GCC diagnostic pop

enum { MARGIN = 8, BAR = 14, TEXT_TOP = 27, QUADS = 512, MISSING = 96, PAPER = 24, INK = 235, WIDE = 800 };
static const uint8_t marked[3] = {255, 120, 0};
static const double SHARE = 0.005; /* of the pixels, to leave out beyond each end of a scale */

/* ---- the range ---- */

static int compare_floats(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}

/* The finite values of a plane from `least` on, sorted; returns their number. */
static size_t sort_finite(const float *plane, size_t pixels, float least, float *sorted)
{
    size_t count = 0;
    for (size_t i = 0; i < pixels; i++)
        if (isfinite(plane[i]) && plane[i] >= least)
            sorted[count++] = plane[i];
    qsort(sorted, count, sizeof *sorted, compare_floats);
    return count;
}

int kiln_false_color_fit(struct kiln_picture *picture, struct kiln_error *error)
{
    const size_t pixels = (size_t)picture->image->width * picture->image->height;
    const bool scale = picture->meaning == KILN_FIELD_SCALE;
    const double share = scale ? SHARE : 0.0;
    float *planes[3], *sorted = NULL;
    const int status = kiln_allocate(&sorted, pixels, sizeof *sorted, "the values of a picture", error);
    for (int c = 0; status == KILN_OK && kiln_image_rgb(picture->image, "", planes) && c < 3; c++) {
        const size_t count = sort_finite(planes[c], pixels, scale ? 0.0f : -INFINITY, sorted),
                     beyond = (size_t)(share * (double)count);
        picture->low[c] = count > 0 ? (double)sorted[beyond] : 0.0;
        picture->high[c] = count > 0 ? (double)sorted[count - 1 - beyond] : 0.0;
    }
    kiln_free(&sorted);
    return status;
}

/* ---- colours ---- */

/* Colour map for values 0 to 1, as 8-bit sRGB: dark violet, blue, green, yellow, with increasing lightness. */
static void color_of(double value, uint8_t rgb[3])
{
    /* of even steps in lightness (CIELAB 14 to 92) */
    static const uint8_t stops[][3] = {{68, 1, 84},    {71, 45, 123}, {59, 82, 139},  {44, 114, 142}, {33, 145, 140},
                                       {40, 174, 128}, {94, 201, 98}, {173, 220, 48}, {253, 231, 37}};
    enum { LAST = sizeof stops / sizeof *stops - 1 };
    const double at = LAST * fmin(fmax(value, 0.0), 1.0);
    const size_t below = at >= LAST ? LAST - 1 : (size_t)at;
    for (int c = 0; c < 3; c++)
        rgb[c] = (uint8_t)lround(stops[below][c] + (at - (double)below) * (stops[below + 1][c] - stops[below][c]));
}

static double place_in(const struct kiln_picture *p, int c, double value)
{
    return p->high[c] > p->low[c] ? (value - p->low[c]) / (p->high[c] - p->low[c]) : 0.0;
}

/* A linear colour as it is. */
static void plain_color(const float color[3], uint8_t rgb[3])
{
    const struct kiln_tone plain = {.curve = KILN_TONE_NONE, .exposure = 1.0, .white = INFINITY};
    double code[3];
    kiln_tone_map_color(&plain, color, code);
    for (int c = 0; c < 3; c++)
        rgb[c] = (uint8_t)lround(255.0 * code[c]);
}

static void color_pixel(const struct kiln_picture *p, float *const planes[3], size_t i, uint8_t rgb[3])
{
    const bool scale = p->meaning == KILN_FIELD_SCALE;
    if (p->key != NULL) {
        plain_color((const float[]){planes[0][i], planes[1][i], planes[2][i]}, rgb);
        return;
    }
    memset(rgb, MISSING, 3);
    if (!isfinite(planes[0][i]) || !isfinite(planes[1][i]) || !isfinite(planes[2][i]))
        return;
    if (scale && planes[0][i] < 0.0f)
        memcpy(rgb, marked, 3);
    else if (scale)
        color_of(place_in(p, 0, (double)planes[0][i]), rgb);
    for (int c = 0; c < 3 && !scale; c++)
        rgb[c] = (uint8_t)lround(255.0 * fmin(fmax(place_in(p, c, (double)planes[c][i]), 0.0), 1.0));
}

/* ---- the strip ---- */

struct canvas {
    uint8_t *bytes;
    uint32_t width, height, top; /* pixels; top: where the strip begins */
    int zoom;                    /* pixels along a side of each dot */
};

/* Width of the strip, as drawn. */
static int width_of_strip(const struct canvas *c) { return (int)c->width / c->zoom; }

/* Draws a dot of the strip, at x, y from its upper left corner. */
static void put(const struct canvas *c, int x, int y, const uint8_t rgb[3])
{
    for (int v = c->zoom * y; v < c->zoom * (y + 1); v++)
        for (int u = c->zoom * x; u < c->zoom * (x + 1); u++)
            if (u >= 0 && v >= 0 && u < (int)c->width && v < (int)(c->height - c->top))
                memcpy(c->bytes + 3 * ((size_t)(v + (int)c->top) * c->width + (size_t)u), rgb, 3);
}

static int width_of(const char *text)
{
    char copy[80];
    (void)snprintf(copy, sizeof copy, "%s", text);
    return stb_easy_font_width(copy);
}

/* Writes a text with its left upper corner at x, y. */
static void write_text(const struct canvas *c, int x, int y, const char *text)
{
    static const uint8_t ink[3] = {INK, INK, INK};
    float quads[QUADS * 16];
    char copy[80];
    (void)snprintf(copy, sizeof copy, "%s", text);
    const int count = stb_easy_font_print((float)x, (float)y, copy, NULL, quads, (int)sizeof quads);
    for (int i = 0; i < count; i++) { /* of each corner x, y, z and a colour; corners 0 and 2 are opposite */
        const float *from = quads + 16 * i, *to = from + 8;
        for (int v = (int)from[1]; v < (int)to[1]; v++)
            for (int u = (int)from[0]; u < (int)to[0]; u++)
                put(c, u, v, ink);
    }
}

/* The bar of colours, with numbers at its ends and its middle. */
static void draw_scale(const struct canvas *c, const struct kiln_picture *p)
{
    const int left = MARGIN, right = width_of_strip(c) - MARGIN;
    char text[80];
    for (int x = left; x < right; x++) {
        uint8_t rgb[3];
        color_of((double)(x - left) / (double)(right - left - 1), rgb);
        for (int y = 0; y < BAR; y++)
            put(c, x, MARGIN + y, rgb);
    }
    (void)snprintf(text, sizeof text, "%.3g", p->low[0]);
    write_text(c, left, TEXT_TOP, text);
    (void)snprintf(text, sizeof text, "%.3g %s", 0.5 * (p->low[0] + p->high[0]), p->unit != NULL ? p->unit : "");
    write_text(c, (left + right - width_of(text)) / 2, TEXT_TOP, text);
    (void)snprintf(text, sizeof text, "%.3g", p->high[0]);
    write_text(c, right - width_of(text), TEXT_TOP, text);
}

/* Draws a legend of what red, green and blue mean. */
static void draw_places(const struct canvas *c, const struct kiln_picture *p)
{
    static const char axes[] = "xyz";
    const int third = (width_of_strip(c) - 2 * MARGIN) / 3;
    for (int a = 0; a < 3; a++) {
        char text[80];
        for (int x = 0; x < third - MARGIN; x++) {
            uint8_t rgb[3] = {0, 0, 0};
            rgb[a] = (uint8_t)lround(255.0 * x / fmax(1.0, third - MARGIN - 1));
            for (int y = 0; y < BAR; y++)
                put(c, MARGIN + a * third + x, MARGIN + y, rgb);
        }
        (void)snprintf(text, sizeof text, "%c %.3g to %.3g %s", axes[a], p->low[a], p->high[a],
                       p->unit != NULL ? p->unit : "");
        write_text(c, MARGIN + a * third, TEXT_TOP, text);
    }
}

/* Draws a legend: for each pair of colours a checkerboard, above its word. */
static void draw_key(const struct canvas *c, const struct kiln_color_key *key)
{
    const int part = (width_of_strip(c) - 2 * MARGIN) / key->pairs;
    for (int i = 0; i < key->pairs; i++) {
        for (int x = 0; x < part - MARGIN; x++) {
            uint8_t rgb[3];
            plain_color(key->of[i].rgb[x / BAR % 2], rgb);
            for (int y = 0; y < BAR; y++)
                put(c, MARGIN + i * part + x, MARGIN + y, rgb);
        }
        write_text(c, MARGIN + i * part, TEXT_TOP, key->of[i].text);
    }
}

int kiln_false_color_write(const char *directory, const char *name, const struct kiln_picture *picture,
                           const char *description, struct kiln_error *error)
{
    const struct kiln_image *image = picture->image;
    const size_t pixels = (size_t)image->width * image->height;
    struct canvas c = {
        .width = image->width, .height = image->height, .top = image->height, .zoom = image->width >= WIDE ? 2 : 1};
    float *planes[3];
    if (image->width >= KILN_LEGEND_LEAST)
        c.height += KILN_LEGEND_HEIGHT * (uint32_t)c.zoom;
    if (!kiln_image_rgb(image, "", planes))
        return kiln_fail(error, KILN_BAD_INPUT, "the image has no channels R, G and B to show");
    int status = kiln_allocate(&c.bytes, (size_t)c.width * c.height, 3, "a picture's bytes", error);
    if (status != KILN_OK)
        return status;
    memset(c.bytes, PAPER, 3 * (size_t)c.width * c.height);
    for (size_t i = 0; i < pixels; i++)
        color_pixel(picture, planes, i, c.bytes + 3 * i);
    if (c.height > c.top && picture->key != NULL)
        draw_key(&c, picture->key);
    else if (c.height > c.top && picture->meaning == KILN_FIELD_SCALE)
        draw_scale(&c, picture);
    else if (c.height > c.top)
        draw_places(&c, picture);
    status = kiln_png_write_bytes(directory, name, c.bytes, c.width, c.height, description, error);
    kiln_free(&c.bytes);
    return status;
}
