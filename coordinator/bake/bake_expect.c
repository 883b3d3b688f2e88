#include <math.h>
#include <stdio.h>

#include "coordinator/bake/bake_private.h"
#include "coordinator/bake/prepare/foretell.h"
#include "coordinator/bake/prepare/stages.h"
#include "coordinator/bake/settings/light_settings.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/text.h"

#define SAID_LEAST 5.0 /* s of a bake, from which on it is worth to say again what it takes */
#define SAID_MORE 1.3  /* factor that is worth it */

/* Puts the time of a phase that is over in the place of the reckoned one. */
static void put_measured(struct kiln_reckoned *reckoned, const struct kiln_phases *phases)
{
    for (size_t i = 0; i < phases->count; i++) {
        const enum kiln_reckon_phase phase = kiln_reckon_phase_of(phases->name[i]);
        if (phase <= KILN_RECKON_validity)
            kiln_reckon_put(reckoned, phase, phases->seconds[i]);
    }
}

/* Reckons with the rounds that are foretold. */
static int reckon(struct kiln_bake *b, struct kiln_error *error)
{
    struct kiln_prepared *p = b->prepared;
    const struct kiln_backend_known known = {.threads = (uint64_t)p->choice.question.threads,
                                             .ranks = (uint32_t)p->ranks,
                                             .import = p->import_seconds,
                                             .points = (double)p->surface_report.points,
                                             .lights = p->lights,
                                             .foretold = &b->prepared->foretold};
    struct kiln_backend_choice now = {.asked = false};
    struct kiln_backend_info info;
    const int status = kiln_backend_ask(&now, b->job, p->scene, &known, error);
    kiln_backend_info(p->backend, &info);
    kiln_backend_predict(&now);
    p->expected = now.reckoned[info.on_device ? KILN_RECKON_VULKAN : KILN_RECKON_EMBREE];
    put_measured(&p->expected, &b->phases);
    return status;
}

/* Samples of all rounds over those of the first that --time has room for; INFINITY: any. */
static double room_for(const struct kiln_bake *b)
{
    const double *seconds = b->prepared->expected.seconds,
                 rounds = seconds[KILN_RECKON_direct] + seconds[KILN_RECKON_final],
                 room = b->job->light.time - (b->prepared->expected.total - rounds);
    return !(b->job->light.time > 0.0) || !(rounds > 0.0) ? INFINITY
                                                          : fmax(b->prepared->foretold.samples * room / rounds, 1.0);
}

/* Rank 0. Foretells the rounds by what was tried, and reckons. */
static int foretell(struct kiln_bake *b, const struct kiln_integrate_settings *settings,
                    const struct kiln_tried_light *tried, struct kiln_error *error)
{
    const bool denoises = kiln_job_denoises(b->job);
    int status;
    KILN_TRY(kiln_prepare_foretell(tried, settings, denoises, INFINITY, &b->prepared->foretold, error));
    KILN_TRY(reckon(b, error));
    if (b->prepared->foretold.tried == 0 || !(b->job->light.time > 0.0))
        return KILN_OK;
    KILN_TRY(kiln_prepare_foretell(tried, settings, denoises, room_for(b), &b->prepared->foretold, error));
    KILN_TRY(reckon(b, error));
end:
    return status;
}

/* The error that a trial lets expect, to be said behind the time. */
static const char *error_text(const struct kiln_bake *b, char *text, size_t size)
{
    const struct kiln_foretold *f = &b->prepared->foretold;
    text[0] = '\0';
    if (f->tried > 0 && f->limited)
        (void)snprintf(text, size, "; by a trial the error ends at %.2g %%, with the most samples that a texel gets",
                       100.0 * f->error);
    else if (f->tried > 0)
        (void)snprintf(text, size, "; by a trial an error of %.2g %% after %u round%s",
                       100.0 * fmax(f->error, b->job->light.time > 0.0 ? 0.0 : b->job->light.published_error),
                       f->rounds, f->rounds > 1 ? "s" : "");
    return text;
}

