#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/crossover_private.h"
#include "coordinator/files/html.h"
#include "coordinator/files/json.h"
#include "worker/base/text.h"

enum { WIDTH = 760, HEIGHT = 460, LEFT = 90, RIGHT = 190, TOP = 48, BOTTOM = 58 };

static double judged(const struct kiln_crossover *c, struct kiln_cost cost)
{
    return c->device ? cost.clock : cost.processor;
}

static double users(const struct kiln_crossover *c) { return c->device ? c->users_clock : c->users; }

/* ---- files ---- */

static int write_csv(const struct kiln_crossover *c, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    struct kiln_html page = {.error = error};
    const struct kiln_crossover_way *ways[] = {&c->lightmaps, &c->few, &c->many};
    const int status = kiln_path_join(path, c->job->output, "crossover.csv", error);
    if (status != KILN_OK)
        return status;
    kiln_html_add(&page, "way,paths,error,distance,nrmse,processor_seconds_a_view,seconds_a_view\n");
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++) {
        const struct kiln_crossover_way *w = ways[i];
        const double share = w->samples == 0 ? 1.0 : w->samples / c->paths;
        const struct kiln_cost cost = w->samples == 0 ? c->view_cost : c->path_cost;
        kiln_html_add(&page, "%s,%u,%.6g,%.6g,%.6g,%.6g,%.6g\n", w->samples == 0 ? "lightmaps" : "path", w->samples,
                      w->error, w->distance, w->nrmse, cost.processor * share, cost.clock * share);
    }
    kiln_html_add(&page, "path at the bake's error,%.6g,%.6g,,,%.6g,%.6g\n", c->paths, c->lightmaps.error,
                  c->path_cost.processor, c->path_cost.clock);
    kiln_html_add(&page, "bake,,,,,%.6g,%.6g\n", c->bake_cost.processor, c->bake_cost.clock);
    return kiln_html_publish(&page, path);
}

static double across(double views, double most) { return LEFT + (WIDTH - LEFT - RIGHT) * views / most; }
static double up(double seconds, double most) { return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * seconds / most; }

static void add_line(struct kiln_html *page, double begin, double slope, double views, double most, const char *color,
                     const char *name)
{
    const double end = begin + slope * views;
    kiln_html_add(page,
                  "<path d=\"M%.1f %.1fL%.1f %.1f\" stroke=\"%s\" stroke-width=\"2\"/><text x=\"%.1f\" y=\"%.1f\" "
                  "fill=\"%s\">%s</text>\n",
                  across(0.0, views), up(begin, most), across(views, views), up(end, most), color,
                  across(views, views) + 8.0, up(end, most) + 4.0, color, name);
}

/* Time over the number of views: both ways, up to twice the crossover. */
static int write_plot(const struct kiln_crossover *c, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    struct kiln_html page = {.error = error};
    const double bake = judged(c, c->bake_cost), view = judged(c, c->view_cost), trace = judged(c, c->path_cost),
                 views = isfinite(users(c)) ? 2.0 * users(c) : 10.0,
                 most = fmax(1e-9, 1.05 * fmax(bake + view * views, trace * views));
    const int status = kiln_path_join(path, c->job->output, "crossover.svg", error);
    if (status != KILN_OK)
        return status;
    kiln_html_add(&page,
                  "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\" "
                  "font-family=\"sans-serif\" font-size=\"12\"><rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n"
                  "<text x=\"%d\" y=\"24\" font-size=\"15\">One bake or path tracing: ",
                  WIDTH, HEIGHT, WIDTH, HEIGHT, LEFT);
    kiln_html_text(&page, c->job->scene);
    kiln_html_add(&page, "</text>\n");
    for (int i = 0; i <= 4; i++)
        kiln_html_add(&page,
                      "<path d=\"M%d %.1fH%d\" stroke=\"#ddd\"/><text x=\"%d\" y=\"%.1f\" text-anchor=\"end\">%.3g s"
                      "</text><text x=\"%.1f\" y=\"%d\" text-anchor=\"middle\">%.3g</text>\n",
                      LEFT, up(0.25 * i * most, most), WIDTH - RIGHT, LEFT - 8, up(0.25 * i * most, most) + 4.0,
                      0.25 * i * most, across(0.25 * i * views, views), HEIGHT - BOTTOM + 18, 0.25 * i * views);
    add_line(&page, bake, view, views, most, "#1f5fa8", "bake, and its views");
    add_line(&page, 0.0, trace, views, most, "#c4451c", "path-traced views");
    kiln_html_add(&page,
                  "<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">views of %d x %d, at the bake's error (%.2f %% of "
                  "white)</text>\n</svg>\n",
                  (LEFT + WIDTH - RIGHT) / 2, HEIGHT - 16, KILN_FULL_WIDTH, KILN_FULL_HEIGHT,
                  100.0 * c->lightmaps.error);
    return kiln_html_publish(&page, path);
}

