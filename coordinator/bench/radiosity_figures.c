#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/log_plot.h"
#include "coordinator/bench/radiosity_private.h"

/* BESIDE: from where on labels stand left of their points */
enum { BESIDE = KILN_LOG_PLOT_WIDTH - KILN_LOG_PLOT_RIGHT - 90, LINES_MOST = 24, POINTS_MOST = 32, LINE_NAME = 32 };

/* One line of a figure; values that are not above 0 have no place on it. */
struct line {
    char name[LINE_NAME];
    bool dashed, loose; /* loose: points alone, with their names beside them */
    int color;
    size_t count;
    double x[POINTS_MOST], y[POINTS_MOST];
    const char *label[POINTS_MOST];
};

struct figure {
    const char *title, *across, *up, *unit[2];
    double factor[2];
    size_t count;
    struct line line[LINES_MOST];
};

static const char *const colors[] = {"#1f5fa8", "#c4451c", "#3d8b37", "#8a4fb0", "#b08a00",
                                     "#555555", "#0f8f9a", "#c23b7a", "#111111"};
enum { COLORS = sizeof colors / sizeof *colors };

static struct line *add_line(struct figure *f, int color, bool dashed, const char *name)
{
    struct line *line = &f->line[f->count < LINES_MOST ? f->count++ : LINES_MOST - 1];
    *line = (struct line){.dashed = dashed, .color = color % COLORS};
    (void)snprintf(line->name, sizeof line->name, "%s", name);
    return line;
}

static void add_point(struct line *line, double x, double y, const char *label)
{
    if (line->count == POINTS_MOST || !(x > 0.0) || !(y > 0.0) || !isfinite(x) || !isfinite(y))
        return;
    line->x[line->count] = x;
    line->y[line->count] = y;
    line->label[line->count++] = label;
}

static void draw_line(struct kiln_html *page, const struct kiln_log_plot *plot, const struct figure *f,
                      const struct line *line)
{
    if (!line->loose) {
        kiln_html_add(page, "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"2\"%s points=\"", colors[line->color],
                      line->dashed ? " stroke-dasharray=\"5 4\"" : "");
        for (size_t i = 0; i < line->count; i++)
            kiln_html_add(page, "%.1f,%.1f ", kiln_log_plot_across(plot, line->x[i]),
                          kiln_log_plot_up(plot, line->y[i]));
        kiln_html_add(page, "\"/>\n");
    }
    for (size_t i = 0; i < line->count; i++) {
        const double x = kiln_log_plot_across(plot, line->x[i]), y = kiln_log_plot_up(plot, line->y[i]);
        kiln_html_add(page,
                      "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"%s\" stroke=\"%s\"><title>%s: %.3g%s, "
                      "%.3g%s</title></circle>\n",
                      x, y, line->dashed ? "#fff" : colors[line->color], colors[line->color],
                      line->label[i] != NULL ? line->label[i] : line->name, f->factor[0] * line->x[i], f->unit[0],
                      f->factor[1] * line->y[i], f->unit[1]);
        if (line->loose && line->label[i] != NULL)
            kiln_html_add(page, "<text x=\"%.1f\" y=\"%.1f\" font-size=\"11\"%s>%s</text>\n",
                          x > BESIDE ? x - 7.0 : x + 7.0, y + 4.0, x > BESIDE ? " text-anchor=\"end\"" : "",
                          line->label[i]);
    }
}

/* A line's name, with its stroke or its dot. */
static void draw_key(struct kiln_html *page, const struct line *line, int x, int y)
{
    const char *color = colors[line->color];
    if (line->loose)
        kiln_html_add(page, "<circle cx=\"%d\" cy=\"%d\" r=\"4\" fill=\"%s\" stroke=\"%s\"/>", x + 10, y,
                      line->dashed ? "#fff" : color, color);
    else
        kiln_html_add(page, "<path d=\"M%d %dh20\" stroke=\"%s\" stroke-width=\"2\"%s/>", x, y, color,
                      line->dashed ? " stroke-dasharray=\"5 4\"" : "");
    kiln_html_add(page, "<text x=\"%d\" y=\"%d\" font-size=\"11\">%s</text>\n", x + 25, y + 4, line->name);
}

