#include "coordinator/bake/report/reached.h"

#include <math.h>
#include <string.h>

#include "coordinator/integrate/quantity.h"
#include "coordinator/run/progress.h"
#include "worker/base/text.h"

#define FINER 0.5  /* of the error reached: what a finer target asks for */
#define LEAST 1e-3 /* finest target that is advised */

static double number_of(const json_t *object, const char *key)
{
    return json_number_value(json_object_get(object, key));
}

static bool has(const json_t *object, const char *key) { return json_object_get(object, key) != NULL; }

static bool is_denoised(const json_t *report)
{
    const char *method = json_string_value(json_object_get(json_object_get(report, "denoise"), "method"));
    return method == NULL || strcmp(method, "none") != 0;
}

/* Seconds of the phases that more samples would make longer. */
static double light_seconds(const json_t *report)
{
    double sum = 0.0;
    size_t index;
    const json_t *phase;
    json_array_foreach(json_object_get(report, "phases"), index, phase)
    {
        const char *name = json_string_value(json_object_get(phase, "name"));
        if (name != NULL && (kiln_is_phase_of_steps(name) || strcmp(name, "light paths") == 0))
            sum += number_of(json_object_get(phase, "seconds"), "max");
    }
    return sum;
}

static double whole_seconds(const json_t *report)
{
    return number_of(report, "seconds") + number_of(report, "seconds_before");
}

/* Two significant digits, rounded down. */
static double rounded(double value)
{
    const double unit = pow(10.0, floor(log10(value)) - 1.0);
    return floor(value / unit + 1e-9) * unit;
}

static json_t *advice(const char *option, const char *because)
{
    return json_pack("{s:s, s:s}", "option", option, "because", because);
}

/* ---- the options, each NULL if it would not help ---- */

static bool is_store(const json_t *report, const char *kind)
{
    const char *own = json_string_value(json_object_get(json_object_get(report, "store"), "kind"));
    return own != NULL && strcmp(own, kind) == 0;
}

static json_t *denoising(const json_t *report)
{
    return is_denoised(report) || !is_store(report, "lightmap")
               ? NULL
               : advice("--denoise auto", "the lightmaps have all the noise of their samples");
}

/* The object whose mean light finer texels would change most. */
static const json_t *coarsest(const json_t *report)
{
    return json_array_get(json_object_get(json_object_get(report, "density"), "objects"), 0);
}

/* Writes the option for texels of half the size. */
static void twice_the_density(const json_t *report, char *option, size_t room)
{
    const double density = number_of(json_object_get(report, "scene"), "texels_per_metre");
    (void)snprintf(option, room, density > 0.0 ? "--texels-per-metre %.3g" : "--texels-per-metre", 2.0 * density);
}

static json_t *finer_texels(const json_t *report)
{
    const json_t *object = coarsest(report), *error = json_object_get(report, "error");
    const double moves = number_of(object, "moves_at_double_density"), lost = number_of(error, "texels_lose"),
                 published = number_of(error, "published");
    char option[64], name[96], because[KILN_REACHED_TEXT];
    twice_the_density(report, option, sizeof option);
    if (object != NULL && (!has(error, "published") || moves >= published)) {
        kiln_text_plain(name, sizeof name, json_string_value(json_object_get(object, "name")));
        (void)snprintf(because, sizeof because,
                       "texels twice as fine would change the light of '%s' by about %.2g %%, %s", name, 100.0 * moves,
                       has(error, "published") ? "more than its noise" : "whatever the samples");
        return advice(option, because);
    }
    if (!has(error, "published") || !(lost > published))
        return NULL;
    (void)snprintf(because, sizeof because, "texels lose %.2g %%, more than the noise; half as wide about half of that",
                   100.0 * lost);
    return advice(option, because);
}

/* The options for more light: `error` is what was reached, `wanted` what is wanted. */
static json_t *more_light(const json_t *report, double error, double wanted, bool late)
{
    const double more = light_seconds(report) * ((error * error) / (wanted * wanted) - 1.0),
                 asked = number_of(json_object_get(report, "error"), "asked");
    char option[64], because[KILN_REACHED_TEXT], time[48];
    (void)kiln_duration_text(whole_seconds(report) + more, time, sizeof time);
    if (late)
        (void)snprintf(option, sizeof option, "--time %.0f", ceil(whole_seconds(report) + more));
    else
        (void)snprintf(option, sizeof option, "--quality %.2g%%", 100.0 * wanted);
    (void)snprintf(because, sizeof because, "%s, in about %s",
                   late && !(wanted > asked) ? "it would reach what was asked for" : "half the noise", time);
    return advice(option, because);
}