/* ---- stdout ---- */

static void sentence(const struct kiln_crossover *c, char text[400])
{
    const char *of = c->device ? "by the clock" : "of the processor";
    if (isfinite(users(c)))
        (void)snprintf(text, 400,
                       "from %.0f view%s on one bake costs less than path tracing each at its error, by time %s",
                       users(c), users(c) > 1.0 ? "s" : "", of);
    else
        (void)snprintf(text, 400,
                       "path tracing a view at the bake's error costs less than drawing it from lightmaps, by time %s",
                       of);
}

static void print_row(const char *name, const struct kiln_crossover_way *way, double paths, double error,
                      struct kiln_cost cost)
{
    char number[32] = "", nrmse[32] = "";
    if (paths > 0.0)
        (void)snprintf(number, sizeof number, "%.4g", paths);
    if (way != NULL)
        (void)snprintf(nrmse, sizeof nrmse, "%.2f", 100.0 * way->nrmse);
    (void)printf("%-26s%8s%12.3f%10s%14.3f%12.3f\n", name, number, 100.0 * error, nrmse, cost.processor, cost.clock);
}

static struct kiln_cost scaled(struct kiln_cost cost, double by)
{
    return (struct kiln_cost){cost.processor * by, cost.clock * by};
}

static void print_table(const struct kiln_crossover *c, const char *text)
{
    (void)printf("%-26s%8s%12s%10s%14s%12s\n", "a view of 1920 x 1080", "paths", "error %", "nrmse %", "processor s",
                 "seconds");
    print_row("from lightmaps", &c->lightmaps, 0.0, c->lightmaps.error, c->view_cost);
    print_row("path-traced", &c->few, c->few.samples, c->few.error, scaled(c->path_cost, c->few.samples / c->paths));
    print_row("path-traced", &c->many, c->many.samples, c->many.error,
              scaled(c->path_cost, c->many.samples / c->paths));
    print_row("path-traced, as the bake", NULL, c->paths, c->lightmaps.error, c->path_cost);
    (void)printf("%-26s%8s%12s%10s%14.3f%12.3f\n", "the bake", "", "", "", c->bake_cost.processor, c->bake_cost.clock);
    (void)printf("the error falls with the power %.2f of the paths; of %d views of %d x %d pixels, against %u paths "
                 "(error %.3f %%)\n",
                 c->exponent, KILN_CROSSOVER_VIEWS, KILN_CROSSOVER_WIDTH, KILN_CROSSOVER_HEIGHT, c->reference_samples,
                 100.0 * c->reference_error);
    (void)puts(text);
    kiln_print(stdout, "%s/crossover.csv, %s/crossover.svg\n", c->job->output, c->job->output);
}

static json_t *number(double value) { return isfinite(value) ? json_real(value) : json_null(); }

int kiln_crossover_tell(const struct kiln_crossover *c, struct kiln_error *error)
{
    char text[400];
    int status = write_csv(c, error);
    if (status == KILN_OK)
        status = write_plot(c, error);
    if (status != KILN_OK)
        return status;
    sentence(c, text);
    if (!c->job->json) {
        print_table(c, text);
        return KILN_OK;
    }
    c->job->answered = true;
    return kiln_json_print(json_pack("{s:s, s:o, s:o, s:f, s:f, s:f, s:f, s:[f,f], s:[f,f], s:[f,f], s:o, s:s}",
                                     "status", "done", "users", number(c->users), "users_by_the_clock",
                                     number(c->users_clock), "error", c->lightmaps.error, "paths", c->paths, "exponent",
                                     c->exponent, "reference_error", c->reference_error, "bake_seconds",
                                     c->bake_cost.processor, c->bake_cost.clock, "view_seconds", c->view_cost.processor,
                                     c->view_cost.clock, "path_seconds", c->path_cost.processor, c->path_cost.clock,
                                     "output", kiln_json_string(c->job->output), "sentence", text),
                           error);
}
