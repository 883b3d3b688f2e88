#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/bench/tradeoff_private.h"
#include "coordinator/job/options.h"

enum { SAMPLES_MOST = 1 << 20 };

/* What is swept, in this order, so that a sweep that ends early has the presets and what is quick. */
static const char *const groups[] = {"presets", "denoise", "schedule", "density", "bounces", "samples", NULL};

static struct kiln_setting of_preset(const char *group, size_t preset)
{
    const struct kiln_quality *q = &kiln_qualities[preset];
    return (struct kiln_setting){.group = group,
                                 .quality = q->name,
                                 .direct = q->samples_direct,
                                 .bounce = q->samples_bounce,
                                 .indirect = q->samples_indirect,
                                 .bounces = -1,
                                 .density = 1.0,
                                 .raw = strcmp(q->name, "reference") == 0};
}

static void add_presets(struct kiln_sweep *sweep)
{
    for (size_t i = 0; i < kiln_quality_count; i++) {
        struct kiln_setting s = of_preset("presets", i);
        s.preset = true;
        (void)snprintf(s.name, sizeof s.name, "%s", s.quality);
        kiln_sweep_add(sweep, &s);
    }
}

/* The presets with one thing changed; `reference` takes too long to be tried in many ways. */
static void add_variants(struct kiln_sweep *sweep, const char *group)
{
    static const double densities[] = {0.7071, 0.5};
    static const int bounces[] = {1, 2, 4};
    for (size_t i = 0; i + 1 < kiln_quality_count; i++) {
        struct kiln_setting s = of_preset(group, i);
        if (strcmp(group, "denoise") == 0) {
            s.raw = true;
            (void)snprintf(s.name, sizeof s.name, "%s, not denoised", s.quality);
            kiln_sweep_add(sweep, &s);
        } else if (strcmp(group, "schedule") == 0) {
            s.equal = true;
            (void)snprintf(s.name, sizeof s.name, "%s, equal", s.quality);
            kiln_sweep_add(sweep, &s);
        } else if (strcmp(group, "density") == 0) {
            for (size_t d = 0; d < sizeof densities / sizeof *densities; d++) {
                s.density = densities[d];
                (void)snprintf(s.name, sizeof s.name, "%s, density %.2g", s.quality, s.density);
                kiln_sweep_add(sweep, &s);
            }
        } else if (i + 2 == kiln_quality_count) { /* where noise hides least what bounces leave out */
            for (size_t b = 0; b < sizeof bounces / sizeof *bounces; b++) {
                s.bounces = bounces[b];
                (void)snprintf(s.name, sizeof s.name, "%s, %d bounce%s", s.quality, s.bounces,
                               s.bounces == 1 ? "" : "s");
                kiln_sweep_add(sweep, &s);
            }
        }
    }
}

static bool is_preset(const struct kiln_setting *s)
{
    for (size_t i = 0; i < kiln_quality_count; i++)
        if (s->direct == kiln_qualities[i].samples_direct && s->bounce == kiln_qualities[i].samples_bounce &&
            s->indirect == kiln_qualities[i].samples_indirect)
            return true;
    return false;
}

double kiln_setting_rays(const struct kiln_setting *s)
{
    /* Bounces of the lean schedule have 3, 1.5, 1, 1/2, 1/2, 1/4 ... times the samples; a shadow ray is the cheaper
     * one. */
    const double many = s->bounces >= 0 && s->bounces < 8 ? s->bounces : 8.0, lean = fmin(3.0 + 0.6 * many, 7.0);
    return s->density * s->density *
           (0.5 * s->direct + (s->equal ? many * s->indirect : lean * s->bounce + (double)s->indirect));
}

/* All products of samples, the quickest first. */
static void add_samples(struct kiln_sweep *sweep)
{
    static const uint32_t directs[] = {16, 64, 256, 1024}, bounces[] = {4, 16, 64}, indirects[] = {32, 128, 512, 2048};
    const size_t first = sweep->count;
    for (size_t d = 0; d < 4; d++)
        for (size_t b = 0; b < 3; b++)
            for (size_t i = 0; i < 4; i++) {
                struct kiln_setting s = {.group = "samples",
                                         .direct = directs[d],
                                         .bounce = bounces[b],
                                         .indirect = indirects[i],
                                         .bounces = -1,
                                         .density = 1.0};
                (void)snprintf(s.name, sizeof s.name, "%u %u %u", s.direct, s.bounce, s.indirect);
                if (!is_preset(&s))
                    kiln_sweep_add(sweep, &s);
            }
    for (size_t i = first + 1; i < sweep->count; i++)
        for (size_t j = i;
             j > first && kiln_setting_rays(&sweep->settings[j]) < kiln_setting_rays(&sweep->settings[j - 1]); j--) {
            const struct kiln_setting s = sweep->settings[j];
            sweep->settings[j] = sweep->settings[j - 1];
            sweep->settings[j - 1] = s;
        }
}