static void draw_figure(const struct kiln_sweep *sweep, const struct figure *f, struct kiln_html *page)
{
    struct kiln_log_plot plot = kiln_log_plot_empty();
    for (size_t l = 0; l < f->count; l++)
        for (size_t i = 0; i < f->line[l].count; i++)
            kiln_log_plot_include(&plot, f->line[l].x[i], f->line[l].y[i]);
    kiln_log_plot_fit(&plot);
    for (int axis = 0; axis < 2; axis++) {
        plot.unit[axis] = f->unit[axis];
        plot.factor[axis] = f->factor[axis];
    }
    kiln_log_plot_begin(page, &plot, f->title, sweep->job->scene, f->across, f->up);
    for (size_t l = 0; l < f->count; l++) {
        const int x = KILN_LOG_PLOT_WIDTH - KILN_LOG_PLOT_RIGHT + 10, y = KILN_LOG_PLOT_TOP + 10 + 18 * (int)l;
        draw_line(page, &plot, f, &f->line[l]);
        draw_key(page, &f->line[l], x, y);
    }
    kiln_html_add(page, "</svg>\n");
}

/* ---- what was measured ---- */

/* The sizes, from the smallest on; returns their number. */
static size_t sizes_of(const struct kiln_sweep *sweep, uint32_t sides[KILN_SETTINGS_MOST])
{
    size_t count = 0;
    for (size_t i = 0; i < sweep->count; i++) {
        const uint32_t side = sweep->settings[i].side;
        size_t at = count;
        if (!kiln_radiosity_is(&sweep->settings[i], "pure"))
            continue;
        for (; at > 0 && sides[at - 1] > side; at--)
            sides[at] = sides[at - 1];
        sides[at] = side;
        count++;
    }
    return count;
}

/* The result of a row at a size; NULL: there is none yet. */
static const struct kiln_setting_result *find(const struct kiln_sweep *sweep, uint32_t side, const char *row)
{
    char name[KILN_SETTING_NAME];
    (void)snprintf(name, sizeof name, "%u %s", side, row);
    for (size_t i = 0; i < sweep->count; i++)
        if (strcmp(sweep->settings[i].name, name) == 0)
            return sweep->results[i].done ? &sweep->results[i] : NULL;
    return NULL;
}

/* The time of a pass: one that is not the first, where there is one. */
static double pass_of(const struct kiln_setting_result *r)
{
    return r->later_pass > 0.0 ? r->later_pass : r->first_pass;
}

/* Adds a line of a row over the sizes. */
static void add_row(const struct kiln_sweep *sweep, struct figure *f, const char *row, const char *name)
{
    uint32_t sides[KILN_SETTINGS_MOST];
    const size_t count = sizes_of(sweep, sides);
    struct line *line = add_line(f, (int)f->count, false, name);
    for (size_t i = 0; i < count; i++) {
        const struct kiln_setting_result *r = find(sweep, sides[i], row);
        if (r != NULL)
            add_point(line, sides[i], pass_of(r), NULL);
    }
}

/* Adds for each size a line of a group's DFPR and a dashed one of its error, over the parameter or the time of a pass.
 */
static void add_group(const struct kiln_sweep *sweep, struct figure *f, const char *group, bool over_time)
{
    uint32_t sides[KILN_SETTINGS_MOST];
    const size_t count = sizes_of(sweep, sides);
    for (size_t k = 0; k < 2 * count; k++) {
        char name[LINE_NAME];
        const bool error = k % 2 == 1;
        (void)snprintf(name, sizeof name, "%u: %s", sides[k / 2], error ? "true error" : "DFPR");
        struct line *line = add_line(f, (int)(k / 2), error, name);
        for (size_t i = 0; i < sweep->count; i++) {
            const struct kiln_setting *s = &sweep->settings[i];
            const struct kiln_setting_result *r = &sweep->results[i];
            if (s->side == sides[k / 2] && kiln_radiosity_is(s, group) && r->done)
                add_point(line, over_time ? pass_of(r) : s->parameter, error ? r->error[0] : r->dfpr_8bit, s->name);
        }
    }
}

