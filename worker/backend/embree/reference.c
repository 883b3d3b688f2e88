/* The reference pass (worker/pass/reference.h): rays over the hemisphere that paths continue. */
#include <math.h>
#include <string.h>

#include "worker/backend/embree/hemisphere.h"
#include "worker/backend/embree/path.h"
#include "worker/backend/embree/reference_paths.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"

_Static_assert(offsetof(struct kiln_reference_result, point) == 0, "what hemisphere_store writes");

/* A thread's working set. */
struct reference_work {
    struct hemisphere h;
    const struct kiln_reference_parameters *parameters;
    struct reference_paths *paths; /* of bdpt and vcm */
    struct subpaths subpaths;
    bool receives_only;        /* no ray meets the tile run's object */
    double last[RAY_LANES][3]; /* of each point's incident light: the part with the largest number of bounces */
};

static void reference_destroy(void **work)
{
    struct reference_work *w = *work;
    if (w != NULL) {
        hemisphere_release(&w->h);
        subpaths_release(&w->subpaths);
    }
    kiln_free(work);
}

static int reference_create(void **work, const struct embree_backend *b, const void *parameters,
                            const struct kiln_batch *part, struct kiln_error *error)
{
    struct reference_work *w = NULL;
    int status = kiln_allocate(&w, 1, sizeof *w, "the reference pass", error);
    *work = w;
    if (status != KILN_OK)
        return status;
    w->parameters = parameters;
    w->paths = b->reference;
    status = hemisphere_create(&w->h, b, part, KILN_REFERENCE_STREAM + part->stream, error);
    if (status == KILN_OK)
        status = hemisphere_ask_lights(&w->h, error);
    if (status != KILN_OK)
        reference_destroy(work);
    return status;
}

/* Returns the weight as incident light of what lane l's ray finds. */
static float incident_weight(const struct reference_work *w, uint32_t l)
{
    const struct tile_run_rays *r = w->h.rays;
    const uint32_t j = r->point[l];
    const struct kiln_vec3 shading = frame_shading(&r->frame, j, vec3(r->facet[0][l], r->facet[1][l], r->facet[2][l]));
    const float cosine = r->frame.smooth ? vec3_dot(shading, rays_direction(r, l)) : r->cosine[l];
    return hemisphere_weight(r, l) * frame_taken_up(&r->frame, j, cosine);
}

/* Counts how lane l's ray ends at a surface, following its chain up to the diffuse parts that it finds. */
static void count_ends(struct reference_work *w, const struct embree_backend *b, uint32_t step, uint32_t l, bool tints)
{
    struct kiln_light_choice *choices = w->h.walk.choices;
    if (!chain_begins_at(b, w->h.rays, l))
        return;
    w->h.walk.choices = NULL; /* lights are not asked for */
    hemisphere_follow(&w->h, step, l, false);
    w->h.walk.choices = choices;
    hemisphere_count_chain(&w->h, l, tints);
}

/* Finds the light of lane l's sample, by its ray and by connections. `ray`: its hit; NULL: no hit to continue from. */
static void find_paths(struct reference_work *w, uint32_t step, uint32_t l, const struct RTCRayHit *ray,
                       struct reference_found *found)
{
    const struct tile_run_rays *r = w->h.rays;
    if (w->parameters->method != KILN_REFERENCE_PATH) {
        reference_follow(&w->subpaths, w->paths, r, step, l, w->receives_only, ray, found);
        return;
    }
    memset(found, 0, sizeof *found);
    if (ray != NULL)
        path_follow(&w->h.walk, kiln_chain_key(r->chance[l]), rays_sample(r, step, l), w->parameters->bounces, ray,
                    found->radiance, found->last);
}

