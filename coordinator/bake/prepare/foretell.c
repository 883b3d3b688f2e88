#include "coordinator/bake/prepare/foretell.h"

#include "coordinator/integrate/parts/light_trial.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

/* Triangles up to which light is tried: a BVH of more takes longer, and more memory beside the bake's own, than to know
 * the number of rounds before the first is worth. */
enum { TRIANGLES_MOST = 1 << 20 };

/* Embree over the surface of the bake, apart from the backend that the bake counts its passes by. */
static int build(struct kiln_backend **backend, const struct kiln_prepared *p, uint64_t seed, struct kiln_error *error)
{
    const struct kiln_backend_params params = {.scene = p->scene,
                                               .geometry = p->geometry,
                                               .lights = p->lights,
                                               .direct_lights = p->direct_lights,
                                               .threads = p->threads,
                                               .instruction_set = p->instruction_set,
                                               .seed = seed};
    const int status = kiln_backend_create(backend, "embree", &params, error);
    return status == KILN_OK ? kiln_backend_set_surface(*backend, p->surface, error) : status;
}

int kiln_prepare_try(const struct kiln_prepared *p, const struct kiln_integrate_settings *settings,
                     struct kiln_tried_light *tried, struct kiln_error *error)
{
    struct kiln_backend *backend = NULL;
    *tried = (struct kiln_tried_light){.tiles = NULL};
    if (!(settings->published_error > 0.0) || p->surface->point_count == 0 ||
        p->geometry->triangle_count > TRIANGLES_MOST)
        return KILN_OK;
    int status = kiln_agree(p->communicator, build(&backend, p, settings->seed, error), error);
    if (status == KILN_OK) {
        const struct kiln_light_trial_params params = {
            .communicator = p->communicator, .settings = settings, .backend = backend, .surface = p->surface};
        status = kiln_light_trial_run(&params, &tried->tiles, &tried->count, error);
    }
    kiln_backend_destroy(&backend);
    return status;
}

int kiln_prepare_foretell(const struct kiln_tried_light *tried, const struct kiln_integrate_settings *settings,
                          bool denoises, double most, struct kiln_foretold *foretold, struct kiln_error *error)
{
    const struct kiln_foretell_from from = {.settings = settings, .denoises = denoises, .most = most - 1.0};
    *foretold = (struct kiln_foretold){.tried = 0};
    if (tried->count == 0)
        return KILN_OK;
    const int status = kiln_rounds_foretell(&from, tried->tiles, tried->count, foretold, error);
    foretold->rounds += 1;
    foretold->samples += 1.0;
    return status;
}

void kiln_prepare_forget(struct kiln_tried_light *tried)
{
    kiln_free(&tried->tiles);
    tried->count = 0;
}
