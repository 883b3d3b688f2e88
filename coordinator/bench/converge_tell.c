#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/converge_private.h"
#include "coordinator/bench/log_plot.h"
#include "coordinator/files/json.h"
#include "worker/base/text.h"

/* ---- files ---- */

/* A sentence as a value of CSV, in quotes. */
static void add_quoted(struct kiln_html *page, const char *text)
{
    kiln_html_add(page, "\"");
    for (const char *at = text; *at != '\0'; at++)
        kiln_html_add(page, "%s%c", *at == '"' ? "\"" : "", *at);
    kiln_html_add(page, "\"\n");
}

static int write_csv(const struct kiln_converge *c, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    struct kiln_html page = {.error = error};
    const int status = kiln_path_join(path, c->job->output, "converge.csv", error);
    if (status != KILN_OK)
        return status;
    kiln_html_add(&page, "method,paths,seconds,rays,rmse,nrmse,rel_rmse,picture_psnr,picture_dissimilarity,refused\n");
    for (size_t i = 0; i < c->count; i++) {
        const struct kiln_converge_method *m = &c->methods[i];
        for (const struct kiln_converge_trial *t = m->trials; t < m->trials + m->count; t++)
            kiln_html_add(&page, "%s,%u,%.6g,%" PRIu64 ",%.6g,%.6g,%.6g,%.6g,%.6g,\n", m->name, t->samples, t->seconds,
                          t->rays, t->rmse, t->nrmse, t->rel_rmse, t->picture_psnr, t->picture_dissimilarity);
        if (m->count == 0) {
            kiln_html_add(&page, "%s,,,,,,,,,", m->name);
            add_quoted(&page, m->refusal);
        }
    }
    return kiln_html_publish(&page, path);
}

static const char *const colors[] = {"#1f5fa8", "#c4451c", "#3d8b37", "#8a4fb0", "#b08a00", "#555555", "#0f8f8f"};
enum { COLORS = sizeof colors / sizeof *colors };

/* Root mean square of the 8-bit pictures' difference, relative to white. */
static double picture_error(const struct kiln_converge_trial *t) { return pow(10.0, -t->picture_psnr / 20.0); }

/* A logarithm has no place for an error of 0. */
static bool is_shown(const struct kiln_converge_trial *t) { return picture_error(t) > 0.0; }

static struct kiln_log_plot fit(const struct kiln_converge *c)
{
    struct kiln_log_plot f = kiln_log_plot_empty();
    for (size_t i = 0; i < c->count; i++)
        for (size_t k = 0; k < c->methods[i].count; k++)
            if (is_shown(&c->methods[i].trials[k]))
                kiln_log_plot_include(&f, c->methods[i].trials[k].seconds, picture_error(&c->methods[i].trials[k]));
    kiln_log_plot_fit(&f);
    return f;
}

/* A method: a line, a circle for each view, its name in the legend. */
static void add_method(struct kiln_html *page, const struct kiln_log_plot *f, const struct kiln_converge_method *m,
                       size_t number)
{
    const char *color = colors[number % COLORS];
    const int right = KILN_LOG_PLOT_WIDTH - KILN_LOG_PLOT_RIGHT, y = KILN_LOG_PLOT_TOP + 14 + 18 * (int)number;
    kiln_html_add(page, "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"2\" points=\"", color);
    for (const struct kiln_converge_trial *t = m->trials; t < m->trials + m->count; t++)
        if (is_shown(t))
            kiln_html_add(page, "%.1f,%.1f ", kiln_log_plot_across(f, t->seconds),
                          kiln_log_plot_up(f, picture_error(t)));
    kiln_html_add(page, "\"/>\n");
    for (const struct kiln_converge_trial *t = m->trials; t < m->trials + m->count; t++)
        if (is_shown(t))
            kiln_html_add(page,
                          "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3\" fill=\"%s\"><title>%s, %u paths a pixel: %.3g %%, "
                          "%.4g dB, %.3g s</title></circle>\n",
                          kiln_log_plot_across(f, t->seconds), kiln_log_plot_up(f, picture_error(t)), color, m->name,
                          t->samples, 100.0 * picture_error(t), t->picture_psnr, t->seconds);
    kiln_html_add(page, "<path d=\"M%d %dh26\" stroke=\"%s\" stroke-width=\"2\"/><text x=\"%d\" y=\"%d\">%s%s</text>\n",
                  right + 12, y, color, right + 44, y + 4, m->name, m->count == 0 ? " (refused)" : "");
}

