#include "coordinator/view/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "coordinator/files/html.h"
#include "coordinator/files/publish.h"
#include "coordinator/output/read/results.h"
#include "coordinator/output/tone_map.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

enum { PICTURE_SIDE = 160, MOST_PICTURES = 200, MOST_BARS = 4096 };

static const char style[] =
    "body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:70em;padding:0 1em;color:#222}"
    "h1,h2{font-weight:600}table{border-collapse:collapse;margin:.5em 0}"
    "td,th{padding:.15em .9em .15em 0;text-align:left;vertical-align:top}td.n,th.n{text-align:right}"
    "img{max-width:100%;background:#eee}figure img{width:10em;height:10em;object-fit:contain;image-rendering:pixelated}"
    "figure{display:inline-block;margin:0 1em 1em "
    "0;vertical-align:top}figcaption{font-size:85%;width:12em;overflow-wrap:anywhere}"
    "svg{max-width:100%}svg text{font-size:12px;fill:#444}svg rect{fill:#b5532a}svg line{stroke:#888}";

struct report {
    struct kiln_results *results;
    const json_t *run;
    struct kiln_html page;
};

/* ---- values that may be missing ---- */

static const json_t *field(const json_t *object, const char *name) { return json_object_get(object, name); }

/* The value of a number, or the luminance of an array of three numbers; NaN for anything else. */
static double number(const json_t *value)
{
    if (json_is_number(value))
        return json_number_value(value);
    if (json_is_array(value) && json_array_size(value) == 3)
        return kiln_luminance((double[3]){number(json_array_get(value, 0)), number(json_array_get(value, 1)),
                                          number(json_array_get(value, 2))});
    return (double)NAN;
}

static void add_value(struct kiln_html *page, const json_t *value)
{
    if (json_is_string(value)) {
        kiln_html_text(page, json_string_value(value));
    } else if (json_is_integer(value)) {
        kiln_html_add(page, "%lld", (long long)json_integer_value(value));
    } else if (json_is_real(value)) {
        kiln_html_add(page, "%.6g", json_real_value(value));
    } else if (json_is_boolean(value)) {
        kiln_html_add(page, "%s", json_is_true(value) ? "yes" : "no");
    } else if (json_is_array(value)) {
        for (size_t i = 0; i < json_array_size(value); i++) {
            kiln_html_add(page, "%s", i == 0 ? "" : " ");
            add_value(page, json_array_get(value, i));
        }
    }
}

/* Whether the value is without information: 0, an empty text, false, null, or missing. */
static bool says_nothing(const json_t *value)
{
    if (json_is_number(value))
        return json_number_value(value) == 0.0;
    if (json_is_string(value))
        return json_string_value(value)[0] == '\0';
    if (!json_is_array(value))
        return !json_is_true(value);
    for (size_t i = 0; i < json_array_size(value); i++)
        if (!says_nothing(json_array_get(value, i)))
            return false;
    return true;
}

/* Whether the value is a scalar or a short array of scalars, which can be shown in a table. */
static bool is_shown(const json_t *value)
{
    return !json_is_object(value) &&
           !(json_is_array(value) && (json_array_size(value) > 4 || json_is_object(json_array_get(value, 0)))) &&
           !says_nothing(value);
}

/* Adds the name of a field, with spaces for underscores. */
static void add_words(struct kiln_html *page, const char *name)
{
    char words[128];
    (void)snprintf(words, sizeof words, "%s", name);
    for (char *c = words; *c != '\0'; c++)
        *c = *c == '_' ? ' ' : *c;
    kiln_html_text(page, words);
}

/* Adds a heading (NULL: none) and a table of the fields of an object that have information. Adds nothing if there are
 * none. */
static void add_object(struct kiln_html *page, const char *title, const json_t *object)
{
    const char *name;
    json_t *value;
    bool any = false;
    json_object_foreach((json_t *)(uintptr_t)object, name, value)
    {
        if (!is_shown(value))
            continue;
        if (!any && title != NULL)
            kiln_html_add(page, "<h2>%s</h2>\n", title);
        kiln_html_add(page, "%s<tr><td>", any ? "" : "<table>");
        any = true;
        add_words(page, name);
        kiln_html_add(page, "</td><td>");
        add_value(page, value);
        kiln_html_add(page, "</td></tr>\n");
    }
    kiln_html_add(page, "%s", any ? "</table>\n" : "");
}