static void add_paths(struct reference_work *w, uint32_t step, uint32_t l, const struct reference_found *found,
                      bool tints)
{
    const struct tile_run_rays *r = w->h.rays;
    const uint32_t j = r->point[l];
    float rgb[3], luminance;
    for (int c = 0; c < 3; c++) {
        const float last = incident_weight(w, l) * found->last[c] * (float)KILN_PI * (tints ? r->tint[l][c] : 1.0f);
        rgb[c] = found->radiance[c] * (float)KILN_PI;
        w->last[j][c] += (double)last + found->last_incident[c];
        w->h.irradiance[j][c] += found->irradiance[c];
        w->h.incident[j][c] += found->incident[c];
    }
    (void)hemisphere_add(&w->h, l, rays_quarter(r, step, l), rgb, tints, &luminance);
    w->h.quarter[rays_quarter(r, step, l)][j] += kiln_luminance(found->irradiance);
}

/* As collect_lanes: adds the light of paths, lane by lane. */
static void collect_paths(const struct embree_backend *b, struct embree_context *context, struct reference_work *w,
                          uint32_t step, uint32_t lanes)
{
    const bool tints = embree_tints(b);
    w->h.walk.context = context;
    memset(w->h.lost, 0, sizeof w->h.lost);
    w->h.found.escaped = w->h.found.blocked = 0;
    for (uint32_t l = 0; l < lanes; l++) {
        const struct RTCRayHit ray = rays_lane(w->h.rays, l);
        const bool meets = ray.hit.geomID != RTC_INVALID_GEOMETRY_ID,
                   arrives = meets && meeting_has_side(b, meeting_record(b, &ray), meeting_is_back(&ray)),
                   goes_on = arrives && hemisphere_weight(w->h.rays, l) > 0.0f;
        struct reference_found found;
        if (!meets)
            w->h.found.escaped_lane[w->h.found.escaped++] = (uint8_t)l;
        else if (!arrives)
            w->h.found.blocked_lane[w->h.found.blocked++] = (uint8_t)l;
        find_paths(w, step, l, goes_on ? &ray : NULL, &found);
        if (goes_on)
            count_ends(w, b, step, l, tints);
        add_paths(w, step, l, &found, tints && goes_on);
    }
    hemisphere_count_lost_in_order(&w->h, lanes);
}

static void reference_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                               size_t tile_run, void *results, uint64_t *rays)
{
    struct reference_work *w = work;
    const struct kiln_surface *s = b->surface;
    const uint32_t steps = rays_begin(w->h.rays, b, tile_run, w->h.stream, 0),
                   object = kiln_map_object(s, s->tile_runs[tile_run].map);
    if (steps == 0)
        return;
    hemisphere_clear(&w->h);
    memset(w->last, 0, sizeof w->last);
    w->h.walk.rays = w->subpaths.rays = 0;
    w->subpaths.context = *context;
    w->receives_only = (b->params.scene->objects[object].flags & KILN_OBJECT_RECEIVER_ONLY) != 0;
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = rays_make(w->h.rays, b, step);
        *rays += lanes;
        rays_trace(w->h.rays, b, context, lanes);
        collect_paths(b, context, w, step, lanes);
    }
    *rays += w->h.walk.rays + w->subpaths.rays;
    if (w->subpaths.status != KILN_OK) {
#pragma omp critical(kiln_reference_status)
        {
            w->paths->status = w->subpaths.status;
            w->paths->error = w->subpaths.error;
        }
    }
    hemisphere_store(&w->h, results, sizeof(struct kiln_reference_result));
    for (uint32_t j = 0; j < w->h.rays->frame.count; j++)
        for (int c = 0; c < 3; c++)
            ((struct kiln_reference_result *)results)[w->h.rays->frame.place[j]].last[c] = (float)w->last[j][c];
}

int embree_reference(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                     uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {reference_create, reference_destroy, reference_tile_run,
                                              sizeof(struct kiln_reference_result)};
    const int status = reference_paths_want(b, parameters, part, error);
    if (status != KILN_OK)
        return status;
    b->reference->status = KILN_OK;
    const int traced = embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
    return traced == KILN_OK && b->reference->status != KILN_OK
               ? kiln_fail(error, b->reference->status, "%s", b->reference->error.message)
               : traced;
}