/* ---- figures ---- */

static void add_6_5(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    struct figure f = {.title = "Time of a pass of pure radiosity (figure 6.5)",
                       .across = "texels a side",
                       .up = "seconds of a pass",
                       .unit = {"", " s"},
                       .factor = {1.0, 1.0}};
    add_row(sweep, &f, "pure", "pure");
    draw_figure(sweep, &f, page);
}

static void add_6_7(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    struct figure f = {.title = "Undersampling by chance (figure 6.7)",
                       .across = "texels a side of a window",
                       .up = "DFPR; dashed: true error",
                       .unit = {"", ""},
                       .factor = {1.0, 1.0}};
    add_group(sweep, &f, "random", false);
    draw_figure(sweep, &f, page);
}

static void add_6_10(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    struct figure f = {.title = "Subdivision, thresholds 0.02 to 0.5 (figure 6.10)",
                       .across = "seconds of a pass",
                       .up = "DFPR; dashed: true error",
                       .unit = {" s", ""},
                       .factor = {1.0, 1.0}};
    add_group(sweep, &f, "subdivide", true);
    draw_figure(sweep, &f, page);
}

/* What a texel sees by a grid of voxels, or by rays: its row in what is kept. */
struct seen {
    const char *texel;
    uint32_t along; /* 0: by rays */
    double facing, by_rays, seen, both;
    double wrong; /* share of those it faces, of which the grid says what rays do not */
};

static struct seen seen_of(const json_t *row)
{
    struct seen s = {.texel = json_string_value(json_object_get(row, "texel")),
                     .along = (uint32_t)json_integer_value(json_object_get(row, "along")),
                     .facing = json_number_value(json_object_get(row, "facing")),
                     .by_rays = json_number_value(json_object_get(row, "rays"))};
    s.seen = s.along > 0 ? json_number_value(json_object_get(row, "voxels")) : s.by_rays;
    s.both = s.along > 0 ? json_number_value(json_object_get(row, "both")) : s.by_rays;
    s.wrong = s.facing > 0.0 ? (s.by_rays + s.seen - 2.0 * s.both) / s.facing : 0.0;
    return s;
}

static void add_table_6_14(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    size_t i;
    const json_t *row;
    kiln_html_add(page, "voxels_along,facing,seen,seen_by_rays,seen_by_both,wrong_share\n");
    json_array_foreach(json_object_get(sweep->kept, "seen"), i, row)
    {
        const struct seen s = seen_of(row);
        if (s.along > 0)
            kiln_html_add(page, "%u,", s.along);
        else
            kiln_html_add(page, "rays,");
        kiln_html_add(page, "%.0f,%.0f,%.0f,%.0f,%.6g\n", s.facing, s.seen, s.by_rays, s.both, s.wrong);
    }
}

static void add_6_14(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    struct figure f = {.title = "What a texel sees by voxels (figure 6.14)",
                       .across = "voxels along the longest side",
                       .up = "texels seen by voxels or rays alone, of those it faces",
                       .unit = {"", " %"},
                       .factor = {1.0, 100.0}};
    struct line *line = add_line(&f, 0, false, "wrong");
    size_t i;
    const json_t *row;
    json_array_foreach(json_object_get(sweep->kept, "seen"), i, row)
    {
        const struct seen s = seen_of(row);
        add_point(line, s.along, s.wrong, NULL);
    }
    draw_figure(sweep, &f, page);
}

