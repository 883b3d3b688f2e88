#include "coordinator/bench/range.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/bench/sweep.h"
#include "coordinator/files/json.h"
#include "worker/base/text.h"

enum { BASES = 3, SPACING_USUAL = 16 };
static const char *const bases[BASES] = {"sh", "octahedral", "cubemap"};

/* ---- settings ---- */

/* The scene's longest side, m; 0: not known yet. */
static double longest_side(const struct kiln_sweep *sweep)
{
    double longest = 0.0;
    for (int a = 0; sweep->reference_scene != NULL && a < 3; a++)
        longest = fmax(longest,
                       sweep->reference_scene->header->bounds_max[a] - sweep->reference_scene->header->bounds_min[a]);
    return longest;
}

/* m; below 0: not known yet; INFINITY: rays have no end. */
static double range_of(const struct kiln_sweep *sweep, const struct kiln_setting *s)
{
    const double side = longest_side(sweep);
    if (!(s->range_factor > 0.0))
        return s->range;
    return side > 0.0 ? s->range_factor * side : -1.0;
}

static void add_all(struct kiln_sweep *sweep, const char *name, struct kiln_setting s)
{
    static const uint32_t spacings[] = {SPACING_USUAL / 2, SPACING_USUAL, 2 * SPACING_USUAL};
    s.group = "range";
    for (int i = 0; i < 3; i++)
        for (int basis = 0; basis < (spacings[i] == SPACING_USUAL ? BASES : 1); basis++) {
            s.probes_along = spacings[i];
            s.basis = basis;
            (void)snprintf(s.name, sizeof s.name, "%.12s, 1/%u, %s", name, s.probes_along, bases[basis]);
            kiln_sweep_add(sweep, &s);
        }
}

static bool read_range(const char *text, double *range)
{
    char *end = NULL;
    *range = *text >= '0' && *text <= '9' ? strtod(text, &end) : -1.0;
    return end != NULL && *end == '\0' && isfinite(*range) && *range >= 0.0;
}

static int choose(struct kiln_sweep *sweep, struct kiln_error *error)
{
    const struct kiln_job *job = sweep->job;
    kiln_sweep_add(sweep, &(struct kiln_setting){.group = "range", .name = "inf", .range = INFINITY});
    if (job->argument_count <= 2)
        add_all(sweep, "0", (struct kiln_setting){.range = 0.0});
    for (int part = 16; job->argument_count <= 2 && part >= 2; part /= 2) {
        char name[KILN_SETTING_NAME];
        (void)snprintf(name, sizeof name, "1/%d", part);
        add_all(sweep, name, (struct kiln_setting){.range_factor = 1.0 / part});
    }
    for (size_t i = 2; i < job->argument_count; i++) {
        double range;
        if (!read_range(job->arguments[i], &range))
            return kiln_fail(error, KILN_USAGE,
                             "kiln bench tracing-range takes ranges in metres, such as 0 or 0.5, not '%.100s'",
                             job->arguments[i]);
        add_all(sweep, job->arguments[i], (struct kiln_setting){.range = range});
    }
    if (sweep->count == KILN_SETTINGS_MOST)
        return kiln_fail(error, KILN_USAGE, "there are too many bakes in one sweep: give fewer ranges");
    return KILN_OK;
}

static void options(const struct kiln_sweep *sweep, const struct kiln_setting *s, char text[KILN_SETTING_OPTIONS])
{
    const double range = range_of(sweep, s), side = longest_side(sweep);
    if (isinf(range))
        (void)snprintf(text, KILN_SETTING_OPTIONS, "--tracing-range inf");
    else if (side > 0.0)
        (void)snprintf(text, KILN_SETTING_OPTIONS,
                       "--tracing-range %.9g --radiance-probe-spacing %.9g --probe-basis %s", range,
                       side / s->probes_along, bases[s->basis]);
    else
        (void)snprintf(text, KILN_SETTING_OPTIONS, "%s of the longest side; --probe-basis %s", s->name,
                       bases[s->basis]);
}

static void key(const struct kiln_setting *s, char text[KILN_SETTING_OPTIONS])
{
    (void)snprintf(text, KILN_SETTING_OPTIONS, "%s (%.17g m)", s->name, s->range);
}

/* Probes and rays both count; nothing is known of either before. */
static double rays(const struct kiln_setting *s)
{
    (void)s;
    return 1.0;
}

static void push_reference(const struct kiln_sweep *sweep, struct kiln_child *child)
{
    (void)child; /* nothing but the options of all bakes */
    if (!sweep->job->quiet)
        (void)fprintf(stderr, "kiln: baking the reference, whose rays have no end\n");
}