/* ---- pictures ---- */

/* Averages n x n pixels, so that the longer side has at most PICTURE_SIDE. */
static int shrink(const struct kiln_image *image, struct kiln_image **small, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    const uint32_t longest = image->width > image->height ? image->width : image->height,
                   every = (longest + PICTURE_SIDE - 1) / PICTURE_SIDE;
    const uint32_t width = (image->width + every - 1) / every, height = (image->height + every - 1) / every;
    float *from[3], *to[3];
    const int status = kiln_image_create(small, width, height, names, 3, error);
    if (status != KILN_OK)
        return status;
    if (!kiln_image_rgb(image, "", from))
        return kiln_fail(error, KILN_BAD_INPUT, "a lightmap has no channels R, G and B");
    (void)kiln_image_rgb(*small, "", to);
    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++) {
            const uint32_t u = x / every, v = y / every;
            const uint32_t wide = u + 1 < width ? every : image->width - u * every,
                           high = v + 1 < height ? every : image->height - v * every;
            for (int c = 0; c < 3; c++)
                to[c][(size_t)v * width + u] += from[c][(size_t)y * image->width + x] / (float)(wide * high);
        }
    return KILN_OK;
}

/* Adds the size and, from run.json, density, validity and error. */
static void add_caption(struct kiln_html *page, const json_t *object, const struct kiln_image *image)
{
    const double density = number(field(object, "texels_per_metre")), valid = number(field(object, "valid")),
                 filled = number(field(object, "filled"));
    const double error = number(field(object, "relative_error"));
    kiln_html_add(page, "%u x %u texels", image->width, image->height);
    if (density > 0.0)
        kiln_html_add(page, ", %.3g a metre", density);
    if (filled > 0.0)
        kiln_html_add(page, "<br>%.3g %% gathered, the rest inside other geometry and filled",
                      100.0 * valid / (valid + filled));
    if (error > 0.0)
        kiln_html_add(page, "<br>standard error of raw samples %.2g %% of the mean", 100.0 * error);
}

/* Irradiance if the light of all lamps were spread evenly over all surfaces; 0: unknown. */
static double level_of(const struct report *r)
{
    const double emitted = number(field(field(r->run, "energy"), "emitted")),
                 area = number(field(field(r->run, "points"), "geometry_area"));
    return emitted > 0.0 && area > 0.0 ? emitted / area : 0.0;
}

static int add_lightmap(struct report *r, const char *file, const char *name, const json_t *object,
                        struct kiln_error *error)
{
    static const char *const wanted[] = {"R", "G", "B"};
    struct kiln_html *page = &r->page;
    struct kiln_image *image = NULL, *small = NULL;
    uint8_t *bytes = NULL;
    char *png = NULL;
    size_t size = 0;
    int status = kiln_results_image(r->results, file, wanted, 3, &image, error);
    if (status == KILN_OK)
        status = shrink(image, &small, error);
    const struct kiln_exposure exposure =
        status == KILN_OK ? kiln_auto_exposure(small, level_of(r)) : kiln_plain_exposure;
    KILN_TRY(status);
    KILN_TRY(kiln_allocate(&bytes, (size_t)small->width * small->height * 3, 1, "a picture", error));
    KILN_TRY(
        kiln_tone_map(small, &(struct kiln_tone){KILN_TONE_REINHARD, exposure.scale, exposure.white}, bytes, error));
    KILN_TRY(kiln_png_encode(bytes, small->width, small->height, &png, &size, error));
    kiln_html_add(page, "<figure>");
    kiln_html_png(page, png, size, name);
    kiln_html_add(page, "<figcaption><b>");
    kiln_html_text(page, name);
    kiln_html_add(page, "</b><br>");
    add_caption(page, object, image);
    kiln_html_add(page, "</figcaption></figure>\n");
end:
    kiln_free(&png);
    kiln_free(&bytes);
    kiln_image_destroy(&small);
    kiln_image_destroy(&image);
    return status;
}

/* Whether a path in run.json stays within the folder. */
static bool stays_inside(const char *path) { return path[0] != '/' && strstr(path, "..") == NULL; }

