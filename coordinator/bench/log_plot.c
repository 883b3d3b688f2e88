#include "coordinator/bench/log_plot.h"

#include <math.h>
#include <stdbool.h>

enum {
    WIDTH = KILN_LOG_PLOT_WIDTH,
    HEIGHT = KILN_LOG_PLOT_HEIGHT,
    LEFT = KILN_LOG_PLOT_LEFT,
    RIGHT = KILN_LOG_PLOT_RIGHT,
    TOP = KILN_LOG_PLOT_TOP,
    BOTTOM = KILN_LOG_PLOT_BOTTOM
};

struct kiln_log_plot kiln_log_plot_empty(void)
{
    return (struct kiln_log_plot){
        {INFINITY, INFINITY}, {-INFINITY, -INFINITY}, .unit = {" s", " %"}, .factor = {1.0, 100.0}};
}

void kiln_log_plot_include(struct kiln_log_plot *plot, double seconds, double error)
{
    const double values[2] = {log10(seconds), log10(error)};
    for (int axis = 0; axis < 2; axis++) {
        plot->low[axis] = fmin(plot->low[axis], values[axis]);
        plot->high[axis] = fmax(plot->high[axis], values[axis]);
    }
}

void kiln_log_plot_fit(struct kiln_log_plot *plot)
{
    for (int axis = 0; axis < 2; axis++) {
        const bool any = isfinite(plot->low[axis]);
        const double middle = any ? 0.5 * (plot->low[axis] + plot->high[axis]) : 0.0,
                     half = any ? fmax(0.15, 0.55 * (plot->high[axis] - plot->low[axis])) : 0.5;
        plot->low[axis] = middle - half;
        plot->high[axis] = middle + half;
    }
}

double kiln_log_plot_across(const struct kiln_log_plot *plot, double seconds)
{
    return LEFT + (WIDTH - LEFT - RIGHT) * (log10(seconds) - plot->low[0]) / (plot->high[0] - plot->low[0]);
}

double kiln_log_plot_up(const struct kiln_log_plot *plot, double error)
{
    return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (log10(error) - plot->low[1]) / (plot->high[1] - plot->low[1]);
}

/* Grid lines and numbers at 1, 2 and 5 times the powers of ten. */
static void add_axis(struct kiln_html *page, const struct kiln_log_plot *plot, int axis)
{
    static const double digits[] = {1.0, 2.0, 5.0};
    for (int decade = (int)floor(plot->low[axis] + log10(plot->factor[axis]));
         decade <= (int)ceil(plot->high[axis] + log10(plot->factor[axis])); decade++)
        for (int d = 0; d < 3; d++) {
            const double number = digits[d] * pow(10.0, decade), value = number / plot->factor[axis], at = log10(value);
            if (at < plot->low[axis] || at > plot->high[axis])
                continue;
            if (axis == 0)
                kiln_html_add(page,
                              "<path d=\"M%.1f %dV%d\" stroke=\"#ddd\"/><text x=\"%.1f\" y=\"%d\" "
                              "text-anchor=\"middle\">%g%s</text>\n",
                              kiln_log_plot_across(plot, value), TOP, HEIGHT - BOTTOM,
                              kiln_log_plot_across(plot, value), HEIGHT - BOTTOM + 18, number, plot->unit[0]);
            else
                kiln_html_add(page,
                              "<path d=\"M%d %.1fH%d\" stroke=\"#ddd\"/><text x=\"%d\" y=\"%.1f\" "
                              "text-anchor=\"end\">%g%s</text>\n",
                              LEFT, kiln_log_plot_up(plot, value), WIDTH - RIGHT, LEFT - 8,
                              kiln_log_plot_up(plot, value) + 4.0, number, plot->unit[1]);
        }
}

void kiln_log_plot_begin(struct kiln_html *page, const struct kiln_log_plot *plot, const char *title, const char *scene,
                         const char *across, const char *up)
{
    kiln_html_add(page,
                  "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" "
                  "font-family=\"sans-serif\" font-size=\"12\"><rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n"
                  "<text x=\"%d\" y=\"24\" font-size=\"15\">%s: ",
                  WIDTH, HEIGHT, WIDTH, HEIGHT, LEFT, title);
    kiln_html_text(page, scene);
    kiln_html_add(page, "</text>\n");
    add_axis(page, plot, 0);
    add_axis(page, plot, 1);
    kiln_html_add(page,
                  "<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">%s</text>\n<text "
                  "transform=\"translate(16 %d) rotate(-90)\" text-anchor=\"middle\">%s</text>\n",
                  (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 16, across, (TOP + HEIGHT - BOTTOM) / 2, up);
}
