#include <math.h>

#include "coordinator/bench/order_private.h"
#include "coordinator/files/html.h"

enum { WIDTH = 860, HEIGHT = 560, LEFT = 78, RIGHT = 170, TOP = 48, BOTTOM = 86 };

/* Across: the side of a cell, logarithmic; or the orders of work, side by side. Up: seconds from 0. */
struct frame {
    bool orders;
    double low, high; /* log10 of the side in metres, or positions */
    double most;      /* seconds */
};

static const char *const colors[] = {"#1f5fa8", "#c4451c", "#3d8b37", "#8a4fb0", "#b08a00", "#555555"};
enum { COLORS = sizeof colors / sizeof *colors };

static double position(const struct frame *f, const struct kiln_setting *s, const struct kiln_setting_result *r)
{
    return f->orders ? (s->objects ? 1.0 : 0.0) : log10(r->cell_size);
}

static double across(const struct frame *f, double at)
{
    return LEFT + (WIDTH - LEFT - RIGHT) * (at - f->low) / (f->high - f->low);
}

static double up(const struct frame *f, double seconds)
{
    return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * seconds / f->most;
}

static bool is_shown(const struct kiln_setting_result *r) { return r->done && r->cell_size > 0.0; }

static struct frame fit(const struct kiln_sweep *sweep)
{
    struct frame f = {.orders = sweep->settings[sweep->count - 1].objects, .low = INFINITY, .high = -INFINITY};
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting_result *r = &sweep->results[i];
        if (!is_shown(r))
            continue;
        f.low = fmin(f.low, position(&f, &sweep->settings[i], r));
        f.high = fmax(f.high, position(&f, &sweep->settings[i], r));
        f.most = fmax(f.most, kiln_sweep_spread(r, KILN_TIME_LIGHT).most);
    }
    const double middle = isfinite(f.low) ? 0.5 * (f.low + f.high) : 0.0,
                 half = isfinite(f.low) ? fmax(f.orders ? 1.0 : 0.15, 0.55 * (f.high - f.low)) : 0.5;
    f.low = middle - half;
    f.high = middle + half;
    f.most = f.most > 0.0 ? 1.08 * f.most : 1.0;
    return f;
}

/* Grid lines of the seconds: at most ten, 1, 2 or 5 times a power of ten apart. */
static void add_seconds(struct kiln_html *page, const struct frame *f)
{
    double apart = pow(10.0, floor(log10(f->most)) - 1.0);
    for (int i = 0; f->most / apart > 10.0; i++)
        apart *= i % 3 == 1 ? 2.5 : 2.0;
    for (int i = 0; i * apart <= f->most; i++)
        kiln_html_add(page,
                      "<path d=\"M%d %.1fH%d\" stroke=\"#ddd\"/><text x=\"%d\" y=\"%.1f\" text-anchor=\"end\">%g "
                      "s</text>\n",
                      LEFT, up(f, i * apart), WIDTH - RIGHT, LEFT - 8, up(f, i * apart) + 4.0, i * apart);
}