static bool has_lightmaps(const struct report *r)
{
    const char *kind = json_string_value(field(field(r->run, "store"), "kind"));
    return kind == NULL || strcmp(kind, "lightmap") == 0;
}

static void add_lightmaps(struct report *r)
{
    const json_t *objects = field(r->run, "objects");
    const size_t count = json_array_size(objects);
    if (count == 0 || !has_lightmaps(r))
        return;
    kiln_html_add(&r->page, "<h2>Lightmaps</h2>\n");
    if (count > MOST_PICTURES)
        kiln_html_add(&r->page, "<p>The first %d of %zu; each with an exposure of its own.</p>\n", MOST_PICTURES,
                      count);
    else
        kiln_html_add(&r->page, "<p>Irradiance, each with an exposure of its own.</p>\n");
    for (size_t i = 0; i < count && i < MOST_PICTURES; i++) {
        const json_t *object = json_array_get(objects, i);
        const char *file = json_string_value(field(object, "lightmap")),
                   *name = json_string_value(field(object, "name"));
        struct kiln_error why = {{0}};
        if (file == NULL || !stays_inside(file))
            continue;
        /* the page shows the message of a lightmap that cannot be read */
        if (add_lightmap(r, file, name == NULL ? file : name, object, &why) != KILN_OK) {
            kiln_html_add(&r->page, "<p>");
            kiln_html_text(&r->page, why.message);
            kiln_html_add(&r->page, "</p>\n");
        }
    }
}

/* Adds viewpoint and exposure of the preview. */
static void add_viewpoint(struct report *r)
{
    const json_t *preview = field(r->run, "preview"), *viewpoint = field(preview, "viewpoint");
    const char *chosen = json_string_value(field(viewpoint, "chosen")),
               *camera = json_string_value(field(viewpoint, "camera"));
    if (chosen == NULL)
        return;
    kiln_html_add(&r->page, "<p>Seen ");
    if (camera != NULL) {
        kiln_html_add(&r->page, "by the scene's camera '");
        kiln_html_text(&r->page, camera);
        kiln_html_add(&r->page, "'");
    } else {
        kiln_html_add(&r->page, "from ");
        kiln_html_text(&r->page, chosen);
        kiln_html_add(&r->page, ", at ");
        add_value(&r->page, field(viewpoint, "from"));
    }
    kiln_html_add(&r->page, "; exposure %+.2f stops.",
                  number(field(field(preview, "exposure"), "automatic")) +
                      number(field(field(preview, "exposure"), "added")));
    if (number(field(preview, "metal_share")) > 0.0005)
        kiln_html_add(&r->page,
                      " Metals, %.1f %% of it, are shown by their base colour under the irradiance: approximate.",
                      100.0 * number(field(preview, "metal_share")));
    if (number(field(preview, "front_light_share")) > 0.0005)
        kiln_html_add(&r->page,
                      " Backs of double-sided surfaces, %.1f %% of it, show their fronts' light: approximate.",
                      100.0 * number(field(preview, "front_light_share")));
    kiln_html_add(&r->page, "</p>\n");
}

static void add_preview(struct report *r)
{
    char *png = NULL;
    size_t size = 0;
    if (kiln_results_bytes(r->results, "preview.png", 64u << 20, &png, &size, NULL) == KILN_OK) {
        kiln_html_add(&r->page, "<p>");
        kiln_html_png(&r->page, png, size, "preview");
        kiln_html_add(&r->page, "</p>\n");
        add_viewpoint(r);
    }
    kiln_free(&png);
}

/* ---- plots ---- */

struct series {
    double *values;
    const char **names;
    size_t count;
};

static bool open_series(struct report *r, struct series *s, size_t count)
{
    *s = (struct series){.count = count < MOST_BARS ? count : MOST_BARS};
    if (r->page.status == KILN_OK)
        r->page.status = kiln_allocate(&s->values, s->count, sizeof *s->values, "a plot", r->page.error);
    if (r->page.status == KILN_OK)
        r->page.status = kiln_allocate(&s->names, s->count, sizeof *s->names, "a plot", r->page.error);
    return r->page.status == KILN_OK;
}

static void close_series(struct series *s)
{
    kiln_free(&s->values);
    kiln_free(&s->names);
}

