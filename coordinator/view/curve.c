#include "coordinator/view/curve.h"

#include <math.h>

#include "coordinator/files/html.h"
#include "coordinator/files/publish.h"

enum { WIDTH = 720, HEIGHT = 420, LEFT = 64, RIGHT = 24, TOP = 44, BOTTOM = 56, LEGEND_STEP = 18 };

static const char *const colors[KILN_CURVES] = {"#1f5fa8", "#c4451c", "#2a8a4a", "#7a3fa0"};

struct curve {
    const char *name; /* text of the legend */
    const double *ranks, *values;
    size_t count;
};

struct frame {
    double decades, top; /* log2 of the largest number of ranks; the largest value on the vertical axis */
};

static double across(const struct frame *f, double ranks)
{
    return LEFT + (WIDTH - LEFT - RIGHT) * log2(ranks) / f->decades;
}
static double up(const struct frame *f, double value)
{
    return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * value / f->top;
}

static void add_axes(struct kiln_html *page, const struct frame *f)
{
    for (int i = 0; i <= (int)(f->top * 5.0 + 0.5); i++) {
        const double y = up(f, i / 5.0);
        kiln_html_add(
            page,
            "<path d=\"M%d %.1fH%d\" stroke=\"#ddd\"/><text x=\"%d\" y=\"%.1f\" text-anchor=\"end\">%d %%</text>\n",
            LEFT, y, WIDTH - RIGHT, LEFT - 8, y + 4.0, 20 * i);
    }
    const int step = f->decades > 10.0 ? 2 : 1;
    for (int i = 0; i <= (int)(f->decades + 1e-9); i += step) {
        const double x = across(f, exp2(i));
        kiln_html_add(
            page,
            "<path d=\"M%.1f %dv5\" stroke=\"#888\"/><text x=\"%.1f\" y=\"%d\" text-anchor=\"middle\">%.0f</text>\n", x,
            HEIGHT - BOTTOM, x, HEIGHT - BOTTOM + 20, exp2(i));
    }
    kiln_html_add(page, "<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">ranks</text>\n", (LEFT + WIDTH - RIGHT) / 2,
                  HEIGHT - 12);
}

static void add_curve(struct kiln_html *page, const struct frame *f, const struct curve *curve, size_t number)
{
    const char *color = colors[number];
    kiln_html_add(page, "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"2\" points=\"", color);
    for (size_t i = 0; i < curve->count; i++)
        kiln_html_add(page, "%.1f,%.1f ", across(f, curve->ranks[i]), up(f, curve->values[i]));
    kiln_html_add(page, "\"/>\n");
    for (size_t i = 0; i < curve->count; i++)
        kiln_html_add(page, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3\" fill=\"%s\"/>\n", across(f, curve->ranks[i]),
                      up(f, curve->values[i]), color);
    const double y = HEIGHT - BOTTOM - 14.0 - (double)number * LEGEND_STEP;
    kiln_html_add(page, "<path d=\"M%d %.1fh22\" stroke=\"%s\" stroke-width=\"2\"/><text x=\"%d\" y=\"%.1f\">",
                  LEFT + 12, y - 4.0, color, LEFT + 40, y);
    kiln_html_text(page, curve->name);
    kiln_html_add(page, "</text>\n");
}

static struct frame fit(const struct curve *curves, size_t count)
{
    struct frame f = {1.0, 1.0};
    for (size_t c = 0; c < count; c++)
        for (size_t i = 0; i < curves[c].count; i++) {
            f.decades = fmax(f.decades, log2(curves[c].ranks[i]));
            f.top = fmax(f.top, ceil(5.0 * curves[c].values[i] - 0.25) / 5.0);
        }
    f.top = fmin(f.top, 4.0);
    return f;
}

static int write_svg(const char *path, const char *title, const struct curve *curves, size_t count,
                     struct kiln_error *error)
{
    const struct frame f = fit(curves, count);
    struct kiln_html page = {.error = error};
    kiln_html_add(&page,
                  "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" "
                  "font-family=\"sans-serif\" "
                  "font-size=\"13\"><rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n<text x=\"%d\" y=\"24\" "
                  "font-size=\"15\">",
                  WIDTH, HEIGHT, WIDTH, HEIGHT, LEFT);
    kiln_html_text(&page, title);
    kiln_html_add(&page, "</text>\n");
    add_axes(&page, &f);
    for (size_t c = 0; c < count; c++)
        add_curve(&page, &f, &curves[c], c);
    kiln_html_add(&page, "</svg>\n");
    return kiln_html_publish(&page, path);
}

int kiln_curve_write(const char *directory, const char *title, const double *ranks,
                     const double *const values[KILN_CURVES], size_t count, struct kiln_error *error)
{
    static const char *const names[KILN_CURVES] = {"strong, all of the bake", "strong, light and exchange",
                                                   "weak, all of the bake", "weak, light and exchange"};
    struct curve curves[KILN_CURVES];
    char path[KILN_PATH_SIZE];
    for (size_t c = 0; c < KILN_CURVES; c++)
        curves[c] = (struct curve){names[c], ranks, values[c], count};
    const int status = kiln_path_join(path, directory, "scaling.svg", error);
    return status == KILN_OK ? write_svg(path, title, curves, KILN_CURVES, error) : status;
}