static void add_frame(struct kiln_html *page, const struct frame *f, const char *scene)
{
    kiln_html_add(page,
                  "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" "
                  "font-family=\"sans-serif\" font-size=\"12\"><rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n"
                  "<text x=\"%d\" y=\"24\" font-size=\"15\">Time of light by %s: ",
                  WIDTH, HEIGHT, WIDTH, HEIGHT, LEFT, f->orders ? "order of work" : "side of a cell");
    kiln_html_text(page, scene);
    kiln_html_add(page, "</text>\n");
    add_seconds(page, f);
    kiln_html_add(page,
                  "<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">%s</text>\n<text transform=\"translate(16 %d) "
                  "rotate(-90)\" text-anchor=\"middle\">passes of light</text>\n",
                  (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 14,
                  f->orders ? "order of work: per cell, or per object" : "side of a radiance cell (logarithmic)",
                  (TOP + HEIGHT - BOTTOM) / 2);
}

/* A setting's name and side below the axis, once for all numbers of ranks; given sides a line lower. */
static void add_label(struct kiln_html *page, const struct frame *f, const struct kiln_setting *s,
                      const struct kiln_setting_result *r)
{
    const double x = across(f, position(f, s, r));
    const bool given = !(s->cell_factor > 0.0);
    char factor[KILN_ORDER_NAME];
    kiln_order_factor(s->cell_factor, factor);
    const int y = HEIGHT - BOTTOM + 18;
    kiln_html_add(page, "<path d=\"M%.1f %dV%d\" stroke=\"#ddd\"/>", x, TOP, HEIGHT - BOTTOM);
    if (f->orders)
        kiln_html_add(page, "<text x=\"%.1f\" y=\"%d\" text-anchor=\"middle\">%s</text>\n", x, y,
                      s->objects ? "objects" : "cells");
    else if (given)
        kiln_html_add(page, "<text x=\"%.1f\" y=\"%d\" text-anchor=\"middle\">%.3g m</text>\n", x, y + 32,
                      r->cell_size);
    else
        kiln_html_add(page,
                      "<text x=\"%.1f\" y=\"%d\" text-anchor=\"middle\"%s>%s</text><text x=\"%.1f\" y=\"%d\" "
                      "text-anchor=\"middle\">%.3g m</text>\n",
                      x, y, kiln_order_is_usual(s) ? " font-weight=\"bold\"" : "", factor, x, y + 16, r->cell_size);
}

/* The settings of a number of ranks that have results, from left to right; returns their number. */
static size_t line_of(const struct kiln_sweep *sweep, const struct frame *f, uint32_t ranks, size_t *indices)
{
    size_t count = 0;
    for (size_t i = 0; i < sweep->count; i++) {
        if (sweep->settings[i].ranks != ranks || !is_shown(&sweep->results[i]))
            continue;
        size_t at = count++;
        const double here = position(f, &sweep->settings[i], &sweep->results[i]);
        for (; at > 0 && position(f, &sweep->settings[indices[at - 1]], &sweep->results[indices[at - 1]]) > here; at--)
            indices[at] = indices[at - 1];
        indices[at] = i;
    }
    return count;
}

/* Lines lie a little beside each other, so that bars can be told apart. */
static double place(const struct kiln_sweep *sweep, const struct frame *f, size_t number, size_t i)
{
    return across(f, position(f, &sweep->settings[i], &sweep->results[i])) + 6.0 * (double)number;
}

/* The medians, with a bar from the least to the most of the runs at each; indirect light is dashed, without bars. */
static void add_line(struct kiln_html *page, const struct kiln_sweep *sweep, const struct frame *f, size_t number,
                     enum kiln_sweep_time time, const size_t *indices, size_t count)
{
    const char *color = colors[number % COLORS];
    const bool all = time == KILN_TIME_LIGHT;
    kiln_html_add(page, "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"2\"%s points=\"", color,
                  all ? "" : " stroke-dasharray=\"5 4\"");
    for (size_t i = 0; i < count; i++)
        kiln_html_add(page, "%.1f,%.1f ", place(sweep, f, number, indices[i]),
                      up(f, kiln_sweep_spread(&sweep->results[indices[i]], time).median));
    kiln_html_add(page, "\"/>\n");
    for (size_t i = 0; i < count; i++) {
        const struct kiln_setting_result *r = &sweep->results[indices[i]];
        const struct kiln_spread t = kiln_sweep_spread(r, time);
        const double x = place(sweep, f, number, indices[i]);
        if (all)
            kiln_html_add(page, "<path d=\"M%.1f %.1fV%.1f\" stroke=\"%s\" stroke-width=\"1.5\"/>", x, up(f, t.least),
                          up(f, t.most), color);
        kiln_html_add(page, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"%s\" stroke=\"%s\"><title>", x,
                      up(f, t.median), all ? color : "#fff", color);
        kiln_html_text(page, sweep->settings[indices[i]].name);
        kiln_html_add(page, ": %.3g s (%.3g to %.3g), %.0f cells</title></circle>\n", t.median, t.least, t.most,
                      r->cells);
    }
}

static void add_legend(struct kiln_html *page, uint32_t ranks, size_t number)
{
    static const char *const what[] = {"all light", "indirect"};
    for (int k = 0; k < 2; k++) {
        const int y = TOP + 14 + 18 * (int)(2 * number) + 18 * k;
        kiln_html_add(page, "<path d=\"M%d %dh26\" stroke=\"%s\" stroke-width=\"2\"%s/><text x=\"%d\" y=\"%d\">%s",
                      WIDTH - RIGHT + 12, y, colors[number % COLORS], k == 0 ? "" : " stroke-dasharray=\"5 4\"",
                      WIDTH - RIGHT + 44, y + 4, what[k]);
        if (ranks > 0)
            kiln_html_add(page, ", %u rank%s", ranks, ranks == 1 ? "" : "s");
        kiln_html_add(page, "</text>\n");
    }
}

static bool is_first_of_its_place(const struct kiln_sweep *sweep, size_t i)
{
    return sweep->settings[i].ranks == sweep->settings[0].ranks && is_shown(&sweep->results[i]);
}

/* Numbers of ranks are repeated in the same order for each setting, so that the first ones are all. */
static size_t count_lines(const struct kiln_sweep *sweep)
{
    size_t lines = 1;
    while (lines < sweep->count && sweep->settings[lines].ranks != sweep->settings[0].ranks)
        lines++;
    return lines;
}

void kiln_order_plot(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    const struct frame f = fit(sweep);
    size_t indices[KILN_SETTINGS_MOST];
    add_frame(page, &f, sweep->job->scene);
    for (size_t i = 0; i < sweep->count; i++)
        if (is_first_of_its_place(sweep, i))
            add_label(page, &f, &sweep->settings[i], &sweep->results[i]);
    for (size_t line = 0; line < count_lines(sweep); line++) {
        const uint32_t ranks = sweep->settings[line].ranks;
        const size_t count = line_of(sweep, &f, ranks, indices);
        add_line(page, sweep, &f, line, KILN_TIME_LIGHT, indices, count);
        add_line(page, sweep, &f, line, KILN_TIME_INDIRECT, indices, count);
        add_legend(page, ranks, line);
    }
    kiln_html_add(page,
                  "<text x=\"%d\" y=\"%d\" font-size=\"11\" fill=\"#555\">medians of the runs; bars from the least "
                  "to the most, of all light</text>\n</svg>\n",
                  LEFT, TOP - 8);
}
