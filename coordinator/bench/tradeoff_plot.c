#include <math.h>

#include "coordinator/bench/tradeoff_private.h"

enum { WIDTH = 860, HEIGHT = 560, LEFT = 78, RIGHT = 150, TOP = 48, BOTTOM = 58 };

/* Both axes are logarithmic. */
struct frame {
    double low[2], high[2]; /* of seconds and of the error, as log10 */
};

static double across(const struct frame *f, double seconds)
{
    return LEFT + (WIDTH - LEFT - RIGHT) * (log10(seconds) - f->low[0]) / (f->high[0] - f->low[0]);
}

static double up(const struct frame *f, double error)
{
    return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (log10(error) - f->low[1]) / (f->high[1] - f->low[1]);
}

static bool is_shown(const struct kiln_setting_result *r) { return r->done && r->seconds > 0.0 && r->error[0] > 0.0; }

static struct frame fit(const struct kiln_sweep *sweep)
{
    struct frame f = {{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting_result *r = &sweep->results[i];
        const double values[2] = {log10(r->seconds), log10(r->error[0])};
        for (int axis = 0; is_shown(r) && axis < 2; axis++) {
            f.low[axis] = fmin(f.low[axis], values[axis]);
            f.high[axis] = fmax(f.high[axis], values[axis]);
        }
    }
    for (int axis = 0; axis < 2; axis++) {
        const double middle = isfinite(f.low[axis]) ? 0.5 * (f.low[axis] + f.high[axis]) : 0.0,
                     half = isfinite(f.low[axis]) ? fmax(0.15, 0.55 * (f.high[axis] - f.low[axis])) : 0.5;
        f.low[axis] = middle - half;
        f.high[axis] = middle + half;
    }
    return f;
}

/* Grid lines and numbers at 1, 2 and 5 times the powers of ten. */
static void add_axis(struct kiln_html *page, const struct frame *f, int axis)
{
    static const double digits[] = {1.0, 2.0, 5.0};
    for (int decade = (int)floor(f->low[axis]); decade <= (int)ceil(f->high[axis]); decade++)
        for (int d = 0; d < 3; d++) {
            const double value = digits[d] * pow(10.0, decade), at = log10(value);
            if (at < f->low[axis] || at > f->high[axis])
                continue;
            if (axis == 0)
                kiln_html_add(page,
                              "<path d=\"M%.1f %dV%d\" stroke=\"#ddd\"/><text x=\"%.1f\" y=\"%d\" "
                              "text-anchor=\"middle\">%g s</text>\n",
                              across(f, value), TOP, HEIGHT - BOTTOM, across(f, value), HEIGHT - BOTTOM + 18, value);
            else
                kiln_html_add(page,
                              "<path d=\"M%d %.1fH%d\" stroke=\"#ddd\"/><text x=\"%d\" y=\"%.1f\" "
                              "text-anchor=\"end\">%g %%</text>\n",
                              LEFT, up(f, value), WIDTH - RIGHT, LEFT - 8, up(f, value) + 4.0, 100.0 * value);
        }
}

static void add_frame(struct kiln_html *page, const struct frame *f, const char *scene)
{
    kiln_html_add(page,
                  "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" "
                  "font-family=\"sans-serif\" font-size=\"12\"><rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n"
                  "<text x=\"%d\" y=\"24\" font-size=\"15\">Error over time: ",
                  WIDTH, HEIGHT, WIDTH, HEIGHT, LEFT);
    kiln_html_text(page, scene);
    kiln_html_add(page, "</text>\n");
    add_axis(page, f, 0);
    add_axis(page, f, 1);
    kiln_html_add(
        page,
        "<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">time of the whole process</text>\n<text "
        "transform=\"translate(16 %d) rotate(-90)\" text-anchor=\"middle\">nrmse against the reference</text>\n",
        (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 16, (TOP + HEIGHT - BOTTOM) / 2);
}

static void add_front(struct kiln_html *page, const struct kiln_sweep *sweep, const struct frame *f)
{
    size_t indices[KILN_SETTINGS_MOST];
    const size_t count = kiln_front_list(sweep, indices);
    kiln_html_add(page, "<polyline fill=\"none\" stroke=\"#1f5fa8\" stroke-width=\"2\" points=\"");
    for (size_t i = 0; i < count; i++)
        if (is_shown(&sweep->results[indices[i]]))
            kiln_html_add(page, "%.1f,%.1f ", across(f, sweep->results[indices[i]].seconds),
                          up(f, sweep->results[indices[i]].error[0]));
    kiln_html_add(page, "\"/>\n");
}

/* A bake: blue on the front, else grey, presets red. Presets and the front have their names beside them. */
static void add_point(struct kiln_html *page, const struct frame *f, const struct kiln_setting *s,
                      const struct kiln_setting_result *r)
{
    const char *color = s->preset ? "#c4451c" : r->front ? "#1f5fa8" : "#999";
    const double x = across(f, r->seconds), y = up(f, r->error[0]);
    kiln_html_add(page, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%d\" fill=\"%s\"><title>", x, y,
                  r->front || s->preset ? 4 : 3, color);
    kiln_html_text(page, s->name);
    kiln_html_add(page, ": %.3g %%, %.3g s, %.3g MiB</title></circle>\n", 100.0 * r->error[0], r->seconds,
                  r->bytes / 0x1p20);
    if (!r->front && !s->preset)
        return;
    kiln_html_add(page, "<text transform=\"translate(%.1f %.1f) rotate(-28)\" font-size=\"11\" fill=\"%s\">", x + 6.0,
                  y - 5.0, color);
    kiln_html_text(page, s->name);
    kiln_html_add(page, "</text>\n");
}

void kiln_tradeoff_plot(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    const struct frame f = fit(sweep);
    add_frame(page, &f, sweep->job->scene);
    add_front(page, sweep, &f);
    for (size_t i = 0; i < sweep->count; i++)
        if (is_shown(&sweep->results[i]))
            add_point(page, &f, &sweep->settings[i], &sweep->results[i]);
    kiln_html_add(page,
                  "<text x=\"%d\" y=\"%d\" font-size=\"11\" fill=\"#555\">samples: direct, bounce, final "
                  "gather; red: presets</text>\n</svg>\n",
                  LEFT, TOP - 8);
}