/* Reads "DIRECT,BOUNCE,INDIRECT", such as 32,4,64. */
static bool read_samples(const char *text, struct kiln_setting *s)
{
    unsigned long values[3];
    for (int i = 0; i < 3; i++) {
        char *end = NULL;
        if (*text < '0' || *text > '9')
            return false;
        values[i] = strtoul(text, &end, 10);
        if (values[i] < 1 || values[i] > SAMPLES_MOST || *end != (i < 2 ? ',' : '\0'))
            return false;
        text = end + 1;
    }
    *s = (struct kiln_setting){.group = "given",
                               .direct = (uint32_t)values[0],
                               .bounce = (uint32_t)values[1],
                               .indirect = (uint32_t)values[2],
                               .bounces = -1,
                               .density = 1.0};
    (void)snprintf(s->name, sizeof s->name, "%u %u %u", s->direct, s->bounce, s->indirect);
    return true;
}

static void add_given(struct kiln_sweep *sweep)
{
    struct kiln_setting s;
    for (size_t i = 2; i < sweep->job->argument_count; i++)
        if (read_samples(sweep->job->arguments[i], &s))
            kiln_sweep_add(sweep, &s);
}

static bool is_named(const struct kiln_job *job, const char *group)
{
    for (size_t i = 2; i < job->argument_count; i++)
        if (strcmp(job->arguments[i], group) == 0)
            return true;
    return job->argument_count <= 2;
}

static int check_names(const struct kiln_job *job, struct kiln_error *error)
{
    char names[200] = "";
    for (size_t g = 0; groups[g] != NULL; g++) {
        const size_t used = strlen(names);
        (void)snprintf(names + used, sizeof names - used, "%s%s", g == 0 ? "" : ", ", groups[g]);
    }
    for (size_t i = 2; i < job->argument_count; i++) {
        struct kiln_setting given;
        bool known = read_samples(job->arguments[i], &given);
        for (size_t g = 0; groups[g] != NULL; g++)
            known = known || strcmp(groups[g], job->arguments[i]) == 0;
        if (!known)
            return kiln_fail(error, KILN_USAGE,
                             "kiln bench tradeoff sweeps no '%.100s'; it sweeps: %s, and samples given as "
                             "DIRECT,BOUNCE,INDIRECT, such as 32,4,64",
                             job->arguments[i], names);
    }
    return KILN_OK;
}

int kiln_settings_choose(struct kiln_sweep *sweep, struct kiln_error *error)
{
    const struct kiln_job *job = sweep->job;
    const int status = check_names(job, error);
    if (status == KILN_OK)
        add_given(sweep);
    for (size_t g = 0; status == KILN_OK && groups[g] != NULL; g++) {
        if (!is_named(job, groups[g]) || (strcmp(groups[g], "density") == 0 && job->lightmap_size != 0))
            continue;
        if (strcmp(groups[g], "presets") == 0)
            add_presets(sweep);
        else if (strcmp(groups[g], "samples") == 0)
            add_samples(sweep);
        else
            add_variants(sweep, groups[g]);
    }
    if (status == KILN_OK && sweep->count == KILN_SETTINGS_MOST)
        return kiln_fail(error, KILN_USAGE, "there are too many bakes in one sweep: give fewer samples");
    if (status == KILN_OK && sweep->count == 0)
        return kiln_fail(error, KILN_USAGE,
                         "density cannot be swept with --lightmap-size, which sets the size of every lightmap");
    return status;
}

void kiln_setting_options(const struct kiln_setting *s, double density, char text[KILN_SETTING_OPTIONS])
{
    size_t used = 0;
    if (s->preset)
        (void)snprintf(text, KILN_SETTING_OPTIONS, "--quality %s", s->quality);
    else
        (void)snprintf(text, KILN_SETTING_OPTIONS,
                       "--samples-direct %u --samples-bounce %u --samples-indirect %u --schedule %s --denoise %s",
                       s->direct, s->bounce, s->indirect, s->equal ? "equal" : "lean", s->raw ? "none" : "regression");
    used = strlen(text);
    if (s->bounces >= 0)
        (void)snprintf(text + used, KILN_SETTING_OPTIONS - used, " --bounces %d", s->bounces);
    used = strlen(text);
    if (s->density < 1.0)
        (void)snprintf(text + used, KILN_SETTING_OPTIONS - used, " --texels-per-metre %.9g", s->density * density);
}
