#include <stdio.h>

#include "coordinator/bake/bake_private.h"
#include "coordinator/bake/prepare/stages.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/text.h"

/* Puts the time of a phase that is over in the place of the reckoned one. */
static void put_measured(struct kiln_reckoned *reckoned, const struct kiln_phases *phases)
{
    for (size_t i = 0; i < phases->count; i++) {
        const enum kiln_reckon_phase phase = kiln_reckon_phase_of(phases->name[i]);
        if (phase <= KILN_RECKON_validity)
            kiln_reckon_put(reckoned, phase, phases->seconds[i]);
    }
}

static int reckon(struct kiln_bake *b, struct kiln_error *error)
{
    struct kiln_prepared *p = b->prepared;
    const struct kiln_backend_known known = {.threads = (uint64_t)p->choice.question.threads,
                                             .ranks = (uint32_t)p->ranks,
                                             .import = p->import_seconds,
                                             .points = (double)p->surface_report.points,
                                             .lights = p->lights};
    struct kiln_backend_choice now = {.asked = false};
    struct kiln_backend_info info;
    const int status = kiln_backend_ask(&now, b->job, p->scene, &known, error);
    kiln_backend_info(p->backend, &info);
    kiln_backend_predict(&now);
    p->expected = now.reckoned[info.on_device ? KILN_RECKON_VULKAN : KILN_RECKON_EMBREE];
    put_measured(&p->expected, &b->phases);
    return status;
}

/* Says what is expected, and for --backend auto what the other backend would take. */
static void say(const struct kiln_bake *b)
{
    const struct kiln_prepared *p = b->prepared;
    const struct kiln_backend_choice *c = &p->choice;
    struct kiln_backend_info info;
    char all[48], light[48], other[48], tail[120] = "";
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
    kiln_print(stderr, "kiln: about %s expected on %s, %s of it light%s\n",
               kiln_duration_text(p->expected.total, all, sizeof all), info.on_device ? "the GPU" : "the processors",
               kiln_duration_text(kiln_reckon_light(&p->expected), light, sizeof light), tail);
}

/* Announces the stages again, now that more is known. */
static void expect_stages(struct kiln_bake *b)
{
    struct kiln_stage stages[KILN_STAGES_MAX];
    kiln_progress_expect(b->progress, stages, kiln_stages_make(b->job, &b->prepared->expected, stages));
}

int kiln_bake_expect(struct kiln_bake *b, struct kiln_error *error)
{
    const int status = b->rank == 0 ? reckon(b, error) : KILN_OK;
    if (status == KILN_OK && b->rank == 0)
        expect_stages(b);
    if (status == KILN_OK && b->rank == 0 && !b->job->quiet)
        say(b);
    return kiln_agree(b->communicator, status, error);
}