static void add_seen_pictures(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    size_t i;
    const json_t *row;
    kiln_html_add(
        page, "<h2>What a texel sees, by rays and by voxels; white: seen, blue: hidden (figure 6.14)</h2>\n<div>\n");
    json_array_foreach(json_object_get(sweep->kept, "seen"), i, row)
    {
        char file[KILN_PICTURE_NAME];
        const struct seen s = seen_of(row);
        kiln_radiosity_seen_picture(s.along, file);
        kiln_html_add(page, "<figure><img src=\"%s\" alt=\"seen\"><figcaption>", file);
        kiln_html_text(page, s.texel != NULL ? s.texel : "");
        if (s.along > 0)
            kiln_html_add(page, ", %u voxels<br>%.1f %% wrong</figcaption></figure>\n", s.along, 100.0 * s.wrong);
        else
            kiln_html_add(page, ", rays<br>%.0f of %.0f texels</figcaption></figure>\n", s.seen, s.facing);
    }
    kiln_html_add(page, "</div>\n");
}

static void add_6_15(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    struct figure f = {.title = "Voxels for rays (figure 6.15)",
                       .across = "voxels along the longest side",
                       .up = "DFPR; dashed: true error",
                       .unit = {"", ""},
                       .factor = {1.0, 1.0}};
    add_group(sweep, &f, "voxels", false);
    draw_figure(sweep, &f, page);
}

/* All rows of a size, error over time of a pass, or of all sizes over the processor time of the bake. */
static void add_scatter(const struct kiln_sweep *sweep, struct figure *f, uint32_t side)
{
    const char *group = "";
    struct line *line = NULL;
    uint32_t sides[KILN_SETTINGS_MOST];
    const size_t sizes = sizes_of(sweep, sides);
    for (size_t first = 0; first < sweep->count && sweep->settings[first].side == sweep->settings[0].side; first++) {
        const struct kiln_setting *row = &sweep->settings[first];
        if (row->generate != NULL)
            continue;
        if (strcmp(row->group, group) != 0) {
            group = row->group;
            line = add_line(f, (int)f->count, f->count >= COLORS, group);
            line->loose = side > 0;
        }
        for (size_t k = 0; k < sizes && line != NULL; k++) {
            const struct kiln_setting_result *r = find(sweep, sides[k], strchr(row->name, ' ') + 1);
            if (r != NULL && (side == 0 || side == sides[k]))
                add_point(line, side > 0 ? pass_of(r) : r->processor_seconds, r->error[0], strchr(row->name, ' ') + 1);
        }
    }
}

static void add_6_11(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    uint32_t sides[KILN_SETTINGS_MOST];
    const size_t count = sizes_of(sweep, sides);
    struct figure f = {.title = "All methods at the largest size (figures 6.11, 6.18)",
                       .across = "seconds of a pass",
                       .up = "true error",
                       .unit = {" s", " %"},
                       .factor = {1.0, 100.0}};
    add_scatter(sweep, &f, sides[count - 1]);
    draw_figure(sweep, &f, page);
}

void kiln_radiosity_plot(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    struct figure f = {.title = "True error over processor time",
                       .across = "processor seconds of the bake",
                       .up = "true error",
                       .unit = {" s", " %"},
                       .factor = {1.0, 100.0}};
    add_scatter(sweep, &f, 0);
    for (size_t l = 0; l < f.count; l++)
        f.line[l].loose = true;
    for (size_t l = 0; l < f.count; l++)
        for (size_t i = 0; i < f.line[l].count; i++)
            f.line[l].label[i] = NULL;
    draw_figure(sweep, &f, page);
}

/* The pure pass of a scene at the largest size; NULL: it has not run, or is none. */
static const struct kiln_setting_result *pure_of(const struct kiln_sweep *sweep, size_t i)
{
    uint32_t sides[KILN_SETTINGS_MOST];
    const struct kiln_setting *s = &sweep->settings[i];
    const size_t count = sizes_of(sweep, sides);
    const bool is_pure = s->generate != NULL || kiln_radiosity_is(s, "pure");
    return is_pure && sweep->results[i].done && s->side == sides[count - 1] ? &sweep->results[i] : NULL;
}

