/* kiln probe: prints the irradiance at a point, from the volume of a bake. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include <jansson.h>

#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/files/publish.h"
#include "coordinator/output/read/results.h"
#include "coordinator/field/units.h"

static const char *const axis_names[6] = {"+x", "-x", "+y", "-y", "+z", "-z"};

struct question {
    double position[3], normal[3];
    bool has_normal;
};

struct answer {
    struct kiln_volume_probe light;
    double irradiance[3]; /* about the normal */
    struct kiln_volume_place place;
};

static int read_number(const char *text, const char *what, double *number, struct kiln_error *error)
{
    char *end;
    *number = strtod(text, &end);
    if (end == text || *end != '\0' || !isfinite(*number))
        return kiln_fail(error, KILN_USAGE, "'%s' is not a number (%s of kiln probe DIR X Y Z [NX NY NZ])", text, what);
    return KILN_OK;
}

static int read_question(const struct kiln_job *job, struct question *q, struct kiln_error *error)
{
    static const char *const names[6] = {"X", "Y", "Z", "NX", "NY", "NZ"};
    double numbers[6] = {0};
    if (job->argument_count != 4 && job->argument_count != 7)
        return kiln_fail(error, KILN_USAGE,
                         "kiln probe needs DIR X Y Z, or DIR X Y Z NX NY NZ; %zu arguments were given",
                         job->argument_count);
    for (size_t i = 1; i < job->argument_count; i++) {
        const int status = read_number(job->arguments[i], names[i - 1], &numbers[i - 1], error);
        if (status != KILN_OK)
            return status;
    }
    q->has_normal = job->argument_count == 7;
    const double length = hypot(hypot(numbers[3], numbers[4]), numbers[5]);
    if (q->has_normal && !(length > 0.0))
        return kiln_fail(error, KILN_USAGE, "the normal (%s, %s, %s) has no length", job->arguments[4],
                         job->arguments[5], job->arguments[6]);
    for (int i = 0; i < 3; i++) {
        q->position[i] = numbers[i];
        q->normal[i] = q->has_normal ? numbers[3 + i] / length : 0.0;
    }
    return KILN_OK;
}

static int find_answer(struct kiln_results *results, const struct question *q, struct answer *a,
                       struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int descriptor;
    int status;
    KILN_TRY(kiln_results_file(results, "volume.hdf", &descriptor, path, error));
    KILN_TRY(
        kiln_reader_light(kiln_results_reader(results), descriptor, path, q->position, &a->light, &a->place, error));
    if (q->has_normal)
        kiln_volume_irradiance(&a->light, q->normal, a->irradiance);
end:
    if (descriptor >= 0)
        (void)close(descriptor);
    return status;
}

static json_t *rgb_json(const float rgb[3])
{
    return json_pack("[f, f, f]", (double)rgb[0], (double)rgb[1], (double)rgb[2]);
}

static int print_json(const struct question *q, const struct answer *a, const struct kiln_units *units,
                      struct kiln_error *error)
{
    json_t *root =
        json_pack("{s:s, s:s, s:[f,f,f], s:b, s:f, s:f, s:f}", "status", "done", "units", units->irradiance, "position",
                  q->position[0], q->position[1], q->position[2], "outside", a->place.outside, "validity",
                  (double)a->light.validity, "mean_distance", (double)a->light.mean_distance, "seen", a->place.seen);
    if (root != NULL && q->has_normal) {
        json_object_set_new(root, "normal", json_pack("[f, f, f]", q->normal[0], q->normal[1], q->normal[2]));
        json_object_set_new(root, "irradiance",
                            json_pack("[f, f, f]", a->irradiance[0], a->irradiance[1], a->irradiance[2]));
    }
    json_t *axes = json_object(), *harmonics = json_array();
    for (int i = 0; i < 6; i++)
        json_object_set_new(axes, axis_names[i], rgb_json(a->light.axes[i]));
    for (int i = 0; i < 9; i++)
        json_array_append_new(harmonics, rgb_json(a->light.harmonics[i]));
    json_object_set_new(root, "axes", axes);
    json_object_set_new(root, "harmonics", harmonics);
    return kiln_json_print(root, error);
}

static void print_text(const struct question *q, const struct answer *a, const struct kiln_units *units)
{
    if (q->has_normal) {
        (void)printf("irradiance %.6g %.6g %.6g %s\n", a->irradiance[0], a->irradiance[1], a->irradiance[2],
                     units->irradiance_text);
    } else {
        (void)printf("irradiance on faces along the axes, %s (R G B)\n", units->irradiance_text);
        for (int i = 0; i < 6; i++)
            (void)printf("  %s  %-12.6g %-12.6g %.6g\n", axis_names[i], (double)a->light.axes[i][0],
                         (double)a->light.axes[i][1], (double)a->light.axes[i][2]);
        (void)puts("harmonics of irradiance, E(n) = sum of c Y(n), in the order 00, 1-1, 10, 11, 2-2, 2-1, 20, 21, 22");
        for (int i = 0; i < 9; i++)
            (void)printf("  %d   %-12.6g %-12.6g %.6g\n", i, (double)a->light.harmonics[i][0],
                         (double)a->light.harmonics[i][1], (double)a->light.harmonics[i][2]);
    }
    (void)printf("validity %.3f, mean distance %.4g m\n", (double)a->light.validity, (double)a->light.mean_distance);
    if (a->place.outside)
        (void)puts("the point is outside the volume: this is the light at the nearest point inside");
    if (!(a->place.seen > 0.0))
        (void)puts(
            "no probe around the point sees it: this is the light of probes behind surfaces; bake with a smaller "
            "--probe-spacing");
}

int kiln_command_probe(struct kiln_job *job, struct kiln_error *error)
{
    struct question question = {{0}, {0}, false};
    struct answer answer = {.place = {0}};
    struct kiln_results *results = NULL;
    const struct kiln_units *units = NULL;
    int status;
    KILN_TRY(read_question(job, &question, error));
    KILN_TRY(kiln_results_open(&results, job->arguments[0], error));
    KILN_TRY(find_answer(results, &question, &answer, error));
    units = kiln_units_of_bake(results);
end:
    kiln_results_close(&results);
    if (status != KILN_OK)
        return status;
    if (job->json)
        return print_json(&question, &answer, units, error);
    if (!job->quiet)
        print_text(&question, &answer, units);
    return KILN_OK;
}