static json_t *of_published(const json_t *report)
{
    const json_t *error = json_object_get(report, "error");
    const double asked = number_of(error, "asked"), reached = number_of(error, "published");
    if (json_is_true(json_object_get(error, "out_of_time")) && reached > asked)
        return more_light(report, reached, fmax(asked, FINER * reached), true);
    if (reached > asked)
        return has(json_object_get(report, "job"), "guide")
                   ? NULL
                   : advice("--guide auto", "texels that light reaches by rare ways have had the most samples that a "
                                            "texel gets, and guided samples find such ways");
    const double finer = rounded(FINER * reached);
    return finer >= LEAST ? more_light(report, reached, finer, false) : NULL;
}

json_t *kiln_best_option(const json_t *report)
{
    const json_t *error = json_object_get(report, "error");
    if (!(number_of(error, "mean_irradiance") > 0.0))
        return NULL;
    json_t *best = denoising(report);
    if (best == NULL)
        best = finer_texels(report);
    if (best != NULL || has(error, "published"))
        return best != NULL ? best : of_published(report);
    const char *method = json_string_value(json_object_get(json_object_get(report, "job"), "method"));
    if (has(error, "target") || !is_store(report, "lightmap") || method == NULL || strcmp(method, "cells") != 0 ||
        has(report, "visible_from"))
        return NULL;
    return advice("--quality 8%", "it says what error the published light has, and goes on until that is reached");
}

/* ---- printing ---- */

static void print_published(FILE *stream, const json_t *error)
{
    const json_t *worst = json_object_get(error, "worst");
    const double rounds = number_of(error, "rounds");
    const char *repeat = json_string_value(json_object_get(error, "repeat"));
    char name[96], asked[48] = "time was over";
    if (!json_is_true(json_object_get(error, "out_of_time")))
        (void)snprintf(asked, sizeof asked, "asked: %.3g %%", 100.0 * number_of(error, "asked"));
    (void)fprintf(stream, "error        %.2g %%: 95 %% of the texels are less than that off (%s; %.0f round%s%s)\n",
                  100.0 * number_of(error, "published"), asked, rounds, rounds > 1.0 ? "s" : "",
                  json_is_true(json_object_get(error, "most_samples")) ? ", the last by the most samples of a texel"
                                                                       : "");
    if (has(error, "texels_lose"))
        (void)fprintf(stream,
                      "texels       lose about %.2g %% of light that changes between them, whatever the samples\n",
                      100.0 * number_of(error, "texels_lose"));
    if (repeat != NULL)
        kiln_print(stream, "the same     %s in the place of --time: bit for bit, whatever the clock\n", repeat);
    if (worst == NULL)
        return;
    kiln_text_plain(name, sizeof name, json_string_value(json_object_get(worst, "object")));
    (void)fprintf(stream, "worst in     '%s', %.2g %%\n", name, 100.0 * number_of(worst, "published"));
}

static void print_target(FILE *stream, const json_t *error)
{
    const double rounds = number_of(error, "rounds");
    (void)fprintf(stream, "error        above %.3g %% in raw samples where %.2f %% of the surface points lie",
                  100.0 * number_of(error, "target"), 100.0 * number_of(error, "above_target"));
    if (has(error, "rounds"))
        (void)fprintf(stream, "; %.0f round%s", rounds, rounds > 1.0 ? "s" : "");
    (void)fputc('\n', stream);
}

void kiln_reached_print(FILE *stream, const json_t *report)
{
    const json_t *error = json_object_get(report, "error"), *improve = json_object_get(report, "improve");
    if (has(error, "published"))
        print_published(stream, error);
    else if (has(error, "target"))
        print_target(stream, error);
    else if (number_of(error, "mean_irradiance") > 0.0)
        (void)fprintf(stream, "error        %.2g %% of the mean in raw samples%s\n",
                      100.0 * number_of(error, "mean_relative"),
                      is_denoised(report) ? "; less in the lightmaps, which are denoised" : "");
    if (improve != NULL)
        kiln_print(stream, "improve it   %s: %s\n", json_string_value(json_object_get(improve, "option")),
                   json_string_value(json_object_get(improve, "because")));
}