/* The scene's name; that of the job's is its file's. */
static const char *scene_of(const struct kiln_sweep *sweep, const struct kiln_setting *s)
{
    const char *slash = strrchr(sweep->job->scene, '/');
    return s->generate != NULL ? s->generate : slash != NULL ? slash + 1 : sweep->job->scene;
}

static void add_table_6_12(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    kiln_html_add(page, "scene,triangles,texels,rays,pass_seconds,pair_nanoseconds\n");
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting_result *r = pure_of(sweep, i);
        if (r != NULL)
            kiln_html_add(page, "%s,%.0f,%.0f,%.6g,%.6g,%.6g\n", scene_of(sweep, &sweep->settings[i]), r->triangles,
                          r->points, r->rays, pass_of(r), 1e9 * pass_of(r) / (r->points * r->points));
    }
}

static void add_6_12(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    struct figure f = {.title = "Time of a pass of pure radiosity, by scene (figure 6.12)",
                       .across = "triangles",
                       .up = "nanoseconds a pair of texels",
                       .unit = {"", " ns"},
                       .factor = {1.0, 1.0}};
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting_result *r = pure_of(sweep, i);
        if (r == NULL)
            continue;
        const char *scene = scene_of(sweep, &sweep->settings[i]), *space = strchr(scene, ' '); /* before an option */
        char name[LINE_NAME];
        (void)snprintf(name, sizeof name, "%.*s, %.0f", (int)(space != NULL ? space - scene : 20), scene, r->triangles);
        struct line *line = add_line(&f, (int)f.count, false, name);
        line->loose = true;
        add_point(line, r->triangles, 1e9 * pass_of(r) / (r->points * r->points), NULL);
    }
    draw_figure(sweep, &f, page);
}

static void add_6_13(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    uint32_t sides[KILN_SETTINGS_MOST];
    const size_t count = sizes_of(sweep, sides);
    struct figure f = {.title = "Passes that keep visibility, over pure ones (figure 6.13)",
                       .across = "texels a side",
                       .up = "time of a pass",
                       .unit = {"", " %"},
                       .factor = {1.0, 100.0}};
    for (int later = 0; later < 2; later++) {
        struct line *line = add_line(&f, later, false, later ? "later passes" : "first pass");
        for (size_t i = 0; i < count; i++) {
            const struct kiln_setting_result *kept = find(sweep, sides[i], "cache"),
                                             *pure = find(sweep, sides[i], "pure");
            if (kept != NULL && pure != NULL)
                add_point(line, sides[i],
                          later ? kept->later_pass / pure->later_pass : kept->first_pass / pure->first_pass, NULL);
        }
    }
    draw_figure(sweep, &f, page);
}

static void add_6_16(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    struct figure f = {.title = "Even directions (figures 6.16, 6.17)",
                       .across = "directions of a texel",
                       .up = "DFPR; dashed: true error",
                       .unit = {"", ""},
                       .factor = {1.0, 1.0}};
    add_group(sweep, &f, "even", false);
    draw_figure(sweep, &f, page);
}

static void add_6_18(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    static const char *const names[] = {"pure",        "random 4", "mipmap 4",  "subdivide 0.1", "cache",
                                        "links 0.015", "even 256", "mixed 256", "cells"};
    struct figure f = {.title = "Time of a pass (figure 6.18)",
                       .across = "texels a side",
                       .up = "seconds of a pass that is not the first",
                       .unit = {"", " s"},
                       .factor = {1.0, 1.0}};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        add_row(sweep, &f, names[i], names[i]);
    draw_figure(sweep, &f, page);
}

/* ---- tables ---- */

/* The row of undersampling by chance whose window has the same ratio to the size at all sizes: 1 at the smallest. */
static void constant_ratio(uint32_t side, uint32_t smallest, char row[LINE_NAME])
{
    const uint32_t window = (side + smallest / 2) / smallest;
    if (window <= 1)
        (void)snprintf(row, LINE_NAME, "pure");
    else
        (void)snprintf(row, LINE_NAME, "random %u", window);
}