/* Says that a plot shows the first of many. */
static void add_left_out(struct report *r, const struct series *s, size_t count, const char *what)
{
    if (s->count < count)
        kiln_html_add(&r->page, "<p>The first %zu of %zu %s.</p>\n", s->count, count, what);
}

static void plot_phases(struct report *r)
{
    const json_t *phases = field(r->run, "phases");
    struct series s;
    if (json_array_size(phases) > 0 && open_series(r, &s, json_array_size(phases))) {
        for (size_t i = 0; i < s.count; i++) {
            const json_t *phase = json_array_get(phases, i), *seconds = field(phase, "seconds");
            const char *name = json_string_value(field(phase, "name"));
            s.names[i] = name == NULL ? "?" : name;
            s.values[i] = number(json_is_object(seconds) ? field(seconds, "max") : seconds);
        }
        kiln_html_add(&r->page, "<h2>Time of each phase</h2>\n<p>Seconds on the slowest rank.</p>\n");
        add_left_out(r, &s, json_array_size(phases), "phases");
        kiln_html_rows(&r->page, "s", s.values, s.names, s.count);
        close_series(&s);
    }
}

/* Plots the total seconds of each rank, from the per_rank lists of the phases. */
static void plot_ranks(struct report *r)
{
    const json_t *phases = field(r->run, "phases");
    size_t ranks = 0;
    struct series s;
    for (size_t i = 0; i < json_array_size(phases); i++) {
        const size_t here = json_array_size(field(json_array_get(phases, i), "per_rank"));
        ranks = here > ranks ? here : ranks;
    }
    if (ranks <= 1 || !open_series(r, &s, ranks)) /* with one rank there is no balance to show */
        return;
    for (size_t i = 0; i < json_array_size(phases) && i < MOST_BARS; i++) {
        const json_t *each = field(json_array_get(phases, i), "per_rank");
        const size_t listed = json_array_size(each);
        for (size_t rank = 0; rank < s.count && rank < listed; rank++) {
            const double seconds = number(json_array_get(each, rank));
            s.values[rank] += isfinite(seconds) ? seconds : 0.0;
        }
    }
    kiln_html_add(&r->page, "<h2>Balance of the ranks</h2>\n<p>Seconds of each rank in all phases.</p>\n");
    add_left_out(r, &s, ranks, "ranks");
    kiln_html_bars(&r->page, "s", s.values, NULL, s.count, 0, 0);
    close_series(&s);
    const json_t *points = field(field(r->run, "balance"), "points_per_rank");
    if (json_array_size(points) > 0 && open_series(r, &s, json_array_size(points))) {
        for (size_t i = 0; i < s.count; i++)
            s.values[i] = number(json_array_get(points, i));
        kiln_html_add(&r->page, "<p>Surface points of each rank.</p>\n");
        kiln_html_bars(&r->page, "points", s.values, NULL, s.count, 0, 0);
        close_series(&s);
    }
    add_object(&r->page, NULL, field(r->run, "balance"));
}

static void plot_bounces(struct report *r)
{
    const json_t *bounces = field(r->run, "bounces");
    const char *flux = json_string_value(field(field(r->run, "energy"), "units"));
    struct series s;
    char(*numbers)[24] = NULL;
    if (json_array_size(bounces) == 0 || !open_series(r, &s, json_array_size(bounces)))
        return;
    if (r->page.status == KILN_OK)
        r->page.status = kiln_allocate(&numbers, s.count, sizeof *numbers, "a plot", r->page.error);
    bool named = r->page.status == KILN_OK;
    for (size_t i = 0; named && i < s.count; i++) {
        const json_t *bounce = json_array_get(bounces, i);
        s.values[i] = number(field(bounce, "energy"));
        s.names[i] = json_string_value(field(bounce, "kind"));
        named = s.names[i] != NULL;
        if (named && strcmp(s.names[i], "bounce") == 0) {
            (void)snprintf(numbers[i], sizeof numbers[i], "%lld",
                           (long long)json_integer_value(field(bounce, "bounce")));
            s.names[i] = numbers[i];
        }
    }
    for (size_t i = 0; i < s.count; i++)
        s.values[i] = number(field(json_array_get(bounces, i), "energy"));
    kiln_html_add(&r->page, "<h2>Energy of each bounce</h2>\n<p>Power arriving at all surfaces, luminance; "
                            "logarithmic, six decades.</p>\n");
    kiln_html_bars(&r->page, flux == NULL ? "W" : flux, s.values, named ? s.names : NULL, s.count, 0, 1);
    kiln_free(&numbers);
    close_series(&s);
    add_object(&r->page, NULL, field(r->run, "energy"));
}