/* ---- files ---- */

static void add_csv(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    kiln_html_add(page, "name,options,range,spacing,basis,nrmse,nrmse_indirect,light_seconds,indirect_seconds,seconds,"
                        "processor_seconds,peak_bytes,probes,probe_bytes,rays,probe_rays,points_without_probe\n");
    for (size_t i = 0; i < sweep->count; i++) {
        char text[KILN_SETTING_OPTIONS];
        const struct kiln_setting *s = &sweep->settings[i];
        const struct kiln_setting_result *r = &sweep->results[i];
        const double range = range_of(sweep, s);
        if (!r->done)
            continue;
        options(sweep, s, text);
        kiln_html_add(page, "\"%s\",%s,%.9g,%.9g,%s,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.0f,%.0f,%.0f,%.0f,%.0f,%.0f\n",
                      s->name, text, range, isinf(range) ? 0.0 : longest_side(sweep) / s->probes_along,
                      isinf(range) ? "" : bases[s->basis], r->error[0], r->error[2], r->light_seconds,
                      kiln_sweep_spread(r, KILN_TIME_INDIRECT).median, r->seconds, r->processor_seconds, r->bytes,
                      r->probes, r->probe_bytes, r->rays, r->probe_rays, r->points_alone);
    }
}

enum { WIDTH = 760, HEIGHT = 480, LEFT = 80, RIGHT = 180, TOP = 48, BOTTOM = 60 };
static const char *const colors[] = {"#1f5fa8", "#c4451c", "#3d8b37", "#8a4fb0", "#b08a00"};

/* What is drawn as one line: harmonics at each spacing, then the other bases. */
static size_t line_of(const struct kiln_setting *s)
{
    return s->basis > 0 ? 2 + (size_t)s->basis : s->probes_along > SPACING_USUAL ? 2 : s->probes_along == SPACING_USUAL;
}

static bool is_on_line(const struct kiln_sweep *sweep, size_t i, size_t line)
{
    const struct kiln_setting *s = &sweep->settings[i];
    return sweep->results[i].done && isfinite(range_of(sweep, s)) && line_of(s) == line;
}

static void add_line(const struct kiln_sweep *sweep, struct kiln_html *page, size_t line, double farthest, double most)
{
    const double x = (WIDTH - LEFT - RIGHT) / farthest, y = (HEIGHT - TOP - BOTTOM) / most;
    static const char *const names[] = {"sh, 1/8 apart", "sh, 1/16", "sh, 1/32", "octahedral, 1/16", "cubemap, 1/16"};
    kiln_html_add(page, "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"2\" points=\"", colors[line]);
    for (size_t i = 0; i < sweep->count; i++)
        if (is_on_line(sweep, i, line))
            kiln_html_add(page, "%.1f,%.1f ", LEFT + x * range_of(sweep, &sweep->settings[i]),
                          HEIGHT - BOTTOM - y * sweep->results[i].error[2]);
    kiln_html_add(page, "\"/>\n");
    for (size_t i = 0; i < sweep->count; i++)
        if (is_on_line(sweep, i, line))
            kiln_html_add(
                page, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"%s\"><title>%s: %.2f %%</title></circle>\n",
                LEFT + x * range_of(sweep, &sweep->settings[i]), HEIGHT - BOTTOM - y * sweep->results[i].error[2],
                colors[line], sweep->settings[i].name, 100.0 * sweep->results[i].error[2]);
    kiln_html_add(page, "<text x=\"%d\" y=\"%d\" fill=\"%s\">%s</text>\n", WIDTH - RIGHT + 14,
                  TOP + 14 + 18 * (int)line, colors[line], names[line]);
}

