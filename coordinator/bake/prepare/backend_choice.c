#include "coordinator/bake/prepare/backend_choice.h"

#include "coordinator/bake/prepare/materials.h"
#include "coordinator/bake/reckon/kernels_kept.h"
#include "coordinator/bake/settings/light_settings.h"

int kiln_backend_ask(struct kiln_backend_choice *choice, const struct kiln_job *job, const struct kiln_scene *scene,
                     const struct kiln_backend_known *known, struct kiln_error *error)
{
    static const struct kiln_lights none = {0};
    struct kiln_job settled = *job; /* borrows all strings */
    struct kiln_reckon_question *q = &choice->question;
    const double points = known->points > 0.0 ? known->points : kiln_work_points(scene, job->lightmaps.both_sides);
    kiln_materials_settle(&settled, scene);
    const struct kiln_integrate_settings settings =
        kiln_light_settings(&settled, known->lights != NULL ? known->lights : &none, (uint64_t)points);
    *q = (struct kiln_reckon_question){.threads = known->threads > 0 ? (double)known->threads : 1.0,
                                       .ranks = known->ranks > 0 ? known->ranks : 1.0,
                                       .import = known->import,
                                       .kernels = kiln_kernels_missing(&settled, &settings, scene)};
    return kiln_work_count(&q->work, &settled, &settings, scene, points, known->foretold, error);
}

void kiln_backend_predict(struct kiln_backend_choice *choice)
{
    for (int b = 0; b < KILN_RECKON_BACKENDS; b++)
        choice->reckoned[b] = kiln_reckon_bake(&choice->question, (enum kiln_reckon_backend)b);
    choice->processors = choice->reckoned[KILN_RECKON_EMBREE].total < choice->reckoned[KILN_RECKON_VULKAN].total;
}

double kiln_backend_rays(const struct kiln_backend_choice *choice)
{
    const struct kiln_work *w = &choice->question.work;
    double rays = w->probe_samples + w->pairs + w->shared + w->paths;
    for (int k = 0; k < KILN_WORK_KINDS; k++)
        rays += w->light[k].samples;
    return rays;
}