/* ---- the page ---- */

static void add_section(struct report *r, const char *title, const char *name)
{
    add_object(&r->page, title, field(r->run, name));
}

/* Adds the error reached, by figures in percent, where it is worst, and the option that would help most. */
static void add_reached(struct report *r)
{
    const json_t *error = field(r->run, "error"), *worst = field(error, "worst"), *improve = field(r->run, "improve");
    const double published = number(field(error, "published")), raw = number(field(error, "mean_relative"));
    const char *object = json_string_value(field(worst, "object")),
               *option = json_string_value(field(improve, "option")),
               *because = json_string_value(field(improve, "because"));
    if (published > 0.0)
        kiln_html_add(&r->page, "<p>95 %% of the texels are less than %.2g %% off (asked for: %.3g %%).",
                      100.0 * published, 100.0 * number(field(error, "asked")));
    else if (raw > 0.0)
        kiln_html_add(&r->page, "<p>Standard error of raw samples: %.2g %% of the mean.", 100.0 * raw);
    else
        return;
    if (published > 0.0 && object != NULL) {
        kiln_html_add(&r->page, " Worst is '");
        kiln_html_text(&r->page, object);
        kiln_html_add(&r->page, "', %.2g %%.", 100.0 * number(field(worst, "published")));
    }
    if (option != NULL && because != NULL) {
        kiln_html_add(&r->page, " What would improve it most: <code>");
        kiln_html_text(&r->page, option);
        kiln_html_add(&r->page, "</code> (");
        kiln_html_text(&r->page, because);
        kiln_html_add(&r->page, ").");
    }
    kiln_html_add(&r->page, "</p>\n");
}

/* Adds the section of errors: of raw samples only where no other is known. */
static void add_errors(struct report *r)
{
    static const char *const of_samples[] = {"rms_standard_error", "mean_relative", "standard_errors_are_of"};
    json_t *error = json_copy((json_t *)(uintptr_t)field(r->run, "error"));
    for (size_t i = 0; i < sizeof of_samples / sizeof *of_samples && field(error, "published") != NULL; i++)
        (void)json_object_del(error, of_samples[i]);
    add_object(&r->page, "Error reached", error);
    json_decref(error);
}

/* Adds the notes of the bake, before all figures. */
static void add_notes(struct report *r)
{
    const json_t *notes = field(r->run, "notes");
    for (size_t i = 0; i < json_array_size(notes); i++) {
        const char *note = json_string_value(json_array_get(notes, i));
        kiln_html_add(&r->page, "<p><b>Note:</b> ");
        kiln_html_text(&r->page, note == NULL ? "" : note);
        kiln_html_add(&r->page, "</p>\n");
    }
}

/* Columns of the table of objects. A column without information is left out. */
static const struct object_column {
    const char *name, *title;
    double scale;
} object_columns[] = {
    {"width", "width", 1.0},
    {"height", "height", 1.0},
    {"texels_per_metre", "texels/m", 1.0},
    {"valid", "gathered", 1.0},
    {"filled", "filled", 1.0},
    {"mean", "mean irradiance", 1.0},
    {"relative_error", "error of raw samples %", 100.0},
    {"vertex_error", "error at vertices %", 100.0},
    {"seam_before", "seams before %", 100.0},
    {"seam_after", "seams after %", 100.0},
};
enum { DENSITY = 2, OBJECT_COLUMNS = sizeof object_columns / sizeof *object_columns };