/* Says what is expected, and for --backend auto what the other backend would take. */
static void say(const struct kiln_bake *b)
{
    const struct kiln_prepared *p = b->prepared;
    const struct kiln_backend_choice *c = &p->choice;
    struct kiln_backend_info info;
    char all[48], light[48], other[48], found[120], tail[120] = "";
    kiln_backend_info(p->backend, &info);
    if (c->asked && info.on_device != c->processors) /* as it was chosen */
        (void)snprintf(tail, sizeof tail, "; %s, %s",
                       info.on_device ? "--backend embree on the processors" : "--backend vulkan with a GPU",
                       kiln_duration_text(c->reckoned[info.on_device ? KILN_RECKON_EMBREE : KILN_RECKON_VULKAN].total,
                                          other, sizeof other));
    if (b->job->light.counted_for != NULL)
        kiln_print(stderr,
                   "kiln: note: --%s leaves no error to ask for: the light has %u, %u and %u samples (direct, bounce, "
                   "indirect)\n",
                   b->job->light.counted_for, b->job->light.samples_direct, b->job->light.samples_bounce,
                   b->job->light.samples_indirect);
    kiln_print(stderr, "kiln: about %s expected on %s, %s of it light%s%s\n",
               kiln_duration_text(p->expected.total, all, sizeof all), info.on_device ? "the GPU" : "the processors",
               kiln_duration_text(kiln_reckon_light(&p->expected), light, sizeof light),
               error_text(b, found, sizeof found), tail);
}

/* Announces the stages again, now that more is known. */
static void expect_stages(struct kiln_bake *b)
{
    struct kiln_stage stages[KILN_STAGES_MAX];
    kiln_progress_expect(b->progress, stages, kiln_stages_make(b->job, &b->prepared->expected, stages));
}

int kiln_bake_expect(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_prepared *p = b->prepared;
    const struct kiln_integrate_settings settings = kiln_light_settings(b->job, p->lights, p->surface->point_count);
    struct kiln_tried_light tried;
    int status = kiln_prepare_try(p, &settings, &tried, error);
    if (status == KILN_OK) {
        status = b->rank == 0 ? foretell(b, &settings, &tried, error) : KILN_OK;
        if (status == KILN_OK && b->rank == 0)
            expect_stages(b);
        if (status == KILN_OK && b->rank == 0 && !b->job->quiet)
            say(b);
        status = kiln_agree(b->communicator, status, error);
    }
    kiln_prepare_forget(&tried);
    return status;
}

/* Seconds of the rounds that are foretold after the first, which the reports are of. Caustics have few of them. */
static double seconds_of_rounds(const struct kiln_step_reports *steps)
{
    const struct kiln_step_report *last = &steps->of[steps->count - 1];
    const struct kiln_foretold *foretold = &last->foretold;
    const double caustics =
        kiln_caustics_found(steps).left_out ? 0.0 : kiln_work_caustics(1.0 + foretold->samples) - 1.0;
    double seconds = foretold->rounds * last->judging_seconds;
    for (size_t i = 0; i < steps->count; i++) {
        const struct kiln_step *step = &steps->of[i].step;
        const double more = kiln_step_has(step, KILN_WITH(landing)) ? caustics
                            : step->bounce > 0 && !step->terminal   ? 0.0
                                                                    : foretold->samples;
        seconds += more * (steps->of[i].seconds + steps->of[i].exchange_seconds);
    }
    return seconds;
}

void kiln_bake_expect_again(void *bake, const struct kiln_step_reports *steps)
{
    struct kiln_bake *b = bake;
    const struct kiln_foretold *foretold = &steps->of[steps->count - 1].foretold;
    const double before = b->prepared->expected.total,
                 left = seconds_of_rounds(steps) + kiln_reckon_after(&b->prepared->expected);
    char text[48];
    b->prepared->expected_then = MPI_Wtime() - b->begin + left;
    if (b->job->quiet || b->job->light.time > 0.0 || fmax(before, b->prepared->expected_then) < SAID_LEAST ||
        (b->prepared->expected_then < SAID_MORE * before && before < SAID_MORE * b->prepared->expected_then))
        return;
    kiln_print(stderr, "kiln: about %s are left, as the first round tells: %u more to an error of %.2g %%%s\n",
               kiln_duration_text(left, text, sizeof text), foretold->rounds,
               100.0 * fmax(foretold->error, b->job->light.published_error),
               foretold->limited ? ", the least with the samples that a texel gets" : "");
}