static int write_plot(const struct kiln_converge *c, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    struct kiln_html page = {.error = error};
    const struct kiln_log_plot f = fit(c);
    const int status = kiln_path_join(path, c->job->output, "converge.svg", error);
    if (status != KILN_OK)
        return status;
    kiln_log_plot_begin(&page, &f, "Error of a view over time", c->job->scene, "time of computing",
                        "error of the 8-bit picture, of white");
    for (size_t i = 0; i < c->count; i++)
        add_method(&page, &f, &c->methods[i], i);
    kiln_html_add(&page, "</svg>\n");
    return kiln_html_publish(&page, path);
}

/* ---- stdout ---- */

enum { CELL = 24 };

/* A number, behind `before`; or what there is in its place. */
static const char *number_text(char text[CELL], const char *before, double value, const char *none)
{
    if (isnan(value))
        return none;
    if (isinf(value))
        return "no error";
    (void)snprintf(text, CELL, "%s%.4g", before, value);
    return text;
}

static void print_method(const struct kiln_converge_method *m)
{
    char psnr[CELL], gain[CELL], level[CELL];
    if (m->count == 0) {
        kiln_print(stdout, "%-12s refused: %s\n", m->name, m->refusal);
        return;
    }
    const struct kiln_converge_trial *last = &m->trials[m->count - 1];
    (void)printf("%-12s%8u%12.4g%12.3f%16s%16s%14s\n", m->name, last->samples, last->seconds, 100.0 * last->nrmse,
                 number_text(psnr, "", m->psnr_at_equal_time, "too slow"), number_text(gain, "", m->gain, "none"),
                 number_text(level, m->at_most ? "<= " : "", m->seconds_to_level, "not reached"));
}

static void print_table(const struct kiln_converge *c)
{
    char equal[CELL], level[CELL], own[CELL];
    (void)snprintf(equal, sizeof equal, "dB in %.3g s", c->equal_seconds);
    (void)snprintf(level, sizeof level, "s to %.0f dB", KILN_CONVERGE_LEVEL);
    (void)printf("%-12s%8s%12s%12s%16s%16s%14s\n", "method", "paths", "seconds", "nrmse %", equal, "dB a doubling",
                 level);
    for (size_t i = 0; i < c->count; i++)
        print_method(&c->methods[i]);
    if (c->reference_samples > 0)
        (void)printf(
            "against %u paths a pixel, whose own error is %s dB; views closer than that cannot be told apart\n",
            c->reference_samples, number_text(own, "", c->reference_psnr, "not known"));
    kiln_print(stdout, "%s/converge.csv, %s/converge.svg\n", c->job->output, c->job->output);
}

static json_t *number(double value) { return isfinite(value) ? json_real(value) : json_null(); }

static json_t *method_json(const struct kiln_converge_method *m)
{
    json_t *trials = json_array();
    for (const struct kiln_converge_trial *t = m->trials; t < m->trials + m->count; t++)
        (void)json_array_append_new(trials, json_pack("{s:i, s:f, s:I, s:f, s:o, s:f, s:o, s:f}", "paths",
                                                      (int)t->samples, "seconds", t->seconds, "rays",
                                                      (json_int_t)t->rays, "rmse", t->rmse, "nrmse", number(t->nrmse),
                                                      "rel_rmse", t->rel_rmse, "picture_psnr", number(t->picture_psnr),
                                                      "picture_dissimilarity", t->picture_dissimilarity));
    return json_pack("{s:s, s:o, s:o, s:o, s:o, s:o}", "method", m->name, "refused",
                     m->count == 0 ? kiln_json_string(m->refusal) : json_null(), "views", trials, "psnr_at_equal_time",
                     number(m->psnr_at_equal_time), "psnr_gain_per_doubled_time", number(m->gain), "seconds_to_45_db",
                     number(m->seconds_to_level));
}

static int print_json(const struct kiln_converge *c, struct kiln_error *error)
{
    json_t *methods = json_array();
    for (size_t i = 0; i < c->count; i++)
        (void)json_array_append_new(methods, method_json(&c->methods[i]));
    c->job->answered = true;
    return kiln_json_print(json_pack("{s:s, s:f, s:o, s:o, s:o, s:o, s:o}", "status", "done", "equal_seconds",
                                     c->equal_seconds, "methods", methods, "reference_samples",
                                     c->reference_samples > 0 ? json_integer(c->reference_samples) : json_null(),
                                     "reference_psnr", number(c->reference_psnr), "reference",
                                     kiln_json_string(c->reference), "output", kiln_json_string(c->job->output)),
                           error);
}

int kiln_converge_tell(const struct kiln_converge *c, struct kiln_error *error)
{
    int status = write_csv(c, error);
    if (status == KILN_OK)
        status = write_plot(c, error);
    if (status != KILN_OK)
        return status;
    if (c->job->json)
        return print_json(c, error);
    print_table(c);
    return KILN_OK;
}