static void add_objects_row(struct report *r, const json_t *object, const bool shown[OBJECT_COLUMNS])
{
    const char *name = json_string_value(field(object, "name"));
    kiln_html_add(&r->page, "<tr><td>");
    kiln_html_text(&r->page, name == NULL ? "" : name);
    kiln_html_add(&r->page, "</td>");
    for (int c = 0; c < OBJECT_COLUMNS; c++) {
        const double value = number(field(object, object_columns[c].name));
        if (shown[c] && isfinite(value))
            kiln_html_add(&r->page, "<td class=n>%.6g</td>",
                          object_columns[c].scale *
                              (json_is_real(field(object, object_columns[c].name)) ? round(1e5 * value) / 1e5 : value));
        else if (shown[c])
            kiln_html_add(&r->page, "<td></td>");
    }
    kiln_html_add(&r->page, "</tr>\n");
}

static void add_objects_table(struct report *r)
{
    const json_t *objects = field(r->run, "objects");
    bool shown[OBJECT_COLUMNS] = {false}, seams = false;
    for (size_t i = 0; i < json_array_size(objects); i++)
        for (int c = 0; c < OBJECT_COLUMNS; c++)
            shown[c] = shown[c] || !says_nothing(field(json_array_get(objects, i), object_columns[c].name));
    for (int c = 0; c < OBJECT_COLUMNS; c++)
        seams = seams || (shown[c] && strncmp(object_columns[c].name, "seam", 4) == 0);
    if (json_array_size(objects) == 0)
        return;
    kiln_html_add(&r->page, "<h2>Objects</h2>\n%s<table><tr><th>name</th>",
                  seams ? "<p>Seams: root mean square of the difference across them, relative to the mean.</p>\n" : "");
    for (int c = 0; c < OBJECT_COLUMNS; c++)
        if (shown[c])
            kiln_html_add(&r->page, "<th class=n>%s</th>",
                          c == DENSITY && !has_lightmaps(r) ? "leaves/m" : object_columns[c].title);
    kiln_html_add(&r->page, "</tr>\n");
    for (size_t i = 0; i < json_array_size(objects); i++)
        add_objects_row(r, json_array_get(objects, i), shown);
    kiln_html_add(&r->page, "</table>\n");
}

/* Adds the top-level fields of run.json, except the notes, which come first. */
static void add_run(struct report *r)
{
    json_t *run = json_copy((json_t *)(uintptr_t)r->run);
    (void)json_object_del(run, "notes");
    add_object(&r->page, "Run", run);
    json_decref(run);
}

static void write_page(struct report *r)
{
    const json_t *scene = field(r->run, "scene");
    const char *title = json_string_value(json_is_object(scene) ? field(scene, "file") : scene);
    kiln_html_add(&r->page, "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>kiln: ");
    kiln_html_text(&r->page, title == NULL ? "bake" : title);
    kiln_html_add(&r->page,
                  "</title><meta name=\"generator\" content=\"" KILN_MADE_BY " " KILN_VERSION
                  "\"><style>%s</style></head><body>\n<h1>",
                  style);
    kiln_html_text(&r->page, title == NULL ? "bake" : title);
    kiln_html_add(&r->page, "</h1>\n");
    add_preview(r);
    add_reached(r);
    add_notes(r);
    add_lightmaps(r);
    add_objects_table(r);
    add_run(r);
    plot_phases(r);
    plot_ranks(r);
    plot_bounces(r);
    add_errors(r);
    add_section(r, "Rays", "rays");
    add_section(r, "Surface points", "points");
    add_section(r, "Store", has_lightmaps(r) ? "" : "store");
    add_section(r, "Memory", "memory");
    add_section(r, "Device", "backend");
    add_section(r, "Settings", "job");
    add_section(r, "Scene", "scene");
    add_section(r, "Units", "units");
    kiln_html_add(&r->page, "</body></html>\n");
}

int kiln_report_write(const char *directory, const char *path, struct kiln_error *error)
{
    json_t *run = NULL;
    struct kiln_results *results = NULL;
    int status;
    KILN_TRY(kiln_results_open(&results, directory, error));
    KILN_TRY(kiln_results_json(results, "run.json", &run, error));
    if (!json_is_object(run))
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "'%s/run.json' is not a report of a bake: it is not a JSON object",
                           directory));
    struct report report = {.results = results, .run = run, .page = {.error = error}};
    write_page(&report);
    KILN_TRY(kiln_html_publish(&report.page, path));
end:
    json_decref(run);
    kiln_results_close(&results);
    return status;
}
