#include "coordinator/bench/log_plot.h"
#include "coordinator/bench/tradeoff_private.h"

static bool is_shown(const struct kiln_setting_result *r) { return r->done && r->seconds > 0.0 && r->error[0] > 0.0; }

static struct kiln_log_plot fit(const struct kiln_sweep *sweep)
{
    struct kiln_log_plot f = kiln_log_plot_empty();
    for (size_t i = 0; i < sweep->count; i++)
        if (is_shown(&sweep->results[i]))
            kiln_log_plot_include(&f, sweep->results[i].seconds, sweep->results[i].error[0]);
    kiln_log_plot_fit(&f);
    return f;
}

static void add_front(struct kiln_html *page, const struct kiln_sweep *sweep, const struct kiln_log_plot *f)
{
    size_t indices[KILN_SETTINGS_MOST];
    const size_t count = kiln_front_list(sweep, indices);
    kiln_html_add(page, "<polyline fill=\"none\" stroke=\"#1f5fa8\" stroke-width=\"2\" points=\"");
    for (size_t i = 0; i < count; i++)
        if (is_shown(&sweep->results[indices[i]]))
            kiln_html_add(page, "%.1f,%.1f ", kiln_log_plot_across(f, sweep->results[indices[i]].seconds),
                          kiln_log_plot_up(f, sweep->results[indices[i]].error[0]));
    kiln_html_add(page, "\"/>\n");
}

/* A bake: blue on the front, else grey, presets red. Presets and the front have their names beside them. */
static void add_point(struct kiln_html *page, const struct kiln_log_plot *f, const struct kiln_setting *s,
                      const struct kiln_setting_result *r)
{
    const char *color = s->preset ? "#c4451c" : r->front ? "#1f5fa8" : "#999";
    const double x = kiln_log_plot_across(f, r->seconds), y = kiln_log_plot_up(f, r->error[0]);
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
    const struct kiln_log_plot f = fit(sweep);
    kiln_log_plot_begin(page, &f, "Error over time", sweep->job->scene, "time of the whole process",
                        "nrmse against the reference");
    add_front(page, sweep, &f);
    for (size_t i = 0; i < sweep->count; i++)
        if (is_shown(&sweep->results[i]))
            add_point(page, &f, &sweep->settings[i], &sweep->results[i]);
    kiln_html_add(page,
                  "<text x=\"%d\" y=\"%d\" font-size=\"11\" fill=\"#555\">samples: direct, bounce, final "
                  "gather; red: presets</text>\n</svg>\n",
                  KILN_LOG_PLOT_LEFT, KILN_LOG_PLOT_TOP - 8);
}