static void add_table_6_1(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    uint32_t sides[KILN_SETTINGS_MOST];
    const size_t count = sizes_of(sweep, sides);
    kiln_html_add(page, "side,texels,window,dfpr_8bit,dfpr,nrmse,pass_seconds\n");
    for (size_t i = 0; i < count; i++) {
        char row[LINE_NAME];
        constant_ratio(sides[i], sides[0], row);
        const struct kiln_setting_result *r = find(sweep, sides[i], row);
        if (r != NULL)
            kiln_html_add(page, "%u,%.0f,%s,%.6g,%.6g,%.6g,%.6g\n", sides[i], r->points,
                          strchr(row, ' ') != NULL ? strchr(row, ' ') + 1 : "1", r->dfpr_8bit, r->dfpr, r->error[0],
                          pass_of(r));
    }
}

static void add_table_6_2(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    uint32_t sides[KILN_SETTINGS_MOST];
    const size_t count = sizes_of(sweep, sides);
    kiln_html_add(page, "side,texels,method,bake_seconds,processor_seconds,dfpr_8bit,nrmse\n");
    for (size_t i = 0; i < count; i++) {
        char undersampled[LINE_NAME];
        constant_ratio(sides[i], sides[0], undersampled);
        const char *const names[] = {"cells", undersampled, "even 1024", "links 0.015"};
        for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
            const struct kiln_setting_result *r = find(sweep, sides[i], names[k]);
            if (r != NULL)
                kiln_html_add(page, "%u,%.0f,%s,%.6g,%.6g,%.6g,%.6g\n", sides[i], r->points, names[k], r->seconds,
                              r->processor_seconds, r->dfpr_8bit, r->error[0]);
        }
    }
}

/* ---- the page ---- */

static void add_picture(const struct kiln_sweep *sweep, uint32_t side, const char *row, const char *ending,
                        struct kiln_html *page)
{
    char file[KILN_PICTURE_NAME];
    struct kiln_setting s = {.side = side};
    const struct kiln_setting_result *r = find(sweep, side, row);
    (void)snprintf(s.name, sizeof s.name, "%u %.30s", side, row);
    kiln_radiosity_picture(&s, ending, file);
    if (r != NULL)
        kiln_html_add(page,
                      "<figure><img src=\"%s\" alt=\"%s\"><figcaption>%s<br>%.3g s, DFPR %.4f, error %.1f "
                      "%%</figcaption></figure>\n",
                      file, s.name, s.name, pass_of(r), r->dfpr_8bit, 100.0 * r->error[0]);
}

static void add_pictures(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    static const char *const windows[] = {"pure", "random 2", "random 4", "random 8", "random 16"};
    uint32_t sides[KILN_SETTINGS_MOST];
    const size_t count = sizes_of(sweep, sides);
    kiln_html_add(page, "<h2>Undersampling by chance, sizes and windows (figure 6.6)</h2>\n");
    for (size_t i = 0; i < count; i++) {
        kiln_html_add(page, "<div>\n");
        for (size_t k = 0; k < sizeof windows / sizeof *windows; k++)
            add_picture(sweep, sides[i], windows[k], "", page);
        kiln_html_add(page, "</div>\n");
    }
    kiln_html_add(page, "<h2>Difference of the lightmap that is off most from pure radiosity; white: 10 %% of the mean "
                        "(figure 6.9)</h2>\n<div>\n");
    for (size_t k = 1; k < sizeof windows / sizeof *windows; k++)
        add_picture(sweep, sides[count - 1], windows[k], "-difference", page);
    kiln_html_add(page,
                  "</div>\n<h2>All methods at the largest size (figures 6.8, 6.11, 6.17)</h2>\n<div>\n<figure><img "
                  "src=\"pictures/reference.png\" alt=\"reference\"><figcaption>reference, by "
                  "paths</figcaption></figure>\n");
    for (size_t i = 0; i < sweep->count; i++)
        if (sweep->settings[i].side == sides[count - 1] && sweep->settings[i].generate == NULL)
            add_picture(sweep, sides[count - 1], strchr(sweep->settings[i].name, ' ') + 1, "", page);
    kiln_html_add(page, "</div>\n");
}