static void plot(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    double farthest = 0.0, most = 0.0;
    for (size_t i = 0; i < sweep->count; i++)
        if (sweep->results[i].done && isfinite(range_of(sweep, &sweep->settings[i]))) {
            farthest = fmax(farthest, range_of(sweep, &sweep->settings[i]));
            most = fmax(most, sweep->results[i].error[2]);
        }
    farthest = farthest > 0.0 ? 1.05 * farthest : 1.0;
    most = most > 0.0 ? 1.1 * most : 1.0;
    kiln_html_add(page,
                  "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" "
                  "font-family=\"sans-serif\" font-size=\"12\"><rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n"
                  "<text x=\"%d\" y=\"24\" font-size=\"15\">Error of indirect light by tracing range: ",
                  WIDTH, HEIGHT, WIDTH, HEIGHT, LEFT);
    kiln_html_text(page, sweep->job->scene);
    kiln_html_add(page, "</text>\n<path d=\"M%d %dV%dH%d\" fill=\"none\" stroke=\"#555\"/>\n", LEFT, TOP,
                  HEIGHT - BOTTOM, WIDTH - RIGHT);
    for (int i = 0; i <= 5; i++)
        kiln_html_add(page,
                      "<text x=\"%d\" y=\"%d\" text-anchor=\"end\">%.2g %%</text><text x=\"%d\" y=\"%d\" "
                      "text-anchor=\"middle\">%.3g m</text>\n",
                      LEFT - 8, HEIGHT - BOTTOM - i * (HEIGHT - TOP - BOTTOM) / 5 + 4, 20.0 * i * most,
                      LEFT + i * (WIDTH - LEFT - RIGHT) / 5, HEIGHT - BOTTOM + 20, 0.2 * i * farthest);
    for (size_t line = 0; line < sizeof colors / sizeof *colors; line++)
        add_line(sweep, page, line, farthest, most);
    kiln_html_add(page, "</svg>\n");
}

static void list(const struct kiln_sweep *sweep)
{
    for (size_t i = 0; i < sweep->count; i++) {
        char text[KILN_SETTING_OPTIONS];
        options(sweep, &sweep->settings[i], text);
        (void)printf("%-28s%s\n", sweep->settings[i].name, text);
    }
    (void)printf("%zu bakes, and the reference before them\n", sweep->count);
}

/* ---- the result ---- */

static void print_text(const struct kiln_sweep *sweep, size_t left)
{
    (void)printf("%-24s%9s%11s%9s%10s%10s%11s%11s%13s%13s\n", "range, spacing, basis", "range m", "indirect %", "all %",
                 "light s", "processor", "probes", "probe MiB", "rays", "probe rays");
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting_result *r = &sweep->results[i];
        if (r->done)
            (void)printf("%-24s%9.4g%11.2f%9.2f%10.3f%10.3f%11.0f%11.2f%13.0f%13.0f\n", sweep->settings[i].name,
                         range_of(sweep, &sweep->settings[i]), 100.0 * r->error[2], 100.0 * r->error[0],
                         r->light_seconds, r->processor_seconds, r->probes, r->probe_bytes / 0x1p20, r->rays,
                         r->probe_rays);
    }
    if (left > 0)
        (void)printf("%zu of %zu bakes are left, for the budget of %.4g s is used up; the same command goes on with "
                     "them\n",
                     left, sweep->count, sweep->job->budget);
    (void)printf("errors are root mean squares against rays without an end, relative to the mean\n");
    kiln_print(stdout, "%s/%s.csv, %s/%s.svg\n", sweep->job->output, sweep->kind->name, sweep->job->output,
               sweep->kind->name);
}

static json_t *row_json(const struct kiln_sweep *sweep, size_t i)
{
    char text[KILN_SETTING_OPTIONS];
    const struct kiln_setting_result *r = &sweep->results[i];
    options(sweep, &sweep->settings[i], text);
    return json_pack("{s:s, s:s, s:o, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "name", sweep->settings[i].name,
                     "options", text, "range", kiln_sweep_number(range_of(sweep, &sweep->settings[i])), "nrmse",
                     r->error[0], "nrmse_indirect", r->error[2], "light_seconds", r->light_seconds, "processor_seconds",
                     r->processor_seconds, "probes", r->probes, "probe_bytes", r->probe_bytes, "rays", r->rays,
                     "probe_rays", r->probe_rays);
}

static int tell(const struct kiln_sweep *sweep, size_t left, struct kiln_error *error)
{
    if (sweep->job->json)
        return kiln_sweep_tell_rows(sweep, left, row_json, error);
    print_text(sweep, left);
    return KILN_OK;
}

int kiln_tracing_range_bench(struct kiln_job *job, struct kiln_error *error)
{
    static const char *const refused[] = {"tracing-range",     "radiance-probe-spacing", "probe-basis",
                                          "probe-side",        "samples-probe",          "reference",
                                          "reference-samples", "verify-fraction",        NULL};
    const struct kiln_sweep_kind kind = {.name = "tracing-range",
                                         .suffix = "-tracing-range",
                                         .refused = refused,
                                         .choose = choose,
                                         .options = options,
                                         .key = key,
                                         .push_reference = push_reference,
                                         .rays = rays,
                                         .csv = add_csv,
                                         .plot = plot,
                                         .list = list,
                                         .tell = tell};
    return kiln_sweep_run(&kind, job, error);
}
