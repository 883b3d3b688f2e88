#include "coordinator/bench/tradeoff.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/tradeoff_private.h"

static void options(const struct kiln_sweep *sweep, const struct kiln_setting *s, char text[KILN_SETTING_OPTIONS])
{
    kiln_setting_options(s, sweep->density, text);
}

static void key(const struct kiln_setting *s, char text[KILN_SETTING_OPTIONS])
{
    kiln_setting_options(s, 1.0, text);
    const size_t used = strlen(text);
    (void)snprintf(text + used, KILN_SETTING_OPTIONS - used, " (%u %u %u, density %.6g)", s->direct, s->bounce,
                   s->indirect, s->density);
}

/* Of many samples, and another seed. */
static void push_reference(const struct kiln_sweep *sweep, struct kiln_child *child)
{
    const double samples = sweep->job->reference_samples;
    if (!sweep->job->quiet)
        (void)fprintf(stderr, "kiln: baking the reference, with %.0f rays in the final gather\n", samples);
    kiln_child_push_number(child, "--samples-direct", "%.0f", fmax(1.0, samples / 4.0));
    kiln_child_push_number(child, "--samples-bounce", "%.0f", fmax(1.0, samples / 64.0));
    kiln_child_push_number(child, "--samples-indirect", "%.0f", samples);
    kiln_child_push_number(child, "--seed", "%.0f", (double)(sweep->job->seed + 1));
    kiln_child_push(child, "--denoise");
    kiln_child_push(child, "none");
    kiln_child_push(child, "--error-map");
}

static void add_csv(const struct kiln_sweep *sweep, struct kiln_html *page)
{
    char text[KILN_SETTING_OPTIONS];
    kiln_html_add(
        page, "group,name,options,samples_direct,samples_bounce,samples_indirect,bounces,schedule,denoised,"
              "texels_per_metre,points,rays,nrmse,nrmse_direct,nrmse_indirect,seconds,light_seconds,processor_seconds,"
              "peak_bytes,front\n");
    for (size_t i = 0; i < sweep->count; i++) {
        const struct kiln_setting *s = &sweep->settings[i];
        const struct kiln_setting_result *r = &sweep->results[i];
        if (!r->done)
            continue;
        options(sweep, s, text);
        kiln_html_add(page, "%s,\"%s\",%s,%u,%u,%u,", s->group, s->name, text, s->direct, s->bounce, s->indirect);
        if (s->bounces < 0)
            kiln_html_add(page, "all");
        else
            kiln_html_add(page, "%d", s->bounces);
        kiln_html_add(page, ",%s,%s,%.9g,%.0f,%.0f,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.0f,%s\n",
                      s->equal ? "equal" : "lean", s->raw ? "no" : "yes", r->texels_per_metre, r->points, r->rays,
                      r->error[0], r->error[1], r->error[2], r->seconds, r->light_seconds, r->processor_seconds,
                      r->bytes, r->front ? "yes" : "no");
    }
}

int kiln_tradeoff_bench(struct kiln_job *job, struct kiln_error *error)
{
    static const char *const refused[] = {
        "quality", "samples-direct", "samples-bounce", "samples-indirect", "samples-probe",
        "bounces", "tail",           "schedule",       "verify-fraction",  NULL};
    static const struct kiln_sweep_kind kind = {.name = "tradeoff",
                                                .suffix = "-tradeoff",
                                                .refused = refused,
                                                .choose = kiln_settings_choose,
                                                .options = options,
                                                .key = key,
                                                .push_reference = push_reference,
                                                .rays = kiln_setting_rays,
                                                .judge = kiln_front_mark,
                                                .csv = add_csv,
                                                .plot = kiln_tradeoff_plot,
                                                .list = kiln_tradeoff_list,
                                                .tell = kiln_tradeoff_tell};
    return kiln_sweep_run(&kind, job, error);
}