/* A table of comma-separated values, as add makes it, as HTML. */
static void add_table(const struct kiln_sweep *sweep, const char *title,
                      void (*add)(const struct kiln_sweep *sweep, struct kiln_html *page), struct kiln_html *page)
{
    struct kiln_html csv = {.error = page->error};
    add(sweep, &csv);
    kiln_html_add(page, "<h2>%s</h2>\n<table><tr><td>", title);
    for (size_t i = 0; csv.text != NULL && i + 1 < csv.size && csv.text[i] != '\0'; i++) {
        const char one[2] = {csv.text[i], '\0'};
        if (one[0] == ',')
            kiln_html_add(page, "</td><td>");
        else if (one[0] == '\n' && csv.text[i + 1] != '\0')
            kiln_html_add(page, "</td></tr>\n<tr><td>");
        else
            kiln_html_text(page, one[0] == '\n' ? "" : one);
    }
    kiln_html_add(page, "</td></tr></table>\n");
    kiln_html_free(&csv);
}

static void add_page(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    kiln_html_add(
        page, "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>kiln bench radiosity</title>"
              "<style>body{font-family:sans-serif;margin:2em;max-width:1400px}figure{display:inline-block;margin:4px;"
              "font-size:12px}td{padding:2px 12px 2px 0;text-align:right}svg{max-width:860px;display:block}"
              "img{width:240px;image-rendering:pixelated}</style></head><body>\n<h1>Radiosity by patches: ");
    kiln_html_text(page, sweep->job->scene);
    kiln_html_add(
        page, "</h1>\n<p>Tables and figures are numbered as in Kahl, &#8220;RTX Radiosity&#8221;, 2023, chapter 6. "
              "DFPR is against pure radiosity of the same size, of 8 bits and all pixels; the true error is the root "
              "mean square against paths at the largest size, over the mean. Seconds are of one pass, by the "
              "clock.</p>\n");
    add_table(sweep, "Windows of one ratio to the size (table 6.1)", add_table_6_1, page);
    add_table(sweep, "Whole bakes (table 6.2)", add_table_6_2, page);
    add_table(sweep, "Scenes (figure 6.12)", add_table_6_12, page);
    add_table(sweep, "What a texel sees (figure 6.14)", add_table_6_14, page);
    add_6_5(sweep, page);
    add_6_7(sweep, page);
    add_6_10(sweep, page);
    add_6_11(sweep, page);
    add_6_12(sweep, page);
    add_6_13(sweep, page);
    add_6_14(sweep, page);
    add_6_15(sweep, page);
    add_6_16(sweep, page);
    add_6_18(sweep, page);
    kiln_radiosity_plot(sweep, page);
    add_pictures(sweep, page);
    add_seen_pictures(sweep, page);
    kiln_html_add(page, "</body></html>\n");
}

const struct kiln_sweep_file kiln_radiosity_files[] = {{"-table-6.1.csv", add_table_6_1},
                                                       {"-table-6.2.csv", add_table_6_2},
                                                       {"-figure-6.5.svg", add_6_5},
                                                       {"-figure-6.7.svg", add_6_7},
                                                       {"-figure-6.10.svg", add_6_10},
                                                       {"-figure-6.11.svg", add_6_11},
                                                       {"-figure-6.12.csv", add_table_6_12},
                                                       {"-figure-6.12.svg", add_6_12},
                                                       {"-figure-6.13.svg", add_6_13},
                                                       {"-figure-6.14.csv", add_table_6_14},
                                                       {"-figure-6.14.svg", add_6_14},
                                                       {"-figure-6.15.svg", add_6_15},
                                                       {"-figure-6.16.svg", add_6_16},
                                                       {"-figure-6.18.svg", add_6_18},
                                                       {".html", add_page},
                                                       {NULL, NULL}};
